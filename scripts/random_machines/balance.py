"""Balance of momentum of random machines over short times between events: what is left of it are forces that the laws allow.

Contacts push, and only where they are closed; friction is at its limit against the slip, or within it where nothing slips; a Jenkins
element follows its spring or is at its limit. Whether such forces exist is a linear program. It knows nothing of how the
library decides which contacts hold and which elements slip, and a motion with a wrong decision has none.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from .laws import marks_of
from .loads import smooth_forces
from .machines import coefficients, matrices, own_numbers
from .runs import SAVED, Failure, Run, run
from .shapes import Shape

# Times between events that are looked at in each motion.
PARTS = 3
# Places in each: both ends, and those of Gauss between them.
PLACES, WEIGHTS = np.polynomial.legendre.leggauss(SAVED // PARTS - 2)
FRACTIONS = np.concatenate([[0.0], (PLACES + 1) / 2, [1.0]])
# Relative rounding of gaps, speeds and forces that are zero, and the error of the balance.
ZERO, OF_BALANCE = 1e-10, 1e-9
# Shortest times between events that are looked at, in forcing periods.
SHORTEST = 1e-5


class _Part(NamedTuple):
    """A motion between two events at `FRACTIONS` of the time."""

    ts: np.ndarray
    x: np.ndarray
    v: np.ndarray
    stretches: np.ndarray

    def mean(self, a: np.ndarray) -> np.ndarray:
        """Mean over the time of what is given at all places, (places, ...)."""
        return np.tensordot(WEIGHTS / 2, a[1:-1], axes=1)


class Forces(NamedTuple):
    """Unknown means of forces: their directions, least and largest, and bounds by other ones, rows <= 0."""

    directions: list[np.ndarray]
    bounds: list[tuple[float, float]]
    rows: list[dict[int, float]]

    def add(self, direction: np.ndarray, least: float, most: float) -> int:
        """A force, and its number."""
        self.directions.append(direction)
        self.bounds.append((least, most))
        return len(self.bounds) - 1


def balance_faults(shape: Shape, a: dict, whole: Run, rng: np.random.Generator) -> list[Failure]:
    """Motions in which no forces that the laws allow give the accelerations."""
    begin, end = _parts(shape, a, whole, rng)
    own_end = whole.ts[:, -1:]
    fractions = ((begin + (end - begin) * FRACTIONS) / own_end[..., None]).reshape(len(begin), -1)
    again = run(shape, a, np.zeros(len(begin)), own_end[:, 0], fractions=fractions)
    failures = []
    for k in range(len(begin)):
        own = own_numbers(a, k)
        split = (again.ts[k], again.xs[k], again.vs[k], again.stretches[k])
        for part in zip(*(np.split(column, PARTS) for column in split), strict=True):
            one = _Part(*part)
            if _is_quiet(again, k, one):
                lack = _lack(shape, own, one)
                if not lack <= 1.0:
                    failures.append(Failure("balance", k, lack))
    return failures


def _is_quiet(run: Run, lane: int, part: _Part) -> bool:
    """Whether no event lies in a time: saved times end steps, whose rounding a chaotic motion magnifies."""
    log, (begin, end) = run.t[lane][: run.num_events[lane]], part.ts[[0, -1]]
    # States behind the end of a run that stopped early are those of its end.
    is_known = np.isfinite(part.x).all() and end <= run.known[lane]
    return bool(is_known and begin < end and not ((log >= begin) & (log <= end)).any())


def _parts(shape: Shape, a: dict, whole: Run, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Begins and ends of times between events and knots, in order, (lanes, parts, 1) each; empty where there are fewer."""
    found = np.zeros((2, len(whole.ts), PARTS, 1))
    for k, frequency in enumerate(a["frequency"]):
        period, marks = 2 * np.pi / frequency, marks_of(shape, a, whole, k)
        long = np.flatnonzero(np.diff(marks) > SHORTEST * period)
        chosen = np.sort(rng.permutation(long)[:PARTS])
        length = np.diff(marks)[chosen]
        margin = 1e-3 * length
        most = np.minimum(period / 16, 1 / fastest(shape, own_numbers(a, k)))
        start = marks[chosen] + margin + (length - 2 * margin) * rng.uniform(0.0, 0.5, len(chosen))
        found[0, k, :, 0] = found[1, k, :, 0] = marks[-1]
        found[0, k, : len(chosen), 0] = start
        found[1, k, : len(chosen), 0] = np.minimum(marks[chosen + 1] - margin, start + most)
    return found[0], found[1]


def fastest(shape: Shape, own: dict) -> float:
    """Bound on the rates of a motion."""
    stiffness, damping = np.abs(own["stiffness"]).sum(), np.abs(own["damping"]).sum()
    for name in ("cushion", "buffer"):
        if name in own:
            stiffness, damping = (
                stiffness + own[f"{name}_stiffness"].sum(),
                damping + own[f"{name}_damping"].sum(),
            )
    stiffness += own["slider_stiffness"].sum()
    lightest = np.linalg.eigvalsh(matrices(shape, own["mass"])).min()
    return float(np.sqrt(stiffness / lightest) + damping / lightest + own["frequency"])


def _lack(shape: Shape, own: dict, part: _Part) -> float:
    """What no forces that the laws allow explain, in units of the tolerance; infinite if an element breaks its law."""
    mass, span = matrices(shape, own["mass"]), part.ts[-1] - part.ts[0]
    smooth = smooth_forces(shape, own, part.ts, part.x, part.v)
    unknown = Forces([], [], [])
    pressing, pressed = _contacts(shape, own, part, unknown)
    of_sliders = _of_sliders(shape, own, part)
    if of_sliders is None or not _friction(shape, own, part, unknown, pressing):
        return np.inf
    smooth = smooth + of_sliders - pressed
    inertia = mass @ (part.v[-1] - part.v[0]) / span
    rest = inertia - part.mean(smooth)
    sizes = np.abs(inertia) + part.mean(np.abs(smooth)) + part.mean(np.abs(part.x) @ np.abs(own["stiffness"]))
    rounding = np.abs(mass) @ np.abs(part.v).max(axis=0) / span
    return distance(rest, unknown, OF_BALANCE * sizes + 1e-4 * OF_BALANCE * rounding)


def _of_sliders(shape: Shape, own: dict, part: _Part) -> np.ndarray | None:
    """Forces of Jenkins elements on the masses, from their stretches; None if one neither sticks nor slips at its limit."""
    force = np.zeros_like(part.x)
    for j, row in enumerate(shape.sliders):
        direction, stretch = coefficients(row, shape.masses), part.stretches[:, j]
        limit = own["slider_limit"][j] / own["slider_stiffness"][j]
        place = part.x @ direction
        scale = ZERO * (np.abs(place).max() + limit)
        sticks = np.abs((stretch - stretch[0]) - (place - place[0])).max() <= scale
        slip = _slip(part.v @ direction, ZERO * (np.abs(part.v).max() + 1e-3))
        slips = slip is not None and np.abs(stretch - slip * limit).max() <= scale
        if not ((sticks and np.abs(stretch).max() <= limit + scale) or slips):
            return None
        force = force - own["slider_stiffness"][j] * stretch[:, None] * direction
    return force


def _contacts(
    shape: Shape, own: dict, part: _Part, unknown: Forces
) -> tuple[list[int | np.ndarray | None], np.ndarray]:
    """Of each contact the number of its unknown force, its known force, or None where it is open; the sum of known ones."""
    pressing: list[int | np.ndarray | None] = []
    pressed, scale = np.zeros_like(part.x), ZERO * (np.abs(part.x).max() + 1e-3)
    for direction, gap in rigid_contacts(shape, own, part.ts, part.x):
        is_closed = np.abs(gap).max() <= scale
        pressing.append(unknown.add(-direction, 0.0, np.inf) if is_closed else None)
    for name, direction, place, j in _soft(shape, own):
        preload = own["preload" if name == "cushion" else "buffer_preload"][j]
        depth, speed = part.x @ direction - place, part.v @ direction
        if preload > 0 and np.abs(depth).max() <= scale:
            pressing.append(unknown.add(-direction, 0.0, preload))
            continue
        force = preload + own[f"{name}_stiffness"][j] * depth + own[f"{name}_damping"][j] * speed
        force = np.where(depth > 0, np.maximum(force, 0.0), 0.0)
        pressing.append(force)
        pressed = pressed + force[:, None] * direction
    return pressing, pressed


def rigid_contacts(
    shape: Shape, own: dict, ts: np.ndarray, x: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Direction and gaps of each rigid stop and contact, at times and places, (times, masses)."""
    found = []
    for j, (i, side) in enumerate(shape.stops):
        sign = 1.0 if side == "upper" else -1.0
        wall = sign * own["position"][j]
        if shape.is_moving and j == 0:
            wall = wall + own["travel"] * np.cos(own["frequency"] * ts)
        found.append((sign * coefficients((i,), shape.masses), sign * (wall - x[:, i])))
    for j, row in enumerate(shape.contacts):
        direction = coefficients(row, shape.masses)
        found.append((direction, own["distance"][j] - x @ direction))
    return found


def _soft(shape: Shape, own: dict) -> list[tuple[str, np.ndarray, float, int]]:
    """Name, direction, place and number of each compliant stop and contact."""
    found = []
    for j, (i, side) in enumerate(shape.cushions):
        sign = 1.0 if side == "upper" else -1.0
        found.append(("cushion", sign * coefficients((i,), shape.masses), own["cushion"][j], j))
    for j, row in enumerate(shape.buffers):
        found.append(("buffer", coefficients(row, shape.masses), own["buffer"][j], j))
    return found


def _friction(
    shape: Shape, own: dict, part: _Part, unknown: Forces, pressing: list[int | np.ndarray | None]
) -> bool:
    """Add the forces of friction; False if an element turned between two events."""
    scale = ZERO * (np.abs(part.v).max() + 1e-3)
    for j, row in enumerate(shape.pads):
        direction, force = coefficients(row, shape.masses), own["friction"][j]
        slip = _slip(part.v @ direction - own["belt"][j], scale)
        if slip is None:
            return False
        least, most = (slip * force, slip * force) if slip else (-own["static"][j], own["static"][j])
        unknown.add(-direction, least, most)
    for j, (row, contact) in enumerate(shape.rubs):
        direction, coefficient, pressure = (
            coefficients(row, shape.masses),
            own["coefficient"][j],
            pressing[contact],
        )
        if pressure is None:
            continue
        slip = _slip(part.v @ direction, scale)
        if slip is None:
            return False
        if isinstance(pressure, np.ndarray):
            most = coefficient * float(part.mean(pressure))
            unknown.add(-direction, slip * most if slip else -most, slip * most if slip else most)
            continue
        force = unknown.add(-direction, -np.inf, np.inf)
        unknown.rows.append({force: 1.0, pressure: -coefficient * (slip or 1.0)})
        unknown.rows.append({force: -1.0, pressure: coefficient * slip if slip else -coefficient})
    return True


def _slip(speed: np.ndarray, scale: float) -> float | None:
    """Direction of a slip, 0 at rest, None if it has both directions."""
    is_forward, is_back = bool((speed > scale).any()), bool((speed < -scale).any())
    return None if is_forward and is_back else float(is_forward) - float(is_back)


def distance(rest: np.ndarray, unknown: Forces, tolerance: np.ndarray) -> float:
    """Least s for which forces within their bounds leave s times the tolerance of the rest, in each component."""
    unit = float(tolerance.max())
    if not unit > 0:
        return 0.0
    allowed, n, m = np.maximum(tolerance / unit, 1e-6), len(rest), len(unknown.bounds)
    forces = np.stack(unknown.directions, axis=1) if m else np.zeros((n, 0))
    rows = np.zeros((len(unknown.rows), m + 1))
    for place, row in zip(rows, unknown.rows, strict=True):
        place[list(row)] = list(row.values())
    above = np.hstack([np.vstack([forces, -forces]), -np.tile(allowed, 2)[:, None]])
    right = np.concatenate([rest, -rest]) / unit
    bounds = [(least / unit, most / unit) for least, most in unknown.bounds]
    found = linprog(
        np.eye(m + 1)[-1],
        np.vstack([above, rows]),
        np.append(right, np.zeros(len(rows))),
        bounds=[*bounds, (0, None)],
    )
    return float(found.fun) if found.status == 0 else np.inf
