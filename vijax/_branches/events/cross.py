"""Continue a branch behind a corner, on the words of letters that the machine follows there.

At a corner the motion solves the equations of the word before, and of every word behind. A word counts if the cycle on it goes
off with positive margins and the machine follows it. Its equations are regular there, or singular where new events meet at
a double root: such words are found with their letters a given time apart, see `apart.py`.
"""

from collections.abc import Iterator, Sequence as Many
from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np

from ..._machine.kinds import RIGID
from ..._machine.laws import contacts_of_elements, kinds_of_elements
from ..._machine.numbers import numbers_of
from ..._orbits.sequence import SECOND
from ..._orbits.side_by_side import has_several_of_a_kind, side_by_side
from ..._system.system import machine_of
from ..behind_event import corrected_on_sequence, step_off
from ..kinds import Kind
from ..margin_sizes import Sizes
from ..padding import padded
from ..parameter_family import ParameterFamily
from ..point import BranchPoint, DirectedBranch, corrected, is_followed
from ..requests import HostCall, Requests, ask
from ..sequence_edits import Word
from ..test_functions import TestFunction, is_plastic, margins, test_slopes
from ..tolerances import CORNER_NEAR, DOUBLE_ROOT, HALF_DIGITS, NEGLIGIBLE, NO_JUMP, TRIALS_AHEAD
from .apart import apart
from .corner import Corner, CornerInstant, CycleOnWords, corner_of
from .following import is_behind, is_followed_behind
from .residuals import ROWS, residuals_of
from .words import Elements, meaning, words_between


def cross(walk: DirectedBranch, test: TestFunction, event: BranchPoint) -> Requests[BranchPoint | None]:
    """The first point of a branch behind a corner; None if no word leads on."""
    if test.kind == Kind.IN_IMPACT:
        return None if test.of_flight else (yield from _past_impact(event, test))
    if test.kind == Kind.CHATTER_COMPLETION and not is_plastic(event.sequence, event.cycle, test):
        return None  # ever more bounces follow: `grazing_cascade.py`
    # In all rounds of a cycle that traverses a shorter one, in one of them alone, or, by a symmetry, half a cycle later too.
    sizes = yield from ask(HostCall(Sizes.of, event.sequence))
    for rounds in dict.fromkeys((1, walk.rounds, 2)):
        corner = corner_of(event, test, rounds, walk.num_periods, sizes)
        point = yield from _point_behind(corner)
        if point is not None:
            return point
    return None


def _past_impact(event: BranchPoint, test: TestFunction) -> Requests[BranchPoint | None]:
    """Continue behind an impact in which friction begins or ceases to stick: the word stays, the branch may go on or come back."""
    tangent, along = event.tangent, event.place.along(event.tangent)
    for side in (1, -1):
        for ds in TRIALS_AHEAD:
            guess = event.place.moved(tangent, ds)
            cycle = yield from corrected(event.sequence, guess, tangent, along + side * ds)
            new = BranchPoint.of(event.sequence, cycle, event.arc + ds)
            is_near = cycle.found.is_converged and new.place.distance(event.place) < CORNER_NEAR * ds
            if is_near and test.of(cycle) < 0 and (yield from is_followed(new)):
                return new if side > 0 else new.turned()
    return None


def _point_behind(corner: Corner) -> Requests[BranchPoint | None]:
    """The first point behind a corner, on the first words that lead on."""
    elements = yield from _elements(corner.event)
    choices = [words_between(at.mode, _acting(at, elements), elements, at.word) for at in corner.instants]
    # Words of one instant are taken in parts whose residuals one call computes, as mostly an early one leads on.
    words = choices[0]
    parts = [[words[k : k + ROWS]] for k in range(0, len(words), ROWS)] if len(choices) == 1 else [choices]
    for part in parts:
        for trial in _alike((yield from _solved(corner, part))):
            point = yield from _point_on(corner, corner.with_words(trial))
            if point is not None:
                return point
    return None


def _elements(event: BranchPoint) -> Requests[Elements]:
    """The elements of the machine at a point."""
    known = yield from ask(HostCall(_elements_of, event.sequence, of_make=True))
    # Of rigid contacts alone a follower is free in every mode.
    if set(known.kinds) <= {RIGID} or not has_several_of_a_kind(known.kinds):
        return known

    def pairs(family: ParameterFamily) -> list[tuple[tuple[int, ...], ...]]:
        system = jax.tree.map(jnp.asarray, family).system_at(event.place.p)  # a machine wants arrays of JAX
        found = side_by_side(numbers_of(system))
        return [tuple(map(tuple, np.sign(own).astype(int).tolist())) for own in found]

    begin, end = yield from ask(HostCall(pairs, event.sequence))
    return known._replace(begin=begin, end=end)


def _elements_of(family: ParameterFamily) -> Elements:
    """The elements of a machine, as if none stood side by side."""
    system = machine_of(family.system)
    kinds = tuple(kinds_of_elements(system))
    none = ((0,) * len(kinds),) * len(kinds)
    return Elements(kinds, tuple(contacts_of_elements(system)), none, none)


def _acting(at: CornerInstant, elements: Elements) -> tuple[int, ...]:
    """Elements of an instant, with friction of their contacts, and those that they follow."""
    return tuple(
        i
        for i, contact in enumerate(elements.contacts)
        if i in at.elements or contact in at.elements or any(elements.begin[i][j] for j in at.elements)
    )


def _alike(choices: list[list[Word]]) -> Iterator[tuple[Word, ...]]:
    """Choices of one word at each instant, with the same events: of several the same change at all."""
    first, *others = choices
    for word in first:
        alike = ([other for other in words if _events(other) == _events(word)] for words in others)
        yield from ((word, *rest) for rest in product(*alike))


def _events(word: Word) -> tuple[int, ...]:
    return tuple(letter.kind % SECOND for letter in word)


def _solved(corner: Corner, choices: Many[Many[Word]]) -> Requests[list[list[Word]]]:
    """The words of each instant whose equations the motion at the corner solves."""
    before = [at.word for at in corner.instants]
    trials = [
        corner.with_words((*before[:k], word, *before[k + 1 :]))
        for k, words in enumerate(choices)
        for word in words
    ]
    if not trials:
        return [[] for _ in choices]
    left = yield from residuals_of([(trial.sequence, trial.place) for trial in trials])
    is_solved = iter(left < NEGLIGIBLE)
    return [[word for word in words if next(is_solved)] for words in choices]


def _point_on(corner: Corner, trial: CycleOnWords) -> Requests[BranchPoint | None]:
    """The first point behind a corner on some words; None if the machine does not follow them."""
    if [meaning(word) for word in trial.words] == [meaning(at.word) for at in corner.instants]:
        return None
    at = yield from corrected_on_sequence(trial.sequence, trial.place, corner.event)
    if isinstance(at, BranchPoint) and _is_at_corner(at, trial):
        for is_ahead in (True, False) if _rises(at, corner.sizes) else (False, True):
            new = yield from step_off(at, is_ahead, partial(_accepted, corner, trial))
            if new is not None and not _has_double_root(new, at, corner, trial):
                return new
    return (yield from apart(corner, trial))


def _accepted(corner: Corner, trial: CycleOnWords, new: BranchPoint) -> Requests[BranchPoint | None]:
    """A point behind a corner, if its margins are positive and the machine follows it; else None."""
    if not is_behind(new, corner, trial.words):
        return None
    return (yield from is_followed_behind(new, corner.num_periods))


def _is_at_corner(at: BranchPoint, trial: CycleOnWords) -> bool:
    away = max(np.abs(at.place.z - trial.place.z).max(), abs(at.place.p - trial.place.p))
    return bool(away < NO_JUMP)


def _rises(at: BranchPoint, sizes: Sizes) -> bool:
    """True if the margins that vanish at a corner rise along the tangent."""
    (sequence,) = padded(at.sequence, (), len(at.cycle.found.speeds))
    of_margins = sizes.of_margins(sequence)
    values, slopes = margins(sequence, at.cycle) / of_margins, test_slopes(sequence, at.cycle) / of_margins
    own = slopes[np.abs(values) < HALF_DIGITS]
    return not len(own) or bool(own.min() > -own.max())


def _new_durations(corner: Corner, trial: CycleOnWords) -> list[int]:
    """Numbers of the flights between the new events of the one instant of a corner."""
    if len(corner.instants) > 1:
        return []
    return [corner.instants[0].first + k for k in range(1, len(trial.words[0]))]


def _has_double_root(new: BranchPoint, at: BranchPoint, corner: Corner, trial: CycleOnWords) -> bool:
    """True if a duration between new events is still zero a step behind a corner."""
    own = _new_durations(corner, trial)
    return bool(np.any(np.abs(new.place.flights[own]) < DOUBLE_ROOT * (new.arc - at.arc)))
