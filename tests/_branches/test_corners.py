"""Words of letters at a corner: which are enumerated, and the cycles on them."""

import numpy as np
import pytest

from vijax._branches.events.words import Elements, meaning, words_between
from vijax._branches.parameter_family import ExtendedCycle
from vijax._branches.sequence_edits import Letter, exchanged, letters_between
from vijax._hybrid.limits import CLOSE, IMPACT, OPEN, RELEASE, SLIP, STICK, TURN
from vijax._machine.kinds import COMPLIANT, FRICTION, JENKINS, RIGID
from vijax._machine.state import AHEAD, BEHIND, CLOSED, FREE, HELD, INSIDE, KEPT, SPRING, STICKING
from vijax._orbits.sequence import LEAVE, SECOND, Sequence


def events_of(words) -> set:
    return {tuple((letter.kind, letter.stop) for letter in word) for word in words}


def machine_of(*kinds: int, contacts: tuple[int, ...] | None = None, begin=None, end=None) -> Elements:
    none = ((0,) * len(kinds),) * len(kinds)
    return Elements(kinds, contacts or (-1,) * len(kinds), begin or none, end or begin or none)


def test_a_touch_of_a_rigid_stop_is_an_impact_or_a_stick_that_ends_at_once():
    words = words_between(((FREE,), (FREE,)), (0,), machine_of(RIGID), ())
    assert events_of(words) == {((IMPACT, 0),), ((IMPACT, 0), (RELEASE, 0))}
    assert words[0] == (Letter(IMPACT, 0, (FREE,)),)


def test_an_impact_that_loses_its_speed_is_none_first():
    before = (Letter(IMPACT, 0, (FREE,)),)
    words = words_between(((FREE,), (FREE,)), (0,), machine_of(RIGID), before)
    assert words[0] == ()
    assert ((IMPACT, 0), (IMPACT, 0)) in events_of(words)  # one impact makes two, none makes no two
    assert before not in words


def test_two_impacts_at_once_are_first_exchanged():
    one, other = (Letter(IMPACT, k, (FREE, FREE)) for k in (0, 1))
    words = words_between(((FREE, FREE), (FREE, FREE)), (0, 1), machine_of(RIGID, RIGID), (one, other))
    assert words[0] == (other, one)


def test_a_held_mass_may_hop_and_land_at_once_whatever_the_restitution():
    words = words_between(((HELD,), (HELD,)), (0,), machine_of(RIGID), ())
    assert words[0] == (Letter(RELEASE, 0, (FREE,)), Letter(IMPACT, 0, (HELD,)))


def test_a_mass_that_comes_to_rest_may_bounce_once_before():
    rests = (Letter(IMPACT, 0, (HELD,)),)
    words = words_between(((FREE,), (HELD,)), (0,), machine_of(RIGID), rests)
    assert words[0] == (Letter(IMPACT, 0, (FREE,)), *rests)
    back = words_between(((FREE,), (HELD,)), (0,), machine_of(RIGID), words[0])
    assert back[0] == rests


def test_a_contact_that_lags_behind_its_mass_may_push_again_before_the_mass_leaves():
    """It opens by its force inside, and the mass leaves without an event of the log, or turns back."""
    inside = Letter(OPEN + SECOND, 0, (INSIDE,))
    words = words_between(((CLOSED,), (CLOSED,)), (0,), machine_of(COMPLIANT), ())
    assert (inside, Letter(CLOSE + SECOND, 0, (CLOSED,))) in words
    words = words_between(((CLOSED,), (FREE,)), (0,), machine_of(COMPLIANT), (Letter(OPEN, 0, (FREE,)),))
    assert (Letter(OPEN + SECOND, 0, (FREE,)),) in words
    silent = inside, Letter(LEAVE, 0, (FREE,))
    assert silent in words
    assert meaning(silent) == meaning((Letter(OPEN + SECOND, 0, (FREE,)),))


def test_friction_that_turns_may_stick_in_between():
    words = words_between(((AHEAD,), (BEHIND,)), (0,), machine_of(FRICTION), (Letter(TURN, 0, (BEHIND,)),))
    stick = Letter(STICK, 0, (STICKING,))
    assert words[0] == (stick, Letter(SLIP + SECOND, 0, (BEHIND,)))
    assert events_of(words).isdisjoint({((STICK, 0), (SLIP, 0))})  # that way it slips ahead
    assert all(sum(letter.kind == TURN for letter in word) <= 1 for word in words)


def test_an_impact_turns_friction_of_its_mass_and_a_slip_turns_nothing_else():
    modes = (FREE, AHEAD), (FREE, BEHIND)
    words = words_between(modes, (0, 1), machine_of(RIGID, FRICTION), (Letter(TURN, 1, modes[1]),))
    assert (Letter(IMPACT, 0, modes[1]),) in words
    for word in words:
        for before, letter in zip((modes[0], *(letter.mode for letter in word)), word, strict=False):
            if letter.stop == 1:
                assert letter.mode[0] == before[0]


def test_a_damped_contact_opens_by_its_force_or_by_its_depth():
    words = words_between(((FREE,), (FREE,)), (0,), machine_of(COMPLIANT), ())
    close = Letter(CLOSE, 0, (CLOSED,))
    assert {(close, Letter(OPEN, 0, (FREE,))), (close, Letter(OPEN + SECOND, 0, (FREE,)))} <= set(words)
    inside = close, Letter(OPEN + SECOND, 0, (INSIDE,)), Letter(LEAVE, 0, (FREE,))
    assert meaning(inside) == meaning(inside[:2]) == meaning((close, Letter(OPEN + SECOND, 0, (FREE,))))


def test_friction_of_a_contact_acts_as_long_as_that_is_closed():
    elements = machine_of(COMPLIANT, FRICTION, contacts=(-1, 0))
    words = words_between(((FREE, FREE), (CLOSED, AHEAD)), (0, 1), elements, ())
    assert (Letter(CLOSE, 0, (CLOSED, AHEAD)),) in words
    words = words_between(((CLOSED, AHEAD), (FREE, FREE)), (0, 1), elements, ())
    assert (Letter(OPEN, 0, (FREE, FREE)),) in words
    elements = machine_of(RIGID, FRICTION, contacts=(-1, 0))
    held = words_between(((FREE, FREE), (HELD, STICKING)), (0, 1), elements, ())
    assert (Letter(IMPACT, 0, (HELD, STICKING)),) in held


def test_friction_side_by_side_turns_and_sticks_in_one_event():
    modes, before = ((AHEAD, BEHIND), (BEHIND, AHEAD)), (Letter(TURN, 0, (BEHIND, AHEAD)),)
    elements = machine_of(FRICTION, FRICTION, begin=((0, -1), (0, 0)))  # along opposite rows
    words = words_between(modes, (0, 1), elements, before)
    assert words[0] == (Letter(STICK, 0, (STICKING, KEPT)), Letter(SLIP + SECOND, 0, (BEHIND, AHEAD)))
    assert all(letter.stop == 0 for word in words for letter in word)


def test_compliant_contacts_side_by_side_close_and_open_in_one_event():
    elements = machine_of(COMPLIANT, COMPLIANT, begin=((0, 1), (0, 0)))
    words = words_between(((FREE, FREE), (FREE, FREE)), (0, 1), elements, ())
    assert (Letter(CLOSE, 0, (CLOSED, CLOSED)), Letter(OPEN, 0, (FREE, FREE))) in words
    assert all(letter.stop == 0 for word in words for letter in word)


def test_sliders_side_by_side_come_to_rest_in_one_event_and_slip_each_at_its_limit():
    elements = machine_of(JENKINS, JENKINS, begin=((0, 1), (0, 0)), end=((0, 0), (0, 0)))
    words = words_between(((AHEAD, AHEAD), (SPRING, SPRING)), (0, 1), elements, ())
    assert words[0] == (Letter(STICK, 0, (SPRING, SPRING)),)
    words = words_between(((SPRING, SPRING), (AHEAD, AHEAD)), (0, 1), elements, ())
    assert {((SLIP, 0), (SLIP, 1)), ((SLIP, 1), (SLIP, 0))} <= events_of(words)


@pytest.fixture
def cycle() -> tuple[Sequence, ExtendedCycle]:
    mode = np.array([[FREE, AHEAD], [FREE, BEHIND], [FREE, STICKING], [FREE, AHEAD]], np.int8)
    sequence = Sequence(np.array([IMPACT, STICK, SLIP]), np.array([0, 1, 1]), mode)
    return sequence, ExtendedCycle(np.zeros(2), np.array([0.25, 0.125, 0.5]), np.array(1.0))


def test_other_letters_keep_the_times_of_all_events(cycle):
    sequence, place = cycle
    word = Letter(IMPACT, 0, (FREE, STICKING)), Letter(SLIP, 1, (FREE, BEHIND))
    new, at = exchanged(sequence, place, [((0, 1), 0.25, word), ((3, 3), 0.9, ())])
    assert new.kind.tolist() == [IMPACT, SLIP, STICK, SLIP]
    np.testing.assert_array_equal(np.cumsum(at.flights), [0.25, 0.25, 0.375, 0.875])
    back, again = exchanged(new, at, [((0, 2), 0.25, letters_between(sequence, 0, 1))])
    for one, other in zip((*back, *again), (*sequence, *place), strict=True):
        np.testing.assert_array_equal(one, other)
