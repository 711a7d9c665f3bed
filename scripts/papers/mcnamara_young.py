"""S. McNamara & W. R. Young, Physics of Fluids A 4, 496 (1992): three equal particles on a line, of which one moves."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .value import Value

# The last value of e with a fourth collision.
FOURTH = 3 - 2 * np.sqrt(2.0)


def particles(restitution: float) -> vx.Solution:
    """Run the first particle against two at rest."""
    contacts = [vx.Contact({k: 1.0, k + 1: -1.0}, 0.0, restitution) for k in (0, 1)]
    machine = vx.ImpactSystem([1.0] * 3, np.zeros((3, 3)), np.zeros((3, 3)), None, contacts)
    return vx.simulate(machine, 0.0, 400.0, [0.0, 1.0, 2.0], [1.0, 0.0, 0.0])


def values() -> list[Value]:
    """Speeds after all collisions, and their number on both sides of the boundary."""
    found = []
    for e in (0.3, 0.6):
        exact = (1 - e) * (3 + e**2) / 8, (1 - e**2) * (3 - e) / 8, ((1 + e) / 2) ** 2
        found += [
            Value("three particles", f"speed {k}, e = {e:g}", formula, 1e-14, float(v), formula)
            for k, (v, formula) in enumerate(zip(np.asarray(particles(e).v1), exact, strict=True))
        ]
    found += [
        Value("three particles", f"collisions, e = {e:.4f}", count, 1, float(particles(e).num_events), count)
        for e, count in ((FOURTH + 1e-3, 3), (FOURTH - 1e-3, 4))
    ]
    return found


def draw(axes: list[Axes]) -> None:
    """Draw the motions with three and with more collisions."""
    for ax, e in zip(axes, (0.6, 0.1), strict=True):
        sol = particles(e)
        vx.plot.time_series(sol, span=(0.0, 8.0), ax=ax, legend=False)
        ax.set_title(f"e = {e:g}: {int(sol.num_events)} collisions", fontsize="medium")
