"""Rods of finite elements that hit: Siconos, ImpactingBar (a benchmark of Doyen, Ern & Piperno), and EDF, V5.02.111 (SDNL111)."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from .independent_structures import contact_of_rods
from .value import Value

ELEMENTS = 20
DENSITY, LENGTH = 7800.0, 1.0
# Modulus, area, gap and speed of the bar, time to its end.
BAR_MODULUS, BAR_AREA, BAR_GAP, BAR_SPEED, BAR_END = 210e9, 3.14e-4, 5e-5, 0.1, 1.2e-3
# Times and printed positions of the tip, and those of the waves in rods without elements.
TIMES, PRINTED, WAVES = (2e-4, 4e-4, 6e-4), (-1.00780e-4, -1.93735e-4, -9.558e-5), (-1e-4, -2e-4, -1e-4)
# Modulus, area and speed of the two rods, time to their end.
ROD_MODULUS, ROD_AREA, ROD_SPEED, ROD_END = 2e11, 4e-4, 1.0, 6.5e-4


def matrices(modulus: float, area: float) -> tuple[np.ndarray, np.ndarray]:
    """Assemble the mass and stiffness matrices of a free rod of linear elements."""
    size = LENGTH / ELEMENTS
    mass, stiffness = np.zeros((2, ELEMENTS + 1, ELEMENTS + 1))
    for i in range(ELEMENTS):
        mass[i : i + 2, i : i + 2] += DENSITY * area * size / 6 * np.array([[2, 1], [1, 2]])
        stiffness[i : i + 2, i : i + 2] += modulus * area / size * np.array([[1, -1], [-1, 1]])
    return mass, stiffness


def bar() -> vx.Solution:
    """Throw a bar on a wall that it does not leave by itself (r = 0)."""
    mass, stiffness = matrices(BAR_MODULUS, BAR_AREA)
    machine = vx.ImpactSystem(mass, 0 * mass, stiffness, stops=[vx.Stop(0, 0.0, "lower", 0.0)])
    nodes = np.ones(ELEMENTS + 1)
    return vx.simulate(machine, 0.0, BAR_END, BAR_GAP * nodes, -BAR_SPEED * nodes)


def rods_at_rest_and_thrown() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Assemble the matrices of a rod and another one, whose far end is fixed, and the speeds with which the first is thrown."""
    own_mass, own_stiffness = matrices(ROD_MODULUS, ROD_AREA)
    n = ELEMENTS + 1
    mass, stiffness = np.zeros((2, 2 * n - 1, 2 * n - 1))
    for matrix, own in ((mass, own_mass), (stiffness, own_stiffness)):
        matrix[:n, :n], matrix[n:, n:] = own, own[:-1, :-1]
    return mass, stiffness, np.where(np.arange(2 * n - 1) < n, -ROD_SPEED, 0.0)


def two_rods() -> vx.Solution:
    """Throw a rod on another one, whose far end is fixed; the tips are nodes 0 and `ELEMENTS` + 1."""
    mass, stiffness, speeds = rods_at_rest_and_thrown()
    tips = vx.Contact({0: -1.0, ELEMENTS + 1: 1.0}, 0.0, 0.0)
    machine = vx.ImpactSystem(mass, 0 * mass, stiffness, stops=[tips])
    return vx.simulate(machine, 0.0, ROD_END, 0 * speeds, speeds)


def by_scipy() -> tuple[float, float, np.ndarray]:
    """Time at which the bar leaves, its mean force, and positions of the rod's tip, of the same elements without vijax."""
    mass, stiffness = matrices(BAR_MODULUS, BAR_AREA)
    speeds, row = np.full(len(mass), -BAR_SPEED), np.eye(len(mass))[0]
    intervals, _, v = contact_of_rods(mass, stiffness, row, speeds, BAR_END, gap=BAR_GAP)
    touches, leaves = intervals[0][0], intervals[-1][1]
    force = float((mass @ (v + BAR_SPEED)).sum() / (leaves - touches))
    mass, stiffness, speeds = rods_at_rest_and_thrown()
    row = np.eye(len(mass))[0] - np.eye(len(mass))[ELEMENTS + 1]
    _, places, _ = contact_of_rods(mass, stiffness, row, speeds, ROD_END, TIMES)
    return leaves, force, places[:, 0]


def values() -> list[Value]:
    """Times and the mean force of the bar, positions of the rod's tip; exact are those of the waves, not of elements."""
    exact_leaves, exact_force, exact_tips = by_scipy()
    sol = bar()
    n, kind = int(sol.num_events), np.asarray(sol.events.kind)
    touches, leaves = np.asarray(sol.events.t)[0], np.asarray(sol.events.t)[n - 1]
    assert kind[n - 1] == vx.RELEASE
    mass, _ = matrices(BAR_MODULUS, BAR_AREA)
    momentum = (mass @ (np.asarray(sol.v1) + BAR_SPEED)).sum()
    tip = np.asarray(two_rods().evaluate(np.array(TIMES))[0])[:, 0]
    coarse = f"{ELEMENTS} elements here, 100 there; by waves 8.8545e-4"
    return [
        Value("ImpactingBar", "touches", 5e-4, 1e-8, float(touches), BAR_GAP / BAR_SPEED),
        Value("ImpactingBar", "leaves", 8.8601e-4, 1e-8, float(leaves), exact_leaves, coarse),
        Value(
            "ImpactingBar",
            "mean force",
            1270.83,
            1e-2,
            float(momentum / (leaves - touches)),
            exact_force,
            f"{ELEMENTS} elements here; printed by waves",
        ),
        *(
            Value("SDNL111", f"tip at {t:g} s", printed, 1e-9, float(x), exact, reason)
            for t, printed, x, exact, reason in zip(
                TIMES,
                PRINTED,
                tip,
                exact_tips.tolist(),
                [f"40 modes and a spring between the tips there; by waves {wave:g}" for wave in WAVES],
                strict=True,
            )
        ),
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the tips."""
    for ax, sol, end, name, tips in zip(
        axes,
        (bar(), two_rods()),
        (BAR_END, ROD_END),
        ("ImpactingBar", "SDNL111"),
        ([0, ELEMENTS], [0, ELEMENTS + 1]),
        strict=True,
    ):
        ts = np.linspace(0.0, end, 400)
        ax.plot(1e3 * ts, 1e6 * np.asarray(sol.evaluate(ts)[0])[:, tips], label=[f"node {i}" for i in tips])
        ax.set(xlabel="Time (ms)", ylabel="Position (µm)")
        ax.set_title(name, fontsize="medium")
        ax.legend()
    axes[1].plot(1e3 * np.array(TIMES), 1e6 * np.array(PRINTED), "s", markerfacecolor="none", markersize=9)
