"""Closed curves of the stroboscopic section, as trigonometric polynomials through their states at equal angles.

An angle of 1 is once round. With an odd number N = 2 M + 1 of states, M harmonics interpolate them, and no harmonic is
counted twice.
"""

from typing import NamedTuple

import numpy as np

# Steps along the circle over which exponents are averaged, and those left out at first.
_STEPS, _LEFT_OUT = 2000, 200


class Circle(NamedTuple):
    """Invariant circle at a value of the parameter.

    Attributes:
        states: scaled states at equal angles, (angles, 2 n).
        rotation: angle that a state gains from one section to the next.
        parameter: scaled value of the parameter.
    """

    states: np.ndarray
    rotation: float
    parameter: float

    @property
    def angles(self) -> np.ndarray:
        """Angles of the states."""
        return np.arange(len(self.states)) / len(self.states)

    def moved(self, way: "Circle", length: float) -> "Circle":
        """The circle a length along a tangent."""
        return Circle(
            self.states + length * way.states,
            self.rotation + length * way.rotation,
            self.parameter + length * way.parameter,
        )

    def minus(self, other: "Circle") -> "Circle":
        """The difference of two circles with the same angles."""
        return self.moved(other, -1.0)

    def along(self, way: "Circle") -> float:
        """Inner product; that of two curves is the mean over the angle."""
        states = np.sum(self.states * way.states) / len(self.states)
        return float(states + self.rotation * way.rotation + self.parameter * way.parameter)

    def resampled(self, num_angles: int) -> "Circle":
        """The same circle by another number of states."""
        weights = interpolation(np.arange(num_angles) / num_angles, len(self.states))
        return self._replace(states=weights @ self.states)


def interpolation(angles: np.ndarray, num: int) -> np.ndarray:
    """Weights of the states at `num` equal angles in those at other angles, (angles, num): Dirichlet's kernel."""
    away = angles[:, None] - np.arange(num) / num
    away -= np.round(away)
    is_here = np.abs(away) < np.finfo(float).eps
    away = np.where(is_here, 0.5, away)
    return np.where(is_here, 1.0, np.sin(np.pi * num * away) / (num * np.sin(np.pi * away)))


def rates(states: np.ndarray) -> np.ndarray:
    """Derivatives by the angle of the states at equal angles, at these angles."""
    harmonics = np.fft.rfft(states, axis=0)
    orders = np.arange(len(harmonics))[:, None]
    return np.fft.irfft(2j * np.pi * orders * harmonics, len(states), axis=0)


def growth_rates(circle: Circle, jacobians: np.ndarray) -> np.ndarray:
    """Lyapunov exponents of the circle, per section: zero along it, then the others, largest first.

    They are averaged along one motion on the circle, with weights that vanish at its ends, so that the error of the
    average falls faster than any power of its length (S. Das et al., Nonlinearity 30, 4111 (2017)).

    Args:
        circle: the circle.
        jacobians: derivatives of the map at its states.
    """
    num, size = circle.states.shape
    along = np.arange(_STEPS + _LEFT_OUT) * circle.rotation % 1.0
    weights = interpolation(along, num)
    matrices, tangents = np.tensordot(weights, jacobians, axes=1), weights @ rates(circle.states)
    frame, logs = np.eye(size), []
    for matrix, tangent in zip(matrices, tangents, strict=True):
        # Known without rounding, which would grow along an unstable circle.
        frame = np.column_stack([tangent / np.linalg.norm(tangent), frame[:, 1:]])
        frame, triangle = np.linalg.qr(matrix @ np.linalg.qr(frame)[0])
        with np.errstate(divide="ignore"):
            logs.append(np.log(np.abs(np.diag(triangle)[1:])))
    place = np.linspace(0, 1, _STEPS + 2)[1:-1]
    shares = np.exp(-1 / (place * (1 - place)))
    others = shares @ np.array(logs[_LEFT_OUT:]) / np.sum(shares)
    return np.concatenate([np.zeros(1), np.sort(others)[::-1]])
