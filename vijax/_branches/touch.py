"""The impact of zero speed at which a branch grazes a stop.

Friction on a mass that turns there turns too, and a Jenkins element that slips sticks: with the impact, or of themselves
where the mass does not reach the stop. These are one letter on one side of the grazing, and their own on the other.
Friction that a light impact tears off has more events behind it, and is refused.
"""

import numpy as np

from .._hybrid.limits import IMPACT, STICK, TURN
from .._machine.kinds import COMPLIANT, FRICTION
from .._machine.state import AHEAD, BEHIND, SPRING, STICKING
from .._orbits.sequence import Sequence
from .._system.system import machine_of
from .._trajectory.concrete_machine import known_machine
from .bifurcation_setup import family_at, with_bifurcation_event
from .branch import Bifurcation
from .kinds import Kind
from .parameter_family import ExtendedCycle, ParameterFamily
from .sequence_edits import Letter, Word, exchanged, letters_between
from .starts import Start
from .tolerances import LOCATED, NEGLIGIBLE

_SLIPS = AHEAD, BEHIND


def touching_impact(point: Bifurcation) -> tuple[Start, ParameterFamily, Sequence, ExtendedCycle, int]:
    """Start and family of a grazing orbit, its cycle with the touch as an impact of zero speed, and the number of that.

    Raises:
        ValueError: if the touched stop is compliant, or the lightest impact stops friction or tears it off.
    """
    start, family, sequence, place = family_at(point, point.value - 1, point.value + 1)
    sequence, place, k, _ = with_bifurcation_event(family, Kind.GRAZING, sequence, place)
    if sequence.num_groups > 1:
        sequence, place, k = _with_turns_in_impact(sequence, place, k)
        _refuse_other_changes(start, sequence, k)
    return start, family, sequence, place, k


def turns_beside(sequence: Sequence, k: int) -> Word:
    """The events of friction and of Jenkins elements in impact `k`, as they are without it."""
    letters, mode = [], sequence.mode[k]
    for element in np.flatnonzero(sequence.mode[k] != sequence.mode[k + 1]):
        mode = np.where(np.arange(len(mode)) == element, sequence.mode[k + 1], mode)
        kind = STICK if mode[element] == SPRING else TURN
        letters.append(Letter(kind, int(element), tuple(map(int, mode))))
    return tuple(letters)


def _with_turns_in_impact(
    sequence: Sequence, place: ExtendedCycle, k: int
) -> tuple[Sequence, ExtendedCycle, int]:
    """The cycle with a touch, event `k`, and the events of friction at its time as one impact; the number of that."""
    times = np.cumsum(place.flights)
    same = np.flatnonzero((np.abs(times - times[k]) < LOCATED) & np.isin(sequence.kind, (STICK, TURN)))
    first, last = int(min([k, *same])), int(max([k, *same])) + 1
    *_, behind = letters_between(sequence, first, last)
    impact = Letter(IMPACT, int(sequence.stop[k]), behind.mode)
    return *exchanged(sequence, place, [((first, last), float(times[k]), (impact,))]), first


def _refuse_other_changes(start: Start, sequence: Sequence, k: int) -> None:
    """Raise an error if impact `k` is with a compliant stop, or does more to friction than turn it."""
    machine = known_machine(machine_of(start.system), start.args).in_numpy
    assert machine.laws is not None
    kinds, rows, mass = np.array(machine.laws.kinds), machine.rows, machine.mass
    touched, before, behind = int(sequence.stop[k]), sequence.mode[k], sequence.mode[k + 1]
    if kinds[touched] == COMPLIANT:
        raise ValueError(
            f"The compliant stop {touched} pushes a mass that just reaches it by no impact: no square root, and no other branch."
        )
    push = rows[touched] / mass if mass.ndim == 1 else np.linalg.solve(mass, rows[touched])
    moved = np.abs(rows @ push)
    is_torn = (kinds == FRICTION) & (before == STICKING) & (moved > NEGLIGIBLE * moved[touched])
    is_turn = np.isin(before, _SLIPS) & np.isin(behind, _SLIPS) & (kinds == FRICTION)
    is_stick = np.isin(before, _SLIPS) & (behind == SPRING) & (kinds > FRICTION)
    is_other = (before != behind) & ~(is_turn | is_stick)
    if np.any(is_torn | is_other):
        raise ValueError(
            f"The lightest impact with stop {touched} changes what element {np.flatnonzero(is_torn | is_other)[0]} does, for a while: "
            "the square root of a grazing, and the orbits that leave it, are found where it turns friction at most. Search beside "
            "it by `vx.find_periodic_orbits`."
        )
