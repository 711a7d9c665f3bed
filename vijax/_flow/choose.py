"""Choice of the flow of a machine."""

import importlib

from .._system.system import ImpactSystem
from .exact_step import ExpandingFlow
from .force_choice import force_flow, warn_once_of, why_no_series
from .interface import AbstractFlow
from .modes import modal_flow
from .switching_modes import switching_modal_flow
from .taylor import TaylorFlow


def choose_flow(
    system: ImpactSystem,
    *,
    can_stick: bool,
    wanted: AbstractFlow | None = None,
    band: tuple[float, float] | None = None,
    for_many: bool = False,
) -> AbstractFlow:
    """Return `wanted`, else modes, or Taylor series; diffrax where a force has none; `band` as in `modal_flow`.

    Modes of machines whose forces switch serve sweeps, `for_many` trajectories.
    """
    if not isinstance(wanted, AbstractFlow | None):
        raise ValueError(
            f"Argument `flow` must be a motion, as `vx.DiffraxFlow(diffrax.Tsit5())` makes of a solver, but is {wanted!r}."
        )
    if system.is_switching and isinstance(wanted, ExpandingFlow) and not isinstance(wanted, TaylorFlow):
        raise ValueError(
            f"Argument `flow` is {type(wanted).__name__}, but among exact flows `TaylorFlow` alone serves machines with friction "
            "or compliant stops: leave it out."
        )
    if system.force is None and system.is_switching:
        return wanted or (switching_modal_flow(system, band=band) if for_many else None) or TaylorFlow()
    if system.force is None:
        return wanted or modal_flow(system, can_stick=can_stick, band=band) or TaylorFlow()
    if isinstance(wanted, ExpandingFlow) and not isinstance(wanted, TaylorFlow):
        raise ValueError(
            f"Argument `flow` is {type(wanted).__name__}, which is exact for linear machines alone, but the "
            "machine has a `force`: leave it out, or use `vx.TaylorFlow` or `vx.DiffraxFlow`."
        )
    if wanted is not None and not isinstance(wanted, TaylorFlow):
        return wanted
    why_not = why_no_series(system)
    if why_not is None:
        return force_flow(system, wanted or TaylorFlow())
    if wanted is not None:
        raise ValueError(f"{why_not} Pass `flow=vx.DiffraxFlow()`.")
    warn_once_of(why_not)
    return load_diffrax_flow()()


def load_diffrax_flow() -> type[AbstractFlow]:
    """Import `DiffraxFlow` on first use: diffrax takes longer to import than everything else."""
    return importlib.import_module(".diffrax_flow", __package__).DiffraxFlow
