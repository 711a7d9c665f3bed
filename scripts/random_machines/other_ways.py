"""The same random machine seen in another way: in a mirror, in other units, with its masses in another order, alone, doubled."""

import numpy as np

from .shapes import Row, Shape, Side

# Numbers that change their signs in a mirror.
_SIGNED = "amplitude", "mean", "belt", "travel", "x0", "v0", "values"


def mirrored(shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The machine seen in a mirror: all positions change their sign."""
    other: dict[Side, Side] = {"lower": "upper", "upper": "lower"}
    stops = tuple((i, other[side]) for i, side in shape.stops)
    cushions = tuple((i, other[side]) for i, side in shape.cushions)
    contacts, buffers = (tuple(row[::-1] for row in rows) for rows in (shape.contacts, shape.buffers))
    signs = {name: -a[name] for name in _SIGNED if name in a}
    other_shape = shape._replace(stops=stops, cushions=cushions, contacts=contacts, buffers=buffers)
    return other_shape, {**a, **signs}


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
        load="harmonic",
        is_parametric=False,
    )
    numbers["coefficient"] = a["coefficient"][:, :0]
    return other, {**a, **numbers}


def _first_of_each(keys: list) -> list[int]:
    return [j for j, key in enumerate(keys) if key not in keys[:j]]


def in_other_units(shape: Shape, a: dict, mass: np.ndarray, length: np.ndarray, time: np.ndarray) -> dict:
    """The same machines in other units, (lanes,) each."""
    force, is_record = mass * length / time**2, shape.load == "table"
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
        "buffer": length,
        "buffer_stiffness": mass / time**2,
        "buffer_damping": mass / time,
        "buffer_preload": force,
        "friction": force,
        "static": force,
        "belt": length / time,
        "slider_stiffness": mass / time**2,
        "slider_limit": force,
        "values": force,
        "knots": time if is_record else np.ones_like(time),
        "swing": mass / time**2,
        "cubic": force / length**3,
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

    matrices = [
        "damping",
        "stiffness",
        *(["mass"] if shape.is_full else []),
        *(["swing"] if "swing" in a else []),
    ]
    vectors = [
        "amplitude",
        "phase",
        "mean",
        "x0",
        "v0",
        "values",
        "cubic",
        *([] if shape.is_full else ["mass"]),
    ]
    numbers = {name: a[name][..., old] for name in vectors if name in a}
    numbers |= {name: a[name][:, old][:, :, old] for name in matrices}
    other = shape._replace(
        stops=tuple((int(order[i]), side) for i, side in shape.stops),
        cushions=tuple((int(order[i]), side) for i, side in shape.cushions),
        contacts=rows(shape.contacts),
        buffers=rows(shape.buffers),
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
        load="harmonic",
        is_parametric=False,
        is_nonlinear=False,
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


def delayed(shape: Shape, a: dict, shift: np.ndarray) -> dict:
    """The machine with its loads at later times, (lanes,)."""
    orders = 1 + np.arange(shape.harmonics)[:, None]
    turn = a["frequency"] * shift
    later = {"phase": a["phase"] - orders * turn[:, None, None]}
    if shape.is_parametric:
        later["swing_phase"] = a["swing_phase"] - turn[:, None]
    if shape.load == "table":
        later["knots"] = a["knots"] + shift[:, None]
    return {**a, **later}


def doubled(shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The machine with two elements of half the strength side by side for each pad, slider, cushion and buffer that no friction is tied to."""
    halves = {
        "friction": 0.5, "static": 0.5, "belt": 1.0, "slider_stiffness": 0.5, "slider_limit": 0.5
    }  # fmt: skip
    if not shape.rubs:
        halves |= {"cushion": 1.0, "cushion_stiffness": 0.5, "cushion_damping": 0.5, "preload": 0.5}
        shape = shape._replace(cushions=shape.cushions * 2, buffers=shape.buffers * 2)
    if shape.buffers:
        halves |= {
            "buffer": 1.0, "buffer_stiffness": 0.5, "buffer_damping": 0.5, "buffer_preload": 0.5
        }  # fmt: skip
    numbers = {name: np.tile(share * a[name], 2) for name, share in halves.items()}
    return shape._replace(pads=shape.pads * 2, sliders=shape.sliders * 2), {**a, **numbers}


# Kinds of elements in the order of their numbers in a log, and the numbers of each.
_ELEMENTS = {
    "stops": ("position", "restitution"),
    "contacts": ("distance", "contact_restitution"),
    "cushions": ("cushion", "cushion_stiffness", "cushion_damping", "preload"),
    "buffers": ("buffer", "buffer_stiffness", "buffer_damping", "buffer_preload"),
    "pads": ("friction", "static", "belt"),
    "rubs": ("coefficient",),
    "sliders": ("slider_stiffness", "slider_limit"),
}


def reordered(shape: Shape, a: dict, rng: np.random.Generator) -> tuple[Shape, dict, np.ndarray]:
    """The machine with its elements listed in another order, and the old number of each in a log."""
    numbers, kinds, old = dict(a), {}, np.empty(0, int)
    for kind, names in _ELEMENTS.items():
        given = getattr(shape, kind)
        order = rng.permutation(len(given))
        if kind == "stops" and shape.is_moving:  # the first is the one that moves
            order = np.sort(order)
        kinds[kind] = tuple(given[k] for k in order)
        numbers |= {name: a[name][:, order] for name in names if name in a}
        old = np.append(old, len(old) + order)
    kinds["rubs"] = tuple((row, int(np.flatnonzero(old == contact)[0])) for row, contact in kinds["rubs"])
    return shape._replace(**kinds), numbers, old


def walled(shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The machine whose compliant stops, without dampers and preloads, are given as a force."""
    walls = {"wall": a["cushion"], "wall_stiffness": a["cushion_stiffness"]}
    none = {name: a[name][:, :0] for name in _ELEMENTS["cushions"]}
    return shape._replace(cushions=(), walls=shape.cushions), {**a, **walls, **none}


def with_knot(shape: Shape, a: dict, at: np.ndarray) -> dict:
    """The machine whose table has a knot more, on its lines or steps, at a time, (lanes,), or within its first interval."""
    is_wave = shape.load == "wave"
    place = np.mod(at * a["frequency"] / (2 * np.pi), 1.0) if is_wave else at
    tables = [
        _one_more(knots, values, own, is_wave, shape.kind == "previous")
        for knots, values, own in zip(a["knots"], a["values"], place, strict=True)
    ]
    knots, values = (np.stack(column) for column in zip(*tables, strict=True))
    return {**a, "knots": knots, "values": values}


def _one_more(
    knots: np.ndarray, values: np.ndarray, place: float, is_wave: bool, is_steps: bool
) -> tuple[np.ndarray, np.ndarray]:
    if is_wave:  # whose first knot follows its last
        place = place + (place < knots[0])
        knots, values = np.append(knots, knots[0] + 1), np.append(values, values[:1], axis=0)
    if not knots[0] < place < knots[-1] or place in knots:
        place = (knots[0] + knots[1]) / 2
    left = int(np.searchsorted(knots, place)) - 1
    share = 0.0 if is_steps else (place - knots[left]) / (knots[left + 1] - knots[left])
    value = values[left] + share * (values[left + 1] - values[left])
    knots, values = np.insert(knots, left + 1, place), np.insert(values, left + 1, value, axis=0)
    if is_wave:
        order = np.argsort(knots[:-1] % 1.0)
        knots, values = knots[:-1][order] % 1.0, values[:-1][order]
    return knots, values
