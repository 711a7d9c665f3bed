"""Orbits of machines with a force, which are found by the stroboscopic map: a spring written as a force, beside the spring."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow  # programs of this file alone, in half a minute

# A step of order 16 has a tolerance of 1e-12.
SOLVED = 1e-11
AMPLITUDE = 0.5


class Spring(eqx.Module):
    stiffness: jax.Array

    def __call__(self, t, x, v, args):
        return -self.stiffness * x


def machine(amplitude, *, has_force):
    load, stops = vx.Harmonic([amplitude], 0.9), [vx.Stop(0, 0.4, "upper", 0.7)]
    force = Spring(jnp.array([0.3])) if has_force else None
    return vx.ImpactSystem([1.0], [[0.1]], [[0.7 if has_force else 1.0]], load, stops, force=force)


@cache
def settled():
    system = machine(AMPLITUDE, has_force=False)
    end = vx.simulate(system, 0.0, 60 * system.forcing.period, max_events=200)
    return np.asarray(end.x1), np.asarray(end.v1)


def told(amplitude, *, has_force):
    orbit = vx.periodic_orbit(machine(amplitude, has_force=has_force), *settled())
    events = orbit.events
    impacts = jnp.stack([events.t, events.velocity_minus, events.impulse])[:, :1]
    return {
        "start": jnp.concatenate([orbit.x0, orbit.v0]),
        "trace": jnp.sum(orbit.multipliers).real,
        "product": jnp.prod(orbit.multipliers).real,
        "impacts": impacts,
    }


def test_an_orbit_of_a_spring_written_as_a_force_has_the_values_and_derivatives_of_the_spring():
    found, wanted = (
        (told(AMPLITUDE, has_force=yes), jax.jacfwd(lambda a, yes=yes: told(a, has_force=yes))(AMPLITUDE))
        for yes in (True, False)
    )
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=SOLVED, atol=SOLVED)


def test_a_search_tells_its_last_run():
    system = machine(AMPLITUDE, has_force=True)
    orbit = vx.periodic_orbit(system, jnp.array([0.1]), jnp.array([0.0]))
    run = vx.simulate(system, 0.0, system.forcing.period, orbit.x0, orbit.v0)
    assert int(run.num_events) == int(orbit.num_impacts.sum()) == 1
    np.testing.assert_allclose(orbit.events.t[:1], run.events.t[:1], rtol=SOLVED)
    matrix = vx.monodromy_matrix(system, orbit.x0, orbit.v0)
    np.testing.assert_allclose(np.sort(orbit.multipliers), np.sort(np.linalg.eigvals(matrix)), rtol=SOLVED)
    # From the orbit itself, which no run has shown yet.
    again = vx.periodic_orbit(system, orbit.x0, orbit.v0)
    np.testing.assert_allclose(again.x0, orbit.x0, rtol=SOLVED)
    np.testing.assert_allclose(again.events.t[:1], orbit.events.t[:1], rtol=SOLVED)
    (many,) = vx.find_periodic_orbits(system, [[0.1, 0.0]], 1, progress=False)
    np.testing.assert_allclose(many.x0, orbit.x0, rtol=SOLVED)
    np.testing.assert_allclose(many.events.t[:1], orbit.events.t[:1], rtol=SOLVED)
    np.testing.assert_allclose(np.sort(many.multipliers), np.sort(orbit.multipliers), rtol=SOLVED)
