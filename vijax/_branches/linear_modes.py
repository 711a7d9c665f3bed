"""Modes of a machine that touches no stop, and where their amplitudes touch one."""

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from .._system.system import ImpactSystem, mass_matrix
from .tolerances import EXACT, ROUNDED


class LinearMode(NamedTuple):
    """A linear mode: its number, frequency, shape of modal mass 1, and the amplitude at which it touches a stop."""

    number: int
    frequency: float
    shape: np.ndarray
    touch: float


def linear_modes(system: ImpactSystem) -> list[LinearMode]:
    """Modes that vibrate, in the order of their frequencies."""
    squares, shapes = scipy.linalg.eigh(np.asarray(system.stiffness), mass_matrix(system.mass))
    found = []
    for k, (square, shape) in enumerate(zip(squares, shapes.T, strict=True)):
        if square > EXACT * max(abs(squares)):
            least = min((one.amplitude for one in touches(system, shape)), default=np.inf)
            found.append(LinearMode(k, float(np.sqrt(square)), shape, least))
    return found


class TouchedStop(NamedTuple):
    """A stop that a mode touches: its number, whether the shape moves towards it, and the amplitude at which they touch."""

    stop: int
    is_ahead: bool
    amplitude: float


def touches(system: ImpactSystem, shape: np.ndarray) -> list[TouchedStop]:
    """The stops that a shape moves towards, or away from."""
    moves = [float(stop.along(shape)) for stop in system.stops]
    gaps = [float(stop.gap(0 * shape, np.zeros(()))) for stop in system.stops]
    return [
        TouchedStop(j, a > 0, gap / abs(a)) for j, (a, gap) in enumerate(zip(moves, gaps, strict=True)) if a
    ]


def first_touches(system: ImpactSystem, mode: LinearMode) -> list[TouchedStop]:
    """The stops that a mode touches first, at both ends of its swing."""
    return [
        one for one in touches(system, mode.shape) if abs(one.amplitude - mode.touch) < ROUNDED * mode.touch
    ]


def energy_at(mode: LinearMode, amplitude: Any) -> Any:
    return (mode.frequency * amplitude) ** 2 / 2


def touches_several(system: ImpactSystem, mode: LinearMode) -> bool:
    """True if a mode touches several stops at one end of its swing at once."""
    ends = [one.is_ahead for one in first_touches(system, mode)]
    return len(ends) != len(set(ends))
