"""Siconos tutorials: a mass on a spring with dry friction, FrictionOscillator."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .value import Value


def oscillator() -> vx.Solution:
    """Run x'' + x = -sgn x' from x = 12, v = 6, to its rest."""
    machine = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], friction=[vx.Friction(0, force=1.0)])
    return vx.simulate(machine, 0.0, 25.0, [12.0], [6.0])


def values() -> list[Value]:
    """All numbers: the printed one is by time steps of 0.01, the others are the closed form."""
    sol = oscillator()
    t, kind = np.asarray(sol.events.t), np.asarray(sol.events.kind)
    first = float(np.arctan2(6.0, 13.0))
    turns, (rest,) = t[kind == vx.TURN], t[kind == vx.STICK]
    # Between turns the middle of the motion is at 1 or -1: each turn lies 2 nearer to 0 than the one before.
    farthest = float(np.hypot(13.0, 6.0)) - 1
    exact = -1 - (farthest - 3) * np.cos(4.98 - first - np.pi)
    reason = "printed by a scheme of first order with steps of 0.01"
    return [
        Value("FrictionOscillator", "x(4.98)", -2.7058, 1e-4, float(sol.evaluate(4.98)[0][0]), exact, reason),
        Value("FrictionOscillator", "first turn", 0.4324077756, 1e-10, float(turns[0]), first),
        Value("FrictionOscillator", "turns", 7, 1, float(len(turns)), 7),
        Value("FrictionOscillator", "rests from", 22.4235563507, 1e-10, float(rest), first + 7 * np.pi),
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the motion and its phase portrait."""
    sol, left, right = oscillator(), *axes
    vx.plot.time_series(sol, ax=left, legend=False)
    left.plot(4.98, -2.7058, "s", markerfacecolor="none", markersize=9)
    left.set_title("FrictionOscillator, printed value as a square", fontsize="medium")
    vx.plot.phase_portrait(sol, ax=right, legend=False)
