"""All branches through the orbits of a sweep."""

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
import xarray as xr

from .._attractors.cycles import periodic_orbits
from .._progress import Interrupted, bringing, tqdm
from .._trajectory.simulate import simulate
from .._types import Count, refuse_single_precision, whole_number
from .._xla import padding_allowed
from .branch import Branch
from .continuation import continued
from .starts import Start, starts_of, value_of
from .switch import switch_branch

# An orbit lies on a branch if it is this close to its chord, relative to the length of that.
_NEAR = 0.1


@padding_allowed
def branches(
    ds: xr.Dataset,
    bounds: tuple[float, float] | None = None,
    *,
    depth: Count = 1,
    max_points: Count = 1000,
    progress: bool = True,
) -> list[Branch]:
    """Follow all branches through the orbits of a sweep along what was swept, each once.

    Args:
        ds: a sweep of one quantity, or what `vx.periodic_orbits` made of it.
        bounds: lowest and highest value of the quantity; those of the sweep if left out.
        depth: how many period doublings are followed from these branches.
        max_points: as for `vx.continuation`.
        progress: show a bar, of the orbits that are accounted for.

    Returns:
        The branches through the sweep, then those of the doubled orbits. Orbits that are none of their machines, or not
        isolated, are left out with a warning.

    Raises:
        ValueError: if not exactly one quantity was swept, or 64-bit numbers are off, or were when it was swept.
        Interrupted: after Ctrl-C, a `KeyboardInterrupt` whose `result` are the branches that were found until then.

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
    paths = [str(dim) for dim in orbits["converged"].dims if dim != "direction"]
    if len(paths) != 1:
        raise ValueError(
            f"Branches need one swept quantity, but there are {paths}: select one value of the others."
        )
    (path,), (low, high) = paths, bounds or (float(ds[paths[0]].min()), float(ds[paths[0]].max()))
    waiting = [start for start in starts_of(orbits) if low <= _value(start, path) <= high]
    found: list[Branch] = []
    with tqdm(total=len(waiting), unit="orbit", disable=not progress) as bar, bringing(lambda: found):
        how = {"path": path, "bounds": (low, high), "max_points": max_points}
        follow = partial(continued, **how, progress=False, leaves_out=True)
        last = _each_once(waiting, found, follow, bar)
        for _ in range(num_doublings):
            points = [point for branch in last for point in branch.bifurcations if point.kind == "pd"]
            doubled = [start for point in points for start in starts_of(switch_branch(point))]
            last = _each_once(doubled, found, follow, bar)
    return found


def _each_once(
    starts: list[Start], found: list[Branch], follow: Callable[[list[Start]], list[Branch | None]], bar: tqdm
) -> list[Branch]:
    """Add the branches of orbits that are on none of those found, each once; those that were added."""
    num_known, left, num_none = len(found), _not_on(starts, found), 0
    while left:
        # Orbits with other numbers of events may lie on one branch, but most do not.
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
            found += [branch] if branch is not None and _not_on([start], found[num_known:]) else []
        if stopped:
            raise stopped
        num_left, taken = len(left), {id(start) for start in firsts}
        left = _not_on([start for start in left if id(start) not in taken], found[num_known:])
        bar.update(num_left - len(left))
    if num_none:
        warnings.warn(
            f"Left out {num_none} orbits that are no periodic orbits of their machines, or not isolated.",
            stacklevel=4,
        )
    return found[num_known:]


def _value(start: Start, path: str) -> float:
    return value_of(start.system, path)


def _not_on(starts: list[Start], branches: list[Branch]) -> list[Start]:
    """The orbits that are on none of the branches, begun in any of their periods."""
    if not branches:
        return starts
    left = []
    for start in starts:
        own = [branch for branch in branches if branch.points.attrs["num_periods"] == start.num_periods]
        states = _states(start) if own else start.state[None]
        left += [] if any(_is_on(branch, _value(start, branch.path), states) for branch in own) else [start]
    return left


def _is_on(branch: Branch, p: float, states: np.ndarray) -> bool:
    """Whether one of the states, (periods, 2 n), is on a branch."""
    points, size = branch.points, np.abs(states[0]).max()
    values, z = branch.values, np.concatenate([points["x0"].values, points["v0"].values], axis=1)
    for k in np.flatnonzero((values[:-1] - p) * (values[1:] - p) <= 0):
        width = values[k + 1] - values[k]
        chord = z[k + 1] - z[k]
        at = z[k] + (p - values[k]) / (width or 1.0) * chord
        away = np.abs(states - at).max(axis=1).min()
        if away < _NEAR * np.abs(chord).max() + 1e-6 * size:
            return True
    return False


def _states(start: Start) -> np.ndarray:
    """The states of an orbit at the start of each of its periods, (n, 2 n)."""
    if start.num_periods == 1:
        return start.state[None]
    x, v = np.split(start.state, 2)
    period = 2 * np.pi / float(start.system.forcing.frequency)
    ts = start.phase / (2 * np.pi) * period + period * np.arange(start.num_periods)
    sol = simulate(start.system, ts[0], ts[-1], x, v, ts=ts, args=start.args, flow=start.flow, throw=False)
    return np.concatenate([sol.xs, sol.vs], axis=1)
