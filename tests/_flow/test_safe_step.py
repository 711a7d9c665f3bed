"""Steps that are proved free of events."""

import jax.numpy as jnp
import numpy as np

from vijax._flow.safe_step import Bound, safe_step


def test_an_event_within_a_short_step_is_found_however_loose_the_bound_of_a_long_one():
    """A mass that leaves a stop in a light bounce returns long before the bound of the first trial gives anything."""
    gap, speed, pull = 1.8e-13, 1.13e-6, 0.6
    bound = Bound(*(jnp.asarray(a) for a in (gap, speed, -pull / 2, 1.0)))
    step, is_root = safe_step(bound, jnp.asarray(1.0), jnp.asarray(1.4e-5))
    assert is_root
    exact = (speed + np.sqrt(speed**2 + 2 * pull * gap)) / pull
    # The step is too short by the third order: rest * U / pull, with U the length of the trial.
    np.testing.assert_allclose(step, exact, rtol=1e-4)
    assert step < exact
