"""Random machines with friction of contacts move as an independent integration says, in any unit and order of the elements."""

import numpy as np
import pytest
from coulomb_bodies import Run, Undecided
from coulomb_scenes import SCENES, machine_of

import vijax as vx

# A program for each kind of machine takes half a minute to compile.
pytestmark = pytest.mark.slow
_UNTIL = 10.0
# Of both, after some hundred events.
_ROUNDING = 1e-9
_UNITS = [(1.0, 1.0, 1.0), (3.0, 1e-6, 1e3)]


@pytest.mark.parametrize("kind", SCENES)
def test_random_machines_move_as_an_independent_integration_says(kind):
    num_compared = 0
    for seed in range(16):
        bodies, x0, v0 = SCENES[kind](np.random.default_rng(seed))
        try:
            x, v = Run(bodies, x0, v0).until(_UNTIL)
            machines = [machine_of(bodies, units) for units in _UNITS]
        except (Undecided, ValueError):  # or refused (Painleve)
            continue
        num_compared += 1
        for machine, (_, length, t) in zip(machines, _UNITS, strict=True):
            sol = vx.simulate(machine, 0.0, _UNTIL * t, x0 * length, v0 * length / t)
            np.testing.assert_allclose(sol.x1 / length, x, rtol=0, atol=_ROUNDING, err_msg=f"{seed}")
            np.testing.assert_allclose(sol.v1 * t / length, v, rtol=0, atol=_ROUNDING, err_msg=f"{seed}")
    assert num_compared >= 10


@pytest.mark.parametrize("seed", [5, 11, 14])
def test_which_of_two_blocks_slips_does_not_depend_on_the_order_of_their_friction(seed):
    """Where the grip is above the friction of slip, either may slip while the other sticks: that slips whose grip is used up."""
    bodies, x0, v0 = SCENES["stack"](np.random.default_rng(seed))
    one, other = (
        vx.simulate(machine_of(bodies, turned=turned), 0.0, _UNTIL, x0, v0) for turned in (False, True)
    )
    np.testing.assert_allclose(one.x1, other.x1, rtol=0, atol=_ROUNDING)
