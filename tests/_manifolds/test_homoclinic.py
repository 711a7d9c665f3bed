"""Homoclinic tangencies: a pendulum between stops in closed form, a saddle that impacts by another section, refusals.

On the unstable manifold of the motion s(t) = A cos(w t + f) without impacts, x = s + c exp(a t); on the stable one x = s + d exp(b t), with
a > 0 > b. The stop at 1 reverses the velocity from one to the other at the time t where

    (1 + r) s' + (r a + b) (1 - s) = 0.

So the manifolds touch where A sqrt((1 + r)^2 w^2 + (r a + b)^2) = |r a + b|: S. W. Shaw & R. H. Rand (1989).
"""

import itertools

import jax
import numpy as np
import pytest
from scipy.optimize import brentq

import vijax as vx

pytestmark = pytest.mark.thorough

DAMPING = 0.1
GROWTH, DECAY = (-DAMPING + sign * np.sqrt(DAMPING**2 + 1) for sign in (1, -1))


def pendulum(amplitude, frequency=1.5, restitution=0.8):
    stops = [vx.Stop(0, 1.0, "upper", restitution), vx.Stop(0, -1.0, "lower", restitution)]
    return vx.ImpactSystem([1.0], [[2 * DAMPING]], [[-1.0]], vx.Harmonic([amplitude], frequency), stops)


def saddle_of(system):
    w = float(system.forcing.frequency)
    response = float(system.forcing.amplitude[0]) / complex(-(w**2) - 1, 2 * DAMPING * w)
    return vx.periodic_orbit(system, [response.real], [-w * response.imag])


def touching_amplitude(frequency, restitution):
    slope = restitution * GROWTH + DECAY
    size = abs(slope) / np.hypot((1 + restitution) * frequency, slope)
    return size * np.hypot(frequency**2 + 1, 2 * DAMPING * frequency)


@pytest.fixture(scope="module")
def saddles():
    return vx.continuation(saddle_of(pendulum(0.45)), "forcing.amplitude[0]", (0.44, 0.4575), progress=False)


@pytest.fixture(scope="module")
def touching(saddles):
    return vx.homoclinic_tangencies(saddles, num_values=4, progress=False)


@pytest.mark.slow
def test_a_pendulum_between_stops_in_closed_form(touching):
    assert sorted(touching["side"].values) == [-1, 1]
    exact = touching_amplitude(1.5, 0.8)
    np.testing.assert_allclose(touching["forcing.amplitude[0]"], exact, rtol=1e-13)
    assert (touching["error"].values < 1e-13).all()
    assert (touching["meet"].values == 1).all()
    assert touching["is_smooth"].values.all()


@pytest.mark.slow
def test_the_homoclinic_motion_leads_from_the_saddle_and_back(touching):
    for k in range(2):
        one = touching.isel(tangency=k)
        system = pendulum(float(one["forcing.amplitude[0]"]))
        states = np.concatenate([one["x"].values, one["v"].values], axis=1)
        states = states[np.isfinite(states).all(axis=1)]
        saddle = np.concatenate([one["saddle_x0"].values, one["saddle_v0"].values])
        away = np.abs(states - saddle).max(axis=1)
        assert away[0] < 1e-2 * away.max()
        assert away[-1] < 1e-2 * away.max()
        for before, after in itertools.pairwise(states[:-1]):
            end = np.concatenate(vx.stroboscopic_map(system, before[:1], before[1:]))
            np.testing.assert_allclose(end, after, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.0, pytest.param(0.8, marks=pytest.mark.slow)])
def test_along_the_frequency_and_without_rebound(restitution):
    amplitude = touching_amplitude(1.5, restitution)
    exact = brentq(lambda w: touching_amplitude(w, restitution) - amplitude, 1.45, 1.55, xtol=1e-15)
    orbit = saddle_of(pendulum(amplitude, 1.49, restitution))
    branch = vx.continuation(orbit, "forcing.frequency", (1.485, 1.505), progress=False)
    found = vx.homoclinic_tangencies(branch, num_values=5, progress=False)
    values = found["forcing.frequency"].values
    near = np.abs(values - exact) < 1e-12
    # Without rebound many motions become one, and those of both sides may too.
    assert near.sum() == 2 if restitution else near.any()
    assert {*found["is_smooth"].values[near]} == {restitution > 0}
    # A faster load needs a larger amplitude.
    assert (found["meet"].values[near] == -1).all()


@pytest.mark.slow
def test_the_value_does_not_depend_on_the_phase_of_the_section():
    """At restitution 0.653 the curves of `manifolds` do not meet near the motion found, at 0.656 they do."""
    path, system = "stops[*].restitution", vx.models.two_sided_oscillator(3.0, damping_ratio=0.025)
    orbit = vx.periodic_orbit(system, [-0.496], [-0.472], 2)
    values = []
    for phase in (0.0, 0.7):
        start = vx.simulate(system, 0.0, phase / 3.0, orbit.x0, orbit.v0)
        saddle = vx.periodic_orbit(system, start.x1, start.v1, 2, phase=phase)
        branch = vx.continuation(saddle, path, (0.645, 0.81), progress=False)
        part = vx.Branch(branch.points.isel(point=branch.values < 0.68), branch.system)
        found = vx.homoclinic_tangencies(part, num_values=25, progress=False)
        assert (found["error"].values < 1e-12).all()
        values += [found[path].values[np.abs(found[path].values - 0.654) < 0.001]]
    assert [len(one) for one in values] == [1, 1]
    np.testing.assert_allclose(*values, rtol=1e-12)


@pytest.mark.slow
def test_motions_that_leave_for_ever_touch_nothing():
    load = vx.Harmonic([0.45], 1.5)
    falling = vx.ImpactSystem([1.0], [[2 * DAMPING]], [[-1.0]], load, [vx.Stop(0, 1.0, "upper", 0.8)])
    branch = vx.continuation(saddle_of(falling), "forcing.amplitude[0]", (0.45, 0.4575), progress=False)
    found = vx.homoclinic_tangencies(branch, num_values=3, progress=False)
    assert {*found["side"].values} == {1}
    np.testing.assert_allclose(found["forcing.amplitude[0]"], touching_amplitude(1.5, 0.8), rtol=1e-13)


def test_branches_without_saddles_and_single_precision_are_refused():
    system = vx.ImpactSystem(
        [1.0], [[0.2]], [[1.0]], vx.Harmonic([0.1], 1.5), [vx.Stop(0, 1.0, "upper", 0.8)]
    )
    branch = vx.continuation(
        vx.periodic_orbit(system, [0.0], [0.0]), "forcing.frequency", (1.4, 1.6), progress=False
    )
    with pytest.raises(ValueError, match="no saddles"):
        vx.homoclinic_tangencies(branch)
    with jax.enable_x64(False), pytest.raises(ValueError, match="64"):
        vx.homoclinic_tangencies(branch)
