"""A machine that jumps on pistons: published multipliers, and its contacts."""

from itertools import pairwise

import numpy as np
import pytest
from helpers import log_of
from model_roundings import EXACT

import vijax as vx


# ln |mu| of the largest multiplier for g = 0.130, 0.134 and 0.140, with all digits of the program
# github.com/professionalMachine1/Multi-piston_vibro-impact_mechanism (LD_DMV.txt).
@pytest.mark.slow
@pytest.mark.parametrize(
    ("gravity", "exponent"),
    [
        (0.130, -0.2963060962),
        (0.134, -0.7793959414),
        (0.140, -1.3862943611),
    ],
)
def test_the_multipliers_of_a_machine_on_two_pistons_are_the_published_ones(gravity, exponent):
    system = vx.models.multi_piston(gravity=gravity)
    # Other orbits coexist; this one is reached from the start of the program, half a turn later in its phase.
    end = vx.simulate(system, np.pi, 400 * 2 * np.pi, [0.005 - 0.12], [0.2], max_events=4096)
    orbit = vx.periodic_orbit(system, end.x1, end.v1)
    assert orbit.is_admissible
    assert np.asarray(orbit.num_impacts).tolist() == [1, 1]
    assert np.log(np.abs(orbit.multipliers)).max() == pytest.approx(exponent, abs=2e-10)


@pytest.mark.slow
def test_a_casing_at_rest_on_one_piston_is_thrown_up_by_another():
    # Both rows are equal, and their pistons move differently.
    sol = vx.simulate(vx.models.multi_piston(), 0.0, 60.0, [0.3])
    log = log_of(sol)
    taken_over = [
        (hit, left)
        for hit, left in pairwise(log)
        if hit.kind == "impact" and left.kind == "release" and hit.t == left.t
    ]
    assert taken_over
    assert all((hit.stop, left.stop) == (1, 0) for hit, left in taken_over)
    t = np.linspace(0.0, 60.0, 2000)
    x, floors = np.asarray(sol.evaluate(t)[0]), -np.asarray(sol.evaluate_stops(t)[0])
    assert (x - floors).min() > -EXACT
    hit, _ = taken_over[0]
    before, after = (float(sol.evaluate(at)[1][0]) for at in (np.nextafter(hit.t, 0), hit.t))
    assert after - before == pytest.approx(1.5 * hit.velocity, rel=1e-12)
