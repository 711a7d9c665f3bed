"""Machines whose motion is known exactly.

Numbers are mpmath's, to `DIGITS` digits, for the machine as stored in doubles. Every entry is checked by
`flown_by_matrix_exponentials`, which uses none of the formulas of the entry.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import mpmath
from mpmath import mp, mpf

import vijax as vx

DIGITS = 40
mp.dps = DIGITS


class Impact(NamedTuple):
    """An exact impact: its time, its stop, and the speed just before."""

    t: mpf
    velocity: mpf
    stop: int = 0


class State(NamedTuple):
    """An exact state: time, positions, velocities."""

    t: mpf
    x: tuple[mpf, ...]
    v: tuple[mpf, ...]


class Problem(NamedTuple):
    """A machine, a start, and the exact motion: its first impacts, and states before the next one."""

    name: str
    system: vx.ImpactSystem
    start: State
    impacts: tuple[Impact, ...]
    states: tuple[State, ...]


def flown_by_matrix_exponentials(problem: Problem, impacts: int = 12) -> mpf:
    """Fly the motion from one impact of the entry to the next; return the largest error.

    The motion is z' = A z for z = (x, v, cosines and sines of the load, 1), with A made of the stored doubles;
    mpmath.expm needs no modes, and has no special cases of resonance or damping. Between impacts no stop may be
    passed.
    """
    system, start = problem.system, problem.start
    n = system.num_masses
    z = mpmath.matrix([*start.x, *start.v, *load_phase(system, start.t), 1])
    a, t, error = first_order_matrix(system), start.t, mpf(0)
    known = [*problem.impacts[:impacts]]
    if len(known) == len(problem.impacts):
        known += problem.states
    for event in sorted(known, key=lambda known: known.t):
        z = _fly(system, a, z, event.t - t)
        t = event.t
        if isinstance(event, Impact):
            stop = system.stops[event.stop]
            r, i = mpf(float(stop.restitution)), stop.mass
            error = max(error, abs(z[i] - mpf(float(stop.position))), abs(z[n + i] - event.velocity))
            z[i], z[n + i] = mpf(float(stop.position)), -r * event.velocity
        else:
            known_state = (*event.x, *event.v)
            error = max(error, *(abs(z[i] - value) for i, value in enumerate(known_state)))
    return error


def _fly(system: vx.ImpactSystem, a: mpmath.matrix, z: mpmath.matrix, span: mpf) -> mpmath.matrix:
    """Advance by `span` in equal parts, after each of which no stop may be passed."""
    parts = 16 if system.stops else 1
    advance = mpmath.expm(a * (span / parts))
    for _ in range(parts):
        z = advance * z
        for stop in system.stops:
            gap = stop.sign * (mpf(float(stop.position)) - z[stop.mass])
            assert gap > -(mpf(10) ** -12), "the exact motion passes through a stop"
    return z


def first_order_matrix(system: vx.ImpactSystem) -> mpmath.matrix:
    """A of z' = A z for z = (x, v, cos W t, sin W t, cos 2 W t, ..., 1), without sticking."""
    n, load = system.num_masses, system.forcing
    amplitudes = load.amplitude.reshape(-1, n).tolist()
    phases = load.phase.reshape(-1, n).tolist()
    mass, c, k = (m.tolist() for m in (system.mass, system.damping, system.stiffness))
    size = 2 * n + 2 * len(amplitudes) + 1
    a = mpmath.zeros(size)
    for i in range(n):
        a[i, n + i] = 1
        for j in range(n):
            a[n + i, j], a[n + i, n + j] = -mpf(k[i][j]) / mass[i], -mpf(c[i][j]) / mass[i]
        for h in range(len(amplitudes)):
            a[n + i, 2 * n + 2 * h] = mpf(amplitudes[h][i]) * mpmath.cos(phases[h][i]) / mass[i]
            a[n + i, 2 * n + 2 * h + 1] = -mpf(amplitudes[h][i]) * mpmath.sin(phases[h][i]) / mass[i]
        a[n + i, size - 1] = mpf(load.mean.tolist()[i]) / mass[i]
    for h in range(len(amplitudes)):
        w = (h + 1) * mpf(float(load.frequency))
        a[2 * n + 2 * h, 2 * n + 2 * h + 1], a[2 * n + 2 * h + 1, 2 * n + 2 * h] = -w, w
    return a


def load_phase(system: vx.ImpactSystem, t: mpf) -> list[mpf]:
    """Cosines and sines of the load at t."""
    harmonics = system.forcing.amplitude.reshape(-1, system.num_masses).shape[0]
    angles = [(h + 1) * mpf(float(system.forcing.frequency)) * t for h in range(harmonics)]
    return [f(angle) for angle in angles for f in (mpmath.cos, mpmath.sin)]


# One mass


def one_mass(
    *,
    m: float = 1.0,
    c: float = 0.0,
    k: float = 1.0,
    amplitude: float = 0.0,
    frequency: float = 0.0,
    phase: float = 0.0,
    mean: float = 0.0,
    stops: tuple[vx.Stop, ...] = (),
) -> vx.ImpactSystem:
    """Machine m x'' + c x' + k x = mean + amplitude cos(frequency t + phase)."""
    load = vx.Harmonic([amplitude], frequency, [phase], [mean])
    return vx.ImpactSystem([m], [[c]], [[k]], load, list(stops))


def _state(t: float | mpf, x: float | mpf, v: float | mpf) -> State:
    return State(mpf(t), (mpf(x),), (mpf(v),))


class SiconosChatter(NamedTuple):
    """The example `LinearOscillatorED` of the Siconos tutorials, and the end of its chatter."""

    problem: Problem
    end: mpf


@cache
def siconos_chatter(bounces: int = 101) -> SiconosChatter:
    """A weight on a spring falls on a floor: m x'' + k x = -m g, x >= 0, e = 0.9, from x = 1 at rest.

    It oscillates about -d, d = m g / k, with w^2 = k / m. It first hits the floor when cos(w t) = d / (1 + d), with
    speed u_0 = w sqrt((1 + d)^2 - d^2). A flight that starts with speed u ends with the same speed, by conservation
    of energy; in the phase plane it is an arc of a circle about -d, of half angle atan(u / (w d)). So the flights
    last (2 / w) atan(u_j / (w d)), u_j = e^j u_0, and the chatter ends after the sum of them all.
    """
    m, k, g, e = 1e-3, 100.0, 9.81, 0.9
    weight = m * g
    system = one_mass(m=m, k=k, mean=-weight, stops=(vx.Stop(0, 0.0, "lower", e),))
    w, d = mpmath.sqrt(mpf(k) / mpf(m)), mpf(weight) / mpf(k)
    t, u = mpmath.acos(d / (1 + d)) / w, w * mpmath.sqrt((1 + d) ** 2 - d**2)
    impacts = []
    while u > mpf(10) ** (-DIGITS):
        impacts.append(Impact(t, -u))
        u *= mpf(e)
        t += 2 / w * mpmath.atan(u / (w * d))
    rest = _state(1, 0, 0)
    problem = Problem("Siconos_chatter", system, _state(0, 1, 0), tuple(impacts[:bounces]), (rest,))
    return SiconosChatter(problem, t)


class StickingOrbit(NamedTuple):
    """A periodic motion with a complete chatter and a sticking phase in every period."""

    problem: Problem
    release: mpf
    end: mpf
    period: mpf


@cache
def sticking_orbit() -> StickingOrbit:
    """A periodic motion with chatter, sticking and release: x'' + x = cos(t / 2), x <= 0, r = 1/2.

    The contact force of the mass at rest on the stop is cos(t / 2), so the mass is released at pi. Then x = 4/3
    cos(t / 2) - 2/3 sin t = 4/3 cos(t / 2) (1 - sin(t / 2)) until 3 pi, where v = 4/3; the next flight ends at 11
    pi / 3 with v = 1. The chatter completes while the force presses, and the mass is released at 5 pi: the period is
    4 pi. Every flight after an impact at T with v is x = 4/3 (cos(t / 2) - cos(T / 2) cos(t - T)) + (2/3
    sin(T / 2) - r v) sin(t - T).
    """
    system = one_mass(amplitude=1.0, frequency=0.5, stops=(vx.Stop(0, 0.0, "upper", 0.5),))
    t, v = 3 * mp.pi, mpf(4) / 3
    impacts = [Impact(t, v)]
    guesses = [2 * mp.pi / 3, mpf("0.985")]
    while v > mpf(10) ** -30:
        guess = guesses.pop(0) if guesses else v / mpmath.cos(t / 2)
        t, v = _next_bounce(t, v, guess)
        impacts.append(Impact(t, v))
    # The remaining bounces are a geometric series of times v / a, a = cos(t / 2); each halves v.
    end = t + 2 * v / mpmath.cos(t / 2)
    start = _state(mp.pi, 0, 0)
    problem = Problem("sticking_orbit", system, start, tuple(impacts), ())
    return StickingOrbit(problem, mp.pi, end, 4 * mp.pi)


def _next_bounce(t0: mpf, v0: mpf, guess: mpf) -> tuple[mpf, mpf]:
    """Next impact of the sticking orbit after one at t0 with speed v0; `guess` is the approximate time between them."""

    def motion(u: mpf) -> tuple[mpf, mpf]:
        half, swing = mpmath.cos(t0 / 2), mpf(2) / 3 * mpmath.sin(t0 / 2) - v0 / 2
        x = mpf(4) / 3 * (mpmath.cos((t0 + u) / 2) - half * mpmath.cos(u)) + swing * mpmath.sin(u)
        v = -mpf(2) / 3 * mpmath.sin((t0 + u) / 2) + mpf(4) / 3 * half * mpmath.sin(u)
        return x, v + swing * mpmath.cos(u)

    # Divided by u, which removes the root of the previous impact; with spare digits for short flights.
    with mp.workdps(3 * DIGITS):
        u = mpmath.findroot(lambda u: motion(u)[0] / u, guess)
        return t0 + u, motion(u)[1]


@cache
def elastic_bounces(bounces: int = 40) -> Problem:
    """Free oscillation against an elastic stop: x'' + x = 0, x <= 1/2, r = 1, from x = -1 at rest.

    It hits the stop first at pi - acos(1/2) = 2 pi / 3 with speed sqrt(3)/2, and then every 4 pi / 3.
    """
    system = one_mass(stops=(vx.Stop(0, 0.5, "upper", 1.0),))
    first, speed = 2 * mp.pi / 3, mpmath.sqrt(3) / 2
    impacts = tuple(Impact((2 * j + 1) * first, speed) for j in range(bounces))
    turn = 2 * bounces * first
    return Problem("elastic_bounces", system, _state(0, -1, 0), impacts, (_state(turn, -1, 0),))


# No stops


def _free(name: str, motion: Callable[[mpf], mpf], times: tuple[float, ...], **machine: float) -> Problem:
    """Free response, with the velocity as derivative of the closed form."""
    with mp.workdps(2 * DIGITS):
        states = tuple(_state(t, motion(mpf(t)), mpmath.diff(motion, mpf(t))) for t in (0.0, *times))
    return Problem(name, one_mass(**machine), states[0], (), states[1:])


@cache
def free_responses() -> tuple[Problem, ...]:
    """Linear motion in every regime of damping and load, in closed form.

    x'' + 2 a x' + x = 0 from x = 1 at rest: exp(-a t) (cos(d t) + a / d sin(d t)) with d^2 = 1 - a^2, cosh and sinh
    for a > 1, and exp(-t) (1 + t) for a = 1. At a = 70 the fast exponential has vanished long before the slow one has
    fallen to exp(-600 / 140): written with cosh it overflows. Without a spring a constant load gives f t^2 / 2, or,
    damped, f t / c - f m / c^2 (1 - exp(-c t / m)). An undamped spring driven at its own frequency moves as t
    sin(t) / 2.
    """
    soon, late = (0.3, 2.0, 17.0, 60.0), (0.3, 5.0, 40.0, 200.0)

    def decaying(a: float) -> Callable[[mpf], mpf]:
        a = mpf(a)
        if a == 1:
            return lambda t: mpmath.exp(-t) * (1 + t)
        if a < 1:
            d = mpmath.sqrt(1 - a**2)
            return lambda t: mpmath.exp(-a * t) * (mpmath.cos(d * t) + a / d * mpmath.sin(d * t))
        d = mpmath.sqrt(a**2 - 1)
        slow, fast = 1 / (a + d), a + d
        return lambda t: (fast * mpmath.exp(-slow * t) - slow * mpmath.exp(-fast * t)) / (fast - slow)

    f, c, w = mpf(0.25), mpf(0.5), mpf(0.75)
    return (
        _free("undamped", mpmath.cos, late),
        _free("underdamped", decaying(0.125), soon, c=0.25),
        _free("critically_damped", decaying(1.0), soon, c=2.0),
        _free("overdamped", decaying(3.0), soon, c=6.0),
        _free("heavily_damped", decaying(70.0), (0.3, 5.0, 100.0, 600.0), c=140.0),
        _free("constant_push", lambda t: f * t**2 / 2, late, k=0.0, mean=0.25),
        _free(
            "damped_push",
            lambda t: f * t / c - f / c**2 * (1 - mpmath.exp(-c * t)),
            late,
            c=0.5,
            k=0.0,
            mean=0.25,
        ),
        _free(
            "shaken_free_mass",
            lambda t: (1 - mpmath.cos(w * t)) / w**2,
            late,
            k=0.0,
            amplitude=1.0,
            frequency=0.75,
        ),
        _free("resonance", lambda t: t * mpmath.sin(t) / 2, late, amplitude=1.0, frequency=1.0),
    )


@cache
def three_masses() -> Problem:
    """Three masses, damping that the modes do not diagonalise, two harmonics and a constant load.

    The state is a sum over the eigenvectors of the first-order matrix.
    """
    load = vx.Harmonic(
        [[0.5, 0.0, -0.25], [0.125, 0.75, 0.0]], 0.8, [[0.0, 0.0, 1.0], [0.5, 2.0, 0.0]], [0.0, 0.1, 0.0]
    )
    damping = [[0.75, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.0, 4.0]]
    stiffness = [[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    system = vx.ImpactSystem([1.0, 2.0, 0.5], damping, stiffness, load)
    start = State(mpf(0), (mpf(1), mpf(-0.5), mpf(0.25)), (mpf(0), mpf(1), mpf(0)))
    values, vectors = mpmath.eig(first_order_matrix(system))
    z = mpmath.matrix([*start.x, *start.v, *load_phase(system, start.t), 1])
    weights = mpmath.lu_solve(vectors, z)

    def state(t: float) -> State:
        modes = mpmath.matrix([w * mpmath.exp(value * t) for w, value in zip(weights, values, strict=True)])
        x = [mpmath.re(a) for a in vectors * modes]
        return State(mpf(t), tuple(x[:3]), tuple(x[3:6]))

    return Problem("three_masses", system, start, (), tuple(state(t) for t in (0.3, 2.0, 17.0, 60.0)))
