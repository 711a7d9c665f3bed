"""Continuation of periodic orbits along a parameter."""

from collections.abc import Callable, Sequence as Many
from typing import Any, overload

import jax
import jax.numpy as jnp
import xarray as xr

from .._jax.arrays import Count, as_numpy_float, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._orbits.orbit import PeriodicOrbit
from .._progress import Interrupted, interrupt_with_result, tqdm
from .._system.parameters import set_parameter
from .branch import Branch, branch_of
from .cycle_quantities import Quantities, Quantity, checked_cycle_quantities, with_quantities
from .follow import follow_branch
from .parameter_family import Family
from .point import BranchPoint, Budget, DirectedBranch
from .scheduler import drive
from .starts import Start, families_of, points_of, refuse_start, starting_orbits


@overload
def continuation(
    orbit: PeriodicOrbit,
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    quantities: Quantities = (),
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
    progress: bool = True,
) -> list[Branch]: ...
@padding_allowed
def continuation(
    orbit: PeriodicOrbit | Many[PeriodicOrbit] | xr.Dataset,
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    quantities: Quantities = (),
    progress: bool = True,
) -> Branch | list[Branch]:
    """Follow a periodic orbit along a parameter in both directions, through bifurcations and changes of its events.

    Pseudo-arclength continuation passes folds. Where an impact appears or disappears, or two impacts exchange their
    order, the branch continues with another sequence of events. Bifurcations are located to rounding, or where the
    machine has a `force` to the accuracy of the `flow` of the orbit, whose motion is solved flight by flight.

    A step is at most 5 % of the bounds long. It is short enough that no pair of multipliers passes +1 unseen, as at a
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
        progress: show a bar.

    Returns:
        The branch, or a list of them.

    Raises:
        ValueError: if the orbit is no periodic orbit of its machine, or not isolated, as at a resonance without
            damping; if its value of the parameter lies outside the bounds; if a bound gives no valid machine; for
            quantities that are unknown, or do not follow for this machine; or if 64-bit numbers are off, or were when the
            orbit was found.
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

    wanted = {}
    if quantities and any(start.is_autonomous for start in starts):
        raise ValueError(
            "Argument `quantities` is for driven machines: leave it out, and use `branch.orbit(k).solution()`."
        )
    for start in starts:
        wanted = checked_cycle_quantities(quantities, start.system)

    def as_asked(followed: list[Branch | None]) -> Branch | list[Branch]:
        whole = zip(followed, starts, strict=True)
        branches = [_with(branch, wanted, start) for branch, start in whole if branch is not None]
        return branches[0] if isinstance(orbit, PeriodicOrbit) else branches

    try:
        return as_asked(follow_branches(starts, path, bounds, max_points, progress=progress))
    except Interrupted as stopped:
        raise Interrupted(as_asked(stopped.result)) from None


def _with(branch: Branch, wanted: dict[str, Quantity], start: Start) -> Branch:
    return with_quantities(branch, wanted, start.flow) if wanted else branch


def follow_branches(
    starts: list[Start],
    path: str,
    bounds: tuple[float, float],
    max_points: Count,
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
    most = whole_number("max_points", max_points, 1)
    families = families_of(starts, path, low, high)
    for family in families[:1]:  # the same values are valid for the others
        for value in (low, high):
            set_parameter(jax.tree.map(jnp.asarray, family.system), path, value)
    all_points = points_of(starts, families)
    if None in all_points and not leaves_out:
        k = all_points.index(None)
        refuse_start(k, starts[k], families[k])
    families = [family for family, point in zip(families, all_points, strict=True) if point is not None]
    points = [point for point in all_points if point is not None]
    walks = [
        DirectedBranch(family.last_phase, (low / family.span, high / family.span), most, budget=budget)
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
            _follow(walks, [family for family in families for _ in "-+"], _both_ways(points), budget, told)
    return result_so_far()


def _follow(
    walks: list[DirectedBranch],
    families: list[Family],
    starts: list[BranchPoint],
    budget: Budget,
    told: tuple[Callable[[int], Any], ...],
) -> None:
    """Follow branches from their starts."""
    tasks = [follow_branch(walk, start) for walk, start in zip(walks, starts, strict=True)]
    num_told = 0

    def tell() -> None:
        nonlocal num_told
        new = sum(len(walk.points) for walk in walks) - num_told
        num_told += new
        budget.points -= new
        budget.is_spent = budget.points <= 0
        for one in told:
            one(new)

    drive(families, tasks, tell)


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
