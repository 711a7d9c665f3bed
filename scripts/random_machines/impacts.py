"""Balance of momentum and energy over the impacts of random machines: impulses that the law of impacts allows.

A motion is looked at just before and just behind some instants. The change of its momentum is the sum of the impulses in the log, and
of those of contacts that are closed and stay so, which push and are not logged. Each contact that is hit pushes, and leaves with the
speed of its restitution, or faster where it does not push; friction of a contact has an impulse within its bound, and at it against a
slip. Whether such impulses exist is a linear program, as in `balance.py`. Without friction the log tells the loss of energy as well.
"""

import math
from typing import NamedTuple

import numpy as np

import vijax as vx

from .balance import OF_BALANCE, Forces, distance, fastest, rigid_contacts
from .laws import marks_of
from .machines import coefficients, matrices, own_numbers
from .runs import ROOM, SAVED, Failure, Run, run
from .shapes import Shape

# Saved times on each side of an instant, and the instants that are looked at in each motion.
SIDE = 3
INSTANTS = SAVED // (2 * SIDE)
# Distance of the saved times, in fastest time scales of the machine.
NEAR = 1e-5
# Rounding of velocities at an instant, from those beside it, relative to the fastest ones: 40 of the last digit.
ROUNDING = 1e-14
# Relative rounding of gaps and speeds that are zero. Slower impacts are those of rounding, which leave no speed.
ZERO = 1e-8


class _Hit(NamedTuple):
    """One impact: its contact, its impulse that opens the gap, speeds of approach before and after it, its restitution."""

    contact: int
    push: float
    minus: float
    plus: float
    restitution: float


class _Impact(NamedTuple):
    """An instant with impacts: states on both sides of it, and the rows of its log."""

    t: float
    x: np.ndarray
    before: np.ndarray
    after: np.ndarray
    rows: np.ndarray

    @property
    def speed(self) -> float:
        """Size of the velocities."""
        return float(np.abs([self.before, self.after]).max()) + 1e-3


def impact_faults(shape: Shape, a: dict, whole: Run, rng: np.random.Generator) -> list[Failure]:
    """Instants whose impulses, speeds or loss of energy the law of impacts does not allow."""
    if not (shape.stops or shape.contacts):
        return []
    lanes, own_end = len(whole.ts), whole.ts[:, -1:]
    times = np.repeat(own_end, SAVED, axis=1)
    for k in range(lanes):
        own = own_numbers(a, k)
        step = NEAR / fastest(shape, own)
        chosen = _instants(shape, a, whole, k, step, rng)
        around = step * np.concatenate([np.arange(-SIDE, 0), np.arange(1, SIDE + 1)])
        times[k, : 2 * SIDE * len(chosen)] = (chosen[:, None] + around).ravel()
    again = run(shape, a, np.zeros(lanes), own_end[:, 0], fractions=np.minimum(times / own_end, 1.0))
    failures = []
    for k in range(lanes):
        for impact in _impacts(again, k):
            for name, lack in _lacks(shape, own_numbers(a, k), again, k, impact).items():
                if not lack <= 1.0:
                    failures.append(Failure(name, k, lack))
    return failures


def _instants(
    shape: Shape, a: dict, whole: Run, lane: int, step: float, rng: np.random.Generator
) -> np.ndarray:
    """Some times of impacts with no other event beside them, in order."""
    marks, known = marks_of(shape, a, whole, lane), min(int(whole.num_events[lane]), ROOM)
    is_impact = whole.kind[lane][:known] == vx.IMPACT
    times = np.unique(whole.t[lane][:known][is_impact])
    if not len(times):
        return times
    apart = np.abs(times[:, None] - marks)
    is_alone = np.where(apart > 0, apart, np.inf).min(axis=1) > 2 * (SIDE + 1) * step
    inside = (times > 2 * SIDE * step) & (times < marks[-1] - 2 * SIDE * step)
    # A bounce of a chatter is like the one before it.
    return np.sort(rng.permutation(times[is_alone & inside])[:INSTANTS])


def _impacts(again: Run, lane: int) -> list[_Impact]:
    """The instants in a run that was saved around them; those that are not where they were are left out."""
    log = again.t[lane][: min(int(again.num_events[lane]), ROOM)]
    found = []
    for first in range(0, 2 * SIDE * INSTANTS, 2 * SIDE):
        ts, x, v = (column[lane][first : first + 2 * SIDE] for column in (again.ts, again.xs, again.vs))
        rows = np.flatnonzero((log > ts[0]) & (log <= ts[-1]))
        is_one = len(rows) and (log[rows] == log[rows[0]]).all() and ts[SIDE - 1] < log[rows[0]] < ts[SIDE]
        if is_one and np.isfinite(v).all():
            t = float(log[rows[0]])
            before, after = (_at(t, ts[half], v[half]) for half in (slice(SIDE), slice(SIDE, None)))
            found.append(_Impact(t, _at(t, ts[:SIDE], x[:SIDE]), before, after, rows))
    return found


def _at(t: float, ts: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at a time, by the polynomial through those beside it."""
    weights = [np.prod([(t - other) / (own - other) for other in ts if other != own]) for own in ts]
    return np.array(weights) @ values


def _lacks(shape: Shape, own: dict, run: Run, lane: int, impact: _Impact) -> dict[str, float]:
    """By how much an instant lacks impulses, restitution and the balance of energy, in units of the tolerance."""
    mass, speed = matrices(shape, own["mass"]), impact.speed
    contacts = rigid_contacts(shape, own, np.array([impact.t]), impact.x[None])
    rows, gaps = (np.stack(column) for column in zip(*contacts, strict=True))
    walls = _speeds_of_walls(shape, own, impact.t)
    hits = _hits(shape, own, run, lane, impact, walls)
    total = np.bincount([hit.contact for hit in hits], [hit.push for hit in hits], len(rows))
    # Of several at one instant some may follow others.
    is_single = len(hits) == 1
    is_closed = np.abs(gaps[:, 0]) <= ZERO * (np.abs(impact.x).max() + 1e-3)
    stays = is_closed & (np.abs(rows @ impact.after - walls) <= ZERO * speed)
    unlogged = np.flatnonzero(stays if is_single else is_closed)
    unknown = Forces([], [], [])
    numbers = {int(j): unknown.add(-rows[j], 0.0, np.inf) for j in unlogged}
    _add_friction(shape, own, impact, unknown, numbers, total, is_single=is_single)
    sizes = np.abs(mass) @ (np.abs(impact.before) + np.abs(impact.after)) + np.abs(total) @ np.abs(rows)
    change = mass @ (impact.after - impact.before) + total @ rows
    # Velocities are rounded as the fastest ones are, those of an impact at the end of a graze too.
    rounding = ROUNDING * np.abs(mass) @ np.abs(run.vs[lane]).max(axis=0)
    lacks = {
        "impulse": distance(change, unknown, OF_BALANCE * sizes + rounding),
        "restitution": max(_lack_of_law(hit, speed, sizes.max()) for hit in hits),
    }
    if is_single and not stays[hits[0].contact]:
        (hit,) = hits
        found = [rows[hit.contact] @ v - walls[hit.contact] for v in (impact.before, impact.after)]
        error = np.abs(np.subtract((hit.minus, hit.plus), found)).max()
        lacks["logged speeds"] = float(error / (OF_BALANCE * speed))
    # The bounces that end at once have impulses as well.
    is_whole = not any(stays[hit.contact] and hit.restitution > 0 for hit in hits)
    if is_whole and not (shape.rubs or shape.is_moving):
        loss = sum(hit.push * (1 - hit.restitution) * hit.minus / 2 for hit in hits)
        before, after = (v @ mass @ v / 2 for v in (impact.before, impact.after))
        lacks["loss of energy"] = abs(before - after - loss) / (OF_BALANCE * sizes.max() * speed)
    return lacks


def _hits(shape: Shape, own: dict, run: Run, lane: int, impact: _Impact, walls: np.ndarray) -> list[_Hit]:
    """Impacts of the log, counted towards their contacts."""
    restitution, hits = np.concatenate([own["restitution"], own["contact_restitution"]]), []
    for row in impact.rows[run.kind[lane][impact.rows] == vx.IMPACT]:
        j = int(run.stop[lane, row])
        is_lower = j < len(shape.stops) and shape.stops[j][1] == "lower"
        side, opens = (-1.0 if is_lower else 1.0), (1.0 if is_lower or j >= len(shape.stops) else -1.0)
        minus, plus = (side * a[lane, row] - walls[j] for a in (run.before, run.after))
        hits.append(_Hit(j, opens * run.impulse[lane, row], minus, plus, restitution[j]))
    return hits


def _lack_of_law(hit: _Hit, speed: float, momentum: float) -> float:
    """By how much an impact breaks the law of restitution: it pushes, and leaves faster only where it does not push."""
    if hit.minus <= ZERO * speed:
        return 0.0
    lack = hit.plus + hit.restitution * hit.minus
    lack = abs(lack) if hit.push > OF_BALANCE * momentum else lack
    return max(lack / (OF_BALANCE * speed), -hit.push / (OF_BALANCE * momentum))


def _add_friction(
    shape: Shape,
    own: dict,
    impact: _Impact,
    unknown: Forces,
    numbers: dict[int, int],
    total: np.ndarray,
    *,
    is_single: bool,
) -> None:
    """Add the impulses of friction of contacts; `numbers` are those of the impulses of contacts that are not logged."""
    for j, (row, contact) in enumerate(shape.rubs):
        if contact >= len(total) or (total[contact] == 0 and contact not in numbers):
            continue
        direction, coefficient = coefficients(row, shape.masses), float(own["coefficient"][j])
        slip = float(direction @ impact.after)
        force = unknown.add(-direction, -np.inf, np.inf)
        pushed = unknown.add(0 * direction, total[contact], total[contact])
        pushes = [pushed, numbers[contact]] if contact in numbers else [pushed]
        for side in (1.0, -1.0):
            unknown.rows.append({force: side, **dict.fromkeys(pushes, -coefficient)})
        if is_single and abs(slip) > ZERO * impact.speed:
            unknown.rows.append({force: -math.copysign(1.0, slip), **dict.fromkeys(pushes, coefficient)})


def _speeds_of_walls(shape: Shape, own: dict, t: float) -> np.ndarray:
    """Speeds of the rigid stops and contacts along their directions."""
    speeds = np.zeros(len(shape.stops) + len(shape.contacts))
    if shape.is_moving:
        sign = 1.0 if shape.stops[0][1] == "upper" else -1.0
        speeds[0] = -sign * own["travel"] * own["frequency"] * np.sin(own["frequency"] * t)
    return speeds
