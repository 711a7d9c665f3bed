"""B. Bernu & R. Mazighi, Journal of Physics A 23, 5745 (1990): two equal beads are thrown on a wall."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .value import Value

# How far from the critical restitution two beads part or stay, and in the pictures.
CLOSE = 1e-3


# Restitution below which the impacts never end, tan^2(pi/8).
CRITICAL = float(np.tan(np.pi / 8) ** 2)


def thrown(restitution: float) -> vx.Solution:
    """Throw two beads at speed 1, a length 1 apart."""
    limits = [vx.Stop(0, 0.0, "lower", restitution), vx.Contact({0: 1.0, 1: -1.0}, 0.0, restitution)]
    machine = vx.ImpactSystem([1.0, 1.0], np.zeros((2, 2)), np.zeros((2, 2)), stops=limits)
    return vx.simulate(machine, 0.0, 1e6, [1.0, 2.0], [-1.0, -1.0])


def parted(restitution: float) -> bool:
    """Flag of finitely many impacts, after which the second bead flies faster than the first."""
    sol = thrown(restitution)
    return vx.STICK not in np.asarray(sol.events.kind)[: int(sol.num_events)]


def values() -> list[Value]:
    """On which side of the critical restitution the impacts end: 1 for beads that part, 0 for beads that rest together."""
    return [
        Value("two beads", f"part at r_c {side:+g}", printed, 1, float(parted(CRITICAL + side)), printed)
        for side, printed in ((-CLOSE, 0), (CLOSE, 1))
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the throw on both sides of the critical restitution."""
    for ax, side in zip(axes, (-CLOSE, CLOSE), strict=True):
        sol = thrown(CRITICAL + side)
        vx.plot.time_series(sol, span=(0.0, 4.0), ax=ax, legend=False)
        ax.set_title(
            f"r = r_c {side:+g}: {'parted' if parted(CRITICAL + side) else 'at rest'}", fontsize="medium"
        )
