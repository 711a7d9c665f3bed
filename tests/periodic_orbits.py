"""Orbits of one mass with one impact in n periods, in closed form, checked like the machines of `problems`."""

from functools import cache
from typing import NamedTuple

import mpmath
from mpmath import mp, mpf
from problems import Impact, Problem, State, one_mass

import vijax as vx


class Orbit(NamedTuple):
    """A published orbit: stop, restitution, load frequency, periods, impact speed, damping, spring."""

    position: float
    restitution: float
    frequency: float
    periods: int
    speed: float | None
    damping: float = 0.0
    stiffness: float = 1.0


# Budd and Dux: stop positions at which (1, n) orbits arise in folds (to 12 digits, sign restored: the impact speed
# must be positive) and double their period, and impact speeds at given stops. The last orbit is our own, damped.
ORBITS = {
    "fold_2.8": Orbit(-1.780235601322, 0.8, 2.8, 1, None),
    "fold_2.6": Orbit(-1.550453685026, 0.8, 2.6, 1, None),
    "fold_2.4": Orbit(-0.579801115740, 0.6, 2.4, 1, None),
    "period_doubling_2.8": Orbit(-0.068575652279, 0.8, 2.8, 1, 0.493081581866),
    "period_doubling_2.6": Orbit(0.026145269011, 0.8, 2.6, 1, 0.429729182279),
    "period_doubling_2.4": Orbit(0.127942235671, 0.6, 2.4, 1, 0.372442463671),
    "two_periods_focus": Orbit(0.0, 0.8, 3.7, 2, 0.6656933528),
    "two_periods_node": Orbit(0.2, 0.8, 3.7, 2, 2.1874438808),
    "two_periods_saddle": Orbit(0.2, 0.8, 3.7, 2, 1.1023656826),
    "subharmonic_2": Orbit(0.001, 0.4, 2.0, 1, 2.222212222200),
    "subharmonic_4": Orbit(0.001, 0.4, 4.0, 2, 0.888788883263),
    "subharmonic_6": Orbit(0.001, 0.4, 6.0, 3, 0.571078464175),
    "damped": Orbit(0.05, 0.6, 2.4, 1, 1.6578091686, damping=0.1, stiffness=1.3),
}


class PeriodicOrbit(NamedTuple):
    """An orbit with one impact in n periods of the load cos(w t + phase), started as it leaves the stop."""

    problem: Problem
    period: mpf
    speed: mpf
    monodromy: mpmath.matrix


@cache
def periodic_orbit(name: str, impacts: int = 6) -> PeriodicOrbit:
    """Orbit of x'' + c x' + k x = cos(w t) that hits x <= s once in n periods, in closed form.

    Let z = (x, x') minus the steady response (p, q) at the impact. Over n periods T the response returns and z -> E
    z, E = expm(((0, 1), (-k, -c)) n T). From (s - p, -r v - q) it must come to (s - p, v - q), so z = (E - I)^-1
    (1 + r) v e2 just after the impact, and with (w1, w2) = (I - E)^-1 (1 + r) e2 - r e2 the response is p = s + w1 v,
    q = w2 v. It has the amplitude G = 1 / |k - w^2 + i c w|, so that (s + w1 v)^2 + (w2 v / w)^2 = G^2 gives v, and
    the angle of p - i q / w the phase of the load. At a fold the two v coincide.

    The linearised impact is S = ((-r, 0), ((a+ + r a-) / v, -r)), a-+ the accelerations before and after it; the
    monodromy matrix is E S.
    """
    orbit = ORBITS[name]
    c, k, w, r = (mpf(a) for a in (orbit.damping, orbit.stiffness, orbit.frequency, orbit.restitution))
    span = 2 * mp.pi * orbit.periods / w
    e = mpmath.expm(mpmath.matrix([[0, 1], [-k, -c]]) * span)
    e2 = mpmath.matrix([0, 1])
    w1, w2 = mpmath.lu_solve(mpmath.eye(2) - e, (1 + r) * e2) - r * e2
    response = 1 / mpmath.mpc(k - w**2, c * w)
    square, half = w1**2 + (w2 / w) ** 2, abs(response) ** 2
    if orbit.speed is None:
        position = float(-mpmath.sign(w1) * w * mpmath.sqrt(square * half) / abs(w2))
        v = -position * w1 / square
    else:
        position = orbit.position
        root = mpmath.sqrt((position * w1) ** 2 - square * (mpf(position) ** 2 - half))
        v = min(
            ((-position * w1 + sign * root) / square for sign in (1, -1)), key=lambda v: abs(v - orbit.speed)
        )
    p, q = position + w1 * v, w2 * v
    phase = float(mpmath.arg(mpmath.mpc(p, -q / w)) - mpmath.arg(response))
    system = one_mass(
        c=orbit.damping,
        k=orbit.stiffness,
        amplitude=1.0,
        frequency=orbit.frequency,
        phase=phase,
        stops=(vx.Stop(0, position, "upper", orbit.restitution),),
    )
    force = mpmath.cos(phase) - k * position
    before, after = force - c * v, force + c * r * v
    saltation = mpmath.matrix([[-r, 0], [(after + r * before) / v, -r]])
    hits = tuple(Impact(j * span, v) for j in range(1, impacts + 1))
    problem = Problem(name, system, State(mpf(0), (mpf(position),), (mpf(-r * v),)), hits, ())
    return PeriodicOrbit(problem, span, v, e * saltation)
