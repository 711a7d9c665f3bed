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


@pytest.mark.parametrize("depth", 10.0 ** -np.arange(2, 13))
def test_a_gap_closes_just_before_friction_stops_its_mass(depth):
    """A mass slides towards a stop, hits it slowly, and stands still; without the stop it would at a small depth."""
    friction, turn, restitution, nothing = 1.3, 0.8, 0.6, np.zeros((1, 1))
    reach = friction + depth
    before = np.arctan2(np.sqrt(depth * (reach + friction)), friction)
    speed = reach * np.sin(before)
    stop, pad = vx.Stop(0, 0.0, "lower", restitution), vx.Friction({0: 1.0}, friction)
    system = vx.ImpactSystem([1.0], nothing, nothing + 1, vx.Harmonic([0.0], 1.0), [stop], friction=[pad])
    sol = vx.simulate(system, 0.0, 2.0, [friction - reach * np.cos(turn)], [-reach * np.sin(turn)])
    assert sol.events.kind[: int(sol.num_events)].tolist() == [vx.IMPACT, vx.STICK]
    times = turn - before + np.array([0.0, np.arctan(restitution * speed / friction)])
    # Rounding of the way is magnified by the slowness of the impact.
    np.testing.assert_allclose(sol.events.t[:2], times, rtol=0, atol=2e-15 / speed)
    rest = np.hypot(friction, restitution * speed) - friction
    assert sol.x1[0] == pytest.approx(rest, abs=1e-15)


@pytest.mark.parametrize("seed", range(4))
def test_light_impacts_just_before_that_of_another_mass_are_located(seed):
    """A mass is pressed against a stop by 1, and hops; another one hits its stop amid the hops."""
    random, nothing, restitution = np.random.default_rng(seed), np.zeros((2, 2)), 0.9
    for _ in range(30):
        speed = 10 ** random.uniform(-5, -3.5)
        hops = 2 * np.arctan(speed * restitution ** np.arange(4))
        hits = np.cumsum(hops) - hops[0] / 2
        other = random.uniform(hits[0], hits[-1])
        stops = [vx.Stop(0, 0.0, "upper", restitution), vx.Stop(1, other, "upper", 0.5)]
        load = vx.Harmonic([0.0, 0.0], 1.0, mean=[1.0, 0.0])
        system = vx.ImpactSystem([1.0, 1.0], nothing, np.diag([1.0, 0.0]), load, stops)
        sol = vx.simulate(system, 0.0, float(hits[-1] + speed / 2), [1 - np.hypot(1, speed), 0.0], [0.0, 1.0])
        times = sol.events.t[: int(sol.num_events)]
        np.testing.assert_allclose(times, np.sort([*hits, other]), rtol=0, atol=1e-14 / speed)
