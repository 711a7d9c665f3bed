"""Words of letters: the events at one instant of a cycle, each with the modes of all elements behind it.

At a corner the events of an instant are exchanged for others that lead from the same modes to the same modes. All words that
do are enumerated from what ends a mode and where it leads; the equations of the cycle then tell which of them it solves.
"""

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from typing import NamedTuple

from ..._hybrid.limits import CLOSE, IMPACT, OPEN, RELEASE, SLIP, STICK, TURN
from ..._machine.kinds import COMPLIANT, FRICTION, JENKINS, RIGID
from ..._machine.state import AHEAD, BEHIND, CLOSED, FREE, HELD, INSIDE, KEPT, SPRING, STICKING, rests_in
from ..._orbits.sequence import LEAVE, SECOND, ends_a_mode
from ..sequence_edits import Letter, Modes, Word

# What ends a mode of an element of a kind: pairs of the event and the mode behind it.
_ENDS: dict[int, dict[int, list[tuple[int, int]]]] = {
    RIGID: {FREE: [(IMPACT, FREE), (IMPACT, HELD)], HELD: [(RELEASE, FREE)]},
    COMPLIANT: {
        FREE: [(CLOSE, CLOSED), (CLOSE, HELD)],
        CLOSED: [(OPEN, FREE), (OPEN + SECOND, FREE), (OPEN + SECOND, INSIDE)],
        INSIDE: [(LEAVE, FREE), (CLOSE + SECOND, CLOSED)],
        HELD: [(OPEN, FREE), (OPEN + SECOND, CLOSED), (CLOSE, CLOSED), (CLOSE + SECOND, CLOSED)],
    },
    FRICTION: {
        AHEAD: [(TURN, BEHIND), (STICK, STICKING)],
        BEHIND: [(TURN, AHEAD), (STICK, STICKING)],
        STICKING: [(SLIP, AHEAD), (SLIP + SECOND, BEHIND)],
    },
    JENKINS: {
        SPRING: [(SLIP, AHEAD), (SLIP + SECOND, BEHIND)],
        AHEAD: [(STICK, SPRING)],
        BEHIND: [(STICK, SPRING)],
    },
}
# Modes of friction that the event of a contact changes, as an impact jumps its velocity and a damper its force.
_JUMPS: dict[int, dict[int, list[int]]] = {
    IMPACT: {AHEAD: [BEHIND], BEHIND: [AHEAD], STICKING: [AHEAD, BEHIND]},
    CLOSE: {STICKING: [AHEAD, BEHIND]},
    OPEN: {STICKING: [AHEAD, BEHIND]},
}
# `_MORE`: how many letters a word may have more than that before the corner. `_MOST`: the most that it has. `_OF_ONE`: the
# most of one element.
_MORE, _MOST, _OF_ONE = 2, 4, 3


class Elements(NamedTuple):
    """All elements of a machine.

    Attributes:
        kinds: their kinds.
        contacts: the contact that presses each friction element, -1 for none.
        begin: of each those that come to rest or close together with it, with the signs of their rows, see `SideBySide`.
        end: of each those that slip or open together with it, likewise.
    """

    kinds: tuple[int, ...]
    contacts: tuple[int, ...]
    begin: tuple[tuple[int, ...], ...]
    end: tuple[tuple[int, ...], ...]

    def follower_modes(self, i: int, kind: int, mode: Modes, after: int) -> dict[int, int] | None:
        """Modes behind an event of element `i` of those that follow it; None if it follows one itself."""
        pairs = self.end if ends_a_mode(kind) else self.begin
        is_one = lambda first, other: _are_alike(pairs[first][other], mode[first], mode[other])  # noqa: E731
        if any(pairs[j][i] and is_one(j, i) for j in range(i)):
            return None
        return {j: _seen_along(sign, after) for j, sign in enumerate(pairs[i]) if sign and is_one(i, j)}

    def is_consistent(self, mode: Modes) -> bool:
        """Whether elements side by side do the same in a mode, but for friction of open contacts."""
        return all(
            not sign
            or (self.kinds[i] == FRICTION and FREE in (mode[i], mode[j]))
            or _are_alike(sign, mode[i], mode[j])
            for i, signs in enumerate(self.end)
            if self.kinds[i] in (FRICTION, COMPLIANT)
            for j, sign in enumerate(signs)
        )


def _seen_along(sign: int, mode: int) -> int:
    """Mode of a follower, along a row of the same or the other sign."""
    if rests_in(mode):
        return KEPT
    return mode if sign > 0 else {AHEAD: BEHIND, BEHIND: AHEAD}.get(mode, mode)


def _are_alike(sign: int, first: int, other: int) -> bool:
    """Whether two elements side by side do the same."""
    return (rests_in(first) and rests_in(other)) or other == _seen_along(sign, first)


@lru_cache(maxsize=1024)
def words_between(
    modes: tuple[Modes, Modes], acting: tuple[int, ...], elements: Elements, before: Word
) -> tuple[Word, ...]:
    """All other words of events of some elements that lead from modes to modes, those with the fewest other events first.

    Args:
        modes: the modes of all elements before the word, and behind it.
        acting: numbers of the elements that have events.
        elements: all elements of the machine.
        before: the word before the corner. One impact of an element makes two only if there was one.
    """
    most = min(len(before) + _MORE, _MOST)
    hits = {letter.stop for letter in before if letter.kind == IMPACT}
    found = []

    def extended(word: Word, mode: Modes) -> None:
        if mode == modes[1] and word != before:
            found.append(word)
        if len(word) == most:
            return
        for letter in _letters(mode, acting, elements):
            own = [one.kind % SECOND for one in (*word, letter) if one.stop == letter.stop]
            is_allowed = own.count(IMPACT) <= 1 + (letter.stop in hits) and own.count(TURN) <= 1
            if is_allowed and len(own) <= _OF_ONE:
                extended((*word, letter), letter.mode)

    extended((), modes[0])
    return tuple(sorted(found, key=lambda word: (abs(len(word) - len(before)), _num_others(word, before))))


def _num_others(word: Word, before: Word) -> int:
    """Number of events of one of two words that the other one has not."""
    own, old = (Counter((letter.kind, letter.stop) for letter in one) for one in (word, before))
    return sum(((own - old) + (old - own)).values())


def _letters(mode: Modes, acting: tuple[int, ...], elements: Elements) -> Iterator[Letter]:
    """All events that may end modes, with those behind them."""
    for i in acting:
        for kind, after in _ENDS[elements.kinds[i]].get(mode[i], []):
            own = elements.follower_modes(i, kind, mode, after)
            if own is None:
                continue
            known = own | {i: after}
            choices = [
                [known[j]]
                if j in known
                else _modes_behind(mode[j], kind, after, elements.kinds[j], elements.contacts[j] == i)
                for j in range(len(mode))
            ]
            yield from (Letter(kind, i, new) for new in product(*choices) if elements.is_consistent(new))


def _modes_behind(own: int, event: int, after: int, kind: int, is_tied: bool) -> list[int]:
    """Modes of an element of a kind behind the event of another one, `is_tied` if that is the contact that presses it."""
    if kind != FRICTION or event % SECOND in (SLIP, STICK, TURN):
        return [own]
    if is_tied and (own == FREE or after in (FREE, INSIDE)):
        return [FREE] if after in (FREE, INSIDE) else [AHEAD, BEHIND, STICKING]
    return [own, *_JUMPS.get(event % SECOND, {}).get(own, [])]


def meaning(word: Word) -> tuple:
    """Motion of a machine on a word, which leaves a contact that pushes no more without an event."""
    return tuple(
        (kind, stop, tuple(FREE if own == INSIDE else own for own in mode))
        for kind, stop, mode in word
        if kind != LEAVE
    )
