"""Test functions of a cycle, which change sign at an event or a bifurcation of a branch."""

from collections.abc import Callable, Sequence as Many
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from .._hybrid.limits import CLOSE as CLOSING, IMPACT, OPEN, RELEASE, STICK, TURN
from .._jax.arrays import array_namespace
from .._machine.state import AHEAD, BEHIND, FREE, SPRING, STICKING
from .._orbits.sequence import NOTHING, SECOND, Sequence
from .kernels import CorrectedCycle
from .kinds import Kind
from .multiplier_functions import Multipliers
from .tolerances import AT_BIFURCATION, HALF_DIGITS, LIGHT_IMPACT, LOCATED, ROUNDED, ROUNDED_FUNCTION


class TestFunction(NamedTuple):
    """A test function.

    Attributes:
        kind: kind of the event or bifurcation at its zero.
        of: its value.
        index: number of the event or stop.
        of_flight: True for the duration of the flight before an event.
        rate: its rate along the branch; None if that is not known.
        least: name of the field of `LeastMargins` that it is, or "".
    """

    kind: str
    of: Callable[[CorrectedCycle], Any]
    index: int = 0
    of_flight: bool = False
    rate: Callable[[CorrectedCycle], Any] | None = None
    least: str = ""


def num_on_circle(mu: Multipliers) -> int:
    """Number of multipliers on the unit circle that are not real."""
    return int(
        np.count_nonzero((np.abs(np.abs(mu) - 1) < AT_BIFURCATION) & (np.abs(mu.imag) > AT_BIFURCATION))
    )


TESTS_OF_NEIGHBOURS = tuple(
    TestFunction(kind, lambda cycle, k=k: cycle.neighbours[k])
    for k, kind in enumerate((Kind.FOLD, Kind.PERIOD_DOUBLING, Kind.BRANCH_POINT, Kind.NEIMARK_SACKER))
)


def is_crossed(before: Any, after: Any) -> Any:
    """True where a function of multipliers changes sign between two values that are not both rounding."""
    xp = array_namespace(before, after)
    return (before * after < 0) & (xp.maximum(xp.abs(before), xp.abs(after)) > ROUNDED_FUNCTION)


def is_between_events(test: TestFunction) -> bool:
    """True for the test function of a guard between events, or of one that an event would keep from vanishing."""
    return bool(test.least)


def tests_of(sequence: Sequence) -> tuple[TestFunction, ...]:
    """Test functions of a sequence, positive as long as a machine can follow it; `index` is that of an event or a guard."""
    arrays = [np.asarray(a) for a in sequence]
    return _tests_of(*((a.tobytes(), a.dtype, a.shape) for a in arrays))


@lru_cache(maxsize=1024)
def _tests_of(*parts: tuple[bytes, np.dtype, tuple[int, ...]]) -> tuple[TestFunction, ...]:
    """`tests_of` a sequence whose arrays have these bytes, types and shapes: branches share a few sequences."""
    sequence = Sequence(*(np.frombuffer(data, dtype).reshape(shape) for data, dtype, shape in parts))
    found, follows_another, has_speed = [], _follows_another(sequence), _has_speed(sequence)
    for k in range(len(sequence.kind)):
        if has_speed[k]:
            kind = Kind.CROSSING_SLIDING if sequence.kind[k] == TURN else Kind.GRAZING
            of_speed = lambda cycle, k=k: float(cycle.found.speeds[k])  # noqa: E731
            rate = lambda cycle, k=k: float(cycle.rates.speeds[k])  # noqa: E731
            found.append(TestFunction(kind, of_speed, k, rate=rate))
        if follows_another[k]:
            of_flight = lambda cycle, k=k: float(_durations(cycle)[k])  # noqa: E731
            rate = lambda cycle, k=k: float(cycle.found.tangent.flights[k])  # noqa: E731
            found.append(TestFunction(_kind_of_meeting(sequence, k), of_flight, k, of_flight=True, rate=rate))
    num = sequence.mode.shape[1]
    slides = np.any(np.isin(sequence.mode, (AHEAD, BEHIND, STICKING, SPRING)), axis=0).tolist()
    for j in range(num * sequence.num_groups):
        is_friction = slides[j % num]
        kinds = {
            "gap": Kind.GRAZING_SLIDING if is_friction else Kind.TOUCH if j < num else Kind.FORCE_ZERO,
            "force": Kind.ADDING_SLIDING if is_friction else Kind.FORCE_ZERO,
            "rise": Kind.TEAR if is_friction else Kind.ONSET,
        }
        for name, kind in kinds.items():
            of_guard = lambda cycle, j=j, name=name: float(getattr(cycle.watched, name)[j])  # noqa: E731
            rate = None
            if sequence.num_groups == 1:
                rate = lambda cycle, j=j, name=name: float(getattr(cycle.rates, name)[j])  # noqa: E731
            found.append(TestFunction(kind, of_guard, j, rate=rate, least=name))
    return tuple(found)


def kind_at(test: TestFunction, sequence: Sequence, cycle: Any) -> str:
    """Kind of the bifurcation at the zero of a test function, of a corrected cycle or of a point of a curve.

    A guard may vanish with an event: with one that cuts its flight off, or at the beginning of its stick.
    """
    if test.least not in ("gap", "force"):
        return test.kind
    own = test.index % sequence.mode.shape[1]
    flight, time = (getattr(cycle.watched, f"{test.least}_{of}")[test.index] for of in ("flight", "time"))
    since = np.cumsum(cycle.found.place.flights[: len(sequence.kind)]) - float(time)
    at_once = np.flatnonzero(np.abs(since) < LOCATED).tolist()
    if test.least == "force":
        # The event of another element sets it free, or the force is least where the element comes to rest.
        is_cut = flight in at_once and sequence.stop[flight] != own
        is_cut = is_cut and sequence.mode[flight, own] != sequence.mode[flight + 1, own]
        begins = test.kind == Kind.ADDING_SLIDING and flight - 1 in at_once
    else:
        is_cut, begins = any(_is_cut(test, sequence, k, own) for k in at_once), False
    return Kind.DOUBLE_IMPACT if is_cut else Kind.SWITCHING_SLIDING if begins else test.kind


def _is_cut(test: TestFunction, sequence: Sequence, k: int, own: int) -> bool:
    """True if event `k` cuts off a flight on which the guard of a test function falls, see `margin_scan.py`."""
    if test.kind != Kind.GRAZING_SLIDING:
        return bool(sequence.stop[k] == own and sequence.kind[k] % SECOND == OPEN)
    # Friction of a contact begins and ends with that.
    is_open = sequence.mode[k : k + 2, own] == FREE
    return bool(sequence.kind[k] == IMPACT or is_open[0] != is_open[1])


def _kind_of_meeting(sequence: Sequence, k: int) -> Kind:
    """Kind of the bifurcation where event `k` meets the one before it."""
    stop = sequence.stop[k]
    if begins_with_contact(sequence, k):
        return Kind.IN_IMPACT
    if k == 0 or stop != sequence.stop[k - 1]:
        return Kind.DOUBLE_IMPACT
    before, between, after = (sequence.mode[i, stop] for i in (k - 1, k, k + 1))
    if SPRING in (
        before,
        between,
        after,
    ):  # a slip of no duration of a Jenkins element, or a stick between two
        return Kind.GRAZING_SLIDING
    if between == STICKING:  # a stick of no duration
        return Kind.GRAZING_SLIDING if before == after else Kind.CROSSING_SLIDING
    if after == STICKING:
        return Kind.ADDING_SLIDING if before == STICKING else Kind.SWITCHING_SLIDING
    return Kind.CHATTER_COMPLETION if sequence.kind[k] == RELEASE else Kind.DOUBLE_IMPACT


def begins_with_contact(sequence: Sequence, k: int) -> bool:
    """True if event `k` stops or turns friction that began to slip as an impact closed its contact, one event before."""
    is_end = k > 0 and sequence.kind[k - 1] == IMPACT and sequence.kind[k] in (STICK, TURN)
    return bool(is_end and sequence.mode[k - 1, sequence.stop[k]] == FREE)


def _has_speed(sequence: Sequence) -> Any:
    """True for events with a test function of their own: an impact, a compliant contact that closes at its gap, a turn."""
    return _is_one_of(sequence.kind, (IMPACT, CLOSING, TURN))


def _is_one_of(kinds: Any, some: tuple[int, ...]) -> Any:
    return array_namespace(kinds).isin(kinds, np.array(some))


def margins(sequence: Sequence, cycle: CorrectedCycle) -> Any:
    """Values of all `tests_of` a padded sequence, (tests,); infinite for no test."""
    return _of_tests(
        sequence, (cycle.found.speeds, _durations(cycle), *_between_events(cycle.watched)), np.inf
    )


def _durations(cycle: Any) -> Any:
    """Durations of the flights of a corrected cycle, or of a point of a curve.

    They are infinite between events that stay at one instant along the branch, as a symmetry keeps them.
    """
    flights, rates = cycle.found.place.flights, cycle.found.tangent.flights
    xp = array_namespace(flights, rates)
    return xp.where((xp.abs(flights) < ROUNDED) & (xp.abs(rates) < HALF_DIGITS), xp.inf, flights)


def test_slopes(sequence: Sequence, cycle: CorrectedCycle) -> Any:
    """Rates of `margins` along the branch, (tests,); 0 for no test."""
    rates = (cycle.rates.speeds, cycle.found.tangent.flights, *_between_events(cycle.rates))
    values = margins(sequence, cycle)
    xp = array_namespace(values)
    return xp.where(xp.isfinite(values), _of_tests(sequence, rates, 0.0), 0.0)


def _between_events(watched: Any) -> tuple:
    return watched.gap, watched.force, watched.rise


def _of_tests(sequence: Sequence, values: tuple, none: float) -> Any:
    """Values of impacts, of flights and of stops, concatenated to one row of tests."""
    speeds, flights, *of_stops = values
    xp = array_namespace(sequence.kind, *values)
    speeds = xp.where(_has_speed(sequence), speeds, none)
    flights = xp.where(_follows_another(sequence), flights, none)
    return xp.concatenate([speeds, flights, *of_stops])


def _follows_another(sequence: Sequence) -> Any:
    """True where an event can meet the one before. Two impacts of one stop are left out: one loses its speed there."""
    kind, stop = sequence.kind, sequence.stop
    is_same = stop[1:] == stop[:-1]
    # Where a compliant contact has no duration, it closes at no speed; where a turn has none, friction would stick.
    alike = _is_one_of(kind, (IMPACT, CLOSING, OPEN, TURN))
    is_same = is_same & alike[1:] & alike[:-1]
    # The first event has none before it.
    xp = array_namespace(kind)
    return xp.concatenate([xp.zeros_like(kind[:1], dtype=bool), ~is_same & (kind[1:] != NOTHING)])


def crossings(tests: Many[TestFunction], before: CorrectedCycle, after: CorrectedCycle) -> list[TestFunction]:
    """Test functions that change from positive to not positive."""
    return [test for test in tests if test.of(before) > 0 >= test.of(after)]


def without_echoes(sequence: Sequence, met: list[TestFunction]) -> list[TestFunction]:
    """Test functions of a step without those of guards of an element whose events meet there: these vanish with them."""
    if sequence.num_groups == 1:
        return met
    num = sequence.mode.shape[1]
    # The duration of a slip that begins with a turn is rounded where it vanishes; the force at that turn is not.
    turns = {test.index: test for test in met if test.kind == Kind.CROSSING_SLIDING and not test.of_flight}
    slips = {test.index for test in met if test.kind == Kind.SWITCHING_SLIDING and test.index - 1 in turns}
    met = [
        test._replace(of=turns[test.index - 1].of, rate=turns[test.index - 1].rate)
        if test.index in slips and test.of_flight
        else test
        for test in met
    ]
    met = [test for test in met if test.of_flight or test.index + 1 not in slips or test.index not in turns]
    # Friction stops a mass behind an impact the sooner, the slower that is.
    impacts = {test.index for test in met if test.kind == Kind.GRAZING and not test.of_flight}
    met = [test for test in met if not (test.of_flight and _is_end_of_rebound(sequence, test.index, impacts))]
    is_of_event = lambda test: test.of_flight or test.kind in (Kind.GRAZING, Kind.CROSSING_SLIDING)  # noqa: E731
    meeting = {int(sequence.stop[test.index]) for test in met if is_of_event(test)}
    return [test for test in met if is_of_event(test) or test.index % num not in meeting]


def _is_end_of_rebound(sequence: Sequence, k: int, impacts: set[int]) -> bool:
    """True if event `k` ends a slip that began with one of some impacts, just before."""
    return k - 1 in impacts and bool(
        sequence.mode[k - 1, sequence.stop[k]] != sequence.mode[k, sequence.stop[k]]
    )


def grips(sequence: Sequence, cycle: CorrectedCycle) -> Any:
    """Grip that impacts leave to friction of their contacts, see `EndOfFlight`, (events stops,).

    Its sign tells whether the friction sticks within the impact or slips. NaN where there is none, and in light bounces, of
    which a chatter has ever more.
    """
    grip, speeds = cycle.watched.grip, cycle.found.speeds
    xp = array_namespace(speeds)
    if grip is None:
        return np.zeros(0)
    num = len(sequence.kind)
    speeds = xp.where(sequence.kind == IMPACT, speeds[:num], 0)
    is_heavy = speeds > LIGHT_IMPACT * xp.max(speeds, initial=0)
    return xp.where(is_heavy[:, None], grip[:num], xp.nan).ravel()


def stops_in_impacts(sequence: Sequence, before: CorrectedCycle, after: CorrectedCycle) -> list[TestFunction]:
    """Test functions of impacts in which friction begins or ceases to stick between two cycles of a sequence."""
    if before.watched.grip is None:
        return []
    first, last = (grips(sequence, cycle) for cycle in (before, after))
    found = []
    for place in np.flatnonzero(is_crossed(first, last)).tolist():
        k, j = divmod(place, sequence.mode.shape[1])
        sign = float(np.sign(first[place]))
        of = lambda cycle, k=k, j=j, sign=sign: sign * float(cycle.watched.grip[k, j])  # noqa: E731
        found.append(TestFunction(Kind.IN_IMPACT, of, k))
    return found


def is_plastic(sequence: Sequence, cycle: CorrectedCycle, test: TestFunction) -> bool:
    """True if the stop of the event of a test function has zero restitution."""
    return bool(cycle.watched.is_plastic[sequence.stop[test.index]])


def num_unstable(cycle: CorrectedCycle) -> Any:
    """Number of multipliers outside the unit circle."""
    xp, mu = array_namespace(cycle.found.multipliers), cycle.found.multipliers
    return xp.count_nonzero(xp.abs(mu) > 1 + HALF_DIGITS, axis=-1)
