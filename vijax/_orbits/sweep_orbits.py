"""The periodic orbits of a sweep, polished in one batch."""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
import xarray as xr

from .._dataset_checks import check_is_dataset
from .._execution.tasks import as_executor
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._machine.numbers import numbers_of
from .._progress import says_what_compiles, tqdm
from .._sections.classify import MOTIONS, classified
from .._sections.record import dims_of, flattened_points, labelled
from .._sweep.outcomes import warn_of_endings
from .._sweep.provenance import machines_of
from .._system.system import ImpactSystem
from .many import Orbits, lanes_first, search_many
from .search import StroboscopicMap

_REPEATS = [MOTIONS.index(name) for name in ("non_impacting", "periodic", "chattering")]


@says_what_compiles
@padding_allowed
def periodic_orbits(
    ds: xr.Dataset, *, max_events: Count = 256, executor: object = None, progress: bool = True
) -> xr.Dataset:
    """Polish every periodic motion of a sweep into its orbit, all in one batch.

    Args:
        ds: result of `vx.sweep`. The guesses are the end states of the points that `vx.classify` calls periodic,
            chattering or non-impacting.
        max_events: maximum number of events of a cycle.
        executor: as for `vx.sweep`: searches go to its workers instead of the cores of this process, with the same
            results.
        progress: show a progress bar.

    Returns:
        With the dimensions of the sweep, `converged`: whether an orbit was found and the machine follows it;
        `x0`, `v0` (..., mass): its state at phase 0; `multipliers` (..., multiplier), complex, the largest magnitude
        first; `is_stable`; `num_periods`; `num_impacts` (..., stop) in one cycle; `residual`, the closing error of the
        cycle, relative to the size of the motion. Where no orbit was found, NaN, False and 0.

    Raises:
        ValueError: if the dataset holds no machine, or a `force` that may not or cannot be imported, see
            `vx.system_of`, if `executor` is not an executor, or if 64-bit numbers are off, or were off in the sweep.
        RuntimeError: if the executor takes no more tasks, or repeatedly loses one.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), {"forcing.frequency": np.arange(0.7, 0.9, 0.01)})
        orbits = vx.periodic_orbits(ds)
        abs(orbits.multipliers).max("multiplier")
        ```
    """
    check_is_dataset(ds, "ds", "`vx.sweep`")
    refuse_single_precision("periodic_orbits", ds.get("x"))
    room = whole_number("max_events", max_events, 1)
    workers = None if executor is None else as_executor(executor)
    warn_of_endings(ds, "max_impacts_reached")
    kinds = classified(ds)
    num_periods = flattened_points(ds, kinds["num_periods"])
    which = np.flatnonzero(np.isin(flattened_points(ds, kinds["motion"]), _REPEATS) & (num_periods > 0))
    states = np.concatenate([flattened_points(ds, ds[name], "mass") for name in ("x", "v")], axis=1)
    # Sorted, neighbouring lanes take about equally long: a period takes at least one step, and each impact one more.
    steps = num_periods * (flattened_points(ds, ds["num_impacts"], "stop").sum(axis=1) + ds.sizes["period"])
    which = which[np.argsort(-steps[which], kind="stable")]
    found = None
    if which.size:
        machines = machines_of(ds, [*dims_of(ds)], which)
        with tqdm(total=len(which), unit="orbit", disable=not progress) as bar:
            found = search_orbits(
                machines, num_periods[which], states[which], room, bar.update, executor=workers
            )
    return _dataset(ds, found, which, num_periods)


def search_orbits(
    machines: ImpactSystem,
    num_periods: np.ndarray,
    states: np.ndarray,
    room: int,
    tell: Callable[[int], Any],
    wanted: AbstractFlow | None = None,
    executor: Executor | None = None,
) -> Orbits:
    """Search for orbits of machines, lanes last, from one state each."""
    numbers, flow = numbers_of(machines), choose_flow(machines, can_stick=True, wanted=wanted)
    (numbers, flow), axes = lanes_first((numbers, flow))
    strobe = StroboscopicMap(
        numbers, flow, num_periods.astype(states.dtype), np.zeros((), states.dtype), room
    )
    return search_many(strobe, [*axes, 0, None], states, tell, executor)


def _dataset(ds: xr.Dataset, found: Orbits | None, which: np.ndarray, num_periods: np.ndarray) -> xr.Dataset:
    size, n = len(num_periods), ds.sizes["mass"]
    start = np.full((size, 2 * n), np.nan, ds["x"].dtype)
    multipliers = np.full((size, 2 * n), np.nan, np.result_type(start, np.complex64))
    residual, is_orbit = np.full(size, np.nan, start.dtype), np.zeros(size, bool)
    impacts = np.zeros((size, ds.sizes["stop"]), int)
    if found is not None:
        is_orbit[which] = found.is_orbit
        which = which[found.is_orbit]
        whole = start, multipliers, residual, impacts
        for a, own in zip(whole, found[:4], strict=True):
            a[which] = own[found.is_orbit]
    columns = {
        "converged": ((), is_orbit),
        "num_periods": ((), np.where(is_orbit, num_periods, 0)),
        "x0": (("mass",), start[:, :n]),
        "v0": (("mass",), start[:, n:]),
        "multipliers": (("multiplier",), multipliers),
        "is_stable": ((), is_orbit & (np.abs(multipliers[:, 0]) < 1)),
        "num_impacts": (("stop",), impacts),
        "residual": ((), residual),
    }
    return labelled(ds, columns).assign_attrs(ds.attrs)
