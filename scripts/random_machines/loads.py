"""Forces of random machines that are known at every instant: loads, springs and dampers."""

import numpy as np
from scipy.interpolate import CubicSpline

from .extras import KNOTS
from .shapes import Shape


def smooth_forces(shape: Shape, own: dict, ts: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """All of them on the masses of one machine, (times, masses)."""
    cubic = own["cubic"] * x**3 if shape.is_nonlinear else 0.0
    return forces_with_power(shape, own, ts, x, v) - x @ own["stiffness"].T - cubic


def forces_with_power(shape: Shape, own: dict, ts: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Those without a potential: loads, dampers, and the stiffness that changes in time, (times, masses)."""
    turn = own["frequency"] * ts
    force = -v @ own["damping"].T
    if shape.load == "wave":
        knots, values = np.append(own["knots"], own["knots"][0] + 1), own["values"][[*range(KNOTS), 0]]
        phase = knots[0] + np.mod(turn / (2 * np.pi) - knots[0], 1.0)
        force = force + _in_table(shape.kind, knots, values, phase, "periodic")
    else:
        waves = np.cos((1 + np.arange(shape.harmonics))[:, None, None] * turn + own["phase"][..., None])
        force = force + own["mean"] + np.einsum("hi,hit->ti", own["amplitude"], waves)
    if shape.load == "table":
        is_inside = (ts >= own["knots"][0]) & (ts < own["knots"][-1])
        force = force + is_inside[:, None] * _in_table(shape.kind, own["knots"], own["values"], ts)
    if shape.is_parametric:
        force = force - np.cos(turn + own["swing_phase"])[:, None] * (x @ own["swing"].T)
    return force


def _in_table(
    kind: str, knots: np.ndarray, values: np.ndarray, ts: np.ndarray, ends: str = "not-a-knot"
) -> np.ndarray:
    """Values of a table at times, (times, masses)."""
    if kind == "previous":
        return values[np.clip(np.searchsorted(knots, ts, side="right") - 1, 0, len(knots) - 1)]
    if kind == "linear":
        return np.stack([np.interp(ts, knots, column) for column in values.T], axis=1)
    return CubicSpline(knots, values, bc_type=ends)(ts)
