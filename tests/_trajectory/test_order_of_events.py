"""Events of two masses that do not feel each other, one just before the other, in closed form."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize("seed", range(4))
def test_a_release_just_before_the_impact_of_another_mass_is_located(seed):
    """Impacts are located from farther away than releases: a step to an impact must not pass a release."""
    random, nothing = np.random.default_rng(seed), np.zeros((2, 2))
    for _ in range(30):
        between = 10 ** random.uniform(-4.5, -1.3)
        speed, stiffness, phase = random.uniform(0.2, 2.0), random.uniform(0.5, 3), random.uniform(0, 1)
        release = np.pi / 2 - phase
        impact = release + between
        stops = [vx.Stop(0, impact * speed, "upper", 0.5), vx.Stop(1, 0.0, "upper", 0.5)]
        load = vx.Harmonic([0.0, 1.0], 1.0, [0.0, phase])
        system = vx.ImpactSystem([1.0, 1.0], nothing, np.diag([0.0, stiffness]), load, stops)
        sol = vx.simulate(system, 0.0, release + 0.3, [0.0, 0.0], [speed, 0.0])
        kinds, times = np.asarray(sol.events.kind), np.asarray(sol.events.t)
        assert times[kinds == vx.RELEASE][0] == pytest.approx(release, abs=1e-13)
        assert times[kinds == vx.IMPACT][0] == pytest.approx(impact, abs=1e-13)
