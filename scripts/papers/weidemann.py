"""T. Weidemann, L. A. Bergman, A. F. Vakakis & M. Krack, Nonlinear Dynamics (2025): a ball in the cavity of an oscillator."""

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import brentq

import vijax as vx

from .independent_structures import CavityFlights
from .value import Value

# Shares of the mass, damping ratio of the oscillator, restitution, frequency and gap.
BALL, DAMPING, RESTITUTION, FREQUENCY, GAP = 0.02, 1e-3, 0.8, 0.99, 25.0

# Positions and velocities close to the orbit.
GUESS = [55.345, 63.227, 13.292, 51.365]


def amplitude_by_one_harmonic() -> float:
    """Return the amplitude of the oscillator by the law of one harmonic, at two impacts a period."""
    rho = (2 / np.pi) * (1 - RESTITUTION) / (1 + RESTITUTION)

    def gap(ratio: float) -> float:
        # Of the ratio of amplitude and gap.
        swing = (1 + np.sqrt((1 + rho**2) * ratio**2 - rho**2)) / (1 + rho**2)
        force = (swing - 1) / ratio - 1j * rho * swing / ratio
        stiffness = 1 - (1 - BALL) * FREQUENCY**2 + 2j * DAMPING * FREQUENCY
        return 1 / abs(stiffness * ratio - 8 * BALL * swing * FREQUENCY**2 * force / np.pi**2)

    return GAP * float(np.asarray(brentq(lambda ratio: gap(ratio) - GAP, 1.5, 4.0, xtol=1e-14)))


def orbit() -> vx.PeriodicOrbit:
    """Find the orbit of one impact a period on either end of the cavity."""
    ends = [vx.Contact({i: 1.0, 1 - i: -1.0}, GAP, RESTITUTION) for i in (0, 1)]
    load = vx.Harmonic([1.0, 0.0], FREQUENCY)
    machine = vx.ImpactSystem([1 - BALL, BALL], np.diag([2 * DAMPING, 0.0]), np.diag([1.0, 0.0]), load, ends)
    return vx.periodic_orbit(machine, GUESS[:2], GUESS[2:])


def first_harmonic(found: vx.PeriodicOrbit) -> float:
    """Return the amplitude of the oscillator's first harmonic."""
    period, number = float(found.period), 2**14
    ts = period * np.arange(number) / number
    position = np.asarray(vx.simulate(found.system, 0.0, period, found.x0, found.v0).evaluate(ts)[0])[:, 0]
    return float(2 * abs(np.mean(position * np.exp(-2j * np.pi * ts / period))))


def values() -> list[Value]:
    """The amplitude by the published law, beside that of the exact orbit."""
    reason = "the law has one harmonic; the orbit has all, of which this is the first"
    law, found = amplitude_by_one_harmonic(), first_harmonic(orbit())
    exact = CavityFlights(BALL, DAMPING, FREQUENCY, GAP, RESTITUTION).first_harmonic(np.array(GUESS))
    return [
        Value("ball in a cavity", "amplitude by the law", 57.39199, 1e-5, law),
        Value("ball in a cavity", "amplitude", 57.39199, 1e-5, found, exact, reason),
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the orbit and the relative motion."""
    found, (left, right) = orbit(), axes
    sol = vx.simulate(found.system, 0.0, 2 * found.period, found.x0, found.v0)
    vx.plot.time_series(sol, ax=left, legend=False)
    left.axhline(amplitude_by_one_harmonic(), color="0.5", linestyle=":")
    left.set_title("amplitude by one harmonic, dotted", fontsize="medium")
    vx.plot.relative_motion(sol, contact=[0, 1], ax=right, legend=False)
