"""Chains of bodies with contacts, friction and compliant stops, integrated independently of vijax.

Between events the motion of a mode is a matrix exponential, sampled densely, and the first zero of a guard is found by
bisection. At each event all sets of modes of what is closed and at rest are tried, by brute force: each is integrated
over a very short time, and stands if no law is broken there. Impacts try all sets of contacts with an impulse (Moreau).
No number is shared with the package; it is accurate to about 1e-8, and slow.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import linprog

# Sizes of a gap, a speed and a force that are zero, in machines of size one.
GAP, SPEED, FORCE = 1e-9, 1e-8, 1e-9
# Time after an instant at which a set of modes is judged, and time between samples.
SHORT, SAMPLE = 1e-5, 0.01


class Rigid(NamedTuple):
    row: np.ndarray
    position: float
    restitution: float


class Soft(NamedTuple):
    row: np.ndarray
    position: float
    stiffness: float
    damping: float
    preload: float


class Rubbing(NamedTuple):
    row: np.ndarray
    force: float
    static: float


class Bodies(NamedTuple):
    """A machine: masses, matrices, load mean + amplitude cos(frequency t), and its elements."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    mean: np.ndarray
    amplitude: np.ndarray
    frequency: float
    elements: list


class Undecided(Exception):
    """No set of modes stands, or the motion chatters: the machine is left out."""


# Modes: free, held (rigid, compliant at rest, friction that sticks), closed compliant, slip ahead and behind.
FREE, HELD, CLOSED, AHEAD, BEHIND = "free", "held", "closed", "ahead", "behind"


def _modes_at_rest(element) -> list[str]:
    if isinstance(element, Rigid):
        return [HELD, FREE]
    return [HELD, CLOSED, FREE] if isinstance(element, Soft) else [HELD, AHEAD, BEHIND]


class _Flow:
    """Linear motion in one mode: y' = A y of y = (x, v, cos, sin, 1), with the forces of what holds as rows of y."""

    def __init__(self, bodies: Bodies, modes: tuple):
        n = len(bodies.mass)
        force = np.zeros((n, 2 * n + 3))
        force[:, :n], force[:, n : 2 * n] = -bodies.stiffness, -bodies.damping
        force[:, 2 * n], force[:, -1] = bodies.amplitude, bodies.mean
        rows = []
        for element, mode in zip(bodies.elements, modes, strict=True):
            if mode == HELD:
                rows.append(element.row)
            elif mode == CLOSED:
                force -= np.outer(element.row, spring_of(element, n))
            elif mode in (AHEAD, BEHIND):
                force[:, -1] -= element.row * element.force * (1 if mode == AHEAD else -1)
        inverse = np.diag(1 / bodies.mass)
        self.reaction = np.zeros((len(modes), 2 * n + 3))
        if rows:
            rows = np.array(rows)
            # Of dependent rows the forces are not unique; the feasible ones are found in `_holds`.
            self.rows, needed = rows, rows @ inverse @ force
            solved = np.linalg.pinv(rows @ inverse @ rows.T, rcond=1e-10) @ needed
            self.reaction[[k for k, mode in enumerate(modes) if mode == HELD]] = solved
            force = force - rows.T @ solved
        self.force, self.acceleration = force, inverse @ force
        a = np.zeros((2 * n + 3, 2 * n + 3))
        a[:n, n : 2 * n], a[n : 2 * n] = np.eye(n), self.acceleration
        a[2 * n, 2 * n + 1], a[2 * n + 1, 2 * n] = -bodies.frequency, bodies.frequency
        self.matrix, self.cache = a, {}

    def step(self, y: np.ndarray, dt: float) -> np.ndarray:
        if dt not in self.cache:
            if len(self.cache) > 4:
                return expm(self.matrix * dt) @ y
            self.cache[dt] = expm(self.matrix * dt)
        return self.cache[dt] @ y


def spring_of(element: Soft, n: int) -> np.ndarray:
    """F0 + k d + c d' as a row of y."""
    row = np.zeros(2 * n + 3)
    row[:n], row[n : 2 * n] = element.stiffness * element.row, element.damping * element.row
    row[-1] = element.preload - element.stiffness * element.position
    return row


class Run:
    """A motion from one event to the next."""

    def __init__(self, bodies: Bodies, x0, v0):
        self.bodies, self.n = bodies, len(bodies.mass)
        self.flows = {}
        self.t, self.y = 0.0, np.concatenate([x0, v0, [1.0, 0.0, 1.0]])
        self.modes = tuple(FREE for _ in bodies.elements)
        self.recent = []
        self.settle()

    @property
    def x(self):
        return self.y[: self.n]

    @property
    def v(self):
        return self.y[self.n : 2 * self.n]

    def flow(self, modes):
        if modes not in self.flows:
            self.flows[modes] = _Flow(self.bodies, modes)
        return self.flows[modes]

    def gap(self, element, y):
        return element.position - element.row @ y[: self.n]

    def speed(self, element, y):
        return element.row @ y[self.n : 2 * self.n]

    def settle(self):
        """Impacts, and then the modes of all elements, those at rest by brute force."""
        self.impact()
        choices = []
        for k, element in enumerate(self.bodies.elements):
            w = self.speed(element, self.y)
            if isinstance(element, Rubbing):
                moving = AHEAD if w > 0 else BEHIND
                choices.append(_modes_at_rest(element) if abs(w) < SPEED else [moving])
                continue
            gap = self.gap(element, self.y)
            if isinstance(element, Rigid):
                at_rest = abs(gap) < GAP and abs(w) < SPEED
                choices.append(_modes_at_rest(element) if at_rest else [FREE])
            elif abs(gap) < GAP and abs(w) < SPEED:
                choices.append(_modes_at_rest(element))
            elif abs(gap) < GAP:
                choices.append([CLOSED if w > 0 and self.spring(element, self.y) > 0 else FREE])
            else:
                changed = self.modes[k] if abs(self.spring(element, self.y)) > FORCE else None
                inside = (
                    [CLOSED, FREE]
                    if changed is None
                    else [CLOSED if self.spring(element, self.y) > 0 else FREE]
                )
                choices.append([FREE] if gap > 0 else inside)
        standing = [m for m in itertools.product(*choices) if self.stands(m)]
        if not standing:
            raise Undecided(f"no set stands at {self.t}")
        rubs = [isinstance(e, Rubbing) for e in self.bodies.elements]

        def count(modes):
            held = [mode == HELD for mode in modes]
            return sum(h and r for h, r in zip(held, rubs, strict=True)), sum(held)

        self.modes = max(standing, key=count)

    def spring(self, element, y):
        return spring_of(element, self.n) @ y

    def impact(self):
        """Moreau's law over the contacts hit and those closed, by trying all sets with an impulse."""
        closed = [
            (e, self.speed(e, self.y))
            for e, mode in zip(self.bodies.elements, self.modes, strict=True)
            if isinstance(e, Rigid)
            and abs(self.gap(e, self.y)) < GAP
            and self.speed(e, self.y) > (-SPEED if mode == HELD else -1e-7)
        ]
        if not any(u > SPEED for _, u in closed):
            return
        rows = np.array([e.row for e, _ in closed])
        u = np.array([w if w > SPEED else 0.0 for _, w in closed])
        r = np.array([e.restitution for e, _ in closed])
        g = rows @ np.diag(1 / self.bodies.mass) @ rows.T
        for active in itertools.product([True, False], repeat=len(closed)):
            s = np.flatnonzero(active)
            p = np.zeros(len(closed))
            if len(s):
                p[s] = np.linalg.lstsq(g[np.ix_(s, s)], ((1 + r) * u)[s], rcond=None)[0]
            rest = -(u - g @ p + r * u)
            if (p > -1e-12).all() and (rest > -1e-12).all() and abs(p @ rest) < 1e-10:
                self.y = self.y.copy()
                self.y[self.n : 2 * self.n] -= rows.T @ p / self.bodies.mass
                self.recent = [t for t in self.recent if t > self.t - 0.02] + [self.t]
                if len(self.recent) > 6:
                    raise Undecided("chatter")
                return
        raise Undecided("impact")

    def stands(self, modes) -> bool:
        """Whether no law is broken a very short time after this instant."""
        flow = self.flow(modes)
        y = self.y.copy()
        for dt in (SHORT, 2 * SHORT):
            y = flow.step(self.y, dt)
            for element, mode in zip(self.bodies.elements, modes, strict=True):
                if mode == AHEAD and self.speed(element, y) < -1e-14:
                    return False
                if mode == BEHIND and self.speed(element, y) > 1e-14:
                    return False
                if (
                    isinstance(element, Rigid)
                    and mode == FREE
                    and self.gap(element, y) < -2e-15 + min(0, self.gap(element, self.y))
                ):
                    return False
                if isinstance(element, Soft):
                    depth, moved = -self.gap(element, y), -self.gap(element, y) + self.gap(element, self.y)
                    at_rest = (
                        abs(self.gap(element, self.y)) < GAP and abs(self.speed(element, self.y)) < SPEED
                    )
                    if at_rest and ((mode == CLOSED and moved < -2e-15) or (mode == FREE and moved > 2e-15)):
                        return False
                    if not at_rest and depth > GAP and mode == FREE and self.spring(element, y) > FORCE:
                        return False
                    if not at_rest and depth > GAP and mode == CLOSED and self.spring(element, y) < -FORCE:
                        return False
        return self.holds(flow, modes, y)

    def bounds(self, element):
        if isinstance(element, Rigid):
            return 0.0, np.inf
        return (0.0, element.preload) if isinstance(element, Soft) else (-element.static, element.static)

    def holds(self, flow, modes, y) -> bool:
        """Whether some forces within the bounds hold what is held: of dependent rows by a linear programme."""
        held = [e for e, mode in zip(self.bodies.elements, modes, strict=True) if mode == HELD]
        if not held:
            return True
        forces = flow.reaction[[k for k, mode in enumerate(modes) if mode == HELD]] @ y
        limits = [self.bounds(e) for e in held]
        if all(low - FORCE <= f <= high + FORCE for f, (low, high) in zip(forces, limits, strict=True)):
            return True
        if np.linalg.matrix_rank(flow.rows, tol=1e-9) == len(held):
            return False
        total = flow.rows.T @ forces
        wide = [(low - FORCE, high + FORCE) for low, high in limits]
        return linprog(np.zeros(len(held)), A_eq=flow.rows.T, b_eq=total, bounds=wide).status == 0

    def broken(self, y) -> bool:
        """Whether a guard of the present modes is negative."""
        for element, mode in zip(self.bodies.elements, self.modes, strict=True):
            if isinstance(element, Rigid) and mode == FREE and self.gap(element, y) < 0:
                return True
            if mode in (AHEAD, BEHIND) and self.speed(element, y) * (1 if mode == AHEAD else -1) < 0:
                return True
            if (
                isinstance(element, Soft)
                and mode == FREE
                and (self.gap(element, y) < 0 and self.spring(element, y) > 0)
            ):
                return True
            if (
                isinstance(element, Soft)
                and mode == CLOSED
                and (self.gap(element, y) > 0 or self.spring(element, y) < 0)
            ):
                return True
        return not self.holds(self.flow(self.modes), self.modes, y)

    def until(self, t1: float):
        """State at t1."""
        while self.t < t1 - 1e-13:
            flow = self.flow(self.modes)
            low, start, is_broken = 0.0, self.y, False
            high = min(2 * SHORT, t1 - self.t)
            while True:
                end = flow.step(start, high - low)
                is_broken = self.broken(end)
                if is_broken or high >= t1 - self.t:
                    break
                low, high, start = high, min(high + SAMPLE, t1 - self.t), end
            if is_broken:
                end, high = self._zero(flow, start, low, high)
            self.t, self.y = self.t + high, end
            if is_broken:
                self.settle()
        return self.x, self.v

    def _zero(self, flow, start, low, high):
        """End of the flight from `start` at `low`, just after the first guard vanishes before `high`."""
        first = low
        while high - low > 2e-13:
            middle = (low + high) / 2
            low, high = (low, middle) if self.broken(flow.step(start, middle - first)) else (middle, high)
        return flow.step(start, high - first), high


def random_chain(seed: int, soft: bool = False, walls: bool = False) -> tuple[Bodies, np.ndarray, np.ndarray]:
    """Three bodies in a row with contacts between them, friction on two of them, a soft or rigid stop; and a start."""
    rng = np.random.default_rng(seed)
    choose = lambda *a: float(rng.choice(a))  # noqa: E731
    mass = np.array([choose(1.0, 1.0, 0.8, 2.0), choose(1.0, 1.3), choose(1.0, 0.3, 1.5)])
    row = lambda **a: np.array([a.get(f"x{i}", 0.0) for i in range(3)])  # noqa: E731
    r = choose(0.0, 0.3, 0.5)
    elements: list = [
        Rigid(row(x0=1.0, x1=-1.0), -1.0, r),
        Rigid(row(x1=1.0, x2=-1.0), -1.0, choose(0.0, r, 0.5)),
    ]
    if walls:
        elements.append(Rigid(row(x2=1.0), 2.0 + choose(0.0, 0.1, 0.3), choose(0.0, 0.4)))
    if soft:
        stop = Soft(
            row(x2=1.0), 2.0 + choose(0.0, 0.0, 0.1), choose(10.0, 30.0), choose(0.0, 0.2), choose(0.2, 0.5)
        )
        elements.append(stop)
    for body in rng.choice(3, 2, replace=False):
        force = rng.uniform(0.05, 0.6)
        elements.append(Rubbing(row(**{f"x{body}": 1.0}), force, force * choose(1.0, 1.0, 1.2, 1.5)))
    mean, amplitude = rng.uniform(-0.3, 0.3, 3) + np.array([0.25, 0.0, -0.15]), rng.uniform(-0.5, 0.5, 3)
    stiffness = np.diag([choose(0.0, 0.3), 0.0, choose(0.0, 0.3)])
    damping = np.diag([choose(0.0, 0.1), 0.0, 0.0])
    stiffness[2] *= 1.0
    x0 = np.array([0.0, 1.0, 2.0]) - np.array(
        [choose(0.0, 0.2, 0.4), 0.0, -choose(0.0, 0.0, 0.2)]
    ) * np.array([1, 1, 0 if (soft or walls) else 1])
    v0 = np.array([choose(0.0, 0.3, 0.8) if x0[0] < 0 else 0.0, 0.0, 0.0])
    return Bodies(mass, damping, stiffness, mean, amplitude, rng.uniform(0.7, 1.5), elements), x0, v0
