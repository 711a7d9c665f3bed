"""Rods, a beam and a ball in a cavity where a printed number differs, by SciPy alone: exponentials of the motion, events by root finding."""

import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

_TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-18}
# A flight off a contact, where the gap is zero.
_AWAY = 1e-9


def contact_of_rods(
    mass: np.ndarray,
    stiffness: np.ndarray,
    row: np.ndarray,
    v: np.ndarray,
    end: float,
    ts=(),
    gap: float = 0.0,
) -> tuple[list[tuple[float, float]], np.ndarray, np.ndarray]:
    """Motion from x = `gap` under row . x >= 0 without restitution: intervals of contact, positions at `ts`, last velocities."""
    inverse, n = np.linalg.inv(mass), len(v)
    way = inverse @ row / (row @ inverse @ row)
    pull = row @ inverse @ stiffness  # its product with x is the force, up to a factor

    def free(t, z):
        return np.concatenate([z[n:], -inverse @ (stiffness @ z[:n])])

    def held(t, z):
        a = free(t, z)[n:]
        return np.concatenate([z[n:], a - way * (row @ a)])

    def hits(t, z):
        return row @ z[:n]

    def lifts(t, z):
        return pull @ z[:n]

    for event in (hits, lifts):
        event.terminal, event.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
    t, z, intervals, places = 0.0, np.concatenate([gap + 0 * v, v]), [], {}
    is_held = gap == 0
    while t < end:
        rate, event = (held, lifts) if is_held else (free, hits)
        begin = t
        if is_held:  # the impact
            z = np.concatenate([a - way * (row @ a) for a in np.split(z, 2)])
        if is_held or t:
            z, begin = solve_ivp(rate, (t, t + _AWAY), z, **_TIGHT).y[:, -1], t + _AWAY
        sol = solve_ivp(rate, (begin, end), z, events=event, dense_output=True, **_TIGHT)
        places |= {one: sol.sol(one)[:n] for one in ts if t <= one <= sol.t[-1]}
        if is_held:
            intervals.append((t, float(sol.t[-1])))
        t, z, is_held = float(sol.t[-1]), sol.y[:, -1], not is_held
    return intervals, np.array([places[one] for one in ts]), z[n:]


def beam_matrices(
    size: float, count: int, width: float, modulus: float, density: float, *, with_shear: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of a pinned beam of cubic elements; with shear (5/6 of the section, no Poisson's ratio) as J. S. Przemieniecki has them."""
    h, area, inertia = size, width**2, width**4 / 12
    p = 24 * inertia / (5 / 6 * area * h**2) if with_shear else 0.0
    units = np.array([1.0, h, 1.0, h])
    of_stiffness = [[12, 6, -12, 6], [6, 4 + p, -6, 2 - p], [-12, -6, 12, -6], [6, 2 - p, -6, 4 + p]]
    a, b = 13 / 35 + 7 * p / 10 + p**2 / 3, 9 / 70 + 3 * p / 10 + p**2 / 6
    c, d = 11 / 210 + 11 * p / 120 + p**2 / 24, 13 / 420 + 3 * p / 40 + p**2 / 24
    e, f = 1 / 105 + p / 60 + p**2 / 120, 1 / 140 + p / 60 + p**2 / 120
    of_mass = np.array([[a, c, b, -d], [c, e, d, -f], [b, d, a, -c], [-d, -f, -c, e]])
    r, s, t, u = 6 / 5, 1 / 10 - p / 2, 2 / 15 + p / 6 + p**2 / 3, 1 / 30 + p / 6 - p**2 / 6
    of_turning = np.array([[r, s, -r, s], [s, t, -s, -u], [-r, -s, r, -s], [s, -u, -s, t]])
    of_mass = of_mass + with_shear * inertia / (area * h**2) * of_turning
    mass, stiffness = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for i in range(count):
        at = slice(2 * i, 2 * i + 4)
        mass[at, at] += density * area * h / (1 + p) ** 2 * np.outer(units, units) * of_mass
        stiffness[at, at] += modulus * inertia / h**3 / (1 + p) * np.outer(units, units) * of_stiffness
    return mass[1:, 1:], stiffness[1:, 1:]


def tip_on_stop(
    mass: np.ndarray,
    stiffness: np.ndarray,
    v: np.ndarray,
    modes: int,
    ratio: float,
    spring: float,
    ts: np.ndarray,
) -> np.ndarray:
    """Height of the tip of the beam, which presses on its elastic stop all along, by the exponential of the motion."""
    squares, shapes = scipy.linalg.eigh(stiffness, mass, subset_by_index=(0, modes - 1))
    frequencies, tip = np.sqrt(np.concatenate([[0.0], squares[1:]])), shapes[-2]
    motion = np.zeros((2 * modes, 2 * modes))
    motion[:modes, modes:] = np.eye(modes)
    motion[modes:, :modes] = -np.diag(frequencies**2) - spring * np.outer(tip, tip)
    motion[modes:, modes:] = -np.diag(2 * ratio * frequencies)
    start = np.concatenate([np.zeros(modes), shapes.T @ mass @ v])
    heights = np.array([tip @ (scipy.linalg.expm(t * motion) @ start)[:modes] for t in ts])
    assert (heights < 0).all()
    return heights


class CavityFlights:
    """Flights of an oscillator and the ball in its cavity, by the exponential of their motion with the load."""

    def __init__(self, ball: float, damping: float, frequency: float, gap: float, restitution: float):
        self.ball, self.frequency, self.gap, self.restitution = ball, frequency, gap, restitution
        motion = np.zeros((6, 6))  # of both positions, both velocities, and cosine and sine of the load
        motion[:2, 2:4] = np.eye(2)
        motion[2, [0, 2, 4]] = np.array([-1.0, -2 * damping, 1.0]) / (1 - ball)
        motion[4, 5], motion[5, 4] = -frequency, frequency
        self.motion = motion

    def after(self, z: np.ndarray, t: float) -> np.ndarray:
        """State after a time."""
        return scipy.linalg.expm(t * self.motion) @ z

    def period(self, start: np.ndarray, number: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """State after a period, and `number` positions of the oscillator at equal times."""
        length, t, z = 2 * np.pi / self.frequency, 0.0, np.concatenate([start, [1.0, 0.0]])
        places, times = [], length * np.arange(number) / max(number, 1)
        while t < length:
            room = lambda s, z=z: self.gap - abs(np.diff(self.after(z, s)[:2])[0])  # noqa: E731
            grid = np.linspace(1e-6, length - t, 400)
            beyond = np.flatnonzero(np.array([room(s) for s in grid]) < 0)
            span = length - t
            if len(beyond):
                span = float(np.asarray(brentq(room, grid[beyond[0] - 1], grid[beyond[0]], xtol=1e-15)))
            places += [self.after(z, one - t)[0] for one in times if t <= one < t + span]
            t, z = t + span, self.after(z, span)
            if len(beyond):
                jump = (1 + self.restitution) * (z[3] - z[2])
                z[2], z[3] = z[2] + self.ball * jump, z[3] - (1 - self.ball) * jump
        return z[:4], np.array(places)

    def first_harmonic(self, guess: np.ndarray, number: int = 2**14) -> float:
        """Amplitude of the first harmonic of the oscillator on the orbit near a guess."""
        start = np.asarray(fsolve(lambda y: self.period(y)[0] - y, guess, xtol=1e-14))
        places = self.period(start, number)[1]
        return float(2 * abs(np.mean(places * np.exp(-2j * np.pi * np.arange(number) / number))))
