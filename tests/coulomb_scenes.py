"""Random machines with friction of contacts, for `coulomb_bodies.py` and for vijax; many numbers are equal, zero or round."""

import numpy as np
from coulomb_flow import Bodies, Rubbing, Slider
from resting_bodies import Rigid, Soft

import vijax as vx

Scene = tuple[Bodies, np.ndarray, np.ndarray]


def _one_of(rng: np.random.Generator, *numbers: float) -> float:
    return float(rng.choice(numbers))


def _rows(*rows: list[float]) -> list[np.ndarray]:
    return [np.array(row, float) for row in rows]


def _rubs(row: np.ndarray, velocity: float, *tied: tuple[float, float, int]) -> Rubbing:
    return Rubbing(row, velocity, 0.0, 0.0, tied)


def block(rng: np.random.Generator) -> Scene:
    """A block on a floor or a belt, that may lift off."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    mu, along, across = of(0.0, 0.1, 0.3, 0.6, 1.5), of(0.0, 0.5, 1.0), of(0.0, 0.0, 0.3)
    between = of(0.0, 0.2) if along else 0.0
    stiffness, damping = np.array([[along, between], [between, across]]), np.diag([of(0.0, 0.05), 0.0])
    mean = np.array([of(0.0, 0.2), -of(1.0, 0.5)])
    amplitude = np.array([of(0.0, 0.5, 1.0), of(0.0, 0.6, 1.3)])
    mass, phase, frequency = np.diag([of(1.0, 2.0), of(1.0, 0.7)]), rng.uniform(0, 6, 2), rng.uniform(0.5, 2)
    floor, tangent = _rows([0, -1], [1, 0])
    contacts = [Rigid(floor, 0.0, of(0.0, 0.5, 0.8, 0.9))]
    friction = [_rubs(tangent, of(0.0, 0.0, 0.3), (mu, mu * of(1.0, 1.0, 1.3), 0))]
    bodies = Bodies(mass, damping, stiffness, mean, amplitude, phase, frequency, contacts, friction)
    return bodies, np.array([of(0.0, 0.5), of(0.0, 0.0, 0.3)]), np.array([of(0.0, 0.0, 1.0), 0.0])


def feet(rng: np.random.Generator) -> Scene:
    """A body on two feet, whose friction acts along one row; it may tilt."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    left, right, tangent = _rows([0, -1, of(1.0, 0.6)], [0, -1, -of(1.0, 1.4)], [1, 0, of(0.0, 0.5)])
    contacts = [Rigid(row, 0.0, of(0.0, 0.5)) for row in (left, right)]
    first, other = of(0.0, 0.2, 0.4), of(0.2, 0.5)
    friction = [_rubs(tangent, of(0.0, 0.0, 0.2), (first, first, 0), (other, other, 1))]
    amplitude = np.array([of(0.3, 0.6), of(0.0, 0.4), of(0.0, 0.2)])
    mass, spring = np.diag([1.0, 1.0, of(0.3, 1.0)]), np.diag([of(0.0, 1.0), 0.0, 0.0])
    mean, phase, frequency = np.array([of(0.0, 0.1), -1.0, 0.0]), rng.uniform(0, 6, 3), rng.uniform(0.5, 2)
    bodies = Bodies(mass, 0.1 * spring, spring, mean, amplitude, phase, frequency, contacts, friction)
    return bodies, np.array([0.0, of(0.0, 0.2), 0.0]), np.array([of(0.0, 0.5), 0.0, 0.0])


def stack(rng: np.random.Generator) -> Scene:
    """A block on a block on a floor or a belt: x and height of the lower, x and height of the upper one."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    m, ratio, lower, upper = of(1.0, 1.0, 2.0), of(1.0, 1.2, 1.2), of(0.2, 0.3), of(0.2, 0.3, 0.5)
    floor, between, below, above = _rows([0, -1, 0, 0], [0, 1, 0, -1], [1, 0, 0, 0], [-1, 0, 1, 0])
    contacts = [Rigid(floor, 0.0, of(0.0, 0.5)), Rigid(between, 0.0, of(0.0, 0.4))]
    friction = [
        _rubs(below, of(0.0, 0.0, 0.3), (lower, lower * ratio, 0)),
        _rubs(above, 0.0, (upper, upper * ratio, 1)),
    ]
    amplitude = np.array([of(0.0, 0.8), of(0.0, 0.5), of(0.0, 0.5), of(0.0, 1.2)])
    stiffness, mean = np.diag([of(0.0, 0.4), 0.0, of(0.0, 0.4), 0.0]), np.array([0.0, -1.0, 0.0, -m])
    mass, phase, none = np.diag([1.0, 1.0, m, m]), np.full(4, of(0.0, 1.0)), np.zeros((4, 4))
    frequency = rng.uniform(0.6, 1.5)
    bodies = Bodies(mass, none, stiffness, mean, amplitude, phase, frequency, contacts, friction)
    return bodies, np.zeros(4), np.array([of(0.0, 0.6), 0.0, of(0.0, 0.6), 0.0])


def corner(rng: np.random.Generator) -> Scene:
    """A block between a belt and a wall that moves along itself: friction of each acts along the other's normal."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    floor, wall, along, up = _rows([0, -1], [1, 0], [1, 0], [0, 1])
    contacts = [Rigid(floor, 0.0, of(0.0, 0.6)), Rigid(wall, of(0.0, 0.2), of(0.0, 0.6))]
    at_floor, at_wall = of(0.2, 0.5), of(0.2, 0.5, 0.9)
    friction = [
        _rubs(along, of(0.2, -0.2), (at_floor, at_floor, 0)),
        _rubs(up, of(-0.3, 0.3), (at_wall, at_wall, 1)),
    ]
    mean, amplitude = np.array([of(0.0, 0.3), -1.0]), np.array([of(0.5, 1.0), of(0.0, 0.7, 1.5)])
    mass, stiffness, none = np.eye(2) * of(1.0, 2.0), np.diag([of(0.0, 0.3), 0.0]), np.zeros((2, 2))
    phase, frequency = rng.uniform(0, 6, 2), rng.uniform(0.6, 1.6)
    bodies = Bodies(mass, none, stiffness, mean, amplitude, phase, frequency, contacts, friction)
    return bodies, np.array([0.0, of(0.0, 0.3)]), np.zeros(2)


def mixed(rng: np.random.Generator) -> Scene:
    """Friction of a compliant floor and of a rigid end, one of constant force, and a slider."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    end, floor, along, across, own, between = _rows(
        [0, 0, 1], [0, -1, 0], [1, 0, 0], [1, 0, 0.5], [0, 0, 1], [1, 0, -1]
    )
    contacts = [
        Rigid(end, 0.3, of(0.3, 0.8)),
        Soft(floor, 0.0, of(10.0, 30.0), of(0.0, 0.5), of(0.0, 0.2)),
    ]
    soft, hard = of(0.2, 0.5), of(0.1, 0.4)
    friction = [
        _rubs(along, of(0.0, 0.2), (soft, soft * of(1.0, 1.2), 1)),
        _rubs(across, 0.0, (hard, hard, 0)),
        Rubbing(own, 0.0, 0.1, 0.1, ()),
    ]
    stiffness = np.array([[1.2, -0.2, 0.0], [-0.2, 0.5, 0.0], [0.0, 0.0, 0.4]])
    amplitude = np.array([of(0.5, 1.0), of(0.2, 0.6), 0.4])
    mass, damping, mean = np.diag([1.0, 0.6, 1.0]), np.diag([0.02, 0.02, 0.0]), np.array([0.0, -0.5, 0.0])
    phase, frequency, sliders = (
        rng.uniform(0, 6, 3),
        rng.uniform(0.6, 1.4),
        (Slider(between, 1.0, of(0.1, 0.3), 0.0),),
    )
    bodies = Bodies(mass, damping, stiffness, mean, amplitude, phase, frequency, contacts, friction, sliders)
    return bodies, np.array([0.0, of(0.0, 0.2), 0.0]), np.array([0.0, 0.0, of(0.0, 0.5)])


def full(rng: np.random.Generator) -> Scene:
    """Two contacts with random rows and a full mass matrix: all directions share inertia."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    masses, springs = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    contacts, friction = [], []
    for k in range(2):
        row, tangent = rng.normal(size=3), rng.normal(size=3)
        row, mu = row / np.linalg.norm(row), of(0.1, 0.3, 0.5)
        tangent = tangent - of(0.0, 1.0) * (tangent @ row) * row
        contacts.append(Rigid(row, rng.uniform(0, 0.3), of(0.0, 0.4, 0.7, 0.85)))
        friction.append(_rubs(tangent / np.linalg.norm(tangent), of(0.0, 0.4), (mu, mu * of(1.0, 1.4), k)))
    stiffness = 0.3 * springs @ springs.T + 0.2 * np.eye(3)
    mean = sum(c.row for c in contacts) * rng.uniform(0, 0.8) + 0.2 * rng.normal(size=3)
    mass, amplitude, phase = (
        0.3 * masses @ masses.T + np.eye(3),
        0.8 * rng.normal(size=3),
        rng.uniform(0, 6, 3),
    )
    frequency = rng.uniform(0.6, 1.6)
    bodies = Bodies(mass, 0.03 * stiffness, stiffness, mean, amplitude, phase, frequency, contacts, friction)
    return bodies, np.zeros(3), rng.normal(size=3) * of(0.0, 0.5)


def at_its_limit(rng: np.random.Generator) -> Scene:
    """A block with two equal elements of friction, whose load reaches their grip, alone or together, and no more."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    mu, (floor, tangent) = of(0.25, 0.5), _rows([0, -1], [1, 0])
    contacts = [Rigid(floor, 0.0, of(0.0, 0.5, 1.0))]
    friction = [_rubs(tangent, of(0.0, 0.0, 0.25), (mu / 2, mu / 2, 0), (mu / 2, mu / 2, 0))]
    mean, amplitude = (
        np.array([of(mu, -mu, 0.0, mu / 2), -1.0]),
        np.array([of(0.0, mu, mu / 2), of(0.0, 0.5, 1.5)]),
    )
    stiffness, phase = (
        np.diag([of(0.0, 0.5, 1.0), 0.0]),
        np.array([of(0.0, np.pi, np.pi / 2), of(0.0, np.pi)]),
    )
    bodies = Bodies(
        np.eye(2), 0 * stiffness, stiffness, mean, amplitude, phase, of(1.0, 0.5), contacts, friction
    )
    return bodies, np.array([of(0.0, mu, -mu, 1.0), of(0.0, 0.0, 0.5)]), np.array([of(0.0, 0.0, 0.5), 0.0])


def weightless(rng: np.random.Generator) -> Scene:
    """A block whose weight vanishes at an instant, on a rigid floor."""
    of = lambda *numbers: _one_of(rng, *numbers)  # noqa: E731
    mu, (floor, tangent) = of(0.0, 0.25, 0.5), _rows([0, -1], [1, 0])
    contacts = [Rigid(floor, 0.0, of(0.0, 0.5, 1.0))]
    friction = [_rubs(tangent, of(0.0, 0.0, 0.25), (mu, mu, 0))]
    mean, amplitude = np.array([of(0.0, mu / 2), -1.0]), np.array([of(0.0, mu, 1.0), 1.0])
    phase = np.array([of(0.0, np.pi, np.pi / 2), of(0.0, np.pi, np.pi / 2, -np.pi / 2)])
    stiffness, frequency = np.diag([of(0.0, 0.5, 1.0), of(0.0, 0.0, 1.0)]), of(0.5, 1.0, 2.0)
    bodies = Bodies(
        np.eye(2), 0 * stiffness, stiffness, mean, amplitude, phase, frequency, contacts, friction
    )
    return bodies, np.array([of(0.0, 0.25, 1.0), 0.0]), np.array([of(0.0, 0.0, 0.5), 0.0])


def preloaded(rng: np.random.Generator) -> Scene:
    """As `weightless`, on a preloaded floor: its force reaches zero, or the preload, and no more."""
    bodies, x0, v0 = weightless(rng)
    floor = bodies.contacts[0].row
    damping, preload = _one_of(rng, 0.0, 0.5), _one_of(rng, 1.0, 2.0)
    return bodies._replace(contacts=[Soft(floor, 0.0, 10.0, damping, preload)]), x0, v0


SCENES = {
    "block": block,
    "feet": feet,
    "stack": stack,
    "corner": corner,
    "mixed": mixed,
    "full": full,
    "limit": at_its_limit,
    "weightless": weightless,
    "preloaded": preloaded,
}


def machine_of(
    bodies: Bodies, units: tuple[float, float, float] = (1.0, 1.0, 1.0), *, turned: bool = False
) -> vx.ImpactSystem:
    """The machine, with units of mass, length and time; `turned` lists friction from the last element to the first."""
    m, length, t = units
    force, k, c = m * length / t**2, m / t**2, m / t
    row = lambda one: {i: float(a) for i, a in enumerate(one.row) if a}  # noqa: E731
    stops = [
        vx.Contact(row(one), one.position * length, one.restitution)
        if isinstance(one, Rigid)
        else vx.CompliantContact(
            row(one), one.position * length, one.stiffness * k, one.damping * c, one.preload * force
        )
        for one in bodies.contacts
    ]
    friction = []
    for one in bodies.friction:
        belt = one.velocity * length / t
        friction += [
            vx.Friction(row(one), velocity=belt, coefficient=mu, static_coefficient=static, contact=at)
            for mu, static, at in one.tied
        ]
        if one.static:
            friction.append(vx.Friction(row(one), one.force * force, one.static * force, belt))
    sliders = [
        vx.Jenkins(row(one), one.stiffness * k, one.limit * force, one.start * length)
        for one in bodies.sliders
    ]
    load = vx.Harmonic(bodies.amplitude * force, bodies.frequency / t, bodies.phase, bodies.mean * force)
    is_full = bool(np.any(bodies.mass - np.diag(np.diag(bodies.mass))))
    mass = (bodies.mass if is_full else np.diag(bodies.mass)) * m
    friction = friction[::-1] if turned else friction
    damping, stiffness = bodies.damping * c, bodies.stiffness * k
    return vx.ImpactSystem(mass, damping, stiffness, load, stops, friction=friction, hysteresis=sliders)
