"""Points at which the equations of a branch are singular, found by their defining systems.

Two branches cross at a branch point. A doubled branch ends where it meets that of half the period, traversed twice, at
the period doubling of the latter. Newton's method along the branch converges at neither; defining systems are regular.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._orbits.sequence import Sequence
from .corrector import evaluate_at
from .defining_systems import AtBranchPoint, AtMultiplier, DefiningSystem, solve
from .kernels import CorrectedCycle, as_corrected_cycle
from .kinds import EndKind, Kind
from .padding import trimmed
from .parameter_family import ExtendedCycle, ParameterFamily
from .point import BranchPoint, End, between, on_plane
from .requests import KernelCall, Requests, ask, location_on
from .sequence_edits import in_a_row
from .test_functions import TestFunction
from .tolerances import AT_BIFURCATION, DOUBLING_FARTHER, DOUBLING_LIKELY, LOCATED, NEAR, ROUNDED

# Number of cycles by which the test function of a branch point is interpolated.
_NODES = 9


def crossing(
    family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle
) -> tuple[ExtendedCycle, Bool[Array, ""]]:
    """The branch point near a guess, and True if there is one."""
    size = len(guess.z)
    condition = AtBranchPoint(jnp.zeros(1), jnp.zeros(size), jnp.zeros((2, size + 1)))
    defining = DefiningSystem(family, sequence, condition)
    solved = solve(defining, defining.unknowns(guess))
    place, own = defining.place(solved.y)
    return place, solved.is_found & (jnp.max(jnp.abs(own)) < ROUNDED)


class Doubling(NamedTuple):
    """The period doubling near a cycle.

    Attributes:
        place: the cycle that doubles its period.
        is_found: True if there is one.
        is_likely: True if the cycle nearby has a multiplier near -1.
    """

    place: ExtendedCycle
    is_found: Bool[Array, ""]
    is_likely: Bool[Array, ""]


def doubling_of_half(family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle) -> DefiningSystem:
    """Defining system of the period doubling of a cycle of half as many periods."""
    half = replace(family, num_periods=family.num_periods / 2)
    borders = jnp.zeros((2, len(guess.z)), jnp.result_type(guess.z, jnp.complex64))
    return DefiningSystem(half, sequence, AtMultiplier(jnp.full(1, jnp.pi, guess.z.dtype), borders))


def doubling(family: ParameterFamily, sequence: Sequence, guess: ExtendedCycle) -> Doubling:
    """The period doubling of a cycle of half as many periods near a guess."""
    defining = doubling_of_half(family, sequence, guess)
    solved = solve(defining, defining.unknowns(guess))
    multipliers = evaluate_at(defining.family, sequence, guess, guess).multipliers
    is_likely = jnp.min(jnp.abs(multipliers + 1), initial=jnp.inf) < DOUBLING_LIKELY
    return Doubling(defining.place(solved.y)[0], solved.is_found, is_likely)


def branch_point(point: BranchPoint, new: BranchPoint, test: TestFunction) -> Requests[BranchPoint | End]:
    """The branch point between two points of a branch."""
    length = new.arc - point.arc
    nodes = (1 - np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)) * length / 2
    known = yield from _cycles_at(point, new, nodes)
    s = _root_of(np.array([s for s, _ in known]), np.array([test.of(cycle) for _, cycle in known]), length)
    if not np.isfinite(s):
        return End(EndKind.NOT_CONVERGED)
    found = yield from branch_point_near(point, between(point, new, s / length), NEAR)
    return End(EndKind.NOT_CONVERGED) if found is None else found


def branch_point_near(
    point: BranchPoint, guess: ExtendedCycle, within: float
) -> Requests[BranchPoint | None]:
    """The branch point within a distance of a guess, on the branch behind a point; None if there is none."""
    place, is_found = yield from ask(KernelCall(crossing, point.sequence, (guess,)))
    place = trimmed(place, len(point.sequence.kind))
    if not is_found or not place.distance(guess) < within:
        return None
    arc = point.arc + float(place.along(point.tangent) - point.place.along(point.tangent))
    return (yield from _point_at(point.sequence, place, point.tangent, arc, Kind.BRANCH_POINT))


def distance_of_halves(num_periods: float, sequence: Sequence, place: ExtendedCycle) -> Requests[float]:
    """Distance of the two halves of a cycle; infinite where periods or events are odd."""
    if num_periods % 2 or len(sequence.kind) % 2:
        return np.inf
    z = yield from ask(location_on(sequence, place, num_periods / 2))
    return np.abs(z - place.z).max()


def end_of_doubled(num_periods: float, point: BranchPoint) -> Requests[BranchPoint | End | None]:
    """The end of a doubled branch at its period doubling, near a point; None if it does not end there."""
    sequence, place, half = point.sequence, point.place, num_periods / 2
    away = yield from distance_of_halves(num_periods, sequence, place)
    if not away < NEAR:
        return None
    num = len(sequence.kind) // 2
    once, guess = trimmed(sequence, num), trimmed(place, num)
    found = yield from ask(KernelCall(doubling, once, (guess,)))
    # At a fold beside a grazing the two halves may be close as well.
    distance, within = away, LOCATED
    if found.is_found:
        distance, within = (
            trimmed(found.place, num).distance(guess),
            LOCATED + DOUBLING_FARTHER * away,
        )
    # The fold is level: rounding moves it along the branch, but not its parameter.
    is_same = bool(found.is_found) and abs(found.place.p - place.p) < ROUNDED * abs(place.p)
    is_end = is_same if away > AT_BIFURCATION else distance < within
    if not (found.is_likely and is_end):
        return None
    if not found.is_found:
        return End(EndKind.NOT_CONVERGED)
    twice, place = in_a_row([(once, trimmed(found.place, num))] * 2, half)
    return (yield from _point_at(twice, place, point.tangent, point.arc, Kind.HALF_PERIOD))


def _point_at(
    sequence: Sequence, place: ExtendedCycle, tangent: ExtendedCycle, arc: float, kind: str
) -> Requests[BranchPoint]:
    cycle = yield from ask(KernelCall(as_corrected_cycle, sequence, (place, tangent)))
    return BranchPoint.of(sequence, cycle, arc, kind=kind)


def _cycles_at(
    point: BranchPoint, new: BranchPoint, ways: np.ndarray
) -> Requests[list[tuple[float, CorrectedCycle]]]:
    """Pairs of distance from a point and corrected cycle there, of those that converge."""
    found = []
    ahead = partial(between, point, new)
    for s in ways:
        cycle = yield from on_plane(point, ahead(s / (new.arc - point.arc)), s)
        found += [(s, cycle)] if cycle.found.is_converged else []
    return found


def _root_of(ways: np.ndarray, values: np.ndarray, length: float) -> float:
    """Zero on a step of the polynomial through values at some distances; NaN unless there is exactly one."""
    # Multipliers of a cycle may overflow.
    ways, values = ways[np.isfinite(values)], values[np.isfinite(values)]
    if len(ways) < 4:
        return np.nan
    roots = np.polynomial.Polynomial.fit(ways, values, len(ways) - 1).roots()
    is_real = np.abs(roots.imag) < ROUNDED * length
    roots = roots[is_real & (roots.real > 0) & (roots.real < length)].real
    return float(roots[0]) if len(roots) == 1 else np.nan
