"""EDF, code_aster, validation manual V5.01: masses with friction and with elastic stops, SDND100, 101, 104, 106, 108 and 122."""

import numpy as np
from matplotlib.axes import Axes

import vijax as vx

from . import independent
from .value import Value

# Gravity of SDND108; share of the motion along the slope of 45 degrees in SDND100.
GRAVITY, ALONG = 10.0, np.sqrt(0.5)


def shoe() -> vx.Solution:
    """Run SDND100: a shoe that slips along a slope to its rest."""
    machine = vx.ImpactSystem([1.0], [[0.0]], [[1e4]], friction=[vx.Friction(0, force=1.0)])
    return vx.simulate(machine, 0.0, 0.2, [0.85e-3], [0.0])


def elastic_stop() -> vx.Solution:
    """Run SDND101: a mass that is thrown on an elastic stop."""
    stop = vx.CompliantStop(0, 0.0, "upper", stiffness=1e6)
    return vx.simulate(vx.ImpactSystem([100.0], [[0.0]], [[1e4]], None, [stop]), 0.0, 0.5, [0.0], [1.0])


def floor(damping: float) -> vx.Solution:
    """Run SDND108: a mass that drops on an elastic floor."""
    stop = vx.CompliantStop(0, -2.0, "lower", stiffness=100.0, damping=damping)
    weight = vx.Harmonic([0.0], 1.0, mean=[-GRAVITY])
    return vx.simulate(vx.ImpactSystem([1.0], [[0.0]], [[0.0]], weight, [stop]), 0.0, 1.0, [0.0], [-1.0])


ENERGY, STIFFNESS, WALL, GAP = 0.00650108331626, 10.0, 50.0, 0.01


def bilinear() -> vx.Solution:
    """Run SDND122: the free motion of a mass between springs of two stiffnesses."""
    stop = vx.CompliantStop(0, GAP, "upper", stiffness=WALL)
    machine = vx.ImpactSystem([1.0], [[0.0]], [[STIFFNESS]], None, [stop])
    return vx.simulate(machine, 0.0, 4.0, [0.0], [np.sqrt(2 * ENERGY)])


def shaken(amplitude: float) -> vx.Solution:
    """Run SDND104: a mass that rubs on a support, shaken."""
    load = vx.Harmonic([amplitude], 2 * np.pi, phase=[np.pi / 2])
    machine = vx.ImpactSystem([1.0], [[0.0]], [[3e-5]], load, friction=[vx.Friction(0, force=1.0)])
    return vx.simulate(machine, 0.0, 12.0)


def pulled() -> vx.Solution:
    """Run SDND106 while its force acts: a mass that is pulled drags another one, which sticks at first."""
    rubbing = vx.Friction(0, force=2000.0, static=3000.0)
    spring, pull = (
        1e4 * np.array([[1.0, -1.0], [-1.0, 1.0]]),
        vx.Harmonic([0.0, 0.0], 1.0, mean=[0.0, 3000.0]),
    )
    machine = vx.ImpactSystem([5.0, 5.0], np.zeros((2, 2)), spring, pull, friction=[rubbing])
    return vx.simulate(machine, 0.0, 0.2)


def values() -> list[Value]:
    """All numbers."""
    return [*_of_shoe(), *_of_elastic_stop(), *_of_shaking(), *_of_pulling(), *_of_floor(), *_of_bilinear()]


def _times(sol: vx.Solution, kind: int) -> np.ndarray:
    return np.asarray(sol.events.t)[np.asarray(sol.events.kind) == kind]


def _of_shoe() -> list[Value]:
    sol, half = shoe(), np.pi / 100
    x = np.asarray(sol.evaluate(half * np.arange(1, 3))[0])[:, 0]
    exact = [(-1) ** n * (0.85e-3 - 2e-4 * n) for n in (1, 2)]
    return [
        Value(
            "SDND100",
            f"DY at t = {n} pi/100",
            printed,
            1e-7,
            float(x[n - 1]) * ALONG,
            exact[n - 1] * ALONG,
        )
        for n, printed in ((1, -4.596e-4), (2, 3.182e-4))
    ]


def _of_elastic_stop() -> list[Value]:
    sol = elastic_stop()
    opened, closed = float(_times(sol, vx.OPEN)[0]), float(_times(sol, vx.CLOSE)[-1])
    depth = float(sol.evaluate(opened / 2)[0][0])
    # The force is smooth within the contact: Gauss points give its impulse to rounding.
    node, weight = np.polynomial.legendre.leggauss(20)
    x = np.asarray(sol.evaluate(opened / 2 * (1 + node))[0])[:, 0]
    impulse = float(1e6 * opened / 2 * weight @ x)
    name, rate = "SDND101", np.sqrt(1.01e6 / 100.0)
    return [
        Value(name, "greatest force", 9950.0, 1.0, 1e6 * depth, 1e6 / rate),
        Value(name, "time of the greatest force", 0.01563, 1e-5, opened / 2, np.pi / 2 / rate),
        Value(name, "speed at the second contact", 1.0, 1e-6, float(sol.evaluate(closed)[1][0]), 1.0),
        Value(
            name,
            "impulse",
            198.05,
            1e-2,
            impulse,
            200 / 1.01,
            "printed with an allowance of 1e-3; 200/1.01 is exact",
        ),
    ]


def _of_shaking() -> list[Value]:
    left_out = "printed without the weak spring"
    found = []
    for amplitude, printed, digit in ((15.0, 15.2671, 1e-4), (1.5, 0.409062, 1e-6), (0.99, 0.0, 1e-12)):
        sol = shaken(amplitude)
        turns = np.asarray(sol.events.t)
        t = np.unique([4.0, *turns[(turns > 4) & (turns < 12)], 12.0])
        way = np.abs(np.diff(np.asarray(sol.evaluate(t)[0])[:, 0])).sum()
        found.append(
            Value(
                "SDND104",
                f"wear power, A = {amplitude:g}",
                printed,
                digit,
                10 * way / 8,
                independent.wear_power(amplitude),
                left_out,
            )
        )
    return found


def _of_pulling() -> list[Value]:
    sol, rate = pulled(), np.sqrt(1e4 / 5)
    x = np.asarray(sol.evaluate(np.array([0.02, 0.15]))[0])
    exact = independent.pulled(0.15)
    name, reason = "SDND106", "printed with a speed at the slip rounded to 13.416"
    return [
        Value(name, "mass 1 slips at", 0.03512, 1e-5, float(_times(sol, vx.SLIP)[0]), np.pi / 2 / rate),
        Value(name, "x2(0.02)", 0.11221, 1e-5, float(x[0, 1]), 0.3 * (1 - np.cos(0.02 * rate))),
        Value(name, "x1(0.15)", 1.35332, 1e-5, float(x[1, 0]), exact[0], reason),
        Value(name, "x2(0.15)", 1.80751, 1e-5, float(x[1, 1]), exact[1], reason),
    ]


def _of_floor() -> list[Value]:
    sol, root = floor(0.0), np.sqrt(41.0)
    touched, left = float(_times(sol, vx.CLOSE)[0]), float(_times(sol, vx.OPEN)[0])
    exact = (root - 1) / 10
    name, reason = (
        "SDND108",
        "the printed floor pulls until it is level; here it lets go where its force is zero",
    )
    damped, (leaves, end) = floor(5.0), independent.dropped(5.0)
    return [
        Value(
            name, "touches", 0.54031242374329, 1e-14, touched, exact, "the printed last digit is one too high"
        ),
        Value(name, "leaves", 0.88545615307643, 1e-14, left),
        Value(name, "x(1)", -1.332162981855, 1e-12, float(sol.x1[0])),
        Value(
            name, "leaves, damping 5", 0.92403882542, 1e-11, float(_times(damped, vx.OPEN)[0]), leaves, reason
        ),
        Value(name, "x(1), damping 5", -1.88214079833, 1e-11, float(damped.x1[0]), end, reason),
    ]


def _of_bilinear() -> list[Value]:
    closes = _times(bilinear(), vx.CLOSE)
    frequency = 1 / float(closes[1] - closes[0])
    e, both = ENERGY / (STIFFNESS * GAP**2), STIFFNESS + WALL
    free = 2 * np.arccos(-1 / np.sqrt(2 * e)) / np.sqrt(STIFFNESS)
    inside = 2 * np.arccos(1 / np.sqrt(1 + (2 * e - 1) * both / STIFFNESS)) / np.sqrt(both)
    exact = 1 / (free + inside)
    return [
        Value("SDND122", words, printed, digit, frequency, exact, reason)
        for words, printed, digit, reason in (
            ("frequency, harmonic balance", 0.6467033, 1e-7, "harmonics left out there"),
            ("frequency, formula", 0.646217, 1e-6, "the printed formula lacks a term"),
        )
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the shoe with its two printed positions, and the drop with its printed times."""
    sol, left, right = shoe(), *axes
    vx.plot.time_series(sol, ax=left, legend=False)
    printed = np.array([-4.596e-4, 3.182e-4]) / ALONG
    left.plot(np.pi / 100 * np.arange(1, 3), printed, "s", markerfacecolor="none", markersize=9)
    left.set_title("SDND100, printed values as squares", fontsize="medium")
    vx.plot.time_series(floor(0.0), ax=right, legend=False)
    for t in (0.54031242374329, 0.88545615307643):
        right.axvline(t, linestyle="--", linewidth=0.8, color="0.5")
    right.set_title("SDND108, printed times dashed", fontsize="medium")
