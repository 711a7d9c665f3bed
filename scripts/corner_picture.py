"""Picture of a corner of a branch, for the page of the method: `python scripts/corner_picture.py` writes docs/corner.png.

A mass that a load drives against friction (J. P. den Hartog, Trans. ASME 53 (1931)) turns at once at high frequencies, and
sticks before it turns at low ones.
"""

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import vijax as vx

PATH, BOUNDS, BESIDE = "forcing.frequency", (0.6, 0.85), (0.68, 0.7227, 0.78)
TO = Path(__file__).resolve().parent.parent / "docs/corner.png"


def machine(frequency: float) -> vx.ImpactSystem:
    """The machine at a frequency of its load."""
    load = vx.Harmonic([1.5], frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, friction=[vx.Friction(0, 1.0)])


def branch() -> vx.Branch:
    """The branch of its periodic motions."""
    system = machine(0.8)
    sol = vx.simulate(system, 0.0, 60 * system.forcing.period, throw=False)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), PATH, BOUNDS, progress=False)


def margins(orbit: vx.PeriodicOrbit) -> tuple[float, float]:
    """Margins of an orbit: how long it sticks before it turns, in periods, and the force beyond the grip where it turns."""
    sol, period = orbit.solution(), orbit.system.forcing.period
    own = slice(0, int(sol.num_events))
    kinds, times = np.asarray(sol.events.kind[own]), np.asarray(sol.events.t[own])
    sticks = np.flatnonzero(kinds == vx.STICK)
    if len(sticks):
        first = sticks[0]
        return float(((np.roll(times, -1) - times) % period)[first] / period), np.nan
    turn = np.flatnonzero(kinds == vx.TURN)[0]
    position, _ = sol.evaluate(times[turn])
    load = 1.5 * np.cos(2 * np.pi * times[turn] / period)
    return np.nan, float(abs(load - position[0]) - 1.0)


def velocities(ax: Axes) -> None:
    """Velocity around the turn, on both sides of the corner and at it."""
    for frequency, style in zip(BESIDE, ("-", "--", "-."), strict=True):
        system = machine(frequency)
        start = vx.simulate(system, 0.0, 60 * system.forcing.period, throw=False)
        times = np.linspace(0, system.forcing.period, 4001)
        sol = vx.simulate(system, 0.0, times[-1], start.x1, start.v1, ts=times)
        v = np.asarray(sol.vs[:, 0])
        last = np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0))[0]
        near = (times - times[last]) / times[-1]
        ax.plot(near, v, style, label=f"{frequency:.4g}")
    ax.set(xlim=(-0.1, 0.2), ylim=(-0.4, 0.4), xlabel="time from the halt / periods", ylabel="velocity")
    ax.legend(title="frequency")


def both_margins(ax: Axes, found: vx.Branch) -> None:
    """Margins of both words over the frequency, which vanish at the corner."""
    values = np.array([margins(found.orbit(row)) for row in range(len(found))])
    (corner,) = found.bifurcations
    order = np.argsort(found.values)
    ax.plot(
        found.values[order], values[order, 0], "-", label="(STICK, SLIP): duration of the stick / periods"
    )
    ax.plot(found.values[order], values[order, 1], "-.", label="(TURN): force beyond the grip")
    ax.plot(corner.value, 0, "ko", label=f"corner, {corner.kind}")
    ax.set(xlabel="frequency", ylabel="margin", ylim=(-0.02, 0.85))
    ax.legend()


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    fig, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    velocities(axes[0])
    both_margins(axes[1], branch())
    fig.savefig(TO, dpi=110)
