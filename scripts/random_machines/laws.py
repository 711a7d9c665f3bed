"""Laws of mechanics that motions of random machines obey: no penetration, impact law, energy, momentum."""

import numpy as np

import vijax as vx

from .loads import forces_with_power
from .machines import matrices, own_numbers
from .runs import ROOM, SAVED, Failure, Run, code_of, run, start_of_rest
from .shapes import Shape

# Relative rounding that a step may add.
ROUNDING = 1e-11
# Relative error of the work of all forces over a part of a period, with as many points as saved times.
OF_WORK = 1e-9


def law_faults(shape: Shape, a: dict, whole: Run, is_sound: np.ndarray) -> list[Failure]:
    """Motions that pass a stop, break the law of impact, gain energy, or have a log that is out of order."""
    given = shape, a, whole, is_sound
    failures = _penetration(*given) + _impact_law(*given) + _order(whole, is_sound)
    if not (shape.is_driven or shape.sliders):  # whose springs have energy as well
        failures += _energy(*given)
    if not (shape.is_switching or shape.is_moving):
        failures += _work(*given)
    return failures


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
    energy = _stored(shape, a, whole)
    for j, (i, side) in enumerate(shape.cushions):
        sign = 1.0 if side == "upper" else -1.0
        depth = np.maximum(sign * whole.xs[..., i] - a["cushion"][:, None, j], 0)
        energy = energy + depth * (a["preload"][:, None, j] + a["cushion_stiffness"][:, None, j] * depth / 2)
    rise, size = np.diff(energy, axis=1).max(axis=1), 1e-11 * energy.max(axis=1) + 1e-300
    return [
        Failure("energy", int(k), float(rise[k] / size[k])) for k in np.flatnonzero(is_sound & (rise > size))
    ]


def _stored(shape: Shape, a: dict, run: Run) -> np.ndarray:
    """Energy of masses and springs at saved times, (lanes, times)."""
    energy = np.einsum("bti,bij,btj->bt", run.vs, matrices(shape, a["mass"]), run.vs) / 2
    energy = energy + np.einsum("bti,bij,btj->bt", run.xs, a["stiffness"], run.xs) / 2
    return energy + (np.einsum("bi,bti->bt", a["cubic"], run.xs**4) / 4 if shape.is_nonlinear else 0.0)


def _work(shape: Shape, a: dict, whole: Run, is_sound: np.ndarray) -> list[Failure]:
    """Between two events the energy grows by the work of loads and dampers: stops and held masses do none."""
    begin, end = _quiet(shape, a, whole)
    places, weights = np.polynomial.legendre.leggauss(SAVED - 2)
    fractions = np.concatenate([[0.0], (places + 1) / 2, [1.0]])
    start = start_of_rest(shape, a, whole.ts[:, 0], begin, is_sound)
    part = run(shape, a, begin, end, *start, fractions=fractions)
    power = np.stack([_power(shape, own_numbers(a, k), part, k) for k in range(len(begin))])
    work = ((end - begin) / 2) * (power[:, 1:-1] @ weights)
    energy = _stored(shape, a, part)
    lack = np.abs(energy[:, -1] - energy[:, 0] - work)
    # Loads that balance each other do no work but that of rounding.
    loads = np.abs(a["mean"]).max(axis=1) * np.abs(part.vs).max(axis=(1, 2))
    powers = np.maximum(np.abs(power).max(axis=1), ROUNDING * loads / OF_WORK)
    size = OF_WORK * (energy.max(axis=1) + (end - begin) * powers + 1e-300)
    is_quiet = is_sound & (part.num_events == 0) & (part.result == whole.result)
    wrong = np.flatnonzero(is_quiet & ~(lack <= size))
    return [Failure("work", int(k), float(lack[k] / size[k])) for k in wrong]


def _quiet(shape: Shape, a: dict, whole: Run) -> tuple[np.ndarray, np.ndarray]:
    """The longest time between events and knots of each motion, or its first part that is a sixteenth of a period, (lanes,) each."""
    begin, end = [], []
    for k, frequency in enumerate(a["frequency"]):
        period, marks = 2 * np.pi / frequency, marks_of(shape, a, whole, k)
        marks = np.append(marks, marks[-1])  # a log may be full at the start
        place = int(np.argmax(np.diff(marks)))
        margin = 1e-3 * (marks[place + 1] - marks[place])
        begin.append(marks[place] + margin)
        end.append(min(marks[place + 1] - margin, begin[-1] + period / 16))
    return np.array(begin), np.array(end)


def marks_of(shape: Shape, a: dict, whole: Run, lane: int) -> np.ndarray:
    """Times of a motion between which it is smooth: both ends, events and knots, up to the last event of a full log."""
    first, *_, last = whole.ts[lane]
    known, period = whole.t[lane][: whole.num_events[lane]], 2 * np.pi / a["frequency"][lane]
    if whole.num_events[lane] >= ROOM:
        last = known[-1]
    own = a["knots"][lane] if shape.load != "harmonic" else np.empty(0)
    if shape.load == "wave":
        own = ((np.arange(np.ceil(last / period))[:, None] + own) * period).ravel()
    return np.unique(np.clip(np.concatenate([[first, last], known, own]), first, last))


def _power(shape: Shape, own: dict, part: Run, lane: int) -> np.ndarray:
    """Power of the forces without a potential, (times,)."""
    x, v = part.xs[lane], part.vs[lane]
    return np.einsum("ti,ti->t", forces_with_power(shape, own, part.ts[lane], x, v), v)


def momentum_faults(shape: Shape, a: dict, begin: np.ndarray, end: np.ndarray) -> list[Failure]:
    """Momentum of machines on which nothing acts from outside."""
    alone = run(shape, a, begin, end)
    momenta = np.einsum("bij,btj->bti", matrices(shape, a["mass"]), alone.vs)
    lack = np.abs(np.diff(momenta.sum(axis=2), axis=1)).max(axis=1)
    size = ROUNDING * np.abs(momenta).max(axis=(1, 2))
    # Rows of the stiffness add up to zero but for rounding.
    pull = np.abs(a["stiffness"]).max(axis=(1, 2)) * np.abs(alone.xs).max(axis=(1, 2))
    size = size + 4 * shape.masses * np.finfo(float).eps * pull * (end - begin)
    is_sound = (alone.result == code_of("successful")) & np.isfinite(alone.xs).all(axis=(1, 2))
    return [
        Failure("momentum", int(k), float(lack[k] / size[k]))
        for k in np.flatnonzero(is_sound & (lack > size))
    ]
