"""Charts of the motions over a plane of two parameters, refined where the motion changes.

Regions of one motion are wide and their boundaries thin. So a coarse grid is run first. Its cells whose corners differ
are halved down to the spacing of the requested grid; the others are filled from their corners, see `refinement.py`.
A region or tongue thinner than the coarse grid may be missed where it contains none of its points.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from .._attractors.attractor import orbits_near
from .._attractors.attractors import machines_of_one, requested_starts
from .._attractors.coexisting import coexisting, lasting
from .._attractors.ensemble import Machines
from .._dataset_attributes import variable_attributes
from .._execution.points import LaneInput, with_values
from .._execution.runner import Counts
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_float, as_numpy_float, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles, tqdm
from .._sections.classify import MOTIONS, classified, warn_of_unsettled_motions
from .._sweep.grid import base_of, values_of
from .._sweep.outcomes import warn_of_endings
from .._sweep.random_numbers import Rng, generator_of
from .._sweep.short_names import with_labels, with_names, without_names
from .._sweep.zipped import START, sweep_zipped
from .._system.parameters import set_parameter
from .._system.system import AnySystem
from .refinement import refined

# Points that are run and classified at a time: their logs are in memory together.
_TOGETHER = 4096
_KIND = ("motion", "num_periods", "num_impacts")


@says_what_compiles
@padding_allowed
def chart(
    system: AnySystem,
    values: Mapping[str, Numbers | tuple[str, Numbers]],
    *,
    stride: Count = 8,
    transient: Count = 100,
    record: Count = 20,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    args: object = None,
    flow: AbstractFlow | None = None,
    lyapunov: bool = False,
    multipliers: bool = False,
    starts: Count | tuple[Numbers, Numbers] | Numbers | None = None,
    bounds: Numbers | None = None,
    rng: Rng | None = None,
    seed: Count | None = None,
    tolerance: float | None = None,
    max_impacts: Count = 2048,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Map the motions over a plane of two parameters, refined where the motion changes.

    The result is that of `vx.classify(vx.sweep(system, values))` on the whole grid, from a fraction of the points.
    First every `stride`-th point is run in both directions. Then cells whose corners differ in motion, periods or
    impacts are halved until no smaller one is on the grid. The rest is filled from the corners. A region thinner than
    `stride` steps of the grid may be missed; `stride=1` runs every point. With `starts` the number of attractors is
    found too, and cells whose corners differ in it are halved as well.

    Args:
        system: the machine.
        values: two paths and their values, as for `vx.sweep`, in increasing or decreasing order.
        stride: steps of the grid between the first points.
        transient: as for `vx.sweep`.
        record: likewise.
        x0: likewise.
        v0: likewise.
        args: likewise.
        flow: likewise.
        lyapunov: likewise.
        multipliers: polish the motions that repeat, and return the Floquet multipliers of their orbits.
        starts: starts from which attractors are searched for at every point that is run, as for `vx.attractors`;
            random ones are drawn for the machine in the middle of the plane. If left out, none are searched for.
        bounds: bounds of random starts, as for `vx.attractors`.
        rng: likewise.
        seed: likewise.
        tolerance: as for `vx.classify`.
        max_impacts: as for `vx.sweep`.
        executor: likewise.
        progress: show a progress bar of the points of each round of halving.
        settings: as for `vx.sweep`.

    Returns:
        Over both paths, `motion`, `num_periods` and `num_impacts` (..., stop) as from `vx.classify`, for
        `vx.plot.regions`; `is_computed`, whether the point was run. With `lyapunov` the `lyapunov_exponents`
        (..., exponent) and `lyapunov_error`; with `multipliers` these, (..., multiplier), complex, the largest
        magnitude first, NaN where the motion does not repeat or no orbit is found; with `starts` the `num_attractors`
        to which they lead, and of how many starts this is unknown, `num_not_settled` and `num_failed`. Points that
        were not run have the motion and the counts of the nearest corner of their cell; exponents, and magnitudes of
        multipliers, are linear between its corners.

    Raises:
        ValueError: unless there are two paths of two values or more, for `starts` with a path of the start, for
            `multipliers` or `starts` if 64-bit numbers are off, or as `vx.sweep` and `vx.attractors` do.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import numpy as np, vijax as vx
        plane = {"forcing.frequency": np.linspace(0.4, 2, 129), "forcing.amplitude[0]": np.linspace(0.2, 1, 65)}
        ax = vx.plot.regions(vx.chart(vx.models.wagg_bishop_a(1.0), plane))
        ```
    """
    stride = whole_number("stride", stride, 1)
    room = whole_number("max_impacts", max_impacts)
    if multipliers or starts is not None:
        refuse_single_precision("chart` with `multipliers` or `starts", system)
    one = machines_of_one("chart", system, args, transient, record, tolerance, flow, None, settings, executor)
    base = base_of(one.system, x0, v0)
    by_path, names = without_names(values, base, free=("x", "v"))
    axes = values_of(by_path)
    if len(axes) != 2 or any(axis.ndim != 1 or len(axis) < 2 for axis in axes.values()):
        raise ValueError(
            "A chart needs two paths with two numbers or more each, but has "
            + ", ".join(f"`{path}` of shape {axis.shape}" for path, axis in axes.items())
            + ": use `vx.sweep` for others."
        )
    counts = Counts(one.transient, one.record, room, None, can_stick=True, lyapunov=bool(lyapunov))
    plan = _PointSettings(base, counts, one, tolerance, bool(multipliers), None)
    rng = generator_of(rng, seed)
    if starts is not None:
        plan = plan._replace(starts=_starts(one, axes, starts, bounds, rng))
    together = _TOGETHER if plan.starts is None else max(_TOGETHER // len(plan.starts), 1)
    shape, outcomes = tuple(len(axis) for axis in axes.values()), []

    def run(where: np.ndarray) -> Iterator[tuple[np.ndarray, xr.Dataset]]:
        with tqdm(total=len(where), unit="point", disable=not progress) as bar:
            for first in range(0, len(where), together):
                part = where[first : first + together]
                index = np.unravel_index(part, shape)
                swept = {path: axis[i] for (path, axis), i in zip(axes.items(), index, strict=True)}
                found, outcome = _found(plan, swept)
                outcomes.append(outcome)
                bar.update(len(part))
                yield part, found

    ds = refined(axes, stride, run, _KIND if plan.starts is None else (*_KIND, "num_attractors"))
    whole = xr.concat(outcomes, START).assign_attrs(max_impacts=room)
    warn_of_endings(whole, "max_impacts_reached", "max_steps_reached", "non_finite", "friction_paradox")
    warn_of_unsettled_motions(whole, tolerance, one.record)
    return with_labels(with_names(ds, names), base.system)


class _PointSettings(NamedTuple):
    """Settings of every point.

    Attributes:
        base: the machine and the start where nothing is swept.
        counts: counts of its sweep.
        one: the machine as it is run to find attractors.
        tolerance: as for `classify`.
        multipliers: true if orbits are polished.
        starts: starts from which attractors are counted, (starts, 2 n), or None.
    """

    base: LaneInput
    counts: Counts
    one: Machines
    tolerance: float | None
    multipliers: bool
    starts: np.ndarray | None


def _starts(
    one: Machines,
    axes: dict[str, np.ndarray],
    starts: Count | tuple[Numbers, Numbers] | Numbers,
    bounds: Numbers | None,
    rng: np.random.Generator,
) -> np.ndarray:
    """The starts that all machines share."""
    if any(_is_start(path) for path in axes):
        raise ValueError(
            f"The attractors of a machine do not depend on its start: with `starts` both paths must be of the machine, but are {[*axes]}."
        )
    middle = one.system
    for path, axis in axes.items():
        middle = set_parameter(middle, path, as_float(axis[len(axis) // 2]))
    rate = as_numpy_float(middle.forcing.frequency).reshape(1)
    return requested_starts(replace(one, system=middle, rate=rate), starts, bounds, rng).states


def _is_start(path: str) -> bool:
    return path.split("[")[0] in ("x0", "v0")


def _found(plan: _PointSettings, swept: dict[str, np.ndarray]) -> tuple[xr.Dataset, xr.Dataset]:
    """Results at some points, and what became of their motions."""
    lanes, size = with_values(plan.base, swept), len(next(iter(swept.values())))
    start = np.concatenate([np.broadcast_to(a, (len(a), size)) for a in (lanes.x0, lanes.v0)]).T
    of_machine = {path: a for path, a in swept.items() if not _is_start(path)}
    machines = plan.one.of_plane(of_machine, size)
    counts, where = plan.counts, (machines.settings, machines.executor)
    ds = sweep_zipped(machines.system, of_machine, start, counts, machines.flow, *where, lambda _: None)
    motions = classified(ds, plan.tolerance)
    outcome = motions[["motion", "num_periods", "recurrence_error", "contraction"]].assign(
        result=ds["result"]
    )
    found = motions[list(_KIND)]
    if counts.lyapunov:
        found = found.assign({name: ds[name] for name in ("lyapunov_exponents", "lyapunov_error")})
    columns = {}
    if plan.multipliers:
        columns["multipliers"] = ((START, "multiplier"), _multipliers(machines, ds, found))
    if plan.starts is not None:
        columns |= {name: (START, a) for name, a in _coexisting(machines, plan.starts).items()}
    found = found.assign({name: (dims, a, variable_attributes(name)) for name, (dims, a) in columns.items()})
    return found.transpose(START, ...), outcome


def _multipliers(machines: Machines, ds: xr.Dataset, found: xr.Dataset) -> np.ndarray:
    """Floquet multipliers of the motions that repeat."""
    states = np.concatenate([ds["x"].values, ds["v"].values], axis=1)
    multipliers = np.full(states.shape, np.nan, np.result_type(states.dtype, np.complex64))
    which = np.flatnonzero(found["num_periods"].values > 0)
    if which.size:
        states = states[which] * machines.scale(which)
        is_quiet = found["motion"].values[which] == MOTIONS.index("non_impacting")
        orbits, is_near = orbits_near(machines, states, which, found["num_periods"].values[which], is_quiet)
        multipliers[which[is_near]] = orbits.multipliers[is_near]
    return multipliers


def _coexisting(machines: Machines, starts: np.ndarray) -> dict[str, np.ndarray]:
    """Number of attractors of each machine, and numbers of starts whose attractor is unknown."""
    size = len(machines.rate)
    machine = np.repeat(np.arange(size), len(starts))
    machines = machines.for_sweep_of(len(machine))
    states = np.tile(starts, (size, 1)) * machines.scale(machine)
    ends = machines.ends(machines.run(states, machine, machines.transient, machines.record), machine)
    found = coexisting(machines, ends)
    motions, number = lasting(found.motions)
    is_unknown = number[found.label] < 0
    which = {
        "num_attractors": np.array([motion.machine for motion in motions], int),
        "num_not_settled": machine[is_unknown & ~ends.is_failed],
        "num_failed": machine[ends.is_failed],
    }
    return {name: np.bincount(a, minlength=size) for name, a in which.items()}
