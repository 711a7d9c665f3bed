"""The periodic response of a linear machine, and the free vibration about it, in the frame of the stops.

Between impacts z = x - w obeys M z'' + C z' + K z = f(t), w the motion of the stops, see `Frame`. Let Phi be the
mass-normalised modes, for M diagonal or full, and w_k their frequencies. In the coordinates y = diag(w) Phi^-1 z and
u = Phi^-1 z' the energy E of the free vibration is (|y|^2 + |u|^2) / 2, K is the unit matrix, the first-order matrix
is skew but for the damping, and one norm, sqrt(2 E), measures vibrations and rounding errors alike.
"""

from typing import NamedTuple

import numpy as np

from .._machine.machine import Machine
from .._system.checks import is_semidefinite, is_symmetric
from .._system.waves import Waves
from .table_waves import enough_harmonics, lanes_first, waves_of_tables

# Assumed rounding error of numbers of order 1, in units of n eps.
_SLACK = 64


class FreeModes(NamedTuple):
    """The free vibration, lanes first.

    Attributes:
        shapes: z = shapes @ y, (lanes, n, n): the norm of row i is sqrt((K^-1)_ii).
        frequencies: w, (lanes, n).
        damping: Phi^T C Phi, (lanes, n, n).
        decay: the largest real part of all eigenvalues, (lanes,).
        rounding: a bound of the errors of numbers of order 1 in these coordinates, (lanes,).
        is_damped: true where K is symmetric and regular, every mode damped, both by more than rounding, and the energy
            never grows, (lanes,); elsewhere the other fields are finite and meaningless.
    """

    shapes: np.ndarray
    frequencies: np.ndarray
    damping: np.ndarray
    decay: np.ndarray
    rounding: np.ndarray
    is_damped: np.ndarray


class PeriodicResponse(NamedTuple):
    """The periodic response, y = Re sum_h waves_h exp(i h W t), h = 0, 1, ..., lanes first.

    Attributes:
        waves: (lanes, 1 + harmonics, n).
        speeds: h W, (lanes, 1 + harmonics).
        rounding: a bound of the error in the energy norm, that of harmonics left out included, (lanes,).
        of_positions: the same of y alone.
    """

    waves: np.ndarray
    speeds: np.ndarray
    rounding: np.ndarray
    of_positions: np.ndarray

    @property
    def num_harmonics(self) -> int:
        """Number of harmonics."""
        return self.waves.shape[1] - 1


def modes_of(machine: Machine) -> FreeModes:
    """Modes of linear machines, lanes last: one for each motion, or one for all."""
    inverse_mass, c, k = map(lanes_first, (machine.contacts.inverse_mass, machine.damping, machine.stiffness))
    root, spread = _root(inverse_mass)
    of_unit_mass = lambda a: np.swapaxes(root, 1, 2) @ a @ root  # noqa: E731
    unit = _SLACK * root.shape[1] * spread * float(np.finfo(machine.damping.dtype).eps)
    squares, vectors = np.linalg.eigh(of_unit_mass(k))
    is_stiff = squares[:, 0] > unit * squares[:, -1]
    squares = np.where(is_stiff[:, None], squares, 1)
    w = np.sqrt(squares)
    damping = np.swapaxes(vectors, 1, 2) @ of_unit_mass(c) @ vectors
    diagonal = np.broadcast_to(w[:, :, None] * np.eye(w.shape[1]), damping.shape)
    # Almost skew where damping is light: rounding then moves its eigenvalues by no more than its own size.
    first_order = np.block([[np.zeros_like(damping), diagonal], [-diagonal, -damping]])
    decay = np.linalg.eigvals(first_order).real.max(axis=1)
    is_damped = is_stiff & (decay < -unit * np.linalg.norm(first_order, axis=(1, 2)))
    # Otherwise the energy may grow, although every mode is damped. Gyroscopic forces do not change it.
    is_damped = is_damped & is_symmetric(k) & is_semidefinite((c + np.swapaxes(c, 1, 2)) / 2)
    # Low modes are less accurate than high ones.
    rounding = unit * squares[:, -1] / squares[:, 0]
    return FreeModes(root @ vectors / w[:, None], w, damping, decay, rounding, is_damped)


def _root(inverse_mass: np.ndarray) -> tuple[np.ndarray, np.ndarray | float]:
    """R of M^-1 = R R^T, (lanes, n, n), and the factor by which its error exceeds that of its entries."""
    if inverse_mass.ndim == 2:
        return np.sqrt(inverse_mass)[:, :, None] * np.eye(inverse_mass.shape[1]), 1.0
    return np.linalg.cholesky(inverse_mass), np.linalg.cond(inverse_mass)


def response_of(machine: Machine, modes: FreeModes) -> PeriodicResponse:
    """The response to the load, including that of moving stops."""
    count = enough_harmonics(machine, modes.frequencies)
    table = waves_of_tables(machine, count)
    own = _of_harmonics(machine, count)
    loads = (own if table is None else own + table.waves) @ modes.shapes
    w, eye = modes.frequencies[:, None], np.eye(len(machine.mean))[None, None]
    speeds = lanes_first(machine.frequency)[:, None] * np.arange(1 + count)
    s = speeds[..., None, None]
    # K, M and C in the coordinates y.
    parts = (
        eye,
        s**2 * (eye / w[..., None] ** 2),
        s * (modes.damping[:, None] / (w[..., None] * w[:, :, None])),
    )
    stiffness = np.where(modes.is_damped[:, None, None, None], parts[0] - parts[1] + 1j * parts[2], eye)
    inverse = np.linalg.inv(stiffness)
    waves = (inverse @ loads[..., None])[..., 0]
    # The parts may cancel, and so may the loads that the frame adds, which are as large as its motion.
    magnified = _norm(inverse, 2) * sum(_norm(part, 2) for part in parts)
    moved = np.linalg.solve(modes.shapes[:, None], _frame_waves(machine, count)[..., None])[..., 0]
    size = (_norm(waves) + _norm(moved)) * (1 + speeds / w.min(axis=2))
    error = modes.rounding * (magnified * size).sum(axis=1)
    if table is not None:
        rounded = _norm((table.size[:, None] @ abs(modes.shapes))[:, 0])
        error = error + modes.rounding * _norm(inverse, 2).sum(axis=1) * rounded
        of_y, of_u = _beyond(table.jumps @ modes.shapes[:, None], modes, speeds)
        return PeriodicResponse(waves, speeds, error + of_y + of_u, error + of_y)
    return PeriodicResponse(waves, speeds, error, error)


def _of_harmonics(machine: Machine, count: int) -> np.ndarray:
    """Amplitudes of the mean load and of its harmonics, (lanes, 1 + count, n)."""
    mean, cosine, sine = map(np.asarray, (machine.mean[None], machine.waves.cosine, machine.waves.sine))
    mean = np.broadcast_to(mean, (1, *np.broadcast_shapes(mean.shape, cosine.shape)[1:]))
    waves = np.broadcast_to(cosine - 1j * sine, (len(cosine), *mean.shape[1:]))
    return _with_harmonics(lanes_first(np.concatenate([mean, waves])), count)


def _with_harmonics(waves: np.ndarray, count: int) -> np.ndarray:
    """Amplitudes with zeros for further harmonics, (lanes, 1 + count, ...)."""
    return np.pad(waves, [(0, 0), (0, 1 + count - waves.shape[1]), (0, 0)])


def _beyond(jumps: np.ndarray, modes: FreeModes, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the harmonics above the last of `speeds`, of y and of u; infinite where modes are too fast for one.

    There modes answer by their inertia, y = (w / s)^2 F and u = w F / s, but for a share q of it by stiffness and damping. The sum of
    h^-p above H is less than H^(1 - p) / (p - 1).

    Args:
        jumps: those of the derivatives of the load of each mode, (lanes, orders, knots, n).
        modes: the modes.
        speeds: h W, (lanes, 1 + H).
    """
    w, count, speed = modes.frequencies, speeds.shape[1] - 1, speeds[:, 1]
    slowest_left = speeds[:, -1] + speed
    drag = np.maximum(_norm(modes.damping, 2), _norm(w[:, :, None] * modes.damping / w[:, None], 2))
    q = (w.max(axis=1) / slowest_left) ** 2 + drag / slowest_left
    factor = np.where(q < 1 / 2, 1 / (1 - np.minimum(q, 1 / 2)), np.inf) / np.pi
    p = np.arange(1, jumps.shape[1] + 1)
    sums = [_norm(jumps * w[:, None, None] ** k).sum(axis=2) for k in (2, 1)]
    of_y = (sums[0] * float(count) ** -(p + 1) / (p + 1)).sum(axis=1) / speed**2
    of_u = (sums[1] * float(count) ** -p / p).sum(axis=1) / speed
    return factor * of_y, factor * of_u


def residual_vibration(
    machine: Machine,
    modes: FreeModes,
    response: PeriodicResponse,
    angle: float,
    state: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Bound sqrt(2 E), E the energy of the difference between a motion and the response, rounding of both included.

    The state is positions and velocities in the fixed frame at the phase `angle` of the load, (lanes, n) each.
    """
    x, v = (_solve(modes.shapes, a) for a in state)
    frame = _frame_waves(machine, response.num_harmonics)
    w, w_rate = (_solve(modes.shapes, a) for a in _at(frame, response.speeds, angle))
    y, y_rate = _at(response.waves, response.speeds, angle)
    u, w_u, y_u = (a / modes.frequencies for a in (v, w_rate, y_rate))
    left = np.hypot(_norm(x - w - y), _norm(u - w_u - y_u))
    size = sum(_norm(a) for a in (x, w, y, u, w_u, y_u))
    return left + response.rounding + modes.rounding * size


def harmonics_of(motion: Waves | None, num_rows: int, count: int) -> np.ndarray:
    """Complex amplitudes of a motion, zero if there is none, h = 0, 1, ..., (lanes, 1 + count, rows)."""
    if motion is None:
        return np.zeros((1, 1 + count, num_rows), complex)
    waves = np.asarray(motion.cosine) - 1j * np.asarray(motion.sine)
    return _with_harmonics(lanes_first(np.concatenate([np.zeros_like(waves[:1]), waves])), count)


def _frame_waves(machine: Machine, count: int) -> np.ndarray:
    """Harmonics of the motion of the frame, (lanes, 1 + count, n)."""
    frame = machine.frame
    return harmonics_of(None if frame is None else frame.waves, len(machine.mean), count)


def _at(waves: np.ndarray, speeds: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Value and rate of a sum of harmonics at a phase."""
    turned = waves * np.exp(1j * angle * np.arange(waves.shape[1]))[:, None]
    return turned.real.sum(axis=1), (1j * speeds[..., None] * turned).real.sum(axis=1)


def _solve(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


def _norm(a: np.ndarray, axes: int = 1) -> np.ndarray:
    return np.linalg.norm(a, axis=tuple(range(-axes, 0)))
