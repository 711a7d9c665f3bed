"""Checks on motions of random machines: laws of mechanics, and the same motion computed in two ways."""

import jax
import jax.numpy as jnp
import numpy as np

import vijax as vx

from .balance import balance_faults
from .compared import Compared
from .impacts import impact_faults
from .laws import gaps, law_faults, momentum_faults
from .machines import machine, own_numbers
from .other_ways import (
    delayed,
    doubled,
    free,
    in_other_units,
    mirrored,
    permuted,
    reordered,
    walled,
    with_knot,
)
from .runs import MOST_STEPS, ROOM, SAVED, Failure, Run, code_of, run, start_of_rest
from .shapes import Shape

# Units are powers of two, up to this one and its inverse: a change of them alters no digit. That of velocities is larger
# than a smallest one, as bounces below 1e-6 complete a chatter: where that is less than rounding, bounces never end.
UNITS, FASTEST = 30, 20
# Units of mass, length and time that alter every digit.
ODD_UNITS = 3.0, 1 / 7, 1 / 3
# Powers of ten by which units of mass, length, time and velocity change.
TENS = 6
# Disturbances by which the growth of errors is measured.
DISTURBANCES = 1e-8, -1e-11
# Step of differences, and the relative one of two of them below which the motion is smooth.
DIFFERENCE, SMOOTH = 4e-6, 1e-5
# Share of the time span that lies between impacts that are not of one chatter.
APART = 3e-3
# Size of a motion that has died out: the squares of smaller numbers are zero.
DEAD = 1e-150


def check_motions(shape: Shape, a: dict, rng: np.random.Generator) -> tuple[list[Failure], int]:
    """Check a batch of machines; what failed, and the number of compared motions."""
    count = len(a["frequency"])
    begin = np.zeros(count)
    end = 12 * 2 * np.pi / a["frequency"]
    whole = run(shape, a, begin, end)
    is_sound = (whole.result == code_of("successful")) & np.isfinite(whole.xs).all(axis=(1, 2))
    growth = _growth(shape, a, whole, begin, end, is_sound) * _grazing(whole)
    own = Compared(shape, a, begin, end, whole, is_sound, growth)
    failures = _codes(shape, a, whole, begin, end) + law_faults(shape, a, whole, is_sound)
    failures += _cut(own, whole.ts[:, SAVED // 2], "cut")
    failures += _phase(own, rng) + _units(own, rng)
    glass = run(*mirrored(shape, a), begin, end)
    failures += own.faults_of("mirror", glass, -glass.xs, -glass.vs)
    if shape.masses > 1:
        order = rng.permutation(shape.masses)
        other = run(*permuted(shape, a, order), begin, end)
        failures += own.faults_of("permutation", other, other.xs[..., order], other.vs[..., order])
    if shape.contacts:
        failures += momentum_faults(*free(shape, a), begin, end)
    at_event = _some_event(own, rng)
    failures += _cut(own, at_event, "cut at an event")
    if shape.load in ("wave", "table") and shape.kind != "cubic":
        knotted = run(shape, with_knot(shape, a, at_event), begin, end)
        failures += own.faults("knot at an event", knotted.xs, knotted.vs)
    failures += _of_elements(own, rng)
    failures += balance_faults(shape, a, whole, rng)
    failures += impact_faults(shape, a, whole, np.random.default_rng([len(begin), shape.masses]))
    return failures, int(own.is_fair.sum())


def _of_elements(own: Compared, rng: np.random.Generator) -> list[Failure]:
    """Motions with the elements in another order, with two in place of each, and with walls as forces."""
    shape, a, given = own.shape, own.a, (own.begin, own.end)
    failures = []
    other_shape, other_a, old = reordered(shape, a, rng)
    if (old != np.arange(len(old))).any():
        other = run(other_shape, other_a, *given)
        # Places behind the end of a log are -1.
        other = other._replace(stop=np.append(old, -1)[other.stop])
        failures += own.faults_of("order of elements", other, other.xs, other.vs)
    if shape.pads or shape.sliders or shape.cushions or shape.buffers:
        twice = run(*doubled(shape, a), *given)
        failures += own.faults_of("doubled elements", twice, twice.xs, twice.vs, events="none")
    if shape.cushions and not (a["cushion_damping"].any() or a["preload"].any() or shape.is_nonlinear):
        as_force = walled(shape, a)
        other = run(*as_force, *given)
        failures += own._replace(shape=as_force[0]).faults("walls as forces", other.xs, other.vs)
    return failures


def _some_event(own: Compared, rng: np.random.Generator) -> np.ndarray:
    """Time of an event of each motion after its start, else the middle, (lanes,)."""
    whole, middle = own.whole, own.whole.ts[:, SAVED // 2]
    chosen = rng.integers(0, np.clip(whole.num_events, 1, ROOM))
    at = whole.t[np.arange(len(chosen)), chosen]
    return np.where((at > own.begin) & (at < own.end), at, middle)


def _cut(own: Compared, since: np.ndarray, name: str) -> list[Failure]:
    """Motions that are run to a time and go on from there end where the whole ones do."""
    start = start_of_rest(own.shape, own.a, own.begin, since, own.is_sound)
    later = run(own.shape, own.a, since, own.end, *start)
    return own.faults(name, later.xs[:, -1:], later.vs[:, -1:], slice(-1, None))


def _phase(own: Compared, rng: np.random.Generator) -> list[Failure]:
    """Motions that begin later, with their loads, are the same."""
    shape, a = own.shape, own.a
    shift = rng.uniform(0, 1, len(own.begin)) * 2 * np.pi / a["frequency"]
    if shape.is_moving or shape.load == "wave":  # which have no phase
        return []
    moved = run(shape, delayed(shape, a, shift), own.begin + shift, own.end + shift)
    return own.faults("phase", moved.xs, moved.vs)


def _units(own: Compared, rng: np.random.Generator) -> list[Failure]:
    """Motions in other units: by powers of two, which alter no digit, by thirds and by powers of ten, which alter all."""
    units = rng.integers(-UNITS, UNITS + 1, (3, len(own.begin)))
    two = 2.0 ** np.stack([*units[:2], np.maximum(units[2], units[1] - FASTEST)])
    other = _in_units(own, two)
    failures = own.faults("units", other.xs, other.vs)
    tens = rng.integers(-TENS, TENS + 1, (3, len(own.begin)))
    ten = 10.0 ** np.stack([*tens[:2], np.maximum(tens[2], tens[1] - TENS)])
    for name, units in (("thirds", np.outer(ODD_UNITS, np.ones(len(own.begin)))), ("tens", ten)):
        other = _in_units(own, units)
        events = "heavy" if name == "thirds" else "none"
        failures += own.faults_of(name, other, other.xs, other.vs, events=events)
    return failures


def _in_units(own: Compared, units: np.ndarray) -> Run:
    """The motions computed in other units of mass, length and time, (3, lanes), with states in those of before."""
    mass, length, time = units
    a = in_other_units(own.shape, own.a, mass, length, time)
    # Steps of a stiff machine differ by some in a hundred: those that just end within the bound end in any unit.
    other = run(own.shape, a, own.begin * time, own.end * time, most_steps=2 * MOST_STEPS)
    unit = (length / time)[:, None]
    xs, vs = other.xs / length[:, None, None], other.vs / unit[..., None]
    return other._replace(xs=xs, vs=vs, before=other.before / unit)


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
        if gaps(shape, _one(a, k), np.zeros((1, 1)), own["x0"][None, None]).min() < DIFFERENCE:
            continue  # and a difference begins where bodies overlap
        coarse, fine = (_difference(last, start, way, step) for step in (DIFFERENCE, DIFFERENCE / 4))
        spread, lack = np.abs(coarse - fine).max(), np.abs(fine - np.asarray(forward)).max()
        # Beside an impact without speed, or where the order of events changes, differences say nothing.
        if spread <= SMOOTH * size and not lack <= 10 * SMOOTH * size:
            failures.append(Failure("derivative and difference", k, lack / (10 * SMOOTH * size)))
    return failures


def _one(a: dict, lane: int) -> dict:
    """One machine as a batch."""
    return {name: value[lane : lane + 1] for name, value in a.items()}


def _difference(function, start, way, step: float) -> np.ndarray:
    """Central difference along a direction."""
    ends = [
        np.asarray(function(*(a + sign * step * b for a, b in zip(start, way, strict=True))))
        for sign in (1, -1)
    ]
    return (ends[0] - ends[1]) / (2 * step)


def _codes(shape: Shape, a: dict, whole: Run, begin: np.ndarray, end: np.ndarray) -> list[Failure]:
    allowed = {code_of("successful"), code_of("max_events_reached")}
    if shape.rubs:  # the law of friction may leave no motion
        allowed.add(code_of("friction_paradox"))
    # A motion without load dies out until the squares of its numbers underflow.
    is_dead = np.nanmin(np.abs(whole.vs).max(axis=2), axis=1) < DEAD
    may_not_end = is_endless(a) | is_dead
    is_long = whole.result == code_of("max_steps_reached")
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
    # From rest the disturbed forces alone move the masses.
    is_still, fastest = (a["v0"] == 0).all(axis=1), np.nanmax(np.abs(whole.vs), axis=(1, 2))
    for disturbance in DISTURBANCES:
        factor = 1 + disturbance
        disturbed = {**a, "stiffness": a["stiffness"] * factor}
        disturbed |= {name: a[name] / factor for name in ("amplitude", "mean")}
        near = run(shape, disturbed, begin, end, None, a["v0"] * (1 + disturbance * shares))
        size = abs(disturbance) * (np.where(is_still, fastest, np.abs(a["v0"]).max(axis=1)) + 1e-300)
        away = np.maximum(
            np.abs(near.xs - whole.xs).max(axis=(1, 2)), np.abs(near.vs - whole.vs).max(axis=(1, 2))
        )
        other = (near.num_events != whole.num_events) | (near.kind != whole.kind).any(axis=1)
        growth = np.maximum(growth, np.where(other | ~is_sound, np.inf, away / size))
    return growth
