"""Sequences and cycles with room for more events, so that one program serves many of them."""

from typing import Any

import numpy as np

from .._orbits.sequence import NOTHING, Sequence
from .parameter_family import ExtendedCycle

# Padded numbers of events for which kernels are compiled.
_ROOMS = 16, 64, 256, 1024
# ROOM_OF_SIMULATION: least padded number of events of a simulation of few branches, so that one program serves most.
ROOM_OF_SIMULATION = _ROOMS[1]
# SPARE: room for bounces that a simulation has and its cycle has not.
# _STICKS: room for sticks in the log of a simulation, as a share of that for events.
SPARE, _STICKS = 4, 0.5
MOST_EVENTS = _ROOMS[-1] - SPARE


def room_of_log(room: int) -> int:
    """Room in the log of a simulation for so many events of a cycle."""
    return room + int(_STICKS * room)


def room_for(num_events: int) -> int:
    """Padded number of events."""
    room = next((room for room in _ROOMS if room >= num_events + SPARE), None)
    if room is None:
        raise ValueError(f"A branch came to a cycle of {num_events} events, and {MOST_EVENTS} are the most.")
    return room


def padded(sequence: Sequence, arguments: tuple, room: int) -> tuple:
    """Pad a sequence, and the cycles among the arguments."""
    more = room - len(sequence.kind)
    if not more:
        return sequence, *arguments
    kind, stop, mode = sequence
    longer = Sequence(_longer(kind, more, NOTHING), _longer(stop, more, 0), _longer(mode, more, mode[-1]))
    return longer, *(
        a._replace(flights=_with_zeros(a.flights, more)) if isinstance(a, ExtendedCycle) else a
        for a in arguments
    )


def padded_for_run(sequence: Sequence, arguments: tuple, room: int) -> tuple:
    """`padded` for a simulation, which has `ROOM_OF_SIMULATION` at least."""
    return padded(sequence, arguments, max(room, ROOM_OF_SIMULATION))


def _with_zeros(flights: np.ndarray, more: int) -> np.ndarray:
    """Durations of flights, along the last axis, with zeros behind."""
    zeros = np.zeros((*np.shape(flights)[:-1], more), np.asarray(flights).dtype)
    return np.concatenate([flights, zeros], axis=-1)


def _longer(rows: np.ndarray, more: int, last: Any) -> np.ndarray:
    """Rows with more of them behind."""
    num, rows = len(rows), np.asarray(rows)
    found = np.empty((num + more, *rows.shape[1:]), rows.dtype)
    found[:num], found[num:] = rows, last
    return found


def trimmed(tree: Any, num_events: int) -> Any:
    """Remove the padding of a sequence or a cycle."""
    if isinstance(tree, ExtendedCycle):
        return tree._replace(flights=tree.flights[:num_events])
    return Sequence(tree.kind[:num_events], tree.stop[:num_events], tree.mode[: num_events + 1])
