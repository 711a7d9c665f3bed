"""Siconos tutorials: ten beads in touch that fall on a floor, BeadColumnED_NewtonLaw."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .value import Value

BEADS, HEIGHT, GRAVITY, END, PRINTED = 10, 0.05, 9.81, 0.12, 0.8037088823063164


def column() -> vx.Solution:
    """Drop the column: all impacts are elastic, and beads that touch stay together where nothing pulls them apart."""
    machine = vx.models.bead_column(num_beads=BEADS, restitution=1.0, gravity=GRAVITY)
    return vx.simulate(machine, 0.0, END, np.full(BEADS, HEIGHT), np.zeros(BEADS))


def values() -> list[Value]:
    """The velocity of the lowest bead after the column has hit the floor as one body."""
    hit = np.sqrt(2 * HEIGHT / GRAVITY)
    exact = GRAVITY * hit - GRAVITY * (END - hit)
    found = float(column().v1[0])
    return [
        Value(
            "BeadColumnED",
            "v1(0.12)",
            PRINTED,
            1e-16,
            found,
            exact,
            "printed by time steps, to their rounding",
        )
    ]


def draw(axes: list[Axes]) -> None:
    """Draw heights and velocities of the lowest and the highest bead."""
    sol = column()
    ts = np.linspace(0.0, END, 400)
    left, right = axes
    for ax, states, name in zip(axes, sol.evaluate(ts), ("Height", "Velocity"), strict=True):
        ax.plot(ts, np.asarray(states)[:, 0], label="bead 0")
        ax.plot(ts, np.asarray(states)[:, -1], "--", label=f"bead {BEADS - 1}")
        ax.set(xlabel="Time", ylabel=name)
    right.plot(END, PRINTED, "s", markerfacecolor="none", markersize=9)
    left.set_title("BeadColumnED, printed value as a square", fontsize="medium")
    left.legend()
