"""A. Mehta & J. M. Luck, Physical Review Letters 65, 393 (1990): a ball that does not rebound on a shaken table."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .value import Value


def ball(acceleration: float) -> vx.ImpactSystem:
    """Make a ball with r = 0 and weight 1 on a table that is shaken with this greatest acceleration."""
    load = vx.Harmonic([acceleration], 1.0, mean=[-1.0])
    return vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0, "lower", 0.0)])


def flights() -> vx.Branch:
    """Follow the motion of one flight a period in the acceleration."""
    machine = ball(3.5)
    settled = vx.simulate(machine, 0.0, 40 * machine.forcing.period, [1.0])
    orbit = vx.periodic_orbit(machine, settled.x1, settled.v1)
    branch = vx.continuation(orbit, "forcing.amplitude[0]", (3.0, 4.0), progress=False)
    assert isinstance(branch, vx.Branch)
    return branch


def values() -> list[Value]:
    """Where single flights begin and where their period doubles: sqrt(1 + pi^2) and sqrt(4 + pi^2)."""
    found = {point.kind: float(point.value) for point in flights().bifurcations}
    exact = {"chatter_completion": np.sqrt(1 + np.pi**2), "pd": np.sqrt(4 + np.pi**2)}
    words = {"chatter_completion": "flights of one period from", "pd": "period doubles at"}
    return [
        Value("ball, r = 0", words[kind], float(f"{value:.10f}"), 1e-10, found[kind], value)
        for kind, value in exact.items()
    ]


def draw(axes: list[Axes]) -> None:
    """Draw a flight and the branch."""
    machine, (left, right) = ball(3.5), axes
    sol = vx.simulate(machine, 0.0, 4 * machine.forcing.period, [1.0])
    vx.plot.time_series(sol, ax=left, legend=False)
    left.set_title("G = 3.5", fontsize="medium")
    vx.plot.branch(flights(), ax=right, legend=False)
