"""Orbits of two masses against digits of an independent solver, see `orbit_digits.py`."""

import numpy as np
import pytest
from helpers import CHATTER_END, KINDS
from orbit_digits import CASES, digits_of, stored

import vijax as vx

pytestmark = pytest.mark.thorough

# States, times and speeds of an orbit, and its multipliers, against 40 digits.
EXACT, EXACT_MULTIPLIERS = 1e-12, 1e-10


@pytest.mark.parametrize("name", CASES)
def test_an_orbit_has_the_digits_of_an_independent_solver(name):
    case, known = CASES[name](), stored()[name]
    orbit = vx.periodic_orbit(case.system, case.x, case.v, case.num_periods)
    for found, digits in ((orbit.x0, known["x0"]), (orbit.v0, known["v0"])):
        np.testing.assert_allclose(found, [float(a) for a in digits], rtol=0, atol=EXACT)
    found, digits = (
        np.asarray(orbit.multipliers),
        [complex(float(a), float(b)) for a, b in known["multipliers"]],
    )
    distance = np.abs(found[:, None] - np.array(digits))
    assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < EXACT_MULTIPLIERS
    # No two solvers end the last bounces of a chatter alike.
    log = orbit.events
    rows = zip(*(a.tolist() for a in (log.t, log.kind, log.stop, log.velocity_minus)), strict=True)
    events = [e for e in rows if e[1] == vx.RELEASE or (e[1] == vx.IMPACT and abs(e[3]) > CHATTER_END)]
    assert len(events) == len(known["events"])
    for (t, kind, stop, v), expected in zip(events, known["events"], strict=True):
        assert (KINDS[kind], stop) == (expected["kind"], expected["stop"])
        assert abs(t - float(expected["t"])) < EXACT
        assert abs(v - float(expected["v_before"])) < EXACT


@pytest.mark.slow
def test_the_digits_are_those_that_their_script_finds():
    name = "a_080_one_impact_of_each"
    assert digits_of(name) == stored()[name]
