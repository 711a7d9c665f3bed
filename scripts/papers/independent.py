"""Numbers where a printed one differs, by SciPy alone: flights by `solve_ivp` or `expm`, events by root finding."""

import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

_TIGHT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}


def _event(function, direction: int):
    """An event at which a flight ends."""
    function.terminal, function.direction = True, direction
    return function


def wear_power(amplitude: float, spring: float = 3e-5, begin: float = 4.0, end: float = 12.0) -> float:
    """Mean power of friction of SDND104, times 10: x'' + k x = A sin(2 pi t) - sgn(x'), from rest."""

    def pull(t, x):
        return amplitude * np.sin(2 * np.pi * t) - spring * x

    t, x, v, way = 0.0, 0.0, 0.0, 0.0
    while t < end:
        if v == 0 and abs(pull(t, x)) <= 1:  # held, until the pull is as large as the friction
            ts = np.linspace(t, end, 20_000)
            beyond = np.flatnonzero(abs(pull(ts, x)) > 1)
            if not len(beyond):
                break
            k = int(beyond[0])
            t = float(np.asarray(brentq(lambda s, x=x: abs(pull(s, x)) - 1, ts[k - 1], ts[k], xtol=1e-15)))
        sign = float(np.sign(v or pull(t, x)))
        rate = lambda s, y, sign=sign: (y[1], pull(s, y[0]) - sign)  # noqa: E731
        turn = _event(lambda s, y: y[1], -int(sign))
        sol = solve_ivp(
            rate, (t, begin if t < begin else end), (x, v), events=turn, first_step=1e-6, **_TIGHT
        )
        way += abs(sol.y[0, -1] - x) if t >= begin else 0.0
        t, x, v = float(sol.t[-1]), float(sol.y[0, -1]), float(sol.y[1, -1]) if sol.status == 0 else 0.0
    return 10 * way / (end - begin)


def pulled(time: float) -> np.ndarray:
    """Positions of SDND106: mass 2 alone until mass 1 slips, then both, by the exponential of the motion."""
    rate, spring = np.sqrt(2000.0), 2000.0 * np.array([[-1.0, 1.0], [1.0, -1.0]])
    slip = np.pi / 2 / rate
    start = np.array([0.0, 0.3, 0.0, 0.3 * rate, 1.0])
    motion = np.zeros((5, 5))
    motion[:2, 2:4], motion[2:4, :2], motion[2:4, 4] = np.eye(2), spring, [-400.0, 600.0]
    return (scipy.linalg.expm((time - slip) * motion) @ start)[:2]


def dropped(damping: float = 5.0) -> tuple[float, float]:
    """SDND108 with a damper: the time at which the floor lets go, its force being zero, and the position at t = 1."""
    touch = (np.sqrt(41.0) - 1) / 10

    def force(t, y):
        return 100 * (y[0] + 2) + damping * y[1]

    down = (-2.0, -1.0 - 10 * touch)
    sol = solve_ivp(
        lambda t, y: (y[1], -10 - force(t, y)), (touch, 1.0), down, events=_event(force, 1), **_TIGHT
    )
    leaves, (x, v) = float(sol.t[-1]), sol.y[:, -1]
    rest = 1 - leaves
    return leaves, float(x + v * rest - 5 * rest**2)


def coupled_period(coupling: float, cycles: int = 60) -> float:
    """Period of the cycle of H. Tang's coupled masses, by flights from impact to impact until it settles."""
    s = np.sqrt(10) * coupling
    mass, damping = np.array([[1.0, -s], [-s, 1.0]]), np.array([[-0.2, 0.6 * s], [0.6 * s, 0.6]])
    stiffness = np.array([[1.0, 9 * s], [9 * s, 9.0]])
    at, inverse = -np.linalg.solve(stiffness, [1.0, 0.0])[0], np.linalg.inv(mass)
    t, before, y = 0.0, 0.0, np.array([0.5, 0.0, 0.0, 0.0])
    for _ in range(cycles):
        sol = solve_ivp(
            lambda t, y: np.concatenate([y[2:], -inverse @ (damping @ y[2:] + stiffness @ y[:2])]),
            (t, t + 20),
            y,
            events=_event(lambda t, y: y[0] - at, -1),
            **_TIGHT,
        )
        t, before, y = float(sol.t[-1]), t, sol.y[:, -1].copy()
        jump = -1.3 * y[2] / inverse[0, 0]  # Newton's law along the first row
        y[0], y[2:] = at, y[2:] + jump * inverse[:, 0]
    return t - before
