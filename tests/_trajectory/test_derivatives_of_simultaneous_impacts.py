"""Derivatives where several masses hit their stops at one instant: each impact has a time of its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._hybrid.own_times import not_differentiable

START, SPAN = np.array([-2.5, -2.5, 0.0, 0.0]), 4.0
FAR = vx.Contact({0: 1.0, 1: -1.0}, 50.0, 0.5)
CUSHION = vx.CompliantStop(0, -30.0, "lower", 1.0)


def twins(coupling, damping, r=0.6, extra=(), force=None, motion=None):
    """Two equal masses with a stop each, in step."""
    stops = [vx.Stop(i, 1.0, "upper", r, motion) for i in (0, 1)]
    stiffness = [[1.0 + coupling, -coupling], [-coupling, 1.0 + coupling]]
    load = vx.Harmonic([0.2, 0.2], 1.3)
    return vx.ImpactSystem([1.0, 1.0], damping, stiffness, load, [*stops, *extra], force=force)


def alone(motion=None):
    """One of these masses."""
    stops = [vx.Stop(0, 1.0, "upper", 0.6, motion)]
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.2], 1.3), stops)


def end(system):
    n = system.num_masses

    def run(start):
        sol = vx.simulate(system, 0.0, SPAN, start[:n], start[n:])
        return jnp.concatenate([sol.x1, sol.v1])

    return run


def differences(function, start, step=1e-5):
    """Central differences, without the error that is linear in the step: on either side another mass hits first."""

    def central(step):
        return np.stack(
            [(function(start + e) - function(start - e)) / (2 * step) for e in step * np.eye(len(start))],
            axis=1,
        )

    return 2 * central(step / 2) - central(step)


@pytest.mark.slow
def test_masses_that_do_not_touch_have_the_derivatives_of_each_alone():
    one = np.asarray(jax.jacfwd(end(alone()))(START[[0, 2]]))
    both = np.asarray(jax.jacfwd(end(twins(0.0, np.diag([0.1, 0.1]))))(START))
    np.testing.assert_allclose(both, np.kron(one, np.eye(2)), atol=1e-12)


def first_impacts(system, count):
    """Times, velocities and impulses of the first impacts, as a function of the start."""
    n = system.num_masses

    def run(start):
        events = vx.simulate(system, 0.0, 9.0, start[:n], start[n:]).events
        rows = events.t, events.velocity_minus, events.velocity_plus, events.impulse
        return jnp.stack([a[:count] for a in rows])

    return run


@pytest.mark.slow
@pytest.mark.parametrize("extra", [(), (FAR,)], ids=["stops alone", "a contact far away"])
@pytest.mark.parametrize("motion", [None, vx.Harmonic([0.05], 1.3, [0.4])], ids=["at rest", "moving"])
def test_each_impact_of_an_instant_has_its_own_derivatives_in_the_log(extra, motion):
    one = np.asarray(jax.jacfwd(first_impacts(alone(motion), 2))(START[[0, 2]]))
    system = twins(0.0, np.diag([0.1, 0.1]), extra=extra, motion=motion)
    both = np.asarray(jax.jacfwd(first_impacts(system, 4))(START))
    wanted = np.einsum("qes,ij->qeisj", one, np.eye(2)).reshape(both.shape)
    np.testing.assert_allclose(both, wanted, atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "damping",
    [
        pytest.param([[0.0, 0.0], [0.0, 0.0]], marks=pytest.mark.slow),
        [[0.2, 0.0], [0.0, 0.2]],
        [[0.3, -0.1], [-0.1, 0.3]],
    ],
    ids=["none", "on the ground", "between"],
)
def test_coupled_masses_have_the_derivatives_of_motions_beside(damping):
    # With a damper between the masses the derivative is the mean of both sides, as is that of central differences.
    run = end(twins(1.0, damping))
    found = np.asarray(jax.jacfwd(run)(START))
    np.testing.assert_allclose(found, differences(run, START), atol=3e-7)
    np.testing.assert_allclose(jax.jacrev(run)(START), found, rtol=1e-12, atol=1e-12)
    swapped = np.kron(np.eye(2), [[0, 1], [1, 0]])
    np.testing.assert_allclose(swapped @ found @ swapped, found, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("extra", [FAR, CUSHION], ids=["contact", "compliant stop"])
def test_elements_far_away_change_no_derivative(extra):
    damping = np.diag([0.1, 0.1])
    plain, more = (np.asarray(jax.jacfwd(end(twins(1.0, damping, extra=e)))(START)) for e in ((), (extra,)))
    np.testing.assert_allclose(more, plain, rtol=1e-11, atol=1e-11)


# The stop of each mass once more, or one behind it in all but its row.
AGAIN = [vx.Contact({i: 1.0}, 1.0, 0.6) for i in (0, 1)]
SOFTER = [vx.Contact({i: 2.0}, 2.0, 0.3) for i in (1, 0)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "extra", [AGAIN, SOFTER, [*AGAIN, *SOFTER], AGAIN[1:]], ids=["twice", "softer", "three", "one of them"]
)
def test_a_stop_described_twice_is_hit_once(extra):
    damping = [[0.3, -0.1], [-0.1, 0.3]]
    plain, more = (np.asarray(jax.jacfwd(end(twins(1.0, damping, extra=e)))(START)) for e in ((), extra))
    np.testing.assert_allclose(more, plain, rtol=1e-11, atol=1e-11)
    one, both = (
        np.asarray(jax.jacfwd(first_impacts(twins(0.0, np.diag([0.1, 0.1]), extra=e), count))(START))
        for e, count in (((FAR,), 2), (extra, 2 + len(extra)))
    )
    own = [0, 1, *[0 if i.masses == (0,) else 1 for i in extra]]
    rows = [1.0, 1.0, *[float(i.row[0]) for i in extra]]
    for quantity, factor in ((0, np.ones(len(rows))), (1, rows), (2, rows)):
        for k, (mass, f) in enumerate(zip(own, factor, strict=True)):
            np.testing.assert_allclose(both[quantity, k], f * one[quantity, mass], rtol=1e-9, atol=1e-11)


@pytest.mark.slow
def test_a_force_has_the_derivatives_of_the_same_springs():
    springs = twins(1.0, np.diag([0.1, 0.1]))
    linear = twins(0.0, np.diag([0.1, 0.1]), force=lambda t, x, v, args: x[::-1] - x)
    one, other = (np.asarray(jax.jacfwd(end(system))(START)) for system in (springs, linear))
    np.testing.assert_allclose(other, one, atol=1e-10)


@pytest.mark.thorough
def test_elastic_impacts_at_one_instant_keep_volumes():
    """Elastic and undamped: the map keeps volumes, so the product of the multipliers is 1."""
    run = end(twins(1.0, np.zeros((2, 2)), r=1.0))
    assert np.linalg.det(np.asarray(jax.jacfwd(run)(START))) == pytest.approx(1.0, abs=1e-11)


@pytest.mark.slow
def test_with_friction_of_contacts_derivatives_are_right_or_not_numbers():
    """A block flies into a corner: derivatives of impacts at one instant are not known, and must not be read as if they were."""
    walls, zeros = [vx.Stop(i, 0.0, "lower", 0.5) for i in (0, 1)], np.zeros((2, 2))
    rubbing = [vx.Friction(1 - k, coefficient=0.1, contact=k) for k in (0, 1)]
    system = vx.ImpactSystem([1.0, 1.0], zeros, zeros, None, walls, friction=rubbing)

    def run(start):
        sol = vx.simulate(system, 0.0, 3.0, start[:2], start[2:])
        return jnp.concatenate([sol.x1, sol.v1])

    slopes = jax.jit(jax.jacfwd(run))
    apart, together = np.array([1.0, 1.5, -1.0, -1.0]), np.array([1.0, 1.0, -1.0, -1.0])
    np.testing.assert_allclose(slopes(apart), differences(run, apart), atol=1e-6)
    assert np.isfinite(np.asarray(run(together))).all()
    assert np.isnan(np.asarray(slopes(together))).any(axis=1).all()


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_what_has_no_derivative_is_nan_in_both_modes(derivative):
    x = jnp.arange(3.0)
    slopes = [derivative(lambda x, w=w: not_differentiable(jnp.array(w), x, x)[0])(x) for w in (False, True)]
    np.testing.assert_array_equal(slopes[0], np.eye(3))
    assert np.isnan(np.diag(slopes[1])).all()
