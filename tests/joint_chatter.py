"""Joint chatter, bounce after bounce, by a solver that shares only the machines with the engine.

Two contacts that feed each other's bounces come to rest together after infinitely many of them. This solver follows
the bounces down to a speed, closes both contacts inelastically there, and holds them from then on. The error vanishes
with that speed: the limit is the motion. Between events a machine is linear, z' = B z with z = (x, v, cos W t, sin W
t, 1), and is advanced by its Taylor series; gaps are updated by increments, so that light bounces keep their digits.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

import vijax as vx

_ORDER, _STEP, _MOST_STEPS, _MOST_BOUNCES = 12, 0.05, 40, 400
_NO_REST = "The contacts do not come to rest together."
_FREQUENCY = 1.3


class Machine(NamedTuple):
    """A machine of n coordinates with two contacts at position zero, and a start at rest.

    Its damping couples the contacts and the directions that they leave free.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    mean: np.ndarray
    amplitude: np.ndarray
    rows: np.ndarray
    restitution: np.ndarray
    x0: np.ndarray

    @property
    def system(self) -> vx.ImpactSystem:
        """The same machine in vijax."""
        load = vx.Harmonic(self.amplitude, _FREQUENCY, mean=self.mean)
        contacts = [
            vx.Contact(dict(enumerate(a)), 0.0, r) for a, r in zip(self.rows, self.restitution, strict=True)
        ]
        return vx.ImpactSystem(self.mass, self.damping, self.stiffness, load, contacts)


def dropped_stack(restitution: float, damping: float = 2.0) -> Machine:
    """Two beads on a floor, and a mass that hangs from the upper one by a spring and a damper."""
    mass, link = np.array([1.0, 0.5, 0.8]), np.array([0.0, 1.0, -1.0])
    between = np.outer(link, link)
    rows = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0]])
    force = -mass * np.array([1.0, 1.0, 0.0])
    x0, still = np.array([0.2, 0.3, 0.3]), np.zeros(3)
    return Machine(np.diag(mass), damping * between, between, force, still, rows, np.full(2, restitution), x0)


def random_machine(seed: int) -> Machine:
    """Random matrices and rows, both contacts pressed."""
    random = np.random.default_rng(seed)
    square = lambda: (lambda a: a @ a.T / 3)(random.normal(size=(3, 3)))  # noqa: E731
    mass, stiffness, damping = square() + np.eye(3) / 2, square(), square() / 3
    rows = random.normal(size=(2, 3))
    mean, amplitude = rows.T @ random.uniform(1, 2, 2), 0.2 * random.normal(size=3)
    restitution, weighted = random.uniform(0.2, 0.7, 2), np.linalg.solve(mass, rows.T)
    x0 = -weighted @ np.linalg.solve(rows @ weighted, random.uniform(0.05, 0.2, 2))
    return Machine(mass, damping, stiffness, mean, amplitude, rows, restitution, x0)


class Closing(NamedTuple):
    """Time at which the bounces are cut off, and the state at the end, (2 n,)."""

    t: float
    end: np.ndarray


def closings(machine: Machine, t1: float, speeds: list[float], *, is_damped: bool = True) -> list[Closing]:
    """Close both contacts once their bounces are slower than each of some falling speeds, and hold them until t1.

    Dampers act on all coordinates while gaps close: by an impulse of C times the displacement. Without it,
    `is_damped=False`, the error is of the second order in the speed.
    """
    n, inverse, a = len(machine.mass), np.linalg.inv(machine.mass), machine.rows
    moved = inverse @ a.T  # velocity changes by unit impulses
    g = a @ moved
    back = np.linalg.solve(g, moved.T).T
    free, held = _first_order(machine, inverse), _first_order(machine, inverse - back @ a @ inverse)
    z, t, gap = np.concatenate([machine.x0, np.zeros(n), [1.0, 0.0, 1.0]]), 0.0, -a @ machine.x0
    found: list[Closing] = []
    for _ in range(_MOST_BOUNCES):
        z, t, gap, j = _next_impact(free, a, z, t, gap)
        z[n : 2 * n] -= (1 + machine.restitution[j]) * (a[j] @ z[n : 2 * n]) / g[j, j] * moved[:, j]
        pull = np.linalg.solve(g, a @ (free @ z)[n : 2 * n]) / np.diag(np.linalg.inv(g))
        fastest = np.sqrt((a @ z[n : 2 * n]) ** 2 + 2 * np.maximum(pull * gap, 0)).max()
        while fastest < speeds[len(found)] and (pull > 0).all():
            way = back @ gap
            v = z[n : 2 * n] - (inverse @ machine.damping @ way if is_damped else 0)
            closed = np.concatenate([z[:n] + way, v - back @ (a @ v), z[2 * n :]])
            found.append(Closing(t, (expm(held * (t1 - t)) @ closed)[: 2 * n]))
            if len(found) == len(speeds):
                return found
    raise ValueError(_NO_REST)


def _first_order(machine: Machine, mobility: np.ndarray) -> np.ndarray:
    """B of z' = B z."""
    n = len(machine.mass)
    b = np.zeros((2 * n + 3, 2 * n + 3))
    b[:n, n : 2 * n] = np.eye(n)
    loads = machine.amplitude[:, None] * [1, 0, 0] + machine.mean[:, None] * [0, 0, 1]
    b[n : 2 * n] = mobility @ np.hstack([-machine.stiffness, -machine.damping, loads])
    b[2 * n, 2 * n + 1], b[2 * n + 1, 2 * n] = -_FREQUENCY, _FREQUENCY
    return b


def _next_impact(b: np.ndarray, rows: np.ndarray, z: np.ndarray, t: float, gap: np.ndarray) -> tuple:
    """State, time and gaps at the next impact, and its contact."""
    n = rows.shape[1]
    for _ in range(_MOST_STEPS):
        series = [z]
        for k in range(1, _ORDER + 1):
            series.append(b @ series[-1] / k)
        ways = -rows @ np.array(series)[:, :n].T
        ways[:, 0] = gap
        times = [_first_root(way) for way in ways]
        j = int(np.argmin(times))
        step = min(times[j], _STEP)
        change = step ** np.arange(1, _ORDER + 1) @ np.array(series[1:])
        z, t, gap = z + change, t + step, gap - rows @ change[:n]
        if times[j] <= _STEP:
            gap[j] = 0.0
            return z, t, gap, j
    raise ValueError(_NO_REST)


def _first_root(way: np.ndarray) -> float:
    """First time within a step at which the gap with this series closes; infinite if there is none."""
    path = np.polynomial.Polynomial(way if way[0] else way[1:])
    slope, roots = path.deriv(), np.linalg.eigvals(np.polynomial.polynomial.polycompanion(path.coef))
    is_real = abs(roots.imag) <= 1e-7 * abs(roots)
    for root in np.sort(roots.real[is_real & (roots.real > 0) & (roots.real <= _STEP)]):
        for _ in range(6):
            root -= path(root) / slope(root)
        if root > 0:
            return float(root)
    return np.inf
