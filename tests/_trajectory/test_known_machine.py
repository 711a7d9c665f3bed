"""A solution of known numbers is a tree like any other, and a machine object is prepared once."""

import copy
import gc
import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._trajectory import concrete_machine
from vijax._trajectory.concrete_machine import known_machine, remembered


@pytest.fixture(scope="module")
def sol() -> vx.Solution:
    return vx.simulate(vx.models.wagg_bishop_b(0.3), 0.0, 20.0)


def leaves_of(tree) -> list:
    return [*jax.tree.leaves(tree), *jax.tree.leaves((tree.machine, tree.flow))]


def assert_same(ours: vx.Solution, other: vx.Solution) -> None:
    assert jax.tree.structure(ours) == jax.tree.structure(other)
    for a, b in zip(leaves_of(ours), leaves_of(other), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        np.testing.assert_array_equal(a, b)


def test_all_attributes_are_arrays_of_jax(sol):
    assert all(isinstance(a, jax.Array) for a in leaves_of(sol))


@pytest.mark.parametrize(
    "through",
    [
        copy.copy,
        copy.deepcopy,
        lambda sol: pickle.loads(pickle.dumps(sol)),
        lambda sol: jax.tree.map(jnp.asarray, sol),
        jax.jit(lambda sol: sol),
    ],
    ids=["copy", "deepcopy", "pickle", "tree_map", "jit"],
)
def test_a_copy_is_the_same_and_is_evaluated_to_the_same(sol, through):
    other = through(sol)
    assert_same(other, sol)
    assert repr(other) == repr(sol)
    for a, b in zip(other.evaluate([3.0, 15.0]), sol.evaluate([3.0, 15.0]), strict=True):
        np.testing.assert_array_equal(a, b)


def test_known_and_traced_numbers_give_trees_of_one_structure(sol):
    traced = jax.jit(lambda t1: vx.simulate(vx.models.wagg_bishop_b(0.3), 0.0, t1))(20.0)
    assert jax.tree.structure(traced) == jax.tree.structure(sol)


def test_a_leaf_may_be_replaced(sol):
    other = eqx.tree_at(lambda s: s.x1, sol, jnp.ones(2))
    np.testing.assert_array_equal(other.x1, np.ones(2))
    np.testing.assert_array_equal(other.v1, sol.v1)


def test_solutions_are_stacked_and_mapped_over(sol):
    many = jax.tree.map(lambda *a: jnp.stack(a), sol, sol)
    x, _ = jax.vmap(lambda s: s.evaluate(3.0))(many)
    np.testing.assert_allclose(x, np.stack([sol.evaluate(3.0)[0]] * 2), rtol=0, atol=1e-14)
    assert many.machine.rate.shape == (2,)


def test_a_machine_object_is_prepared_once_and_a_changed_one_anew():
    system = vx.models.wagg_bishop_a(0.8)
    first = vx.simulate(system, 0.0, 20.0)
    known = remembered(system, None)
    assert known is known_machine(system, None)
    assert_same(vx.simulate(system, 0.0, 20.0), first)
    changed = eqx.tree_at(lambda s: s.stops[0].restitution, system, jnp.asarray(0.2))
    assert remembered(changed, None) is None
    assert float(vx.simulate(changed, 0.0, 20.0).x1[0]) != float(first.x1[0])
    assert_same(vx.simulate(system, 0.0, 20.0), first)


def test_arrays_that_can_be_changed_are_read_again():
    system = vx.models.wagg_bishop_a(0.8)
    amplitude = np.array(system.forcing.amplitude)
    mutable = eqx.tree_at(lambda s: s.forcing.amplitude, system, amplitude)
    first = vx.simulate(mutable, 0.0, 20.0)
    amplitude *= 2
    assert remembered(mutable, None) is None
    assert float(vx.simulate(mutable, 0.0, 20.0).x1[0]) != float(first.x1[0])


@pytest.mark.slow
def test_a_machine_object_is_not_kept_alive():
    gc.collect()
    before = len(concrete_machine._seen)
    system = vx.models.wagg_bishop_a(0.77)
    vx.simulate(system, 0.0, 1.0)
    assert len(concrete_machine._seen) == before + 1
    del system
    gc.collect()
    assert len(concrete_machine._seen) <= before


def test_a_known_machine_is_traced_where_its_start_is():
    system = vx.models.wagg_bishop_b(0.3)
    expected = vx.simulate(system, 0.0, 20.0).x1
    found = jax.jit(lambda x0: vx.simulate(system, 0.0, 20.0, x0).x1)(jnp.zeros(2))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert remembered(system, None) is not None


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"t1": -1.0}, "`t1` must not lie before `t0`"),
        ({"t1": np.nan}, "`t1` must be finite"),
        ({"x0": [np.inf, 0.0]}, "`x0` must be finite"),
        ({"v0": [np.nan, 0.0]}, "`v0` must be finite"),
        ({"x0": [9.0, 9.0]}, "The start lies beyond a stop"),
        ({"ts": [2.0, 1.0]}, "`ts` must be in increasing order"),
    ],
)
def test_a_start_is_checked_although_the_machine_is_known(options, sentence):
    system = vx.models.wagg_bishop_b(0.3)
    vx.simulate(system, 0.0, 1.0)
    with pytest.raises(ValueError, match=sentence):
        vx.simulate(system, 0.0, **({"t1": 5.0} | options))


def test_a_start_beyond_a_stop_at_zero_by_rounding_is_on_it():
    system = vx.models.impact_oscillator(2.7, position=0.0, restitution=0.8)
    at, past = (vx.simulate(system, 0.0, 3.0, [x], [0.5]) for x in (0.0, 1e-17))
    assert float(past.x1[0]) == pytest.approx(float(at.x1[0]), abs=1e-15)
    with pytest.raises(ValueError, match="The start lies beyond a stop"):
        vx.simulate(system, 0.0, 3.0, [1e-14], [0.5])


@pytest.mark.parametrize("friction", [[], [vx.Friction(0, 0.2)]], ids=["smooth", "rubbing"])
@pytest.mark.parametrize(
    "stop",
    [vx.Stop(0, 0.0, "lower", 0.3), vx.Contact({0: -1.0}, 0.0, restitution=0.3)],
    ids=["stop", "contact"],
)
def test_a_mass_on_its_stop_rests_although_its_velocity_is_a_rounding_error(stop, friction):
    # Newton's method leaves such velocities at the start of an orbit.
    load = vx.Harmonic(amplitude=[-2.0], frequency=0.8)
    system = vx.ImpactSystem([0.7], [[0.1]], [[1.0]], load, [stop], friction=friction)
    for v in (0.0, 1e-40, -1e-40, 1e-18):
        sol = vx.simulate(system, 0.0, 3.0, [0.0], [v])
        assert int(sol.events.kind[0]) == vx.RELEASE
        assert float(sol.events.t[0]) > 1.9
