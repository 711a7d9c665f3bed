"""Test of a force for Taylor series, and the flow that integrates a machine by these."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._series.refused import Refused
from .._system.force import BoundForce, force_of
from .._system.system import ImpactSystem
from .force_flow import ForceFlow
from .force_plan import plan_of
from .taylor import TaylorFlow

# Operations of all coefficients, written out, beyond which a program takes too long to compile.
_MOST_OPERATIONS = 40_000
# Share of the tolerance where powers begin and end: close to these the steps shrink, and all err to the same side.
_OF_POWERS, _LEAST = 1e-2, 1e-15

_warned: set[str] = set()


def why_no_series(system: ImpactSystem) -> str | None:
    """Sentence that tells why the force of a machine is not integrated by Taylor series; None if it is."""
    try:
        plan = _plan(system)
    except Refused as refused:
        return f"The force uses `{refused.operation}`, which has no Taylor series here."
    if plan.has_infinite_slopes:
        return "The force has a power below 1, or a root, whose slope is infinite where it begins."
    if plan.num_operations(TaylorFlow().order) > _MOST_OPERATIONS:
        return "The force has too many operations for Taylor series written out."
    return None


def force_flow(system: ImpactSystem, wanted: TaylorFlow) -> ForceFlow:
    """Flow of a machine with a force of which `why_no_series` is None."""
    plan, tolerance = _plan(system), wanted.tolerance
    if plan.has_closing_powers:
        tolerance = min(tolerance, max(tolerance * _OF_POWERS, _LEAST))
    return ForceFlow(wanted.order, tolerance, plan.num_switches)


def _plan(system: ImpactSystem) -> Any:
    lanes = system.stiffness.ndim > 2
    assert system.force is not None
    force = force_of(system)
    force = force if isinstance(force, BoundForce) else BoundForce(force, None)
    as_array = lambda a: jnp.asarray(a) if isinstance(a, np.ndarray | np.generic) else a  # noqa: E731
    return plan_of(jax.tree.map(as_array, force), system.num_masses, lanes=lanes, jacobian=True)


def warn_once_of(why_not: str) -> None:
    """Warn that a machine with a force moves by diffrax, once for each reason."""
    if why_not not in _warned:
        _warned.add(why_not)
        warnings.warn(
            f"{why_not} The machine moves by `vx.DiffraxFlow()`; pass it as `flow` to say so.", stacklevel=4
        )
