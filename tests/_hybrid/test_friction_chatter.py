"""Chatter of contacts beside friction, in closed form."""

import numpy as np
import pytest

import vijax as vx


@pytest.mark.thorough
@pytest.mark.parametrize("size", [1.0, 1e2, 1e4])
def test_friction_slides_on_while_two_masses_chatter_together(size):
    """Impacts between two masses leave their momentum: the sum of forces stops both, and then they slide back."""
    slide, bounce, length = 2e-7 * size, 1e-8 * size, 1e-5 * size
    push, load, force = 0.5, -3.0, 1.0
    nothing, contact = np.zeros((2, 2)), vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.28)
    forcing = vx.Harmonic([0.0, 0.0], 1.0, mean=[push, load])
    system = vx.ImpactSystem(
        [1.0, 1.0], nothing, nothing, forcing, [contact], friction=[vx.Friction(1, force)]
    )
    sol = vx.simulate(system, 0.0, length, [0.0, 0.0], [slide + bounce, slide])
    stop = (2 * slide + bounce) / (force - push - load)
    events, last = sol.events, int(sol.num_events) - 1
    assert (int(events.kind[last]), int(events.stop[last])) == (vx.TURN, 1)
    assert float(events.t[last]) == pytest.approx(stop, rel=1e-12)
    np.testing.assert_allclose(sol.v1, (force + push + load) / 2 * (length - stop), rtol=1e-12)
