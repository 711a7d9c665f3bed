"""Words whose equations are singular at a corner: the cycle with their letters a given time apart.

Impacts that graze at several stops, and a contact that closes and opens, begin at double roots. The sum of the times between
the new letters is held fixed instead of a tangent; as it shrinks the cycle must come to the corner, else it is of another branch.
"""

import numpy as np

from ..behind_event import is_joined
from ..parameter_family import ExtendedCycle
from ..point import BranchPoint, corrected
from ..requests import Requests
from ..tolerances import APART, NEAR
from .corner import Corner, CycleOnWords
from .following import is_behind, is_followed_behind


def apart(corner: Corner, trial: CycleOnWords) -> Requests[BranchPoint | None]:
    """The followed point behind a corner with the letters of a word a given time apart; None if there is none."""
    if not any(trial.words):
        return None
    event, sequence, place = corner.event, trial.sequence, trial.place
    moves = _moves(corner, trial)
    for length in APART:
        guess = place._replace(flights=place.flights + length * np.diff(moves, prepend=0.0))
        weights = ExtendedCycle(0 * place.z, np.diff(moves, prepend=0.0), 0 * place.p)
        cycle = yield from corrected(sequence, guess, weights, guess.along(weights))
        if not cycle.found.is_converged:
            continue
        new = BranchPoint.of(sequence, cycle, event.arc)
        away = new.place.distance_of_starts(event.place)
        if not (away < NEAR and is_behind(new, corner, trial.words)):
            continue
        followed = yield from is_followed_behind(new, corner.num_periods)
        if followed is None or not (yield from is_joined(event, new)):
            continue
        followed = followed._replace(arc=event.arc + away)
        return followed if new.tangent.along(weights) > 0 else followed.turned()
    return None


def _moves(corner: Corner, trial: CycleOnWords) -> np.ndarray:
    """By how much each event moves as letters part by 1 in all; one that is alone comes earlier."""
    moves = np.zeros(len(trial.sequence.kind))
    shift = 0
    for instant, word in zip(corner.instants, trial.words, strict=True):
        first, num = instant.first + shift, len(word)
        moves[first : first + num] = np.arange(num) - (num - 1) / 2 if num > 1 else -1.0
        shift += num - (instant.last - instant.first)
    return moves
