"""Rates of the moments of a cycle from its linearised flights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._branches.kernels import CycleEquations
from vijax._branches.padding import padded, room_for
from vijax._branches.start_points import points_of
from vijax._branches.starts import families_of, starting_orbits
from vijax._orbits.cycle import traverse
from vijax._orbits.linear_cycle import linearise_course

FREQUENCY = "forcing.frequency"
# Rounding, of rates up to 10.
ROUNDING = 1e-12


def stops() -> vx.ImpactSystem:
    return vx.models.wagg_bishop_a(0.8)


def friction() -> vx.ImpactSystem:
    load = vx.Harmonic([1.0], 0.7)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [], friction=[vx.Friction(0, 0.3)])


@pytest.mark.slow
@pytest.mark.parametrize("machine", [stops, friction], ids=lambda machine: machine.__name__)
def test_rates_are_the_derivatives_of_a_traversal(machine):
    system = machine()
    settled = vx.simulate(system, 0.0, 100 * system.forcing.period)
    starts = starting_orbits([vx.periodic_orbit(system, settled.x1, settled.v1)])
    (family,) = families_of(starts, FREQUENCY, 0.6, 1.0)
    (point,) = points_of(starts, [family])
    assert point is not None
    assert len(point.sequence.kind) > 1
    sequence, place, tangent = padded(
        point.sequence, (point.place, point.tangent), room_for(len(point.sequence.kind))
    )

    @jax.jit
    def both(family, sequence, place, tangent):
        count, equations = jnp.sum(sequence.is_event), CycleEquations.of(family, sequence, place)
        _, _, course = linearise_course(
            equations.problem, family.unknowns(place), family.scale, count, equations.change
        )
        start = jnp.append(tangent.z, tangent.p)
        given = course.begins, *course.rates(start, tangent.flights, family.scale)
        moments = lambda at: traverse(equations.at(at.p), family.unknowns(at), count)  # noqa: E731
        (begins, _), rates = jax.jvp(moments, (place,), (tangent,))
        return given, (begins, *rates), count

    given, expected, count = both(*jax.tree.map(jnp.asarray, (family, sequence, place, tangent)))
    (begins, rates, speeds), (other_begins, other_rates, other_speeds) = given, expected
    for one, other in zip(
        jax.tree.leaves((begins, rates)), jax.tree.leaves((other_begins, other_rates)), strict=True
    ):
        np.testing.assert_allclose(one[: count + 1], other[: count + 1], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(speeds, other_speeds, rtol=0, atol=ROUNDING)
    assert np.abs(rates.z[count]).max() > 1e-2
