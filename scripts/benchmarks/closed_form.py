"""Orbits and branches of one mass: time against error, beside continuation by SciPy.

The mass of the impact demo of COCO (damping 0.1, stop at 1, restitution 0.8, forcing frequency 1) impacts once a
period. Its speed of impact is known for two amplitudes of the load, and the branch between them is followed.
"""

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.integrate
import scipy.optimize

import vijax as vx

from .report import say
from .timing import in_turns, repeated

DAMPING, RESTITUTION, PERIOD = 0.1, 0.8, 2 * np.pi
AMPLITUDE = "forcing.amplitude[0]"
# Amplitudes at both ends of the branch, and the speeds of impact there.
ENDS, SPEEDS = (0.2, 1.0), (0.29861285205633, 1.6957329375949)
TOLERANCES = 1e-6, 1e-9, 1e-12
# Length of a step of the peers in the space of phase, speed and amplitude.
STEP = 0.1

# A flight from an impact: from its time, speed and amplitude to those of the next one.
Flight = Callable[[float, float, float], tuple[float, float]]


def closed_form(full: bool) -> list[dict]:
    """One orbit and the branch from it: time and error of the speed of impact, at both ends of the branch."""
    system = vx.ImpactSystem(
        [1.0], [[DAMPING]], [[1.0]], vx.Harmonic([1.0], 1.0), [vx.Stop(0, 1.0, "upper", RESTITUTION)]
    )
    find = partial(vx.periodic_orbit, system, [0.9], [1.0])
    orbit = find()
    follow = partial(vx.continuation, orbit, AMPLITUDE, ENDS, progress=False)
    branch = follow()
    timed = in_turns({"orbit": repeated(find), "branch": repeated(lambda: follow().values)}, 7 if full else 3)
    speeds = branch.points["impact_speed"].values[:, 0]
    rows = [
        {
            "method": "vijax",
            "orbit / ms": 1e3 * timed["orbit"]["min / s"],
            "orbit error": abs(float(orbit.events.velocity_minus[0]) - SPEEDS[1]),
            "branch / ms": 1e3 * timed["branch"]["min / s"],
            "points": len(branch),
            "branch error": abs(float(speeds[np.argmin(branch.values)]) - SPEEDS[0]),
        }
    ]
    say(rows[-1])
    for name, flight in {
        "closed form": closed_flight,
        **{f"solve_ivp, {tolerance:g}": partial(integrated_flight, tolerance) for tolerance in TOLERANCES},
    }.items():
        rows.append({"method": name, **_by_scipy(flight)})
        say(rows[-1])
    return rows


def _by_scipy(flight: Flight) -> dict:
    """The orbit by the hybrid method of Powell, and the branch by pseudo-arclength in steps of one length."""

    def equations(y: np.ndarray) -> np.ndarray:
        end, speed = flight(*y)
        return np.array([end - y[0] - PERIOD, speed - y[1]])

    def at(amplitude: float, guess: np.ndarray) -> np.ndarray:
        found = scipy.optimize.root(lambda u: equations(np.append(u, amplitude)), guess[:2], tol=1e-13)
        return np.append(found.x, amplitude)

    start = time.perf_counter()
    first = y = at(ENDS[1], np.array([1.0, 1.5, 0.0]))
    of_orbit, points = time.perf_counter() - start, 1
    tangent = np.array([0.0, 0.0, -1.0])
    while y[2] > ENDS[0]:
        base, ahead = y, tangent
        plane = lambda y, base=base, ahead=ahead: np.append(equations(y), (y - base) @ ahead - STEP)  # noqa: E731
        y, points = scipy.optimize.root(plane, y + STEP * tangent, tol=1e-13).x, points + 1
        tangent = (y - base) / np.linalg.norm(y - base)
    last = at(ENDS[0], y)
    return {
        "orbit / ms": 1e3 * of_orbit,
        "orbit error": abs(first[1] - SPEEDS[1]),
        "branch / ms": 1e3 * (time.perf_counter() - start),
        "points": points,
        "branch error": abs(last[1] - SPEEDS[0]),
    }


def closed_flight(start: float, speed: float, amplitude: float) -> tuple[float, float]:
    """From an impact to the next one, by the motion in closed form; its time by bracketing."""
    decay, rate = DAMPING / 2, np.sqrt(1 - DAMPING**2 / 4)

    def steady(t: float) -> np.ndarray:  # of x'' + c x' + x = A cos t
        return amplitude / DAMPING * np.array([np.sin(t), np.cos(t)])

    x, v = np.array([1.0, -RESTITUTION * speed]) - steady(start)
    sine = (v + decay * x) / rate

    def gap(t: float) -> float:
        turn = rate * (t - start)
        free = np.exp(-decay * (t - start)) * (x * np.cos(turn) + sine * np.sin(turn))
        return 1 - free - steady(t)[0]

    ts = start + np.linspace(0.05, 1.5, 60) * PERIOD
    before = np.flatnonzero(np.diff(np.sign([gap(t) for t in ts])) < 0)
    end = float(ts[-1])
    if len(before):
        ends = ts[before[0]], ts[before[0] + 1]
        end = scipy.optimize.root_scalar(gap, bracket=ends, method="brentq", xtol=1e-15, rtol=1e-15).root
    turn = rate * (end - start)
    slope = rate * (sine * np.cos(turn) - x * np.sin(turn)) - decay * (x * np.cos(turn) + sine * np.sin(turn))
    return end, np.exp(-decay * (end - start)) * slope + steady(end)[1]


def integrated_flight(tolerance: float, start: float, speed: float, amplitude: float) -> tuple[float, float]:
    """From an impact to the next one, by `solve_ivp` with its events."""

    def gap(t: float, y: np.ndarray) -> float:
        return 1 - y[0] if t > start + 0.05 * PERIOD else 1.0

    gap.terminal, gap.direction = True, -1
    found = scipy.integrate.solve_ivp(
        lambda t, y: (y[1], amplitude * np.cos(t) - DAMPING * y[1] - y[0]),
        (start, start + 1.5 * PERIOD),
        (1.0, -RESTITUTION * speed),
        "DOP853",
        events=gap,
        rtol=tolerance,
        atol=tolerance,
    )
    return found.t[-1], found.y[1, -1]
