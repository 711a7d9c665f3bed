"""Continuation of periodic orbits along a parameter."""

from collections.abc import Callable, Sequence as Many
from typing import Any, NamedTuple, overload

import jax
import jax.numpy as jnp
import xarray as xr

from .._jax.arrays import Count, as_numpy_float, real_number, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._orbits.orbit import PeriodicOrbit
from .._progress import Interrupted, interrupt_with_result, says_what_compiles, tqdm
from .._system.parameters import machine_at
from .branch import Branch, branch_of
from .cycle_quantities import Quantities, Quantity, checked_cycle_quantities, with_quantities
from .follow import follow_branch
from .monitors import Monitors, Stop, Watched, WatchedWalk, checked_monitors
from .parameter_family import ParameterFamily
from .peak_quantities import PeakQuantity, checked_peak_quantities
from .peaks import find_peaks
from .point import BranchPoint, Budget, DirectedBranch
from .scheduler import drive
from .start_points import points_of, refuse_start
from .starts import Start, families_of, starting_orbits
from .tolerances import LONGEST_STEP, PROBE_STEP, SAME


@overload
def continuation(
    orbit: PeriodicOrbit,
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    quantities: Quantities = (),
    peaks: Many[str] = (),
    monitor: Monitors | None = None,
    stop: Stop | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    progress: bool = True,
) -> Branch: ...
@overload
def continuation(
    orbit: Many[PeriodicOrbit] | xr.Dataset,
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    quantities: Quantities = (),
    peaks: Many[str] = (),
    monitor: Monitors | None = None,
    stop: Stop | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    progress: bool = True,
) -> list[Branch]: ...
@says_what_compiles
@padding_allowed
def continuation(
    orbit: PeriodicOrbit | Many[PeriodicOrbit] | xr.Dataset,
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    quantities: Quantities = (),
    peaks: Many[str] = (),
    monitor: Monitors | None = None,
    stop: Stop | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    progress: bool = True,
) -> Branch | list[Branch]:
    """Follow a periodic orbit along a parameter in both directions, through bifurcations and changes of its events.

    Pseudo-arclength continuation passes folds. Where an impact appears or disappears, or two impacts exchange their
    order, the branch continues with another sequence of events. Bifurcations are located to rounding, or where the
    machine has a `force` to the accuracy of the `flow` of the orbit, whose motion is solved flight by flight.

    A step is at most `step` long. It is short enough that no pair of multipliers passes +1 unseen, as at a
    resonance, and that no gap, force or impact speed vanishes twice on it: a window of impacts is found if it is
    wider than a millionth of the bounds. Other pairs of changes on one step, such as two close period doublings, may be
    missed: follow the branch again within narrower bounds to find them.

    Args:
        orbit: the orbit to start from. Several, a list or the result of `vx.periodic_orbits`, are followed as a batch.
        path: the parameter, as in `vx.sweep`; a path with a star sets all that it names to one value.
        bounds: its lowest and highest value.
        max_points: largest number of points in each direction.
        quantities: names as in `vx.sweep`, whose recorded periods are here the cycle, or a dict of names and functions of
            one cycle, a `vx.Solution`, that return a number or an array, as in `{"energy": f, "x": "max_position"}`. They
            become columns of `branch.points`, NaN where the machine does not follow the orbit, or a run of one cycle
            leaves it because it is too unstable.
        peaks: names of quantities whose peaks are located, "max_position", "min_position", "peak_to_peak", "max_velocity" or
            "min_velocity", of every mass, or of one, as "peak_to_peak[1]". They become `branch.peaks`, where the quantity
            is largest or smallest along the branch, at a resonance for instance, and columns of `branch.points`.
        monitor: names and functions of one cycle, a `vx.Solution`, that return a number, as in `{"energy": f}`. Where one
            passes zero, continuously, the branch has a special point of kind "monitor:energy". Their values become
            columns as well. Two zeros on one step are missed: give a shorter `step`.
        stop: conditions that end the branch in a direction: a kind of `branch.special_points`, as in "pd" or
            "monitor:energy", several of these, or a dict of names and kinds or functions of the branch so far, a
            `vx.Branch` from the orbit to the newest point, that return True or False. `branch.ends` is then "stop:" and
            the name or the kind.
        step: longest step, in units of the parameter; 5 % of the bounds if left out. The first one is at most 0.2 %.
        tolerance: size of a Newton step, relative to the orbit, below which the orbit counts as solved, at most 1e-8; if
            left out, rounding.
        progress: show a bar.

    Returns:
        The branch, or a list of them.

    Raises:
        ValueError: if the orbit is no periodic orbit of its machine, or not isolated, as at a resonance without
            damping; if its value of the parameter lies outside the bounds; if a bound gives no valid machine; for
            quantities that are unknown, or do not follow for this machine; for a monitor that returns no number; for
            unknown kinds in `stop`; or if 64-bit numbers are off, or were when the orbit was found.
        Interrupted: after Ctrl-C, a `KeyboardInterrupt` whose `result` is the part followed so far.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_a(0.8)
        orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
        branch = vx.continuation(orbit, "forcing.frequency", (0.7, 1.0))
        branch.bifurcations
        ```

    References:
        E. L. Allgower & K. Georg, Numerical Continuation Methods (1990); M. di Bernardo et al., Piecewise-smooth
        Dynamical Systems (2008), Ch. 6.
    """
    starts = starting_orbits(orbit)
    refuse_single_precision("continuation", [(start.system, start.state) for start in starts])

    options, wanted = following(max_points, monitor, stop, step, tolerance), {}
    for start in starts:
        sought = checked_peak_quantities(peaks, start.system)
        named = checked_cycle_quantities(quantities, start.system)
        wanted = dict.fromkeys(one.name for one in sought)
        wanted = {name: name for name in wanted} | named | options.watched.monitors
        options = options._replace(peaks=tuple(sought))

    def as_asked(followed: list[Branch | None]) -> Branch | list[Branch]:
        whole = zip(followed, starts, strict=True)
        branches = [_with(branch, wanted, start) for branch, start in whole if branch is not None]
        return branches[0] if isinstance(orbit, PeriodicOrbit) else branches

    try:
        return as_asked(follow_branches(starts, path, bounds, options, progress=progress))
    except Interrupted as stopped:
        raise Interrupted(as_asked(stopped.result)) from None


class Following(NamedTuple):
    """Settings of a continuation.

    Attributes:
        max_points: largest number of points in each direction.
        watched: monitors and conditions.
        step: longest step, in units of the parameter, or None.
        tolerance: of the corrector.
        peaks: quantities whose peaks are located.
    """

    max_points: int
    watched: Watched
    step: float | None
    tolerance: float
    peaks: tuple[PeakQuantity, ...] = ()

    def longest(self, span: float) -> float:
        """Longest step, along the scaled parameter.

        Raises:
            ValueError: if it is not between the shortest one and the bounds.
        """
        if self.step is None:
            return LONGEST_STEP
        longest = self.step / span
        if not PROBE_STEP <= longest <= 1:
            raise ValueError(
                f"Argument `step` must be between {PROBE_STEP * span:g} and {span:g}, a share of {PROBE_STEP:g} and all of the "
                f"bounds, but is {self.step:g}."
            )
        return longest


def following(
    max_points: Count,
    monitor: Monitors | None,
    stop: Stop | None,
    step: float | None,
    tolerance: float | None,
) -> Following:
    """Arguments of a call, checked.

    Raises:
        ValueError: for one that is wrong.
    """
    most = whole_number("max_points", max_points, 1)
    length = None if step is None else real_number("step", step)
    small = 0.0 if tolerance is None else real_number("tolerance", tolerance)
    if not 0 <= small <= SAME:
        raise ValueError(
            f"Argument `tolerance` must be between 0, for rounding, and {SAME:g}, but is {small:g}."
        )
    return Following(most, checked_monitors(monitor, stop), length, small)


def _with(branch: Branch, wanted: dict[str, Quantity], start: Start) -> Branch:
    return with_quantities(branch, wanted, start.flow) if wanted else branch


def follow_branches(
    starts: list[Start],
    path: str,
    bounds: tuple[float, float],
    options: Following,
    *,
    progress: bool = False,
    leaves_out: bool = False,
    budget: Budget | None = None,
    tell: Callable[[int], Any] | None = None,
) -> list[Branch | None]:
    """Branches of several orbits, followed as a batch; with `leaves_out`, None for a start that gives no branch.

    `budget` is that of the points of all, of which it is reduced; `tell` is called with the number of new points.
    """
    budget = budget or Budget()
    low, high = _two_numbers(bounds)
    families = families_of(starts, path, low, high, options.tolerance)
    for family in families[:1]:  # the same values are valid for the others
        for value in (low, high):
            machine_at(jax.tree.map(jnp.asarray, family.system), path, value)
    all_points = points_of(starts, families)
    if None in all_points and not leaves_out:
        k = all_points.index(None)
        refuse_start(k, starts[k], families[k])
    kept = [k for k, point in enumerate(all_points) if point is not None]
    families, flows = [families[k] for k in kept], [starts[k].flow for k in kept]
    points = [point for point in all_points if point is not None]
    longest = options.longest(high - low)
    walks = [
        DirectedBranch(
            family.last_phase,
            (low / family.span, high / family.span),
            options.max_points,
            longest=longest,
            budget=budget,
        )
        for family in families
        for _ in "-+"
    ]

    def result_so_far() -> list[Branch | None]:
        whole = zip(families, points, walks[::2], walks[1::2], strict=True)
        branches = iter([branch_of(family, start, back, forth) for family, start, back, forth in whole])
        return [None if point is None else next(branches) for point in all_points]

    with interrupt_with_result(result_so_far):
        with tqdm(unit="point", disable=not progress) as bar:
            told = (tell,) if tell else (bar.update,) if progress else ()
            both = _both_ways(points)
            watches = [
                WatchedWalk(options.watched, walk, families[k // 2], flows[k // 2], start)
                for k, (walk, start) in enumerate(zip(walks, both, strict=True))
                if any(options.watched)
            ]
            _follow(walks, [family for family in families for _ in "-+"], both, budget, told, watches)
            for k, (walk, start) in enumerate(zip(walks, both, strict=True)):
                if options.peaks:
                    walk.monitored += find_peaks(walk, families[k // 2], start, options.peaks)
    return result_so_far()


def _follow(
    walks: list[DirectedBranch],
    families: list[ParameterFamily],
    starts: list[BranchPoint],
    budget: Budget,
    told: tuple[Callable[[int], Any], ...],
    watches: list[WatchedWalk],
) -> None:
    """Follow branches from their starts."""
    tasks = [follow_branch(walk, start) for walk, start in zip(walks, starts, strict=True)]
    num_told, points = 0, [walk.points for walk in walks]

    def tell() -> None:
        nonlocal num_told
        for watch in watches:
            watch.update()
        new = sum(map(len, points)) - num_told
        num_told += new
        budget.points -= new
        budget.is_spent = budget.points <= 0
        for one in told:
            one(new)

    drive(families, tasks, tell)
    tell()  # the last points of all


def _two_numbers(bounds: tuple[float, float]) -> tuple[float, float]:
    try:
        low, high = (float(as_numpy_float(a)) for a in bounds)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"Argument `bounds` must be a lower and a higher value, but is {bounds!r}."
        ) from error
    return low, high


def _both_ways(starts: list[BranchPoint]) -> list[BranchPoint]:
    """Each start twice, towards smaller and towards larger values of the parameter."""
    found = []
    for start in starts:
        is_forth = start.tangent.p > 0
        found += [start.turned(), start] if is_forth else [start, start.turned()]
    return found
