"""Elements side by side are their sum: friction, sliders, soft stops; in sweeps, batches and derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from resting_bodies import Bodies, Rigid, Rubbing, Run, Soft

import vijax as vx

pytestmark = pytest.mark.thorough

EXACT = 1e-11
# Of the independent integration, which finds events by bisection.
NUMERICAL = 1e-6
LOAD = vx.Harmonic([3.5], 0.7)


def oscillator(stops=(), **elements) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], LOAD, list(stops), **elements)


SOFT = 20.0, 0.4, 0.3
PAIRS = {
    "friction": (
        lambda: oscillator(friction=[vx.Friction(0, 1.0), vx.Friction(0, 2.0)]),
        lambda: oscillator(friction=[vx.Friction(0, 3.0)]),
    ),
    "friction with static": (
        lambda: oscillator(friction=[vx.Friction(0, 1.0, 1.1), vx.Friction(0, 2.0, 2.3)]),
        lambda: oscillator(friction=[vx.Friction(0, 3.0, 3.4)]),
    ),
    "four friction elements": (
        lambda: oscillator(friction=[vx.Friction(0, f) for f in (0.5, 1.25, 0.25, 1.0)]),
        lambda: oscillator(friction=[vx.Friction(0, 3.0)]),
    ),
    "compliant stops": (
        lambda: oscillator([vx.CompliantStop(0, 1.0, "upper", *(s * a for a in SOFT)) for s in (0.3, 0.7)]),
        lambda: oscillator([vx.CompliantStop(0, 1.0, "upper", *SOFT)]),
    ),
    "sliders": (
        lambda: oscillator(hysteresis=[vx.Jenkins(0, 1.5 * s, 1.2 * s) for s in (0.3, 0.7)]),
        lambda: oscillator(hysteresis=[vx.Jenkins(0, 1.5, 1.2)]),
    ),
}
_MANY = ["compliant stops", "four friction elements", "friction with static", "sliders"]
_NAMES = [pytest.param(name, marks=pytest.mark.slow) if name in _MANY else name for name in PAIRS]


@pytest.mark.parametrize("name", _NAMES)
def test_two_elements_are_one_of_their_sum(name):
    several, one = (vx.simulate(make(), 0.0, 30.0) for make in PAIRS[name])
    np.testing.assert_allclose(several.x1, one.x1, rtol=0, atol=EXACT)
    np.testing.assert_allclose(several.v1, one.v1, rtol=0, atol=EXACT)
    if name == "friction":
        # Moreau's time stepping: 1.0689, which falls to this with its step.
        np.testing.assert_allclose(one.x1, 1.06887, rtol=0, atol=5e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", _NAMES)
def test_so_they_are_in_a_sweep(name):
    values = {"forcing.frequency": np.linspace(0.6, 0.9, 4)}
    several, one = (
        vx.sweep(make(), values, transient=20, record=2, progress=False, quantities=["rms_velocity"])
        for make in PAIRS[name]
    )
    for column in ("x", "v", "rms_velocity"):
        np.testing.assert_allclose(several[column][..., 0], one[column][..., 0], rtol=0, atol=10 * EXACT)


@pytest.mark.slow
def test_derivatives_by_each_are_those_by_the_sum():
    def end(forces):
        friction = [vx.Friction(0, force) for force in forces]
        return vx.simulate(oscillator(friction=friction), 0.0, 30.0).x1[0]

    (by_sum,) = jax.grad(end)(jnp.array([3.0]))
    step = 1e-5
    difference = (end(jnp.array([3.0 + step])) - end(jnp.array([3.0 - step]))) / (2 * step)
    assert abs(by_sum - difference) < 1e-7
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(end)(jnp.array([1.0, 2.0])), by_sum, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_in_a_batch_each_pair_is_its_own_sum():
    several, one = (PAIRS["friction"][k]() for k in (0, 1))

    def end(system, where, forces):
        friction = [eqx.tree_at(lambda f: f.force, f, force) for f, force in zip(where, forces, strict=True)]
        own = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], LOAD, [], friction=friction)
        return vx.simulate(own, 0.0, 30.0).x1[0]

    first, second = jnp.array([1.0, 0.2, 0.0, 1.7]), jnp.array([2.0, 0.3, 1.0, 1.7])
    found = jax.vmap(lambda a, b: end(several, several.friction, (a, b)))(first, second)
    right = jax.vmap(lambda a: end(one, one.friction, (a,)))(first + second)
    np.testing.assert_allclose(found, right, rtol=0, atol=EXACT)


def row(num: int, **values: float) -> np.ndarray:
    return np.array([values.get(f"x{i}", 0.0) for i in range(num)])


def bodies(mass, mean, amplitude, elements, stiffness=0.0, damping=0.0) -> Bodies:
    own = np.eye(len(mass))
    return Bodies(
        np.array(mass), damping * own, stiffness * own, np.array(mean), np.array(amplitude), 1.1, elements
    )


def _ring(forces, ground=()):
    """Three blocks, each with friction on the two others: a closed loop of elements."""
    pairs = [row(3, x0=1.0, x1=-1.0), row(3, x1=1.0, x2=-1.0), row(3, x2=1.0, x0=-1.0)]
    rubbing = [Rubbing(own, force, force) for own, force in zip(pairs, forces, strict=True)]
    return rubbing + [Rubbing(row(3, **{f"x{i}": 1.0}), force, force) for i, force in ground]


_LINKS = [Rigid(row(3, x0=1.0, x1=-1.0), -1.0, 0.5), Rigid(row(3, x1=1.0, x2=-1.0), -1.0, 0.3)]
CASES = {
    "a ring that a load turns": (
        bodies([1.0, 1.0, 1.0], [0.0] * 3, [1.5, -0.4, -0.2], _ring([0.4, 0.3, 0.5])),
        [0.0] * 3,
        [0.0] * 3,
    ),
    "a ring on the ground": (
        bodies(
            [1.0, 2.0, 0.5], [0.1, 0.0, 0.0], [1.5, 0.3, -0.5], _ring([0.4, 0.4, 0.4], [(0, 0.2), (0, 0.1)])
        ),
        [0.0] * 3,
        [0.0] * 3,
    ),
    "a ring of three equal bounds on springs": (
        bodies([1.0, 1.0, 1.0], [0.0] * 3, [1.2, 0.0, 0.0], _ring([0.3, 0.3, 0.3]), stiffness=0.5),
        [0.2, 0.0, 0.0],
        [0.0] * 3,
    ),
    "friction beyond two held contacts": (
        bodies([1.0, 1.0, 2.0], [1.0, 0.0, 0.0], [0.0] * 3, [*_LINKS, Rubbing(row(3, x2=1.0), 2.0, 2.0)]),
        [-0.4, 1.0, 2.0],
        [0.9, 0.0, 0.0],
    ),
    "a soft stop beyond two held contacts": (
        bodies(
            [1.0, 1.0, 2.0], [1.0, 0.0, 0.0], [0.0] * 3, [*_LINKS, Soft(row(3, x2=1.0), 2.0, 100.0, 0.0, 2.0)]
        ),
        [-0.4, 1.0, 2.0],
        [0.9, 0.0, 0.0],
    ),
    "two that lean on one that sticks": (
        bodies(
            [1.0, 1.0, 1.0],
            [-0.1, -0.33, 0.0],
            [0.0, 0.0, -0.05],
            [*_LINKS, Rubbing(row(3, x1=1.0), 0.277, 0.36), Rubbing(row(3, x2=1.0), 0.05, 0.07)],
        ),
        [0.0, 1.0, 2.0],
        [0.1, 0.1, 0.1],
    ),
}
_OFTEN = ("a ring that a load turns",)


@pytest.mark.parametrize(
    "name", [name if name in _OFTEN else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
@pytest.mark.parametrize("unit", [1.0, 1 / 7])
def test_loops_and_rows_of_bodies_move_as_an_independent_integration_says(name, unit):
    given, x0, v0 = CASES[name]
    end = 1.8
    x, v = Run(given, np.array(x0), np.array(v0)).until(end)
    sol = vx.simulate(machine_of(given, unit), 0.0, end, x0, v0)
    np.testing.assert_allclose(sol.x1, x, rtol=0, atol=NUMERICAL)
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=NUMERICAL)


def machine_of(given: Bodies, unit: float) -> vx.ImpactSystem:
    """The bodies in another unit of mass."""
    own = lambda e: {i: float(a) for i, a in enumerate(e.row) if a}  # noqa: E731
    of = lambda kind: [e for e in given.elements if isinstance(e, kind)]  # noqa: E731
    stops = [vx.Contact(own(e), e.position, e.restitution) for e in of(Rigid)]
    stops += [
        vx.CompliantContact(own(e), e.position, unit * e.stiffness, unit * e.damping, unit * e.preload)
        for e in of(Soft)
    ]
    friction = [vx.Friction(own(e), unit * e.force, unit * e.static) for e in of(Rubbing)]
    load = vx.Harmonic(unit * given.amplitude, given.frequency, mean=unit * given.mean)
    mass, damping, stiffness = (unit * a for a in (given.mass, given.damping, given.stiffness))
    return vx.ImpactSystem(mass, damping, stiffness, load, stops, friction=friction)
