"""Bodies in a row that touch, with friction and compliant stops beside their contacts, and numbers as people choose them.

Equal masses, equal frequencies, gaps of zero, loads that just balance friction, starts at rest and on a stop: what an instant decides hangs
on sums that are zero but for rounding, in any unit and in any order of the elements.
"""

import numpy as np

from .shapes import Row, Shape, Side

# Shares of the links that are rigid, of the ends with a stop, of those that are rigid, of pads beside one of the same row, of containers.
RIGID, STOPPED, RIGID_STOPS, SAME_ROW, CONTAINER = 0.8, 0.5, 0.6, 0.4, 0.15
# Most friction elements. Each is doubled by a check, and all sets of what rests are tried.
MOST_PADS = 3
# Share of the shapes whose compliant elements have neither damper nor preload.
PLAIN_SPRINGS = 0.5


def touching_shape(rng: np.random.Generator, most_masses: int) -> Shape:
    """Draw a row of bodies, with a contact between any two neighbours."""
    n = int(rng.integers(2, max(most_masses, 2) + 1))
    is_rigid = rng.random(n - 1) < RIGID
    is_rigid[rng.integers(n - 1)] = True
    links = [(i, i + 1) for i in range(n - 1)]
    contacts: list[Row] = [row for row, own in zip(links, is_rigid, strict=True) if own]
    if rng.random() < CONTAINER:
        contacts.append(contacts[0][::-1])
    stops: list[tuple[int, Side]] = []
    cushions: list[tuple[int, Side]] = []
    ends: tuple[tuple[int, Side], ...] = (0, "lower"), (n - 1, "upper")
    for end in ends:
        if rng.random() < STOPPED:
            (stops if rng.random() < RIGID_STOPS else cushions).append(end)
    pads: list[Row] = []
    for _ in range(rng.integers(MOST_PADS + 1)):
        is_pair, first = rng.random() < 0.3, int(rng.integers(n - 1))
        row: Row = (first, first + 1) if is_pair else (int(rng.integers(n)),)
        pads.append(pads[-1] if pads and rng.random() < SAME_ROW else row)
    return Shape(
        masses=n,
        stops=tuple(stops),
        contacts=tuple(contacts),
        cushions=tuple(cushions),
        pads=tuple(pads),
        is_general=True,
        buffers=tuple(row for row, own in zip(links, is_rigid, strict=True) if not own),
    )


def touching_numbers(rng: np.random.Generator, shape: Shape, count: int) -> dict[str, np.ndarray]:
    """Draw round numbers of many machines, and starts in touch or near it, (count, ...) each."""
    n = shape.masses

    def choose(*values: float, size: tuple[int, ...] = ()) -> np.ndarray:
        return rng.choice(values, (count, *size))

    def alike(*values: float, size: int) -> np.ndarray:
        """The same for all elements in half of the machines."""
        a = choose(*values, size=(size,))
        return np.where(rng.random((count, 1)) < 0.5, a[:, :1], a) if size else a

    mass = alike(1.0, 1.0, 2.0, 3.0, 0.5, size=n)
    stiffness, damping = _matrices(rng, mass)
    friction = alike(0.1, 0.2, 0.25, 0.3, size=len(shape.pads))
    x0 = np.cumsum(choose(0.0, 0.0, 0.0, 0.1, 0.2, size=(n,)), axis=1)
    softness = 0.0 if rng.random() < PLAIN_SPRINGS else 1.0
    numbers = {
        "mass": mass,
        "damping": damping,
        "stiffness": stiffness,
        "mean": _means(rng, shape, mass, friction),
        "amplitude": choose(0.0, 0.0, 0.3, 0.4, size=(1, 1)) * _shares(rng, mass)[:, None],
        "phase": np.repeat(choose(0.0, 0.0, np.pi, np.pi / 2, size=(1, 1)), n, axis=2),
        "frequency": choose(0.7, 1.0, 1.3),
        "travel": np.zeros(count),
        "position": _end_places(shape.stops, x0, choose(0.0, 0.1, 0.5, size=(len(shape.stops),))),
        "restitution": choose(0.0, 0.3, 0.5, 1.0, size=(len(shape.stops),)),
        "distance": np.where([row[0] < row[1] for row in shape.contacts], 0.0, 0.5 + x0[:, -1:]),
        "contact_restitution": alike(0.0, 0.5, 0.5, 0.7, 1.0, size=len(shape.contacts)),
        "cushion": _end_places(shape.cushions, x0, choose(0.0, 0.0, 0.1, size=(len(shape.cushions),))),
        "buffer": np.zeros((count, len(shape.buffers))),
        "friction": friction,
        "static": friction * alike(1.0, 1.0, 1.2, 1.5, size=len(shape.pads)),
        "belt": np.zeros_like(friction),
        "slider_stiffness": np.zeros((count, 0)),
        "slider_limit": np.zeros((count, 0)),
        "coefficient": np.zeros((count, 0)),
        "x0": x0,
        "v0": choose(0.0, 1.0, size=(1,)) * choose(0.0, 0.0, 0.8, -0.5, size=(n,)),
    }
    for name, elements in (("cushion", shape.cushions), ("buffer", shape.buffers)):
        numbers[f"{name}_stiffness"] = alike(10.0, 50.0, size=len(elements))
        numbers[f"{name}_damping"] = softness * alike(0.0, 0.2, size=len(elements))
        numbers[f"{name}_preload"] = softness * alike(0.0, 0.2, size=len(elements))
    numbers["preload"] = numbers.pop("cushion_preload")
    return numbers


def _matrices(rng: np.random.Generator, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping: none, of equal frequencies, of a symmetric chain, of the first mass alone."""
    count, n = mass.shape
    own = mass[:, :, None] * np.eye(n)
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    first = np.zeros((n, n))
    first[0, 0] = 1.0
    kinds = np.stack([0 * own, own, *(a * np.ones((count, 1, 1)) for a in (chain, first))])
    lanes = np.arange(count)
    stiffness = kinds[rng.integers(4, size=count), lanes]
    of_springs = rng.random((count, 1, 1)) < 0.5
    share = rng.choice([0.0, 0.0, 0.1], (count, 1, 1))
    return stiffness, share * np.where(of_springs, stiffness, own)


def _means(rng: np.random.Generator, shape: Shape, mass: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """Mean loads: none, of weight, pressing the row together, or those that friction just balances."""
    count, n = mass.shape
    size = rng.choice([0.1, 0.3], (count, 1))
    pressing = np.zeros((count, n))
    pressing[:, 0], pressing[:, -1] = 1.0, -1.0
    balanced = np.zeros((count, n))
    for k, row in enumerate(shape.pads):
        for i, value in zip(row, (1.0, -1.0), strict=False):
            balanced[:, i] += value * friction[:, k]
    sign = rng.choice([1.0, -1.0], (count, 1))
    kinds = np.stack([0 * mass, sign * size * mass, size * pressing, sign * balanced])
    return kinds[rng.integers(4, size=count), np.arange(count)]


def _shares(rng: np.random.Generator, mass: np.ndarray) -> np.ndarray:
    """Shares of the masses in the load: as their mass, all the first one's, or alternating."""
    count, n = mass.shape
    kinds = np.stack([mass, np.tile(np.eye(n)[0], (count, 1)), np.tile((-1.0) ** np.arange(n), (count, 1))])
    return kinds[rng.integers(3, size=count), np.arange(count)]


def _end_places(ends: tuple[tuple[int, Side], ...], x0: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Places of stops at both ends, at or beyond the start of their mass."""
    own = [x0[:, i] if side == "upper" else -x0[:, i] for i, side in ends]
    return np.stack(own, axis=1) + beyond if ends else beyond
