"""Invariant circles by Newton's method on the invariance of a circle under the stroboscopic map.

Unknowns are the states K(theta) at equal angles, the rotation number rho and the parameter. The equations are
P(K(theta)) = K(theta + rho) at these angles, a phase condition that keeps the circle from turning in itself, and one more,
which fixes the place along the family of circles.
"""

from typing import NamedTuple

import numpy as np

from .._orbits.newton import has_converged, is_worth_a_step
from .circle import Circle, interpolation, rates
from .section_map import MapOfStates, Mapped

# Most Newton steps, and a step that counts as converged, relative to the scale.
_MAX_STEPS, _SMALL = 10, 1e-9


class CorrectedCircle(NamedTuple):
    """Circle that satisfies the equations at its angles.

    Attributes:
        circle: the circle.
        mapped: images of its states.
        tangent: unit tangent of the family.
        error: largest distance between images and circle, half way between the angles.
        num_steps: Newton steps.
    """

    circle: Circle
    mapped: Mapped
    tangent: Circle
    error: float
    num_steps: int


def corrected(section: MapOfStates, guess: Circle, way: Circle) -> CorrectedCircle | None:
    """Circle in the plane through a guess that is normal to `way`; None where Newton's method fails."""
    now, row, rate = guess, _row(way), rates(guess.states)
    size = last = np.float64(np.finfo(float).max)
    number = 0
    while is_worth_a_step(size, last, number, _MAX_STEPS, tolerance=_SMALL):
        equations, matrix = _linearised(section, now, rate, row)
        equations[-2] = np.sum((now.states - guess.states) * rate) / len(rate)
        equations[-1] = now.minus(guess).along(way)
        if not (np.isfinite(matrix).all() and np.isfinite(equations).all()):
            return None
        try:
            step = np.linalg.solve(matrix, equations)
        except np.linalg.LinAlgError:
            return None
        now = now.minus(_circle(step, now))
        size, last, number = np.abs(step).max(), size, number + 1
    if not has_converged(size):
        return None
    mapped = section(now.states, now.parameter)
    return CorrectedCircle(now, mapped, _tangent(matrix, now), error_of(section, now), number)


def error_of(section: MapOfStates, circle: Circle) -> float:
    """Largest distance between images and circle half way between its angles, in the scale of the states."""
    num = len(circle.states)
    between = circle.angles + 0.5 / num
    images = section(interpolation(between, num) @ circle.states, circle.parameter).states
    there = interpolation(between + circle.rotation, num) @ circle.states
    return float(np.abs(images - there).max())


def _linearised(
    section: MapOfStates, now: Circle, rate: np.ndarray, row: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Equations without the last two, and the matrix of all."""
    num, size = now.states.shape
    mapped = section(now.states, now.parameter)
    shift = interpolation(now.angles + now.rotation, num)
    equations = np.concatenate([(mapped.states - shift @ now.states).ravel(), np.zeros(2)])
    matrix = np.zeros((num * size + 2, num * size + 2))
    blocks = matrix[:-2, :-2].reshape(num, size, num, size)
    blocks[np.arange(num), :, np.arange(num)] = mapped.jacobians
    for k in range(size):
        blocks[:, k, :, k] -= shift
    matrix[:-2, -2] = -(shift @ rates(now.states)).ravel()
    matrix[:-2, -1] = mapped.slopes.ravel()
    matrix[-2, :-2] = rate.ravel() / num
    matrix[-1] = row
    return equations, matrix


def _row(way: Circle) -> np.ndarray:
    return np.concatenate([way.states.ravel() / len(way.states), [way.rotation, way.parameter]])


def _circle(unknowns: np.ndarray, like: Circle) -> Circle:
    return Circle(unknowns[:-2].reshape(like.states.shape), float(unknowns[-2]), float(unknowns[-1]))


def _tangent(matrix: np.ndarray, like: Circle) -> Circle:
    right = np.zeros(len(matrix))
    right[-1] = 1.0
    way = _circle(np.linalg.solve(matrix, right), like)
    length = np.sqrt(way.along(way))
    return Circle(way.states / length, way.rotation / length, way.parameter / length)
