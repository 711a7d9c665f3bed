"""Shifts of the masses that change no spring force and no gap."""

import numpy as np
import pytest

import vijax as vx
from vijax._machine.numbers import numbers_of
from vijax._orbits.rigid_modes import free_shifts

LOAD = vx.Harmonic([1.0, 0.0, 0.0], 1.0)
# Masses 0 and 1 are joined by a spring, 1 and 2 by a contact: all three may shift together.
JOINED = np.array([[0.3, -0.3, 0.0], [-0.3, 0.3, 0.0], [0.0, 0.0, 0.0]])
TIE = vx.Contact({1: 1.0, 2: -1.3}, 0.1, 0.5)


def shifts(stiffness: np.ndarray, stops: list) -> np.ndarray:
    system = vx.ImpactSystem([1.0, 2.0, 3.0], 0 * stiffness, stiffness, LOAD, stops)
    return np.asarray(free_shifts(numbers_of(system)))


@pytest.mark.parametrize("weak", [1e-6, 1.0, 1e6])
def test_there_is_none_to_the_last_bit_where_every_mass_is_held(weak):
    hold = np.diag([0.0, 0.0, weak])
    assert not shifts(JOINED + hold, [TIE]).any()
    assert not shifts(JOINED, [TIE, vx.Stop(mass=2, position=0.1, restitution=0.5)]).any()


def test_a_chain_of_springs_and_contacts_moves_on_as_one():
    found = shifts(JOINED, [TIE])
    together = np.array([1.3, 1.3, 1.0])
    assert np.linalg.matrix_rank(found) == 1
    np.testing.assert_allclose(found @ together, together, rtol=1e-15)


def test_masses_that_nothing_joins_move_on_each_by_itself():
    np.testing.assert_array_equal(shifts(0 * JOINED, []), np.eye(3))
