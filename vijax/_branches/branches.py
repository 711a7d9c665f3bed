"""All branches through the orbits of a sweep."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import xarray as xr

from .._dataset_checks import check_is_dataset
from .._jax.arrays import Count, refuse_single_precision, whole_number
from .._jax.users_line import users_line
from .._jax.xla import padding_allowed
from .._orbits.sweep_orbits import periodic_orbits
from .._progress import Interrupted, interrupt_with_result, says_what_compiles, tqdm
from .._sweep.short_names import with_paths
from .branch import Branch
from .continuation import follow_branches, following
from .cycle_quantities import Quantities, checked_cycle_quantities, with_quantities
from .kinds import Kind
from .membership import KnownOrbits
from .monitors import Monitors, Stop
from .point import Budget
from .starts import Start, starting_orbits, value_of
from .switch import switch_branch

# Largest number of points of a direction of a branch.
_MOST_POINTS = 1000


@says_what_compiles
@padding_allowed
def branches(
    ds: xr.Dataset,
    bounds: tuple[float, float] | None = None,
    *,
    depth: Count = 1,
    fold: bool = False,
    max_points: Count = 100_000,
    max_branches: Count = 1000,
    quantities: Quantities = (),
    monitor: Monitors | None = None,
    stop: Stop | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    progress: bool = True,
) -> list[Branch]:
    """Follow all branches through the orbits of a sweep along the swept quantity, each branch once.

    Args:
        ds: a sweep of one quantity, or the result of `vx.periodic_orbits` for it.
        bounds: lowest and highest value of the quantity; those of the sweep if left out.
        depth: number of successive period doublings that are followed from these branches.
        fold: of branches that are mirror images of each other, by `system.symmetries()`, follow one. A branch that passes through a
            pitchfork has both halves all the same.
        max_points: number of points of all branches together at which no more are followed. A direction of a branch
            has no more than 1000.
        max_branches: largest number of branches.
        quantities: as for `vx.continuation`.
        monitor: as for `vx.continuation`.
        stop: as for `vx.continuation`: each branch ends where a condition holds.
        step: as for `vx.continuation`.
        tolerance: as for `vx.continuation`.
        progress: show a bar, which counts the points found.

    Returns:
        The branches through the sweep, then those of the doubled orbits. Points that are no periodic orbits of their
        machines, or not isolated, are left out with a warning; so are orbits for which a budget does not suffice.

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
    check_is_dataset(ds, "ds", "`vx.sweep` or `vx.periodic_orbits`")
    refuse_single_precision("branches", ds.get("x0", ds.get("x")))
    num_doublings = whole_number("depth", depth)
    most = whole_number("max_branches", max_branches, 1)
    options = following(_MOST_POINTS, monitor, stop, step, tolerance)
    budget = Budget(whole_number("max_points", max_points, 1))
    orbits = ds if "converged" in ds else periodic_orbits(ds, progress=progress)
    orbits = with_paths(orbits)
    paths = [str(dim) for dim in orbits["converged"].dims if dim != "direction"]
    if len(paths) != 1:
        raise ValueError(
            f"Branches need one swept quantity, but there are {paths}: select one value of the others."
        )
    (path,), (low, high) = paths, bounds or (float(orbits[paths[0]].min()), float(orbits[paths[0]].max()))
    waiting = [start for start in starting_orbits(orbits) if low <= value_of(start.system, path) <= high]
    wanted = {}
    for start in waiting[:1]:
        wanted = checked_cycle_quantities(quantities, start.system) | options.watched.monitors
    found: list[Branch] = []
    with (
        tqdm(unit="point", disable=not progress) as bar,
        interrupt_with_result(lambda: found),
    ):
        follow = partial(
            follow_branches,
            path=path,
            bounds=(low, high),
            options=options,
            leaves_out=True,
            budget=budget,
            tell=bar.update,
        )
        search = _Search(found, most, budget, follow, bar, fold=fold)
        last = search.follow_each_once(waiting)
        for _ in range(num_doublings):
            points = [
                point
                for branch in last
                for point in branch.bifurcations
                if point.kind == Kind.PERIOD_DOUBLING
            ]
            if search.is_over:
                break
            doubled = [start for point in points for start in starting_orbits(switch_branch(point))]
            last = search.follow_each_once(doubled)
    return [with_quantities(branch, wanted, waiting[0].flow) for branch in found] if wanted else found


@dataclass
class _Search:
    """Search for branches.

    Attributes:
        found: branches so far.
        most: largest number of them.
        budget: points of all branches.
        follow: follows the branches of orbits.
        bar: shows how far it is.
        fold: whether mirror images count as one.
    """

    found: list[Branch]
    most: int
    budget: Budget
    follow: Callable[[list[Start]], list[Branch | None]]
    bar: tqdm
    fold: bool = False

    @property
    def is_over(self) -> bool:
        """True if no more branches may be followed."""
        return self.budget.is_spent or len(self.found) >= self.most

    def follow_each_once(self, starts: list[Start]) -> list[Branch]:
        """Add the branches of all orbits that lie on none found, each branch once; return the added ones."""
        num_known, num_none = len(self.found), 0
        orbits = KnownOrbits(starts, fold=self.fold)
        left = orbits.not_on([*range(len(starts))], self.found)
        while left and not self.is_over:
            self.bar.set_postfix_str(f"{len(self.found)} branches, {len(left)} orbits left", refresh=False)
            # One orbit for each number of periods and events: orbits that differ in these seldom share a branch.
            kinds: dict[tuple, int] = {}
            for k in left:
                kinds.setdefault((starts[k].num_periods, starts[k].num_events), k)
            firsts, stopped = list(kinds.values())[: self.most - len(self.found)], None
            try:
                followed = self.follow([starts[k] for k in firsts])
            except Interrupted as interrupt:
                followed, stopped = interrupt.result, interrupt
            own = {k: branch for k, branch in zip(firsts, followed, strict=True) if branch is not None}
            num_none += len(firsts) - len(own)
            left = self._add(orbits, own, [k for k in left if k not in firsts and not stopped])
            if stopped:
                raise stopped
        self._warn(num_none, len(left))
        return self.found[num_known:]

    def _add(self, orbits: KnownOrbits, own: dict[int, Branch], others: list[int]) -> list[int]:
        """Add the branches of some orbits, each once; return those of the others that lie on none."""
        branches = list(own.values())
        try:
            on = orbits.on([*own, *others], branches)
        except KeyboardInterrupt:
            self.found += branches
            raise
        kept: list[int] = []
        for number, k in enumerate(own):
            if not on[k].intersection(kept):
                kept.append(number)
        self.found += [branches[number] for number in kept]
        return [k for k in others if not on[k].intersection(kept)]

    def _warn(self, num_none: int, num_left: int) -> None:
        if num_none:
            warnings.warn(
                f"Left out {num_none} orbits that are no periodic orbits of their machines, or not isolated.",
                stacklevel=users_line(),
            )
        if num_left:
            warnings.warn(
                f"Left out {num_left} orbits that lie on no branch found: raise `max_points` or `max_branches`.",
                stacklevel=users_line(),
            )
