"""Random machines: a shape, for which programs are compiled, and the numbers of many machines of that shape."""

from typing import Any, Literal, NamedTuple

import numpy as np

import vijax as vx

# A row that names two masses has the coefficients 1 and -1.
Row = tuple[int, ...]
Side = Literal["upper", "lower"]


class Shape(NamedTuple):
    """What all machines of a batch have in common.

    Attributes:
        masses: n.
        is_full: whether the mass matrix is full.
        stops: mass and side of each rigid stop.
        contacts: masses of each rigid contact.
        cushions: mass and side of each compliant stop.
        pads: masses of each friction element of constant normal force.
        rubs: masses of each friction element tied to a contact, and the number of that, stops, contacts and cushions in one row.
        sliders: masses of each Jenkins element.
        harmonics: of the load.
        is_driven: whether there is a load, a mean load, a moving stop or a belt.
        is_moving: whether stop 0 moves.
        is_general: whether the damping is not proportional.
    """

    masses: int
    is_full: bool
    stops: tuple[tuple[int, Side], ...]
    contacts: tuple[Row, ...]
    cushions: tuple[tuple[int, Side], ...]
    pads: tuple[Row, ...]
    rubs: tuple[tuple[Row, int], ...]
    sliders: tuple[Row, ...]
    harmonics: int
    is_driven: bool
    is_moving: bool
    is_general: bool

    @property
    def is_switching(self) -> bool:
        """Whether forces switch: friction, Jenkins elements or compliant stops."""
        return bool(self.cushions or self.pads or self.rubs or self.sliders)

    @property
    def is_rigid(self) -> bool:
        """Whether all contacts are rigid stops of one mass."""
        return not (self.contacts or self.is_switching)


def draw_shape(rng: np.random.Generator, most_masses: int) -> Shape:
    """Draw a shape; small machines are the most frequent."""
    n = min(int(rng.geometric(0.4)), most_masses)
    sides: tuple[Side, Side] = "lower", "upper"
    whole = [(i, side) for i in range(n) for side in sides]
    places = [whole[k] for k in rng.permutation(len(whole))]
    kind = rng.choice(["stops", "contacts", "friction", "cushions", "rubbing", "hysteresis", "all"])
    stops = places[: rng.integers(1, min(4, 2 * n) + 1)]
    contacts: list[Row] = []
    cushions: list[tuple[int, Side]] = []
    pads: list[Row] = []
    if kind in ("contacts", "all") and n > 1:
        contacts = [_pair(rng, n) for _ in range(rng.integers(1, 3))]
        contacts = list(dict.fromkeys(contacts))
    if kind in ("cushions", "all"):
        cushions, stops = stops[:2], stops[2:]
    if kind in ("friction", "all"):
        pads = [_row(rng, n) for _ in range(rng.integers(1, 3))]
        pads = list(dict.fromkeys(pads))
    pressing = len(stops) + len(contacts) + len(cushions)
    rubs: list[tuple[Row, int]] = []
    if pressing and (kind == "rubbing" or (kind == "all" and rng.random() < 0.3)):
        rubs = [(_row(rng, n), int(rng.integers(pressing))) for _ in range(rng.integers(1, 3))]
        rubs = list(dict.fromkeys(rubs))
    sliders: list[Row] = []
    if kind == "hysteresis" or (kind == "all" and rng.random() < 0.3):
        sliders = [_row(rng, n) for _ in range(rng.integers(1, 3))]
    is_driven = bool(rng.random() < 0.85)
    return Shape(
        masses=n,
        is_full=bool(n > 1 and rng.random() < 0.2),
        stops=tuple(stops),
        contacts=tuple(contacts),
        cushions=tuple(cushions),
        pads=tuple(pads),
        rubs=tuple(rubs),
        sliders=tuple(sliders),
        harmonics=int(rng.choice([1, 1, 1, 2, 3])),
        is_driven=is_driven,
        is_moving=bool(is_driven and stops and rng.random() < 0.2),
        is_general=bool(n > 1 and rng.random() < 0.4),
    )


def _pair(rng: np.random.Generator, n: int) -> Row:
    return tuple(int(i) for i in rng.permutation(n)[:2])


def _row(rng: np.random.Generator, n: int) -> Row:
    return _pair(rng, n) if n > 1 and rng.random() < 0.4 else (int(rng.integers(n)),)


def draw_numbers(rng: np.random.Generator, shape: Shape, count: int) -> dict[str, np.ndarray]:
    """Draw the numbers of many machines, and starts with no stop passed, (count, ...) each."""
    n = shape.masses

    def spread(low: float, high: float, *size: int) -> np.ndarray:
        return 10 ** rng.uniform(low, high, (count, *size))

    def sometimes(share: float, value: float, a: np.ndarray) -> np.ndarray:
        return np.where(rng.random(a.shape) < share, value, a)

    root = rng.normal(size=(count, n, n)) * 0.3 + np.eye(n)
    mass = spread(-1, 1, n)
    full = np.einsum("bij,bj,bkj->bik", root, mass, root) if shape.is_full else mass
    between, ground = sometimes(0.1, 0.0, spread(-1.5, 1.5, max(n - 1, 1))), spread(-1, 1.5, n)
    ground = sometimes(0.3, 0.0, ground)
    ground[:, 0] = spread(-1, 1.5)
    stiffness = _chain(n, ground, between)
    share = sometimes(0.15, 0.0, spread(-2.5, -0.3))[:, None, None]
    damping = share * stiffness
    if shape.is_general:
        damping = damping + _chain(n, sometimes(0.5, 0.0, spread(-2, 0, n)), spread(-2, 0, max(n - 1, 1)))
    driven = float(shape.is_driven)
    size = sometimes(0.3, 0.0, spread(-1, 0.5, shape.harmonics, n))
    size[:, 0, 0] = spread(-0.5, 0.5)
    num_stops, num_contacts = len(shape.stops), len(shape.contacts)
    num_cushions, num_pads = len(shape.cushions), len(shape.pads)
    force = spread(-1.5, 0.3, num_pads)
    x0, travel = np.zeros((count, n)), rng.uniform(0.0, 0.2, count)
    position = sometimes(0.1, 0.0, rng.uniform(0.02, 0.8, (count, num_stops)))
    # Both stops of a mass cannot be at 0: the later one is moved away.
    masses = [i for i, _ in shape.stops]
    for j, i in enumerate(masses):
        if i in masses[:j]:
            is_shut = position[:, masses.index(i)] + position[:, j] == 0
            position[:, j] = np.where(is_shut, 0.1, position[:, j])
    distance = sometimes(0.1, 0.0, rng.uniform(0.02, 0.8, (count, num_contacts)))
    for j, row in enumerate(shape.contacts):  # nor two contacts that act against each other
        for k in (k for k, other in enumerate(shape.contacts[:j]) if other == row[::-1]):
            distance[:, j] = np.where(distance[:, j] + distance[:, k] == 0, 0.1, distance[:, j])
    if shape.is_moving:  # at the start it may be anywhere on its way
        position[:, 0] += travel
    numbers = {
        "mass": full,
        "damping": damping,
        "stiffness": stiffness,
        "amplitude": driven * size,
        "phase": rng.uniform(0, 2 * np.pi, (count, shape.harmonics, n)),
        "mean": driven * sometimes(0.5, 0.0, rng.normal(size=(count, n)) * 0.3),
        "frequency": spread(-0.5, 0.5),
        "position": position,
        "restitution": _restitution(rng, (count, num_stops)),
        "travel": travel,
        "distance": distance,
        "contact_restitution": np.repeat(_restitution(rng, (count, 1)), num_contacts, axis=1),
        "cushion": rng.uniform(0.02, 0.8, (count, num_cushions)),
        "cushion_stiffness": spread(0, 3, num_cushions),
        "cushion_damping": sometimes(0.4, 0.0, spread(-1.5, 0.5, num_cushions)),
        "preload": sometimes(0.5, 0.0, spread(-1.5, 0, num_cushions)),
        "friction": force,
        "static": force * sometimes(0.5, 1.0, rng.uniform(1, 2, force.shape)),
        "belt": driven * sometimes(0.7, 0.0, rng.normal(size=(count, num_pads)) * 0.3),
        "slider_stiffness": spread(-1, 1.5, len(shape.sliders)),
        "slider_limit": spread(-1.5, 0.3, len(shape.sliders)),
        "x0": x0,
        "v0": rng.normal(size=(count, n)),
    }
    return numbers | {
        "coefficient": largest_coefficients(shape, numbers) * spread(-1.5, 0.0, len(shape.rubs))
    }


def largest_coefficients(shape: Shape, a: dict[str, np.ndarray]) -> np.ndarray:
    """Coefficients of friction of contacts with which each contact can still slip (Painleve), (count, rubs)."""
    n = shape.masses
    matrices = a["mass"] if shape.is_full else np.einsum("bi,ij->bij", a["mass"], np.eye(n))
    flexibility = np.linalg.inv(matrices)
    pressing = [*((i,) for i, _ in shape.stops), *shape.contacts, *((i,) for i, _ in shape.cushions)]
    found = np.empty((len(matrices), len(shape.rubs)))
    for k, (row, contact) in enumerate(shape.rubs):
        normal, tangent = (_vector(one, n) for one in (pressing[contact], row))
        own, beside = (np.einsum("i,bij,j->b", normal, flexibility, one) for one in (normal, tangent))
        share = 0.8 / sum(other == contact for _, other in shape.rubs)
        found[:, k] = np.minimum(3.0, share * own / np.maximum(np.abs(beside), 1e-300))
    return found


def _vector(row: Row, n: int) -> np.ndarray:
    vector = np.zeros(n)
    for i, value in _coefficients(row).items():
        vector[i] = value
    return vector


def _restitution(rng: np.random.Generator, size: tuple[int, ...]) -> np.ndarray:
    """From 0.2 to 0.95, sometimes plastic or elastic."""
    r, dice = rng.uniform(0.2, 0.95, size), rng.random(size)
    return np.where(dice < 0.08, 0.0, np.where(dice > 0.92, 1.0, r))


def _chain(n: int, ground: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Matrix of springs to the ground and between neighbours, (count, n, n)."""
    matrix = np.einsum("bi,ij->bij", ground, np.eye(n))
    for i in range(n - 1):
        row = np.zeros(n)
        row[i], row[i + 1] = 1.0, -1.0
        matrix = matrix + between[:, i, None, None] * np.outer(row, row)
    return matrix


def machine(shape: Shape, a: dict[str, Any]) -> vx.ImpactSystem:
    """Machine of a shape with the numbers of one lane."""
    load = vx.Harmonic(a["amplitude"], a["frequency"], a["phase"], a["mean"])
    motion = vx.Harmonic(a["travel"].reshape(1), a["frequency"]) if shape.is_moving else None
    stops: list[Any] = [
        vx.Stop(i, _side(side) * a["position"][j], side, a["restitution"][j], motion if j == 0 else None)
        for j, (i, side) in enumerate(shape.stops)
    ]
    stops += [
        vx.Contact(_coefficients(row), a["distance"][j], a["contact_restitution"][j])
        for j, row in enumerate(shape.contacts)
    ]
    stops += [
        vx.CompliantStop(
            i,
            _side(side) * a["cushion"][j],
            side,
            a["cushion_stiffness"][j],
            a["cushion_damping"][j],
            a["preload"][j],
        )
        for j, (i, side) in enumerate(shape.cushions)
    ]
    friction = [
        vx.Friction(_coefficients(row), a["friction"][j], a["static"][j], a["belt"][j])
        for j, row in enumerate(shape.pads)
    ]
    friction += [
        vx.Friction(_coefficients(row), coefficient=a["coefficient"][j], contact=contact)
        for j, (row, contact) in enumerate(shape.rubs)
    ]
    hysteresis = [
        vx.Jenkins(_coefficients(row), a["slider_stiffness"][j], a["slider_limit"][j])
        for j, row in enumerate(shape.sliders)
    ]
    matrices = a["mass"], a["damping"], a["stiffness"]
    return vx.ImpactSystem(*matrices, load, stops, friction=friction, hysteresis=hysteresis)


def own_numbers(a: dict[str, np.ndarray], lane: int) -> dict[str, np.ndarray]:
    """Numbers of one lane."""
    return {name: value[lane] for name, value in a.items()}


def _side(side: str) -> float:
    return 1.0 if side == "upper" else -1.0


def _coefficients(row: Row) -> dict[int, float]:
    return dict(zip(row, (1.0, -1.0), strict=False))


def mirrored(shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The machine seen in a mirror: all positions change their sign."""
    other: dict[Side, Side] = {"lower": "upper", "upper": "lower"}
    stops = tuple((i, other[side]) for i, side in shape.stops)
    cushions = tuple((i, other[side]) for i, side in shape.cushions)
    contacts = tuple(row[::-1] for row in shape.contacts)
    signs = {name: -a[name] for name in ("amplitude", "mean", "belt", "travel", "x0", "v0")}
    return shape._replace(stops=stops, cushions=cushions, contacts=contacts), {**a, **signs}


def symmetric(shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The machine made symmetric: with the mirror images of its stops, contacts and cushions, no means, belts, moving stops, rubs.

    The mirror image of a motion, half a forcing period later, is then a motion as well: of the harmonics only odd ones act.
    """
    one_side = _first_of_each([i for i, _ in shape.stops])
    one_way = _first_of_each([frozenset(row) for row in shape.contacts])
    one_cushion = _first_of_each([i for i, _ in shape.cushions])
    pairs: tuple[tuple[list[int], tuple[str, ...]], ...] = (
        (one_side, ("position", "restitution")),
        (one_way, ("distance", "contact_restitution")),
        (one_cushion, ("cushion", "cushion_stiffness", "cushion_damping", "preload")),
    )
    numbers = {name: np.repeat(a[name][:, own], 2, axis=1) for own, names in pairs for name in names}
    for name in ("position", "distance"):  # both sides cannot be at 0
        numbers[name] = np.where(numbers[name] == 0, 0.1, numbers[name])
    is_even = np.arange(shape.harmonics) % 2 == 1
    numbers["amplitude"] = np.where(is_even[:, None], 0.0, a["amplitude"])
    numbers |= {name: np.zeros_like(a[name]) for name in ("mean", "belt", "travel")}
    sides: tuple[Side, Side] = "lower", "upper"
    other = shape._replace(
        stops=tuple((shape.stops[j][0], side) for j in one_side for side in sides),
        contacts=tuple(row for j in one_way for row in (shape.contacts[j], shape.contacts[j][::-1])),
        cushions=tuple((shape.cushions[j][0], side) for j in one_cushion for side in sides),
        rubs=(),
        is_moving=False,
    )
    numbers["coefficient"] = a["coefficient"][:, :0]
    return other, {**a, **numbers}


def _first_of_each(keys: list) -> list[int]:
    return [j for j, key in enumerate(keys) if key not in keys[:j]]


def in_other_units(a: dict, mass: np.ndarray, length: np.ndarray, time: np.ndarray) -> dict:
    """The same machines in other units, (lanes,) each."""
    force = mass * length / time**2
    factors = {
        "mass": mass,
        "damping": mass / time,
        "stiffness": mass / time**2,
        "amplitude": force,
        "mean": force,
        "frequency": 1 / time,
        "position": length,
        "travel": length,
        "distance": length,
        "cushion": length,
        "cushion_stiffness": mass / time**2,
        "cushion_damping": mass / time,
        "preload": force,
        "friction": force,
        "static": force,
        "belt": length / time,
        "slider_stiffness": mass / time**2,
        "slider_limit": force,
        "x0": length,
        "v0": length / time,
    }
    ones = np.ones_like(mass)
    return {
        name: value * np.reshape(factors.get(name, ones), (-1,) + (1,) * (value.ndim - 1))
        for name, value in a.items()
    }


def permuted(shape: Shape, a: dict, order: np.ndarray) -> tuple[Shape, dict]:
    """The machine with its masses numbered in another order: mass i becomes mass `order[i]`."""
    old = np.argsort(order)

    def rows(given: tuple[Row, ...]) -> tuple[Row, ...]:
        return tuple(tuple(int(order[i]) for i in row) for row in given)

    matrices = ["damping", "stiffness", *(["mass"] if shape.is_full else [])]
    vectors = ["amplitude", "phase", "mean", "x0", "v0", *([] if shape.is_full else ["mass"])]
    numbers = {name: a[name][..., old] for name in vectors}
    numbers |= {name: a[name][:, old][:, :, old] for name in matrices}
    other = shape._replace(
        stops=tuple((int(order[i]), side) for i, side in shape.stops),
        cushions=tuple((int(order[i]), side) for i, side in shape.cushions),
        contacts=rows(shape.contacts),
        pads=rows(shape.pads),
        rubs=tuple((rows((row,))[0], contact) for row, contact in shape.rubs),
        sliders=rows(shape.sliders),
    )
    return other, {**a, **numbers}


def free(shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The machine on which nothing acts from outside: no ground, no stops, no load."""
    own, sliders = (
        [j for j, row in enumerate(rows) if len(row) == 2] for rows in (shape.pads, shape.sliders)
    )
    first, count = len(shape.stops), len(shape.contacts)
    rubs = [j for j, (row, k) in enumerate(shape.rubs) if len(row) == 2 and first <= k < first + count]
    other = shape._replace(
        stops=(),
        cushions=(),
        pads=tuple(shape.pads[j] for j in own),
        rubs=tuple((shape.rubs[j][0], shape.rubs[j][1] - first) for j in rubs),
        sliders=tuple(shape.sliders[j] for j in sliders),
        is_driven=False,
        is_moving=False,
    )
    numbers = {name: np.zeros_like(a[name]) for name in ("amplitude", "mean")}
    for name in ("damping", "stiffness"):
        numbers[name] = a[name] - np.einsum("bi,ij->bij", a[name].sum(axis=2), np.eye(shape.masses))
    for name in ("position", "restitution", "cushion", "cushion_stiffness", "cushion_damping", "preload"):
        numbers[name] = a[name][:, :0]
    numbers |= {name: a[name][:, own] for name in ("friction", "static", "belt")}
    numbers |= {name: a[name][:, sliders] for name in ("slider_stiffness", "slider_limit")}
    numbers["coefficient"] = a["coefficient"][:, rubs]
    return other, {**a, **numbers}
