"""From an orbit to its branch."""

import warnings
from collections.abc import Sequence as Many
from typing import overload

import jax
import numpy as np

from .._flow.choose import choose_flow
from .._flow.taylor import TaylorFlow
from .._machine.numbers import numbers_of
from .._orbits.orbit import PeriodicOrbit
from .._orbits.sequence import nothing_happens
from .._progress import tqdm
from .._system.parameters import get_parameter
from .._system.system import with_args
from .._types import Count, as_known, is_traced, whole_number
from .branch import Branch, branch_of
from .family import Family
from .follow import Point, Walk, begin, follow
from .programs import drive


@overload
def continuation(
    orbit: PeriodicOrbit,
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    progress: bool = True,
) -> Branch: ...
@overload
def continuation(
    orbit: Many[PeriodicOrbit],
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    progress: bool = True,
) -> list[Branch]: ...
def continuation(
    orbit: PeriodicOrbit | Many[PeriodicOrbit],
    path: str,
    bounds: tuple[float, float],
    *,
    max_points: Count = 1000,
    progress: bool = True,
) -> Branch | list[Branch]:
    """Follow a periodic orbit along a parameter, both ways, through all that changes it.

    By pseudo-arclength, so that folds are passed; where an impact comes or goes, or two impacts change their order, the
    sequence of events changes and the branch goes on. Bifurcations on the way are located.

    Args:
        orbit: from which to begin; several are followed side by side.
        path: the parameter, as in `vx.sweep`.
        bounds: its lowest and highest value.
        max_points: the most points each way.
        progress: show a bar.

    Returns:
        The branch, or a list of them.

    Raises:
        ValueError: if the orbit is none, or its value of the parameter does not lie within the bounds.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
        branch = vx.continuation(orbit, "forcing.frequency", (0.7, 1.0))
        branch.bifurcations
        ```

    References:
        E. L. Allgower & K. Georg, Numerical Continuation Methods (1990); M. di Bernardo et al., Piecewise-smooth
        Dynamical Systems (2008), Ch. 6.
    """
    orbits = [orbit] if isinstance(orbit, PeriodicOrbit) else list(orbit)
    low, high = (float(as_known(a)) for a in bounds)
    most = whole_number("max_points", max_points, 1)
    families = [_family(one, path, low, high) for one in orbits]
    starts = _starts(orbits, families)
    walks = [
        Walk(family.num_periods, (low / family.span, high / family.span), most)
        for family in families
        for _ in "-+"
    ]
    tasks = [follow(walk, start) for walk, start in zip(walks, _both_ways(starts), strict=True)]
    with tqdm(unit="point", disable=not progress) as bar:

        def tell() -> None:
            bar.update(sum(len(walk.points) for walk in walks) - bar.n)

        try:
            drive([family for family in families for _ in "-+"], tasks, tell)
        except KeyboardInterrupt:  # what is done is kept
            warnings.warn("Interrupted: the branches are not complete.", stacklevel=2)
    pairs = zip(families, orbits, starts, walks[::2], walks[1::2], strict=True)
    branches = [
        branch_of(family, one.system, start, back, forth) for family, one, start, back, forth in pairs
    ]
    return branches[0] if isinstance(orbit, PeriodicOrbit) else branches


def _family(orbit: PeriodicOrbit, path: str, low: float, high: float) -> Family:
    """The machines of an orbit along a parameter."""
    if is_traced(orbit):
        raise ValueError("`continuation` needs known numbers: call it outside of `jax.jit` and `jax.vmap`.")
    system = jax.tree.map(np.asarray, with_args(orbit.system, orbit.args))
    if system.force is not None:
        raise ValueError(
            "`continuation` follows the orbits of machines without a `force`: theirs are known in closed form."
        )
    value = np.asarray(get_parameter(system, path))
    if value.ndim:
        raise ValueError(
            f"The path `{path}` names {value.size} numbers: name one of them, as in `{path}[0]`."
        )
    if not low < high:
        raise ValueError(f"Argument `bounds` must be a lower and a higher value, but is ({low}, {high}).")
    if not low <= value <= high:
        raise ValueError(
            f"The orbit has {value} for `{path}`, which does not lie within the bounds {low} and {high}."
        )
    if not bool(orbit.is_admissible):
        raise ValueError(
            "The branch begins with an orbit that the machine follows, but this one is not admissible."
        )
    # Modes are made of known numbers alone.
    changes_modes = path.startswith(("mass", "damping", "stiffness"))
    numbers = numbers_of(system)
    x, v = np.asarray(orbit.x0), np.asarray(orbit.v0)
    sizes = [np.abs(x).max(), np.abs(v).max() / numbers.frequency, np.abs(numbers.limit).max(initial=0)]
    length = max(float(max(sizes)), np.finfo(x.dtype).tiny)
    return Family(
        system=system,
        flow=jax.tree.map(np.asarray, TaylorFlow() if changes_modes else choose_flow(system, can_stick=True)),
        num_periods=np.asarray(float(orbit.num_periods), x.dtype),
        phase=np.asarray(orbit.phase) / (2 * np.pi),
        scale=np.repeat(length * np.array([1.0, float(numbers.frequency)]), len(x)).astype(x.dtype),
        span=np.asarray(high - low, x.dtype),
        path=path,
    )


def _starts(orbits: list[PeriodicOrbit], families: list[Family]) -> list[Point]:
    """The points at which the branches begin."""
    tasks = []
    for orbit, family in zip(orbits, families, strict=True):
        num_events = int(np.count_nonzero(np.asarray(orbit.events.kind) >= 0))
        room = nothing_happens(num_events, orbit.system.num_stops)
        p = float(np.asarray(get_parameter(family.system, family.path)) / family.span)
        start = np.concatenate([np.asarray(orbit.x0), np.asarray(orbit.v0)])
        tasks.append(begin(jax.tree.map(np.asarray, room), start, p))
    starts = drive(families, tasks, lambda: None)
    for k, start in enumerate(starts):
        if start is None:
            raise ValueError(
                f"Orbit {k} is no periodic orbit of its machine: find one by `vx.periodic_orbit`."
            )
    return starts


def _both_ways(starts: list[Point]) -> list[Point]:
    """Every start twice, towards smaller and towards larger values of the parameter."""
    found = []
    for start in starts:
        is_forth = start.tangent.p > 0
        found += [start.turned(), start] if is_forth else [start, start.turned()]
    return found
