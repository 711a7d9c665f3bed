"""Rigid contacts of one place and one restitution are one limit, in orbits and branches as in runs."""

import numpy as np
import pytest

import vijax as vx

PLACE, RESTITUTION = 0.3, 0.7


def machine(num_contacts: int, *, rubs: bool = False, restitution: float = RESTITUTION) -> vx.ImpactSystem:
    """One mass before a stop that is described once, or again by contacts of other rows."""
    rows = [1.0, 3.0, 0.5][:num_contacts]
    stops = [vx.Contact({0: row}, PLACE * row, restitution) for row in rows]
    friction = [vx.Friction(0, 0.1, static=0.13)] if rubs else []
    load = vx.Harmonic([0.6], 1.1, mean=[0.05])
    return vx.ImpactSystem([1.0], [[0.05]], [[1.0]], load, stops, friction=friction)


def orbit_of(system: vx.ImpactSystem) -> vx.PeriodicOrbit:
    """The orbit of one period to which the machine settles."""
    settled = vx.simulate(system, 0.0, 40 * 2 * np.pi / 1.1)
    return vx.periodic_orbit(system, settled.x1, settled.v1)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "kind", [{}, {"rubs": True}, {"restitution": 0.0}], ids=["rigid", "friction", "plastic"]
)
def test_orbits_are_those_of_one_contact(kind):
    one, *others = (orbit_of(machine(number, **kind)) for number in (1, 2, 3))
    for other in others:
        np.testing.assert_allclose([*other.x0, *other.v0], [*one.x0, *one.v0], rtol=0, atol=1e-12)
        expected = np.sort_complex(np.asarray(one.multipliers))
        np.testing.assert_allclose(
            np.sort_complex(np.asarray(other.multipliers)), expected, rtol=0, atol=1e-11
        )


@pytest.mark.slow
@pytest.mark.parametrize("rubs", [False, True])
def test_branches_are_those_of_one_contact(rubs):
    one, other = (
        vx.continuation(orbit_of(machine(number, rubs=rubs)), "forcing.frequency", (0.5, 2.5))
        for number in (1, 2)
    )
    assert other.ends == one.ends
    assert [point.kind for point in other.bifurcations] == [point.kind for point in one.bifurcations]
    values = [[float(point.value) for point in branch.bifurcations] for branch in (one, other)]
    assert len(values[0]) > 0
    np.testing.assert_allclose(values[1], values[0], rtol=0, atol=1e-9)
