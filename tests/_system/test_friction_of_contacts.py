"""Friction of contacts as the user describes it: arguments, paths, files, pictures."""

import jax
import numpy as np
import pytest

import vijax as vx
from vijax._system.parameters import parameter_names, set_parameter


def _block(**friction) -> vx.ImpactSystem:
    none, floor = np.zeros((2, 2)), vx.Stop(1, 0.0, "lower", 0.5)
    weight = vx.Harmonic([0.0, 0.0], 1.0, mean=[0.0, -1.0])
    return vx.ImpactSystem([1.0, 1.0], none, none, weight, [floor], friction=[vx.Friction(0, **friction)])


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "Give `force`"),
        ({"force": 1.0, "coefficient": 0.1}, "and not both"),
        ({"force": 1.0, "contact": 0}, "give `coefficient` instead of `force`"),
        ({"coefficient": 0.1, "static": 0.2}, "give `static_coefficient` instead"),
        ({"force": 0.1, "static_coefficient": 0.2}, "give `static` instead"),
        ({"coefficient": 0.3, "static_coefficient": 0.2}, "must not be below `coefficient`"),
        ({"coefficient": -0.3}, "must be finite and not negative"),
        (
            {"coefficient": 0.3, "contact": 1},
            r"`friction\[0\].contact` is 1, but the machine has stops 0 to 0",
        ),
    ],
)
def test_wrong_arguments_are_told(given, told):
    with pytest.raises(ValueError, match=told):
        _block(**given)


def test_friction_of_contacts_survives_a_file(tmp_path):
    block = _block(coefficient=0.3, static_coefficient=0.4, velocity=0.1)
    for name in ("block.toml", "block.json"):
        vx.save(block, tmp_path / name)
        again = vx.load(tmp_path / name)
        assert again.friction[0].contact == 0
        for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(block), strict=True):
            np.testing.assert_array_equal(one, other)


def test_its_coefficient_is_a_parameter():
    assert {"friction[0].coefficient", "friction[0].velocity"} <= set(
        parameter_names(_block(coefficient=0.3))
    )
    changed = set_parameter(_block(coefficient=0.3), "friction[0].coefficient", 0.2)
    np.testing.assert_allclose(np.asarray(changed.friction[0].coefficient), 0.2)


def test_it_tells_what_it_is():
    assert "of x0, contact 0, coefficient 0.3" in repr(_block(coefficient=0.3))
    vx.plot.machine(_block(coefficient=0.3))


def test_a_full_mass_matrix_counts_for_painleve():
    mass, none = np.array([[1.0, 0.5], [0.5, 1.0]]), np.zeros((2, 2))
    floor = vx.Contact({1: -1.0}, 0.0)

    def block(coefficient):
        return vx.ImpactSystem(
            mass, none, none, None, [floor], friction=[vx.Friction(0, coefficient=coefficient)]
        )

    # a M^-1 a = 4 / 3 and a M^-1 g = 2 / 3.
    block(1.99)
    with pytest.raises(ValueError, match=r"the coefficient must be below 2\."):
        block(2.01)
    soft = vx.CompliantContact({1: -1.0}, 0.0, 10.0)
    vx.ImpactSystem(mass, none, none, None, [soft], friction=[vx.Friction(0, coefficient=3.0)])
