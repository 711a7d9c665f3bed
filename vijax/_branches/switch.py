"""Branch switching: from a point of a branch to the other branches through it."""

import numpy as np

from .._jax.arrays import check_type, refuse_single_precision
from .._jax.xla import padding_allowed
from .._orbits.orbit import PeriodicOrbit
from .._orbits.sequence import Sequence
from .bifurcation_setup import family_at
from .branch import Bifurcation, branch_of
from .grazing_families import hits_of, leave, repeated, touch_of
from .kinds import Kind
from .padding import trimmed
from .parameter_family import ExtendedCycle, ParameterFamily
from .pitchfork import crossing_direction, null_vectors
from .point import BranchPoint, DirectedBranch, correct_with_free_parameter, first_followed
from .requests import Requests
from .scheduler import drive
from .sequence_edits import in_a_row
from .starts import family_of
from .tolerances import TRIALS_ON_OTHER
from .touch import touching_impact


@padding_allowed
def switch_branch(point: Bifurcation) -> list[PeriodicOrbit]:
    """Find orbits on the other branches through a point of a branch, close to it.

    At a period doubling this is the orbit of twice the period, at the end of a doubled branch that of half the period.
    At a pitchfork it is one of the two mirror images, and `orbit.mirrored()` the other; from the branch of these, where it
    turns, the symmetric orbit. At any other branch point there is one on each side. Where an impact appears or vanishes, there are those of one to
    three periods of the orbit that touches the stop, which hit it in some of these periods, as far as the machine
    follows them. A fold has none. Where two impacts exchange their order, the branch itself continues.

    Args:
        point: one of `branch.bifurcations`.

    Returns:
        The orbits, from which `vx.continuation` continues; none where there are no other branches.

    Raises:
        ValueError: for a Neimark-Sacker point, where no periodic orbit branches off, for a grazing of a compliant
            stop, or of one whose lightest impact stops friction or tears it off, or if 64-bit numbers are off.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_b(1.05)
        sol = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=4000)
        branch = vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), "forcing.frequency", (1.0, 1.1))
        doubled = [vx.switch_branch(point) for point in branch.bifurcations if point.kind == "pd"]
        ```

    References:
        E. L. Allgower & K. Georg, Numerical Continuation Methods (1990), Ch. 8.
    """
    check_type("point", point, Bifurcation, "one of `branch.bifurcations`")
    refuse_single_precision("switch_branch", point.branch.points["x0"])
    if point.kind == Kind.NEIMARK_SACKER:
        raise ValueError(
            "A torus leaves at a Neimark-Sacker point, no periodic orbit: run `vx.simulate` beside it."
        )
    if point.kind == Kind.GRAZING:
        return _at_grazing(point)
    if point.kind not in (Kind.PERIOD_DOUBLING, Kind.BRANCH_POINT, Kind.PITCHFORK):
        return []
    path, value = point.branch.path, point.value
    start, family, sequence, place = family_at(point, value - 1, value + 1)
    if _ends_doubled(point):
        half = family_of(start._replace(num_periods=start.num_periods // 2), path, value - 1, value + 1)
        (other,) = drive([half], [_half_cycle_orbit(sequence, place)], lambda: None)
        return [] if other is None else [_orbit(half, other)]
    if point.kind == Kind.PERIOD_DOUBLING:
        sequence, place = in_a_row([(sequence, place)] * 2, start.num_periods)
        family = family_of(start._replace(num_periods=2 * start.num_periods), path, value - 1, value + 1)
    sides = (1.0,) if point.kind == Kind.PERIOD_DOUBLING else (1.0, -1.0)
    beside = _across if point.kind == Kind.PITCHFORK and _turns(point) else _beside
    found = drive([family] * len(sides), [beside(sequence, place, side) for side in sides], lambda: None)
    orbits = [_orbit(family, other) for other in found if other is not None]
    # The two sides of a pitchfork are mirror images, or belong to one branch of symmetric orbits.
    return orbits[:1] if point.kind == Kind.PITCHFORK else orbits


def _turns(point: Bifurcation) -> bool:
    """True if the parameter of a branch turns at a point."""
    before, at, after = (
        point.branch.values[np.clip(k, 0, len(point.branch) - 1)]
        for k in (point.index - 1, point.index, point.index + 1)
    )
    return bool((before - at) * (after - at) > 0)


def _ends_doubled(point: Bifurcation) -> bool:
    """True if a doubled branch ends at a point."""
    first, last = point.branch.ends
    end = {0: first, len(point.branch) - 1: last}.get(point.index)
    return point.kind == Kind.BRANCH_POINT and end == Kind.HALF_PERIOD


def _half_cycle_orbit(sequence: Sequence, place: ExtendedCycle) -> Requests[BranchPoint | None]:
    """An orbit on the branch of half as many periods, from a cycle that traverses it twice."""
    num = len(sequence.kind) // 2
    once = trimmed(sequence, num)
    cycle = yield from correct_with_free_parameter(once, trimmed(place, num))
    at = BranchPoint.of(once, cycle, 0.0)
    return (yield from first_followed(once, at.place, at.tangent, TRIALS_ON_OTHER))


def _at_grazing(point: Bifurcation) -> list[PeriodicOrbit]:
    """Orbits on the families that leave a grazing."""
    path, value = point.branch.path, point.value
    start, family, sequence, place, k = touching_impact(point)
    (touch,) = drive([family], [touch_of(sequence, place, k, start.num_periods)], lambda: None)
    orbits = []
    for is_hit in hits_of(touch, start.num_periods):
        num_periods = len(is_hit) * touch.num_periods
        longer = family_of(start._replace(num_periods=num_periods), path, value - 1, value + 1)
        (other,) = drive([longer], [leave(*repeated(touch, is_hit), TRIALS_ON_OTHER)], lambda: None)
        orbits += [] if other is None else [_orbit(longer, other)]
    return orbits


def _orbit(family: ParameterFamily, point: BranchPoint) -> PeriodicOrbit:
    """The orbit of a single point."""
    empty = DirectedBranch(float(family.num_periods), (0.0, 0.0), 0)
    return branch_of(family, point, empty, empty).orbit(0)


def _across(sequence: Sequence, place: ExtendedCycle, side: float) -> Requests[BranchPoint | None]:
    """An orbit a short way along the branch of symmetric orbits, from a point at which asymmetric ones turn."""
    along = yield from crossing_direction(sequence, place)
    return (yield from first_followed(sequence, place, along, tuple(side * ds for ds in TRIALS_ON_OTHER)))


def _beside(sequence: Sequence, place: ExtendedCycle, side: float) -> Requests[BranchPoint | None]:
    """An orbit a short way along the null vector of the equations at fixed parameter."""
    along, _ = yield from null_vectors(sequence, place)
    lengths = tuple(side * ds for ds in TRIALS_ON_OTHER)
    return (yield from first_followed(sequence, place, along, lengths))
