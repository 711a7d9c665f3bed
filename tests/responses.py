"""Periodic response of linear machines, harmonic by harmonic, and a machine to compute it for."""

import numpy as np

import vijax as vx

LOAD = vx.Harmonic(
    [[0.3, 0.1, 0.0], [0.05, 0.0, 0.2]], 0.9, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], [0.1, 0.0, -0.2]
)
SHAKEN = vx.Harmonic([[0.4], [0.1]], 0.9, [[0.7], [0.2]], [0.05])
# Far from all motions; one of them moves, so the frame moves too.
FAR = [vx.Stop(0, 50.0, "upper", 0.7), vx.Stop(2, 60.0, "upper", 0.7, SHAKEN)]
UNEVEN = vx.chain([1.0, 0.5, 2.0], [0.3, 0.1, 0.2], [1.0, 3.0, 0.7], LOAD, FAR)


def matrices(system: vx.ImpactSystem) -> tuple[np.ndarray, ...]:
    return np.diag(system.mass), np.asarray(system.damping), np.asarray(system.stiffness)


def amplitudes(system: vx.ImpactSystem, waves: np.ndarray) -> np.ndarray:
    """Response to a load Re sum_h waves_h exp(i h W t), h = 1, 2, ..., harmonic by harmonic."""
    m, c, k = matrices(system)
    speeds = float(system.forcing.frequency) * np.arange(1, len(waves) + 1)
    return np.array(
        [np.linalg.solve(k - s**2 * m + 1j * s * c, f) for s, f in zip(speeds, waves, strict=True)]
    )


def response_at(system: vx.ImpactSystem, angle: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of the periodic response, in the fixed frame."""
    load = system.forcing
    waves = amplitudes(system, np.atleast_2d(load.amplitude * np.exp(1j * np.asarray(load.phase))))
    orders = np.arange(1, len(waves) + 1)[:, None]
    turned = waves * np.exp(1j * orders * angle)
    rate = 1j * orders * float(load.frequency) * turned
    mean = np.linalg.solve(system.stiffness, load.mean)
    return mean + turned.real.sum(axis=0), rate.real.sum(axis=0)
