"""All branches through the orbits of a sweep."""

import warnings
from collections.abc import Callable
from functools import partial

import xarray as xr

from .._jax.arrays import Count, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._orbits.sweep_orbits import periodic_orbits
from .._progress import Interrupted, interrupt_with_result, tqdm
from .._sweep.short_names import with_paths
from .branch import Branch
from .continuation import follow_branches
from .cycle_quantities import Quantities, checked_cycle_quantities, with_quantities
from .kinds import Kind
from .membership import not_on
from .starts import Start, starting_orbits, value_of
from .switch import switch_branch


@padding_allowed
def branches(
    ds: xr.Dataset,
    bounds: tuple[float, float] | None = None,
    *,
    depth: Count = 1,
    max_points: Count = 1000,
    quantities: Quantities = (),
    progress: bool = True,
) -> list[Branch]:
    """Follow all branches through the orbits of a sweep along the swept quantity, each branch once.

    Args:
        ds: a sweep of one quantity, or the result of `vx.periodic_orbits` for it.
        bounds: lowest and highest value of the quantity; those of the sweep if left out.
        depth: number of successive period doublings that are followed from these branches.
        max_points: as for `vx.continuation`.
        quantities: as for `vx.continuation`.
        progress: show a bar, which counts the orbits that lie on a branch found.

    Returns:
        The branches through the sweep, then those of the doubled orbits. Points that are no periodic orbits of their
        machines, or not isolated, are left out with a warning.

    Raises:
        ValueError: if not exactly one quantity was swept, or if 64-bit numbers are off, or were during the sweep.
        Interrupted: after Ctrl-C, a `KeyboardInterrupt` whose `result` are the branches found so far.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        swept = {"forcing.frequency": np.linspace(0.7, 1.0, 40)}
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), swept, transient=200)
        found = vx.branches(ds)
        ```
    """
    refuse_single_precision("branches", ds.get("x0", ds.get("x")))
    num_doublings = whole_number("depth", depth)
    orbits = ds if "converged" in ds else periodic_orbits(ds, progress=progress)
    orbits = with_paths(orbits)
    paths = [str(dim) for dim in orbits["converged"].dims if dim != "direction"]
    if len(paths) != 1:
        raise ValueError(
            f"Branches need one swept quantity, but there are {paths}: select one value of the others."
        )
    (path,), (low, high) = paths, bounds or (float(orbits[paths[0]].min()), float(orbits[paths[0]].max()))
    waiting = [start for start in starting_orbits(orbits) if low <= _value(start, path) <= high]
    wanted = {}
    for start in waiting[:1]:
        wanted = checked_cycle_quantities(quantities, start.system)
    found: list[Branch] = []
    with (
        tqdm(total=len(waiting), unit="orbit", disable=not progress) as bar,
        interrupt_with_result(lambda: found),
    ):
        how = {"path": path, "bounds": (low, high), "max_points": max_points}
        follow = partial(follow_branches, **how, progress=False, leaves_out=True)
        last = _follow_each_branch_once(waiting, found, follow, bar)
        for _ in range(num_doublings):
            points = [
                point
                for branch in last
                for point in branch.bifurcations
                if point.kind == Kind.PERIOD_DOUBLING
            ]
            doubled = [start for point in points for start in starting_orbits(switch_branch(point))]
            last = _follow_each_branch_once(doubled, found, follow, bar)
    return [with_quantities(branch, wanted, waiting[0].flow) for branch in found] if wanted else found


def _follow_each_branch_once(
    starts: list[Start], found: list[Branch], follow: Callable[[list[Start]], list[Branch | None]], bar: tqdm
) -> list[Branch]:
    """Add the branches of all orbits that lie on none found, each branch once; return the added ones."""
    num_known, left, num_none = len(found), not_on(starts, found), 0
    while left:
        # One orbit for each number of periods and events: orbits that differ in these seldom share a branch.
        kinds: dict[tuple, Start] = {}
        for start in left:
            kinds.setdefault((start.num_periods, start.num_events), start)
        firsts, stopped = list(kinds.values()), None
        try:
            followed = follow(firsts)
        except Interrupted as interrupt:
            followed, stopped = interrupt.result, interrupt
        for start, branch in zip(firsts, followed, strict=True):
            num_none += branch is None
            found += [branch] if branch is not None and not_on([start], found[num_known:]) else []
        if stopped:
            raise stopped
        num_left, taken = len(left), {id(start) for start in firsts}
        left = not_on([start for start in left if id(start) not in taken], found[num_known:])
        bar.update(num_left - len(left))
    if num_none:
        warnings.warn(
            f"Left out {num_none} orbits that are no periodic orbits of their machines, or not isolated.",
            stacklevel=4,
        )
    return found[num_known:]


def _value(start: Start, path: str) -> float:
    return value_of(start.system, path)
