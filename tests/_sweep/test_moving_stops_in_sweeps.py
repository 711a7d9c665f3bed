"""Sweeps of machines with moving stops, against trajectories one by one."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shaken import MAGNIFIED, W, ball, table, two_masses

import vijax as vx

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def swept():
    """A sweep over the displacement of the walls."""
    values = {"stops[*].motion.amplitude[0][0]": np.linspace(0.05, 0.15, 5)}
    # A machine with moving stops only.
    system = eqx.tree_at(lambda s: s.stops, two_masses(), two_masses().stops[1:])
    return vx.sweep(system, values, transient=3, record=3, progress=False)


@pytest.mark.slow
def test_a_sweep_tells_of_the_motion_in_space(swept):
    (path,) = swept.result.dims
    point = swept.isel({path: 3})
    system = vx.system_of(point)
    assert float(system.stops[1].motion.amplitude[0, 0]) == float(point[path])
    period = 2 * np.pi / 1.3
    follow = lambda x: vx.simulate(system, 0.0, 6 * period, [x, 0.0], ts=np.arange(4, 7) * period)  # noqa: E731
    solution, kicked = follow(0.0), follow(1e-9)
    log = solution.events
    is_recorded = (log.kind == vx.IMPACT) & (log.t > 3 * period)
    # A few roundings of positions, as magnified by this motion.
    growth = jnp.max(jnp.abs((kicked.events.velocity_minus - log.velocity_minus)[is_recorded])) / 1e-9
    magnified = 1e-15 * float(growth)
    assert magnified < 2e-12
    velocity = point.impact_velocity.dropna("impact")
    np.testing.assert_allclose(velocity, log.velocity_minus[is_recorded], rtol=0, atol=magnified)
    _, of_stops = solution.evaluate_stops(log.t[is_recorded])
    relative = velocity - of_stops[jnp.arange(len(velocity)), log.stop[is_recorded]]
    found = point.impact_relative_velocity.dropna("impact")
    np.testing.assert_allclose(found, relative, rtol=0, atol=magnified)
    np.testing.assert_allclose(point.section_x, solution.xs, rtol=0, atol=magnified)
    np.testing.assert_allclose(point.section_v, solution.vs, rtol=0, atol=magnified)
    np.testing.assert_allclose(point.v, solution.v1, rtol=0, atol=magnified)


@pytest.mark.slow
def test_whole_motions_are_swept_and_have_no_frequency_of_their_own(swept):
    system = vx.system_of(swept)
    amplitudes = np.array([[[0.05], [0.0]], [[0.05], [0.04]]])
    ds = vx.sweep(system, {"stops[*].motion.amplitude": amplitudes}, transient=3, record=3, progress=False)
    np.testing.assert_array_equal(ds.x[1], swept.x[0])
    np.testing.assert_array_equal(ds["stops[*].motion.amplitude.values"], amplitudes)
    with pytest.raises(ValueError, match="names nothing that can be swept"):
        vx.sweep(system, {"stops[0].motion.frequency": [1.0]}, progress=False)


def test_the_frequency_of_the_load_is_swept_with_that_of_the_stops():
    system = ball(0.05)  # not thrown off below W = 6.3: the ball rests on the table
    x, _ = table(0.0, amplitude=0.05)
    frequencies = np.array([1.0, 2.0, 3.0])
    ds = vx.sweep(
        system, {"forcing.frequency": frequencies}, x0=[x + 1e-3], transient=3, record=1, progress=False
    )
    speeds = -0.05 * frequencies * np.sin(0.3)
    np.testing.assert_allclose(ds.v[:, 0], speeds, rtol=1e-13)
    assert ds.stuck.all()


def carried_by_hand(systems):
    """End states of machines in turn, each started where the one before it ended, the first from rest."""
    x, v, ends = [0.0], [0.0], []
    for system in systems:
        end = vx.simulate(system, 0.0, system.forcing.period, x, v)
        x, v = end.x1, end.v1
        ends.append([*x, *v])
    return np.array(ends)


@pytest.mark.slow
def test_where_a_stop_is_at_the_start_decides_what_is_carried():
    # At the start of every period the stop is at 1.8, far beyond its middle.
    walls = [vx.Stop(0, 0.3, "upper", 0.7, vx.Harmonic([1.5], 1.3))]
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.8], 1.3, mean=[1.0]), walls)
    amplitudes = np.array([0.1, 0.2, 0.3, 0.4])
    ds = vx.sweep(
        system, {"forcing.amplitude[0]": amplitudes}, transient=0, record=1, carry="up", progress=False
    )
    loads = [eqx.tree_at(lambda s: s.forcing.amplitude, system, jnp.array([a])) for a in amplitudes]
    ends = carried_by_hand(loads)
    assert ends[:, 0].max() > 0.3
    np.testing.assert_allclose(np.stack([ds.x[:, 0], ds.v[:, 0]], axis=1), ends, rtol=0, atol=MAGNIFIED)


def test_a_mass_that_is_held_is_carried_with_its_stop():
    travel = np.array([0.05, 0.1, 0.15])
    ds = vx.sweep(
        ball(0.05), {"stops[0].motion.amplitude[0]": travel}, x0=[0.15], transient=5, record=1,
        carry="up", progress=False,
    )  # fmt: skip
    assert ds.stuck.all()
    # The first one falls onto the table, the others rest on it throughout.
    np.testing.assert_allclose(ds.held_time[1:, 0, 0], 2 * np.pi / W, rtol=1e-13)
    np.testing.assert_allclose(ds.x[:, 0], travel * np.cos(0.3), rtol=1e-13)
    assert (ds.steps[1:] < ds.steps[0]).all()
