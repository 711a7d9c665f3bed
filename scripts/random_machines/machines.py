"""Numbers of random machines, and the machines."""

from typing import Any, NamedTuple

import numpy as np

import vijax as vx

from .extras import forces_of, load_of
from .shapes import Row, Shape


class _Draws(NamedTuple):
    """Random numbers of many machines, (count, ...) each."""

    rng: np.random.Generator
    count: int

    def spread(self, low: float, high: float, *size: int) -> np.ndarray:
        """Powers of ten between two exponents."""
        return 10 ** self.rng.uniform(low, high, (self.count, *size))

    def sometimes(self, share: float, value: float, a: np.ndarray) -> np.ndarray:
        """Numbers of which a share is a value instead."""
        return np.where(self.rng.random(a.shape) < share, value, a)


def draw_numbers(rng: np.random.Generator, shape: Shape, count: int) -> dict[str, np.ndarray]:
    """Draw the numbers of many machines, and starts with no stop passed, (count, ...) each."""
    n, draws = shape.masses, _Draws(rng, count)
    spread, sometimes = draws.spread, draws.sometimes
    system = _draw_matrices(draws, shape)
    driven = float(shape.is_driven)
    size = sometimes(0.3, 0.0, spread(-1, 0.5, shape.harmonics, n))
    size[:, 0, 0] = spread(-0.5, 0.5)
    num_contacts, num_cushions, num_pads = len(shape.contacts), len(shape.cushions), len(shape.pads)
    force = spread(-1.5, 0.3, num_pads)
    travel = rng.uniform(0.0, 0.2, count)
    position, distance = _draw_places(draws, shape)
    if shape.is_moving:  # at the start it may be anywhere on its way
        position[:, 0] += travel
    numbers = {
        **system,
        "amplitude": driven * size,
        "phase": rng.uniform(0, 2 * np.pi, (count, shape.harmonics, n)),
        "mean": driven * sometimes(0.5, 0.0, rng.normal(size=(count, n)) * 0.3),
        "frequency": spread(-0.5, 0.5),
        "position": position,
        "restitution": _restitution(rng, position.shape),
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
        "x0": np.zeros((count, n)),
        "v0": rng.normal(size=(count, n)),
    }
    return numbers | {
        "coefficient": largest_coefficients(shape, numbers) * spread(-1.5, 0.0, len(shape.rubs))
    }


def _draw_matrices(draws: _Draws, shape: Shape) -> dict[str, np.ndarray]:
    """Masses, dampers and springs."""
    n = shape.masses
    root = draws.rng.normal(size=(draws.count, n, n)) * 0.3 + np.eye(n)
    mass = draws.spread(-1, 1, n)
    full = np.einsum("bij,bj,bkj->bik", root, mass, root) if shape.is_full else mass
    between, ground = (
        draws.sometimes(0.1, 0.0, draws.spread(-1.5, 1.5, max(n - 1, 1))),
        draws.spread(-1, 1.5, n),
    )
    ground = draws.sometimes(0.3, 0.0, ground)
    ground[:, 0] = draws.spread(-1, 1.5)
    stiffness = _chain(n, ground, between)
    share = draws.sometimes(0.15, 0.0, draws.spread(-2.5, -0.3))[:, None, None]
    damping = share * stiffness
    if shape.is_general:
        damping = damping + _chain(
            n, draws.sometimes(0.5, 0.0, draws.spread(-2, 0, n)), draws.spread(-2, 0, max(n - 1, 1))
        )
    return {"mass": full, "damping": damping, "stiffness": stiffness}


def _draw_places(draws: _Draws, shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Positions of stops, and distances of contacts."""
    position = draws.sometimes(0.1, 0.0, draws.rng.uniform(0.02, 0.8, (draws.count, len(shape.stops))))
    # Both stops of a mass cannot be at 0: the later one is moved away.
    masses = [i for i, _ in shape.stops]
    for j, i in enumerate(masses):
        if i in masses[:j]:
            is_shut = position[:, masses.index(i)] + position[:, j] == 0
            position[:, j] = np.where(is_shut, 0.1, position[:, j])
    distance = draws.sometimes(0.1, 0.0, draws.rng.uniform(0.02, 0.8, (draws.count, len(shape.contacts))))
    for j, row in enumerate(shape.contacts):  # nor two contacts that act against each other
        for k in (k for k, other in enumerate(shape.contacts[:j]) if other == row[::-1]):
            distance[:, j] = np.where(distance[:, j] + distance[:, k] == 0, 0.1, distance[:, j])
    return position, distance


def largest_coefficients(shape: Shape, a: dict[str, np.ndarray]) -> np.ndarray:
    """Coefficients of friction of contacts with which each contact can still slip (Painleve), (count, rubs)."""
    n = shape.masses
    flexibility = np.linalg.inv(matrices(shape, a["mass"]))
    pressing = [*((i,) for i, _ in shape.stops), *shape.contacts, *((i,) for i, _ in shape.cushions)]
    found = np.empty((len(flexibility), len(shape.rubs)))
    for k, (row, contact) in enumerate(shape.rubs):
        normal, tangent = (coefficients(one, n) for one in (pressing[contact], row))
        own, beside = (np.einsum("i,bij,j->b", normal, flexibility, one) for one in (normal, tangent))
        share = 0.8 / sum(other == contact for _, other in shape.rubs)
        found[:, k] = np.minimum(3.0, share * own / np.maximum(np.abs(beside), 1e-300))
    return found


def coefficients(row: Row, n: int) -> np.ndarray:
    """A row as a vector, (n,)."""
    vector = np.zeros(n)
    for i, value in _coefficients(row).items():
        vector[i] = value
    return vector


def matrices(shape: Shape, mass: np.ndarray) -> np.ndarray:
    """Mass matrices from the numbers of the masses, (..., n, n)."""
    return mass if shape.is_full else mass[..., None] * np.eye(shape.masses)


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
    load = load_of(shape, a, vx.Harmonic(a["amplitude"], a["frequency"], a["phase"], a["mean"]))
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
    stops += [
        vx.CompliantContact(
            _coefficients(row),
            a["buffer"][j],
            a["buffer_stiffness"][j],
            a["buffer_damping"][j],
            a["buffer_preload"][j],
        )
        for j, row in enumerate(shape.buffers)
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
    other = {"friction": friction, "hysteresis": hysteresis, **forces_of(shape, a)}
    return vx.ImpactSystem(a["mass"], a["damping"], a["stiffness"], load, stops, **other)


def own_numbers(a: dict[str, np.ndarray], lane: int) -> dict[str, np.ndarray]:
    """Numbers of one lane."""
    return {name: value[lane] for name, value in a.items()}


def _side(side: str) -> float:
    return 1.0 if side == "upper" else -1.0


def _coefficients(row: Row) -> dict[int, float]:
    return dict(zip(row, (1.0, -1.0), strict=False))
