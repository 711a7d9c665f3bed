"""Impacts at the very end of a period."""

import jax
import numpy as np
import pytest

import vijax as vx
from vijax._sections.section_side import after_impacts, machines_of_lanes


@pytest.mark.parametrize("element", [vx.Friction(0, 0.05), vx.Friction(0, coefficient=0.05, contact=1)])
def test_friction_is_not_hit_where_contacts_are(element):
    stops = [vx.Stop(0, 0.1, "upper", 0.7), vx.Contact({1: -1.0}, 0.0, restitution=0.5)]
    load = vx.Harmonic([0.5, 0.0], 2.2, mean=[0.0, -1.0])
    system = vx.ImpactSystem([1.0, 1.0], np.zeros((2, 2)), np.eye(2), load, stops, friction=[element])
    lanes = jax.tree.map(lambda a: np.repeat(np.asarray(a)[..., None], 2, axis=-1), system)
    closed = np.array([[True, True], [False, False]])
    states = np.array([[0.1, 0.0], [0.1, 0.0]]), np.array([[2.0, 0.3], [1.0, 0.3]])
    x, v = after_impacts(machines_of_lanes(lanes), 0.0, states, closed)
    np.testing.assert_allclose(x, states[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(v, [[-1.4, 0.3], [-0.7, 0.3]], rtol=1e-15)
