"""Orbits of two masses against digits of an independent solver, see `orbit_digits.py`."""

import json

import numpy as np
import pytest
from orbit_digits import CASES, DATA

import vijax as vx

DIGITS = json.loads(DATA.read_text())


def numbers(rows) -> np.ndarray:
    return np.asarray(rows, dtype=np.float64)


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_an_orbit_has_the_digits_of_an_independent_solver(name):
    case, known = CASES[name](), DIGITS[name]
    orbit = vx.periodic_orbit(case.system, case.x, case.v, case.num_periods)
    np.testing.assert_allclose(orbit.x0, numbers(known["x0"]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(orbit.v0, numbers(known["v0"]), rtol=0, atol=1e-12)
    # Of a chatter, the bounces that are not light are known.
    log = orbit.events
    impacts = [event for event in known["events"] if event["kind"] == "impact"]
    times, stops = numbers([event["t"] for event in impacts]), np.array([event["stop"] for event in impacts])
    velocities = numbers([event["v_before"] for event in impacts])
    for t, stop, velocity in zip(times, stops, velocities, strict=True):
        own = (log.kind == vx.IMPACT) & (log.stop == stop)
        k = np.nanargmin(np.where(own, np.abs(log.t - t), np.nan))
        assert float(log.t[k]) == pytest.approx(t, abs=1e-12)
        assert float(log.velocity_minus[k]) == pytest.approx(velocity, abs=1e-12)
    found, expected = np.asarray(orbit.multipliers), numbers(known["multipliers"]) @ [1, 1j]
    distance = np.abs(found[:, None] - expected)
    assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < 1e-10 * max(
        1, np.abs(expected).max()
    )
