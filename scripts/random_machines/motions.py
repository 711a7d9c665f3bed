"""Checks on motions of random machines: laws of mechanics, and the same motion computed in two ways."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import vijax as vx

from .machines import Shape, free, in_other_units, machine, mirrored, own_numbers, permuted

# Number of saved states, room for events, and relative rounding that a step may add.
SAVED, ROOM, ROUNDING = 33, 256, 1e-11
# Bound on steps: on an elastic stop bounces never end.
MOST_STEPS = 20_000
# Units are powers of two, up to this one and its inverse: a change of them alters no digit. That of velocities is larger
# than a smallest one, as bounces below 1e-6 complete a chatter: where that is less than rounding, bounces never end.
UNITS, FASTEST = 30, 20
# Units of mass, length and time that alter every digit: where an outcome depends on rounding, motions part at once, from less
# than `TOGETHER` of their size to more than `APART_AT_ONCE` from one saved state to the next.
ODD_UNITS, TOGETHER, APART_AT_ONCE = (3.0, 1 / 7, 1 / 3), 1e-11, 1e-4
# Disturbances by which the growth of errors is measured; motions in which one grows more are compared no further.
DISTURBANCES, MOST_GROWTH = (1e-8, -1e-11), 1e5
# Share of the time span that lies between impacts that are not of one chatter.
APART = 3e-3
# Size of a motion that has died out: the squares of smaller numbers are zero.
DEAD = 1e-150


class Failure(NamedTuple):
    """One machine that fails one check, by how much beyond the tolerance."""

    check: str
    lane: int
    excess: float


class Run(NamedTuple):
    """Results of a batch, (lanes, ...)."""

    ts: np.ndarray
    xs: np.ndarray
    vs: np.ndarray
    t: np.ndarray
    stop: np.ndarray
    kind: np.ndarray
    before: np.ndarray
    after: np.ndarray
    num_events: np.ndarray
    result: np.ndarray
    stretches: np.ndarray

    def start_at(self, place: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities from which runs go on from a saved state, (lanes, masses and Jenkins elements)."""
        stretches = self.stretches[:, place]
        x, v = self.xs[:, place], self.vs[:, place]
        return np.append(x, 0 * stretches, axis=1), np.append(v, stretches, axis=1)


def stretches_of(sol: vx.Solution, ts: np.ndarray, system: vx.ImpactSystem) -> np.ndarray:
    """Stretches of the Jenkins elements at times, (times, hysteresis)."""
    if not system.hysteresis:
        return np.zeros((len(ts), 0))
    is_known = np.asarray(sol.known_until) >= ts  # before a motion that stopped early
    forces = np.asarray(sol.hysteresis_force(np.where(is_known, ts, ts[0])))
    return forces / [float(one.stiffness) for one in system.hysteresis]


def run(shape: Shape, a: dict, begin, end, x0=None, v0=None, most_steps: int | None = MOST_STEPS) -> Run:
    """Simulate the machines one by one: one program serves all of a size, and compiles in a fraction of a batch's time."""
    x0, v0 = a["x0"] if x0 is None else x0, a["v0"] if v0 is None else v0
    rows = []
    for k in range(len(begin)):
        own = own_numbers(a, k)
        ts = begin[k] + (end[k] - begin[k]) * np.linspace(0.0, 1.0, SAVED)
        system = machine(shape, own)
        sol = vx.simulate(
            system,
            begin[k],
            end[k],
            x0[k],
            v0[k],
            ts=ts,
            max_events=ROOM,
            max_steps=most_steps,
            throw=False,
        )
        log = sol.events
        own_log = log.t, log.stop, log.kind, log.velocity_minus, log.velocity_plus
        found = ts, sol.xs, sol.vs, *own_log, sol.num_events, sol.result._value, stretches_of(sol, ts, system)
        rows.append([np.asarray(a) for a in found])
    return (
        Run(*(np.stack(column) for column in zip(*rows, strict=True)))
        if rows
        else Run(*[np.empty(0)] * len(Run._fields))
    )


def check_motions(shape: Shape, a: dict, rng: np.random.Generator) -> tuple[list[Failure], int]:
    """Check a batch of machines; what failed, and the number of compared motions."""
    count = len(a["frequency"])
    begin = np.zeros(count)
    end = 12 * 2 * np.pi / a["frequency"]
    whole = run(shape, a, begin, end)
    failures = _codes(shape, a, whole, begin, end)
    is_sound = (whole.result == _code("successful")) & np.isfinite(whole.xs).all(axis=(1, 2))
    failures += _penetration(shape, a, whole, is_sound)
    failures += _impact_law(shape, a, whole, is_sound)
    failures += _order(whole, is_sound)
    if not (shape.is_driven or shape.sliders):  # whose springs have energy as well
        failures += _energy(shape, a, whole, is_sound)
    growth = _growth(shape, a, whole, begin, end, is_sound) * _grazing(whole)
    fair = is_sound & (growth < MOST_GROWTH)
    scale = np.abs(whole.xs).max(axis=(1, 2)) + 1e-3, np.abs(whole.vs).max(axis=(1, 2)) + 1e-3

    def compare(name: str, xs: np.ndarray, vs: np.ndarray, like: Run = whole, part: slice = slice(None)):
        error = np.maximum(
            np.abs(xs - like.xs[:, part]).max(axis=(1, 2)) / scale[0],
            np.abs(vs - like.vs[:, part]).max(axis=(1, 2)) / scale[1],
        )
        bound = ROUNDING * np.maximum(growth, 1)
        return [
            Failure(name, int(k), float(error[k] / bound[k]))
            for k in np.flatnonzero(fair & ~(error <= bound))
        ]

    middle = SAVED // 2
    # Runs that ended before it are run from their start again, and not compared.
    is_whole = is_sound[:, None]
    since = np.where(is_sound, whole.ts[:, middle], begin)
    none = np.zeros((count, len(shape.sliders)))
    x_now, v_now = (
        np.where(is_whole, now, np.append(start, none, axis=1))
        for now, start in zip(whole.start_at(middle), (a["x0"], a["v0"]), strict=True)
    )
    half = run(shape, a, since, end, x_now, v_now)
    failures += compare("cut", half.xs[:, ::2], half.vs[:, ::2], part=slice(middle, None))
    shift = rng.uniform(0, 1, count) * 2 * np.pi / a["frequency"]
    orders = 1 + np.arange(shape.harmonics)[:, None]
    if not shape.is_moving:
        later = {**a, "phase": a["phase"] - orders * (a["frequency"] * shift)[:, None, None]}
        moved = run(shape, later, begin + shift, end + shift)
        failures += compare("phase", moved.xs, moved.vs)
    units = rng.integers(-UNITS, UNITS + 1, (3, count))
    mass, length, time = 2.0 ** np.stack([*units[:2], np.maximum(units[2], units[1] - FASTEST)])
    other = run(shape, in_other_units(a, mass, length, time), begin * time, end * time)
    per_length = 1 / length[:, None, None]
    failures += compare("units", other.xs * per_length, other.vs * per_length * time[:, None, None])
    failures += _rounding_decides(shape, a, whole, begin, end, is_sound)
    glass = run(*mirrored(shape, a), begin, end)
    failures += compare("mirror", -glass.xs, -glass.vs)
    if shape.masses > 1:
        order = rng.permutation(shape.masses)
        other = run(*permuted(shape, a, order), begin, end)
        failures += compare("permutation", other.xs[..., order], other.vs[..., order])
    if shape.contacts:
        failures += _momentum(*free(shape, a), begin, end)
    return failures, int(fair.sum())


def _rounding_decides(
    shape: Shape, a: dict, whole: Run, begin: np.ndarray, end: np.ndarray, is_sound: np.ndarray
) -> list[Failure]:
    """Motions that part from themselves at once in units that alter every digit: the outcome of an event depended on rounding."""
    mass, length, time = np.outer(ODD_UNITS, np.ones(len(begin)))
    other = run(shape, in_other_units(a, mass, length, time), begin * time, end * time)
    per_length, rate = 1 / length[:, None, None], (time / length)[:, None, None]
    away = np.maximum(
        np.abs(other.xs * per_length - whole.xs).max(axis=2)
        / (np.abs(whole.xs).max(axis=(1, 2)) + 1e-3)[:, None],
        np.abs(other.vs * rate - whole.vs).max(axis=2) / (np.abs(whole.vs).max(axis=(1, 2)) + 1e-3)[:, None],
    )
    before = np.maximum.accumulate(np.concatenate([np.zeros((len(begin), 1)), away[:, :-1]], axis=1), axis=1)
    parts = ((away > APART_AT_ONCE) & (before < TOGETHER)).any(axis=1)
    wrong = np.flatnonzero(is_sound & (parts | (other.result != whole.result)))
    return [Failure("rounding decides", int(k), float(np.nanmax(away[k]) / APART_AT_ONCE)) for k in wrong]


def check_alone(shape: Shape, a: dict, lanes: list[int]) -> list[Failure]:
    """Single runs, and derivatives forward and reverse, of a few lanes."""
    failures = []
    for k in lanes:
        own = own_numbers(a, k)
        end = 6 * 2 * np.pi / own["frequency"]

        def last(x0, v0, own=own, end=end):
            sol = vx.simulate(
                machine(shape, own), 0.0, end, x0, v0, max_events=ROOM, max_steps=MOST_STEPS, throw=False
            )
            return jnp.concatenate([sol.x1, sol.v1])

        start, way = (own["x0"], own["v0"]), (np.cos(1.0 + own["x0"]), np.sin(2.0 + own["v0"]))
        alone = last(*start)
        forward = jax.jvp(last, start, way)[1]
        weights = jnp.cos(jnp.arange(len(alone)))
        back = jax.vjp(last, *start)[1](weights)
        pair = float(forward @ weights), float(sum(b @ w for b, w in zip(back, way, strict=True)))
        size = float(jnp.abs(forward).max()) + 1e-2  # of what was of size 1 on its way here
        if not abs(pair[0] - pair[1]) <= 1e-9 * size:
            failures.append(Failure("forward and reverse", k, abs(pair[0] - pair[1]) / (1e-9 * size)))
    return failures


def _code(name: str) -> int:
    return int(getattr(vx.RESULTS, name)._value)


def _codes(shape: Shape, a: dict, whole: Run, begin: np.ndarray, end: np.ndarray) -> list[Failure]:
    allowed = {_code("successful"), _code("max_events_reached")}
    if shape.rubs:  # the law of friction may leave no motion
        allowed.add(_code("friction_paradox"))
    # A motion without load dies out until the squares of its numbers underflow.
    is_dead = np.nanmin(np.abs(whole.vs).max(axis=2), axis=1) < DEAD
    may_not_end = is_endless(a) | is_dead
    is_long = whole.result == _code("max_steps_reached")
    failed = [int(k) for k, code in enumerate(whole.result) if int(code) not in allowed]
    # Stiff machines take many steps: what the library allows by itself is enough for them.
    longer = [k for k in failed if is_long[k] and not may_not_end[k]]
    again = run(
        shape, {name: v[longer] for name, v in a.items()}, begin[longer], end[longer], most_steps=None
    )
    stalled = {k for k, code in zip(longer, again.result, strict=True) if int(code) not in allowed}
    return [Failure(f"result {whole.result[k]}", k, 1.0) for k in failed if k in stalled or not is_long[k]]


def is_endless(a: dict) -> np.ndarray:
    """Whether a machine may come to rest after infinitely many bounces, never at once, (lanes,).

    So it is on an elastic stop, and where a preload sets in: bounces shrink only as dampers take energy.
    """
    r = np.concatenate([a["restitution"], a["contact_restitution"]], axis=1)
    return (r == 1).any(axis=1) | (a["preload"] > 0).any(axis=1)


def gaps(shape: Shape, a: dict, ts: np.ndarray, xs: np.ndarray) -> np.ndarray:
    """Gaps of rigid stops and contacts at saved states, (lanes, times, contacts)."""
    gaps = []
    for j, (i, side) in enumerate(shape.stops):
        sign = 1.0 if side == "upper" else -1.0
        wall = sign * a["position"][:, None, j] * np.ones_like(ts)
        if shape.is_moving and j == 0:
            wall = wall + a["travel"][:, None] * np.cos(a["frequency"][:, None] * ts)
        gaps.append(sign * (wall - xs[..., i]))
    for j, (i, k) in enumerate(shape.contacts):
        gaps.append(a["distance"][:, None, j] - (xs[..., i] - xs[..., k]))
    return np.stack(gaps, axis=-1) if gaps else np.ones((*ts.shape, 1))


def _penetration(shape: Shape, a: dict, whole: Run, is_sound: np.ndarray) -> list[Failure]:
    scale = 1e-12 * (np.abs(whole.xs).max(axis=(1, 2)) + 1.0)
    # A start beyond a moving stop is refused or pushed by it: its first instants are its own.
    least = gaps(shape, a, whole.ts, whole.xs).min(axis=(1, 2))
    return [
        Failure("penetration", int(k), float(-least[k] / scale[k]))
        for k in np.flatnonzero(is_sound & (least < -scale))
    ]


def _impact_law(shape: Shape, a: dict, whole: Run, is_sound: np.ndarray) -> list[Failure]:
    """Impacts alone at their instant reverse the velocity relative to the contact, times the restitution."""
    r = np.concatenate([a["restitution"], a["contact_restitution"]], axis=1)
    failures = []
    for j in range(r.shape[1]):
        if shape.is_moving and j == 0:
            continue
        is_own = (whole.stop == j) & (whole.kind == vx.IMPACT) & is_sound[:, None]
        same = np.abs(whole.t[:, :, None] - whole.t[:, None, :]) < 1e-9
        is_alone = is_own & ((same & (whole.kind == vx.IMPACT)[:, None, :]).sum(axis=2) == 1)
        lack = np.abs(whole.after + r[:, j : j + 1] * whole.before)
        size = 1e-11 * (np.abs(whole.vs).max(axis=(1, 2))[:, None] + 1e-3)
        wrong = (is_alone & (lack > size)).any(axis=1)
        failures += [Failure("impact law", int(k), 1.0) for k in np.flatnonzero(wrong)]
    return failures


def _order(whole: Run, is_sound: np.ndarray) -> list[Failure]:
    t = np.where(np.arange(whole.t.shape[1]) < whole.num_events[:, None], whole.t, np.inf)
    later = np.diff(np.where(np.isfinite(t), t, whole.ts[:, -1:] + 1.0), axis=1) >= 0
    is_inside = (whole.t <= whole.ts[:, -1:] * (1 + 1e-12)) | ~np.isfinite(t)
    wrong = is_sound & ~(later.all(axis=1) & is_inside.all(axis=1))
    return [Failure("order of the log", int(k), 1.0) for k in np.flatnonzero(wrong)]


def _energy(shape: Shape, a: dict, whole: Run, is_sound: np.ndarray) -> list[Failure]:
    energy = np.einsum("bti,bij,btj->bt", whole.vs, _matrices(shape, a), whole.vs) / 2
    energy = energy + np.einsum("bti,bij,btj->bt", whole.xs, a["stiffness"], whole.xs) / 2
    for j, (i, side) in enumerate(shape.cushions):
        sign = 1.0 if side == "upper" else -1.0
        depth = np.maximum(sign * whole.xs[..., i] - a["cushion"][:, None, j], 0)
        energy = energy + depth * (a["preload"][:, None, j] + a["cushion_stiffness"][:, None, j] * depth / 2)
    rise, size = np.diff(energy, axis=1).max(axis=1), 1e-11 * energy.max(axis=1) + 1e-300
    return [
        Failure("energy", int(k), float(rise[k] / size[k])) for k in np.flatnonzero(is_sound & (rise > size))
    ]


def _momentum(shape: Shape, a: dict, begin: np.ndarray, end: np.ndarray) -> list[Failure]:
    """Momentum of machines on which nothing acts from outside."""
    alone = run(shape, a, begin, end)
    momenta = np.einsum("bij,btj->bti", _matrices(shape, a), alone.vs)
    lack = np.abs(np.diff(momenta.sum(axis=2), axis=1)).max(axis=1)
    size = ROUNDING * np.abs(momenta).max(axis=(1, 2))
    # Rows of the stiffness add up to zero but for rounding.
    pull = np.abs(a["stiffness"]).max(axis=(1, 2)) * np.abs(alone.xs).max(axis=(1, 2))
    size = size + 4 * shape.masses * np.finfo(float).eps * pull * (end - begin)
    is_sound = (alone.result == _code("successful")) & np.isfinite(alone.xs).all(axis=(1, 2))
    return [
        Failure("momentum", int(k), float(lack[k] / size[k]))
        for k in np.flatnonzero(is_sound & (lack > size))
    ]


def _matrices(shape: Shape, a: dict) -> np.ndarray:
    """Mass matrices, (lanes, masses, masses)."""
    return a["mass"] if shape.is_full else np.einsum("bi,ij->bij", a["mass"], np.eye(shape.masses))


def _grazing(whole: Run) -> np.ndarray:
    """Magnification of rounding at the lightest impact that is none of a chatter: errors of its energy are divided by its speed."""
    before = np.concatenate([np.full_like(whole.t[:, :1], -np.inf), whole.t[:, :-1]], axis=1)
    is_apart = whole.t - before > APART * (whole.ts[:, -1:] - whole.ts[:, :1])
    is_own = is_apart & (whole.kind == vx.IMPACT) & (np.arange(ROOM) < whole.num_events[:, None])
    speed = np.where(is_own, np.abs(whole.before), np.inf).min(axis=1)
    return np.maximum(1, np.nanmax(np.abs(whole.vs), axis=(1, 2)) / np.maximum(speed, 1e-300))


def _growth(shape: Shape, a: dict, whole: Run, begin, end, is_sound: np.ndarray) -> np.ndarray:
    """Largest growth of disturbances of the start and the forces until the end; infinite where the events change.

    A stick erases what the start was disturbed by: forces are disturbed all the way. Every mass is disturbed differently: a motion
    without load is as stable as any if all of it is scaled.
    """
    growth, shares = np.zeros(len(begin)), np.cos(1.0 + 3.0 * np.arange(shape.masses))
    for disturbance in DISTURBANCES:
        factor = 1 + disturbance
        disturbed = {**a, "stiffness": a["stiffness"] * factor, "amplitude": a["amplitude"] / factor}
        near = run(shape, disturbed, begin, end, None, a["v0"] * (1 + disturbance * shares))
        size = abs(disturbance) * (np.abs(a["v0"]).max(axis=1) + 1e-300)
        away = np.maximum(
            np.abs(near.xs - whole.xs).max(axis=(1, 2)), np.abs(near.vs - whole.vs).max(axis=(1, 2))
        )
        other = (near.num_events != whole.num_events) | (near.kind != whole.kind).any(axis=1)
        growth = np.maximum(growth, np.where(other | ~is_sound, np.inf, away / size))
    return growth
