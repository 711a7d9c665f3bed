"""Motion of machines with friction and Jenkins elements in one set of modes, by a Taylor series."""

from typing import Any, NamedTuple

import numpy as np
from resting_bodies import Rigid

ORDER = 24


class Rubbing(NamedTuple):
    """Friction along a row: constant forces, and coefficients (mu, static mu, number of the contact)."""

    row: np.ndarray
    velocity: float
    force: float
    static: float
    tied: tuple[tuple[float, float, int], ...]


class Slider(NamedTuple):
    row: np.ndarray
    stiffness: float
    limit: float
    start: float


class Bodies(NamedTuple):
    """A machine: matrices, load mean + amplitude cos(frequency t + phase), and its elements."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    mean: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    frequency: float
    contacts: list
    friction: list
    sliders: tuple = ()


class Flow:
    """Motion y' = A y of y = (x, v, z, cos, sin, 1) in one set of modes, and the guards, rows that stay positive."""

    def __init__(self, run: Any, modes: tuple):
        b, n = run.bodies, run.n
        contacts, friction, sliders = run.split(modes)
        direct = [{"+": 1.0, "-": -1.0}.get(mode, 0.0) for mode in friction]
        inverse = np.linalg.inv(b.mass)
        springs = self._springs(run, contacts, direct, sliders)
        force = self._held(run, contacts, friction, direct, inverse, springs)
        a = np.zeros((run.size, run.size))
        a[:n, n : 2 * n], a[n : 2 * n] = np.eye(n), inverse @ force
        for j, (slider, mode) in enumerate(zip(b.sliders, sliders, strict=True)):
            if mode != "stick":
                a[2 * n + j, n : 2 * n] = slider.row
        a[-3, -2], a[-2, -3] = -b.frequency, b.frequency
        self.matrix = a
        self.guards = self._guards(run, contacts, friction, sliders)
        self.step = min(0.05, 1 / (np.abs(np.linalg.eigvals(a)).max() + 1e-9))

    def _springs(self, run, contacts, direct, sliders) -> np.ndarray:
        """Forces on the masses without those of what holds, as rows of y."""
        b, n = run.bodies, run.n
        force = np.zeros((n, run.size))
        force[:, :n], force[:, n : 2 * n] = -b.stiffness, -b.damping
        force[:, -3], force[:, -2] = b.amplitude * np.cos(b.phase), -b.amplitude * np.sin(b.phase)
        force[:, -1] = b.mean
        pairs = zip(b.contacts, contacts, strict=True)
        self.normal = [run.spring(c) if mode == "closed" else np.zeros(run.size) for c, mode in pairs]
        for f, s in zip(b.friction, direct, strict=True):
            force -= s * np.outer(f.row, f.force * run.one + sum(mu * self.normal[i] for mu, _, i in f.tied))
        for c, own in zip(b.contacts, self.normal, strict=True):
            force -= np.outer(c.row, own)
        for j, (slider, mode) in enumerate(zip(b.sliders, sliders, strict=True)):
            s = {"+": 1.0, "-": -1.0}.get(mode, 0.0)
            stretch = run.stretch(j) if mode == "stick" else s * slider.limit * run.one
            force -= np.outer(slider.row, stretch)
        return force

    def _held(self, run, contacts, friction, direct, inverse, force) -> np.ndarray:
        """Forces with those of contacts that hold, and the friction that they press, and of friction that sticks."""
        b = run.bodies
        held = [k for k, mode in enumerate(contacts) if mode == "held"]
        stuck = [k for k, mode in enumerate(friction) if mode == "stick"]
        self.is_singular, self.tangent = False, {}
        if not held and not stuck:
            return force
        rows = np.array([b.contacts[k].row for k in held] + [b.friction[k].row for k in stuck])
        ways = rows.copy()
        for i, k in enumerate(held):
            for f, s in zip(b.friction, direct, strict=True):
                ways[i] += s * sum(mu for mu, _, at in f.tied if at == k) * f.row
        among = rows @ inverse @ ways.T
        # Dependent rows have no unique forces: such sets are left out.
        self.is_singular = np.linalg.cond(among) > 1e10
        forces = np.linalg.pinv(among, rcond=1e-10) @ rows @ inverse @ force
        for k, own in zip(held, forces, strict=False):
            self.normal[k] = own
        self.tangent = dict(zip(stuck, forces[len(held) :], strict=True))
        return force - ways.T @ forces

    def _guards(self, run, contacts, friction, sliders) -> np.ndarray:
        """Rows that are positive as long as the modes last."""
        b, rows = run.bodies, []
        self.owners: list[int] = []
        own = lambda k: self.owners.extend([k] * (len(rows) - len(self.owners)))  # noqa: E731
        for k, (c, mode) in enumerate(zip(b.contacts, contacts, strict=True)):
            gap = run.gap(c)
            if isinstance(c, Rigid):
                rows.append(gap if mode == "open" else self.normal[k])
            elif mode == "open":
                rows.append(gap)
            elif mode == "held":
                rows += [self.normal[k], c.preload * run.one - self.normal[k]]
            else:
                rows += [-gap, run.spring(c) if mode == "closed" else -run.spring(c)]
            own(k)
        for k, (f, mode) in enumerate(zip(b.friction, friction, strict=True)):
            if mode == "stick":
                grip = f.static * run.one + sum(mu * self.normal[i] for _, mu, i in f.tied)
                rows += [grip - self.tangent[k], grip + self.tangent[k]]
            elif mode != "none":
                rows.append(run.sliding(f) * (1 if mode == "+" else -1))
            own(len(contacts) + k)
        for j, (slider, mode) in enumerate(zip(b.sliders, sliders, strict=True)):
            if mode == "stick":
                rows += [slider.limit * run.one - run.stretch(j), slider.limit * run.one + run.stretch(j)]
            else:
                rows.append(run.speed(slider) * (1 if mode == "+" else -1))
            own(len(contacts) + len(friction) + j)
        return np.array(rows).reshape(-1, run.size)

    def series(self, y: np.ndarray) -> np.ndarray:
        terms = [y]
        for k in range(1, ORDER + 1):
            terms.append(self.matrix @ terms[-1] / k)
        return np.array(terms)

    def stands(self, y: np.ndarray) -> bool:
        """Whether the first derivative that is not zero of every guard is positive."""
        if self.is_singular:
            return False
        value, size = y, np.abs(y)
        undecided = np.ones(len(self.guards), bool)
        for _ in range(5):
            g, noise = self.guards @ value, 1e-10 * (np.abs(self.guards) @ size) + 1e-13
            if np.any(undecided & (g < -noise)):
                return False
            undecided &= np.abs(g) <= noise
            value, size = self.matrix @ value, np.abs(self.matrix) @ size
        return True
