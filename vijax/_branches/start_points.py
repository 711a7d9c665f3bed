"""First points of branches, from the orbits where they begin."""

import numpy as np

from .._machine.laws import kinds_of_elements
from .._orbits.sequence import Sequence, empty_sequence, sticks_all_along
from .._system.system import machine_of
from .follow import point_at_orbit
from .padding import room_for
from .parameter_family import ParameterFamily
from .point import BranchPoint
from .scheduler import drive
from .starts import Start, value_of
from .tolerances import IS_ONE


def points_of(starts: list[Start], families: list[ParameterFamily]) -> list[BranchPoint | None]:
    """Points at which the branches begin; None for a start that is no orbit of its machine, or not isolated."""
    which = [k for k, start in enumerate(starts) if _surplus(start, families[k]) <= families[k].num_sliders]
    tasks = []
    rooms: dict[tuple[int, tuple[int, ...]], Sequence] = {}
    for start, family in ((starts[k], families[k]) for k in which):
        room_for(start.num_events)  # raises if there are too many
        size = start.num_events, tuple(kinds_of_elements(machine_of(start.system)))
        if size not in rooms:
            rooms[size] = empty_sequence(*size)
        p = float(value_of(family.system, family.path) / family.span)
        tasks.append(point_at_orbit(rooms[size], start.state, p))
    found = dict(zip(which, drive([families[k] for k in which], tasks, lambda: None), strict=True))
    points = [found.get(k) for k in range(len(starts))]
    return [
        point
        if point is None or _surplus(starts[k], families[k]) <= _num_pinned(point, families[k])
        else None
        for k, point in enumerate(points)
    ]


def _surplus(start: Start, family: ParameterFamily) -> int:
    """Number of directions, except for rigid shifts, along which all neighbours of an orbit are orbits at the same parameter.

    At a fold one multiplier is 1, and the branch continues. Where two are, as at a resonance of a vibration without
    losses, Newton's method converges to any of the neighbours.
    """
    num_ones = np.count_nonzero(np.abs(start.multipliers - 1) < IS_ONE)
    drift = 0 if family.drift is None else np.trace(family.drift)
    return round(num_ones - 1 - 2 * np.trace(family.shifts) - drift)


def _num_pinned(point: BranchPoint, family: ParameterFamily) -> int:
    """Number of Jenkins elements that stick all along: Newton's method keeps their sliders, see `slider_pin`."""
    num = family.num_sliders
    return int(np.count_nonzero(sticks_all_along(point.sequence, num))) if num else 0


def refuse_start(number: int, start: Start, family: ParameterFamily) -> None:
    """Raise the reason why no branch begins at an orbit."""
    if _surplus(start, family) <= 0:
        raise ValueError(
            f"Orbit {number} is no periodic orbit of its machine: find one by `vx.periodic_orbit`."
        )
    raise ValueError(
        f"Orbit {number} is not isolated: two of its multipliers are exactly +1, as at a resonance without damping. All its "
        "neighbours repeat as well, and no branch is told among them. Add damping, or begin at a frequency off the resonance."
    )
