"""Symmetries of machines: which there are, in words, and that each maps a motion to a motion."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

HALF = "1/2 of a period later"
BOTH = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
LOAD = vx.Harmonic([1.0], 2.0)
SQUARE = vx.Waveform([0.0, np.pi], [[1.0], [-1.0]], 2.0, "previous")
SPRINGS, DAMPERS = [[2.0, -1.0], [-1.0, 2.0]], [[0.2, -0.1], [-0.1, 0.2]]
RING = 2.5 * np.eye(3) - 0.5 * (np.roll(np.eye(3), 1, 0) + np.roll(np.eye(3), -1, 0))


def one(load: Any = LOAD, stops: Any = BOTH, **more):
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, stops, **more)


def two(amplitude, stops, **more):
    return vx.ImpactSystem([1.0, 1.0], DAMPERS, SPRINGS, vx.Harmonic(amplitude, 1.0), stops, **more)


def ring(phases=(0.0, 2 * np.pi / 3, 4 * np.pi / 3)):
    """Three equal masses in a ring, loaded one after the other."""
    stops = [vx.Stop(i, 0.3, "upper", 0.5) for i in range(3)]
    return vx.ImpactSystem(np.ones(3), 0.1 * RING, RING, vx.Harmonic(np.ones(3), 1.0, phases), stops)


def moving(amplitude):
    wave = lambda size: vx.Harmonic([size], 2.0)  # noqa: E731
    stops = [vx.Stop(0, 0.5, "upper", 0.8, wave(0.1)), vx.Stop(0, -0.5, "lower", 0.8, wave(amplitude))]
    return one(vx.Harmonic([0.0], 2.0), stops)


def between_walls(coefficients=(0.2, 0.2), belt=0.0):
    """A block between a floor and a ceiling with friction on both."""
    walls = [vx.Stop(1, 0.3, "upper", 0.5), vx.Stop(1, -0.3, "lower", 0.5)]
    rubbing = [
        vx.Friction(0, coefficient=mu, contact=1 - k, velocity=belt) for k, mu in enumerate(coefficients)
    ]
    load = vx.Harmonic([0.4, 1.0], 1.3)
    return vx.ImpactSystem(np.ones(2), 0.1 * np.eye(2), np.eye(2), load, walls, friction=rubbing)


def on_floor(normal):
    """A block on a floor that shakes along and across it."""
    load = vx.Harmonic([[0.4, normal[0]], [0.0, normal[1]]], 1.3, mean=[0.0, -1.0])
    rubbing = [vx.Friction(0, coefficient=0.2, contact=0)]
    floor = [vx.Stop(1, 0.0, "lower", 0.5)]
    return vx.ImpactSystem(np.ones(2), np.zeros((2, 2)), np.diag([1.0, 0.5]), load, floor, friction=rubbing)


CASES = {
    "friction of two walls": (between_walls(), [f"x0 -> -x0, x1 -> -x1, {HALF}"]),
    "unequal friction of two walls": (between_walls((0.2, 0.3)), []),
    "walls on a belt": (between_walls(belt=0.2), []),
    "friction of a floor": (on_floor((0.0, 0.3)), [f"x0 -> -x0, {HALF}"]),
    "friction of a floor shaken in time": (on_floor((0.3, 0.0)), []),
    "two stops": (one(), [f"x0 -> -x0, {HALF}"]),
    "two cushions": (
        one(
            stops=[
                vx.CompliantStop(0, 0.5, "upper", 30.0, 0.3),
                vx.CompliantStop(0, -0.5, "lower", 30.0, 0.3),
            ]
        ),
        [f"x0 -> -x0, {HALF}"],
    ),
    "one stop": (one(stops=BOTH[:1]), []),
    "unequal restitution": (one(stops=[BOTH[0], vx.Stop(0, -0.5, "lower", 0.7)]), []),
    "even harmonics": (one(vx.Harmonic([[1.0], [0.3]], 2.0)), []),
    "odd harmonics": (one(vx.Harmonic([[1.0], [0.0], [0.3]], 2.0)), [f"x0 -> -x0, {HALF}"]),
    "second harmonic alone": (
        one(vx.Harmonic([[0.0], [0.3]], 2.0)),
        ["x0 -> -x0, 1/4 of a period later", HALF, "x0 -> -x0, 3/4 of a period later"],
    ),
    "about another point": (
        one(
            vx.Harmonic([1.0], 2.0, mean=[0.3]),
            [vx.Stop(0, 0.8, "upper", 0.8), vx.Stop(0, -0.2, "lower", 0.8)],
        ),
        [f"x0 -> -x0 + 0.6, {HALF}"],
    ),
    "load and stops about different points": (one(vx.Harmonic([1.0], 2.0, mean=[0.3])), []),
    "no load": (one(None), ["x0 -> -x0"]),
    "square wave": (one(SQUARE), [f"x0 -> -x0, {HALF}"]),
    "sum of loads": (one(LOAD + SQUARE), [f"x0 -> -x0, {HALF}"]),
    "record": (one(vx.Tabulated([0.0, 1.0], [[1.0], [0.0]])), []),
    "friction": (one(friction=[vx.Friction(0, 0.1)]), [f"x0 -> -x0, {HALF}"]),
    "belt": (one(friction=[vx.Friction(0, 0.1, velocity=0.2)]), []),
    "odd force": (one(force=lambda t, x, v, args: -(x**3)), [f"x0 -> -x0, {HALF}"]),
    "even force": (one(force=lambda t, x, v, args: -(x**2)), []),
    "force with the load": (one(force=lambda t, x, v, args: jnp.cos(2 * t) * x), []),
    "force twice a period": (one(force=lambda t, x, v, args: jnp.cos(4 * t) * x), [f"x0 -> -x0, {HALF}"]),
    "stops that move alike": (moving(0.1), [f"x0 -> -x0, {HALF}"]),
    "stops that breathe": (moving(-0.1), ["x0 -> -x0"]),
    "swap": (two([1.0, 1.0], [vx.Stop(i, 0.2, "upper", 0.7) for i in (0, 1)]), ["x0 -> x1, x1 -> x0"]),
    "swap half a period later": (
        two([1.0, -1.0], [vx.Stop(i, 0.2, "upper", 0.7) for i in (0, 1)]),
        [f"x0 -> x1, x1 -> x0, {HALF}"],
    ),
    "swap and mirror": (
        two([1.0, -1.0], [vx.Contact({0: 1.0, 1: -1.0}, 0.2, 0.5)]),
        ["x0 -> -x1, x1 -> -x0"],
    ),
    "stops behind each other": (
        two(
            [1.0, 0.0],
            [
                vx.CompliantStop(0, s * d, "upper" if s > 0 else "lower", k)
                for d, k in ((0.1, 3.0), (0.3, 5.0))
                for s in (1, -1)
            ],
        ),
        [f"x0 -> -x0, x1 -> -x1, {HALF}"],
    ),
    "ring": (
        ring(),
        [
            "x0 -> x2, x1 -> x0, x2 -> x1, 1/3 of a period later",
            "x0 -> x1, x1 -> x2, x2 -> x0, 2/3 of a period later",
        ],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_machine_has_the_symmetries_that_one_sees(name):
    machine, words = CASES[name]
    assert [repr(own) for own in machine.symmetries()] == [f"<Symmetry {own}>" for own in words]


def test_a_symmetry_names_the_stops_and_friction_elements_that_it_exchanges():
    machine = two(
        [1.0, -1.0],
        [
            vx.Stop(0, 0.2, "upper", 0.7),
            vx.Contact({0: 1.0, 1: -1.0}, 0.3, 0.5),
            vx.Stop(1, -0.2, "lower", 0.7),
        ],
        friction=[vx.Friction(1, 0.1), vx.Friction(0, 0.1)],
    )
    (swap,) = machine.symmetries()
    assert swap.stops == (2, 1, 0)
    assert swap.friction == (1, 0)
    assert swap.order == 2
    (mirror,) = between_walls().symmetries()
    assert mirror.stops == mirror.friction == (1, 0)


def test_feet_of_equal_rows_are_exchanged_with_their_friction():
    feet = [vx.Contact({0: -1.0, 1: side}, 0.0, 0.5) for side in (0.5, -0.5)]
    rubbing = [vx.Friction(2, coefficient=0.3, contact=k) for k in (0, 1)]
    load = vx.Harmonic([0.0, 0.0, 1.0], 1.0, mean=[-1.0, 0.0, 0.0])
    machine = vx.ImpactSystem(
        np.ones(3), np.zeros((3, 3)), np.diag([0.0, 0.0, 1.0]), load, feet, friction=rubbing
    )
    swap = next(own for own in machine.symmetries() if own.stops == (1, 0))
    assert swap.friction == (1, 0)


def test_a_family_has_the_symmetries_of_its_machine():
    family = vx.Family(
        lambda amplitude, mean=0.0: one(vx.Harmonic([amplitude], 2.0, mean=[mean])), amplitude=1.0
    )
    assert len(family.symmetries()) == 1
    assert not family.at(mean=0.1).symmetries()


def test_a_long_chain_is_quick_and_free_masses_are_refused():
    n = 30
    ends = [vx.Stop(n - 1, 0.3, "upper", 0.5), vx.Stop(n - 1, -0.3, "lower", 0.5)]
    chain = vx.chain(np.ones(n), np.ones(n), np.ones(n), vx.Harmonic(np.eye(n)[0], 1.0), ends)
    (mirror,) = chain.symmetries()
    np.testing.assert_array_equal(mirror.matrix, -np.eye(n))
    free = vx.ImpactSystem(np.ones(12), np.eye(12), np.eye(12), vx.Harmonic(np.zeros(12), 1.0))
    with pytest.raises(ValueError, match="too many symmetries"):
        free.symmetries()


def test_numbers_must_be_known():
    with pytest.raises(ValueError, match=r"outside of `jax.jit`"):
        jax.jit(lambda a: one(vx.Harmonic([a], 2.0)).symmetries())(1.0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        "ring",
        "about another point",
        "second harmonic alone",
        "square wave",
        "swap and mirror",
        pytest.param("friction of two walls", marks=pytest.mark.slow),
    ],
)
def test_a_symmetry_maps_a_motion_to_a_motion(name):
    machine, rng = CASES[name][0], np.random.default_rng(1)
    period, n = float(machine.forcing.period), machine.num_masses
    x, v = 0.05 * rng.normal(size=n), 0.9 * rng.normal(size=n)
    for own in machine.symmetries():
        t0 = float(own.shift) * period
        motion = vx.simulate(machine, t0, t0 + 3 * period, x, v)
        image = vx.simulate(machine, 0.0, 3 * period, own.matrix @ x + own.offset, own.matrix @ v)
        assert int(motion.num_events) == int(image.num_events) > 0
        np.testing.assert_allclose(own.matrix @ motion.x1 + own.offset, image.x1, rtol=0, atol=1e-13)
        np.testing.assert_allclose(own.matrix @ motion.v1, image.v1, rtol=0, atol=1e-13)
        of_image = np.asarray(own.stops)[np.asarray(image.events.stop)[: int(image.num_events)]]
        np.testing.assert_array_equal(of_image, np.asarray(motion.events.stop)[: int(motion.num_events)])
