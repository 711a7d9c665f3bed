"""H. Tang, notes in `HongTang973/NonsmoothSystem`: self-excited cycles of a mass, after Andronov, and of two coupled ones."""

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import brentq

import vijax as vx

from . import independent
from .value import Value

# Damping ratio and restitution.
CASES = ((-0.05, 0.6), (-0.1, 0.5))
# Coupling of two masses, and printed periods of their cycles.
COUPLED = ((0.0, 4.74997), (0.01, 4.7885159))


def cycle(damping_ratio: float, restitution: float) -> vx.PeriodicOrbit:
    """Find the cycle of x'' + 2 xi x' + x = 0 with a stop at 1."""
    stop = vx.Stop(0, 1.0, "upper", restitution)
    return vx.periodic_orbit(
        vx.ImpactSystem([1.0], [[2 * damping_ratio]], [[1.0]], stops=[stop]), [0.5], [0.0]
    )


def coupled_cycle(coupling: float) -> vx.PeriodicOrbit:
    """Find the cycle of two coupled masses, the first with negative damping and a stop below its rest under a unit force."""
    s = np.sqrt(10) * coupling
    stiffness = np.array([[1.0, 9 * s], [9 * s, 9.0]])
    stop = vx.Stop(0, -np.linalg.solve(stiffness, [1.0, 0.0])[0], "lower", 0.3)
    machine = vx.ImpactSystem(
        [[1.0, -s], [-s, 1.0]], [[-0.2, 0.6 * s], [0.6 * s, 0.6]], stiffness, stops=[stop]
    )
    return vx.periodic_orbit(machine, [0.5, 0.0], [0.0, 0.0])


def andronov(damping_ratio: float, restitution: float) -> tuple[float, float]:
    """Return w T and the multiplier by Andronov's function, of g = -xi / w."""
    g = -damping_ratio / np.sqrt(1 - damping_ratio**2)

    def phi(t: float, g: float) -> float:
        return 1 - np.exp(g * t) * (np.cos(t) - g * np.sin(t))

    def ratio(t: float) -> float:
        return phi(t, g) / phi(t, -g)

    found = brentq(
        lambda t: ratio(t) * np.exp(-2 * g * t) - restitution, np.pi + 1e-6, 2 * np.pi - 1e-6, xtol=1e-15
    )
    turn = float(np.asarray(found))
    return turn, float(ratio(turn) ** 2 * np.exp(-2 * g * turn))


def values() -> list[Value]:
    """Periods and multipliers beside those of Andronov's function, and periods of the coupled masses."""
    found = []
    for xi, r in CASES:
        orbit, (turn, multiplier) = cycle(xi, r), andronov(xi, r)
        ours = float(orbit.period) * np.sqrt(1 - xi**2), float(np.real(np.asarray(orbit.multipliers)[1]))
        words = f"xi = {xi:g}, r = {r:g}"
        found += [
            Value("Andronov's cycle", f"w T, {words}", turn, 1e-12, ours[0], turn),
            Value("Andronov's cycle", f"multiplier, {words}", multiplier, 1e-12, ours[1], multiplier),
        ]
    late = "printed one output step of 0.001 late"
    return found + [
        Value(
            "coupled masses",
            f"period, coupling {coupling:g}",
            period,
            digit,
            float(coupled_cycle(coupling).period),
            independent.coupled_period(coupling),
            late,
        )
        for (coupling, period), digit in zip(COUPLED, (1e-5, 1e-7), strict=True)
    ]


def draw(axes: list[Axes]) -> None:
    """Draw both cycles."""
    for ax, (xi, r) in zip(axes, CASES, strict=True):
        vx.plot.phase_portrait(cycle(xi, r), ax=ax, legend=False)
        ax.set_title(f"xi = {xi:g}, r = {r:g}", fontsize="medium")
