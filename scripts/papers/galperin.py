"""G. Galperin, Playing pool with pi, Regular and Chaotic Dynamics 8 (2003): two balls and a wall count the digits of pi."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .value import Value

MASSES = (1.0, 100.0, 1e4)


def balls(mass: float) -> vx.Solution:
    """Run a ball that comes against another one at rest before a wall, all elastic."""
    wall, contact = vx.Stop(0, 0.0, "lower", 1.0), vx.Contact({0: 1.0, 1: -1.0}, 0.0, 1.0)
    machine = vx.ImpactSystem([1.0, mass], np.zeros((2, 2)), np.zeros((2, 2)), None, [wall, contact])
    return vx.simulate(machine, 0.0, 8.0, [1.0, 2.0], [0.0, -1.0])


def values() -> list[Value]:
    """The numbers of collisions, floor(pi sqrt(M))."""
    return [
        Value("two balls", f"collisions, M = {mass:g}", printed, 1, float(balls(mass).num_events), printed)
        for mass, printed in zip(MASSES, (3, 31, 314), strict=True)
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the motions of two pairs."""
    for ax, mass in zip(axes, MASSES[:2], strict=True):
        sol = balls(mass)
        vx.plot.time_series(sol, ax=ax, legend=False)
        ax.set_title(f"M = {mass:g}: {int(sol.num_events)} collisions", fontsize="medium")
