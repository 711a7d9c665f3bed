"""Machines with friction or compliant stops against closed forms and published figures."""

import jax
import numpy as np
import pytest
from model_roundings import ORBIT
from switching_scenes import switching_scene

import vijax as vx

pytestmark = pytest.mark.thorough


def settled(system: vx.ImpactSystem, periods: int) -> vx.Solution:
    """Two periods after a long transient."""
    end = periods * system.forcing.period
    before = vx.simulate(system, 0.0, end)
    return vx.simulate(system, end, end + 2 * system.forcing.period, before.x1, before.v1)


def at_events(sol: vx.Solution, kind: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and velocities before the events of a kind."""
    events, n = sol.events, int(sol.num_events)
    times = np.asarray(events.t)[:n][np.asarray(events.kind)[:n] == kind]
    states = [sol.evaluate(t) for t in times]
    return times, *(np.array([state[k][0] for state in states]) for k in (0, 1))


def test_the_undamped_friction_oscillator_has_den_hartogs_amplitude():
    w, amplitude = 0.8, 4.0
    v, u = 1 / (1 - w**2), np.sin(np.pi / w) / (w * (1 + np.cos(np.pi / w)))
    sol = settled(vx.models.friction_oscillator(w, amplitude), 400)
    _, x, _ = at_events(sol, vx.TURN)
    np.testing.assert_allclose(np.abs(x), np.sqrt((amplitude * v) ** 2 - u**2), rtol=ORBIT)
    assert len(x) == 4


def test_the_damped_friction_oscillator_has_the_known_amplitude():
    sol = settled(vx.models.friction_oscillator(0.8, 1.5, damping_ratio=0.05), 100)
    np.testing.assert_allclose(np.abs(at_events(sol, vx.TURN)[1]), 2.145852589884217, rtol=ORBIT)


@pytest.mark.slow
def test_a_friction_that_weakens_oscillates_with_the_period_of_leine_and_others():
    system = vx.models.friction_oscillator(1.0, 0.0, velocity=0.2, weakening=3.0)
    times, *_ = at_events(vx.simulate(system, 0.0, 60.0, [0.5], [0.2]), vx.STICK)
    np.testing.assert_allclose(np.diff(times), 12.0010312948, atol=6e-11)


@pytest.mark.slow
def test_a_friction_damped_pair_driven_in_opposite_phases_is_two_masses_on_the_ground():
    sol = settled(vx.models.friction_damped_pair(0.8, 1.5, damping_ratio=0.05), 100)
    np.testing.assert_allclose(np.abs(at_events(sol, vx.TURN)[1]), 2.145852589884217, rtol=ORBIT)
    np.testing.assert_allclose(sol.x1[0], -sol.x1[1], rtol=ORBIT)


@pytest.mark.slow
def test_a_blow_drives_the_bit_of_a_drill_as_far_as_its_energy_lasts():
    m, thrust, resistance, r, speed = 2.0, 0.3, 1.0, 0.6, 1.5
    system = vx.models.percussive_drill(
        1.0,
        0.0,
        mass=m,
        thrust=thrust,
        resistance=resistance,
        restitution=r,
        stiffness=0.0,
        damping_ratio=0.0,
    )
    sol = vx.simulate(system, 0.0, 10.0, v0=[speed, 0.0])
    begin = (1 + r) * speed / (1 + m)
    np.testing.assert_allclose(sol.x1[1], m * begin**2 / (2 * (resistance - thrust)), rtol=ORBIT)
    assert sol.sticking1[0]


def test_a_drill_advances_while_it_vibrates():
    sol = vx.simulate(vx.models.percussive_drill(0.9, 0.8), 0.0, 200.0)
    assert sol.x1[1] > 1.0


@pytest.mark.slow
def test_a_harvester_hits_its_ends_as_an_impact_pair_and_bears_the_weight_of_its_ball():
    w, a, r, half, slope, g = 2.0, 0.4, 0.6, 1.0, 0.1, 9.81
    flat = vx.models.vibro_impact_harvester(w, a, restitution=r, travel=2 * half)
    q = np.pi * (1 + r) / (2 * (1 - r))
    hits = vx.simulate(flat, 0.0, 500.0, v0=[1.0], max_events=2048).events
    angle = w * np.asarray(hits.t)[np.asarray(hits.stop) == 0][-3:]
    np.testing.assert_allclose(a * (q * np.sin(angle) - np.cos(angle)), half, rtol=1e-9)
    steep = vx.models.vibro_impact_harvester(w, a, restitution=r, travel=2 * half, inclination=slope)
    periods = 20 * steep.forcing.period
    sol = vx.simulate(steep, 0.0, periods, v0=[1.0], max_events=2048)
    impulses = np.asarray(sol.events.impulse)[: int(sol.num_events)]
    # Over whole periods the shaking gives no momentum.
    np.testing.assert_allclose(impulses.sum(), sol.v1[0] - 1.0 + g * np.sin(slope) * periods, atol=1e-11)


def test_a_mass_on_a_belt_sticks_to_it():
    system = vx.models.friction_oscillator(0.5, 0.0, force=0.5, static=1.0, velocity=0.2)
    sol = vx.simulate(system, 0.0, 60.0)
    times, x, v = at_events(sol, vx.SLIP)
    assert len(times) > 3
    # It is carried along until the spring overcomes the static friction.
    np.testing.assert_allclose(x, 1.0, rtol=ORBIT)
    np.testing.assert_allclose(v, 0.2, rtol=ORBIT)


def test_the_soft_oscillator_grazes_where_its_linear_motion_does():
    w = 0.801928106593235
    for factor, touches in ((1 - 1e-9, False), (1 + 1e-9, True)):
        system = vx.models.soft_impact_oscillator(w, 0.7 * factor, stiffness=5.0)
        response = 0.7 * factor * w**2 / (1 - w**2 + 2j * 0.01 * w)
        assert (abs(response) > 1.26) is touches
        # On the linear motion, at a time when it is far from the stop: other motions coexist.
        start = [[response.real], [-w * response.imag]]
        sol = vx.simulate(system, 0.0, 1.5 * system.forcing.period, *start)
        assert bool(np.any(np.asarray(sol.events.kind) == vx.CLOSE)) is touches


@pytest.mark.slow
def test_the_contact_of_the_soft_oscillator_lasts_as_long_as_known():
    sol = settled(vx.models.soft_impact_oscillator(0.85, stiffness=5.0), 500)
    (begin, _, speed), (end, _, _) = at_events(sol, vx.CLOSE), at_events(sol, vx.OPEN)
    np.testing.assert_allclose(end[end > begin[0]][0] - begin[0], 0.9036391573887, rtol=1e-11)
    np.testing.assert_allclose(speed, 0.6246389664526, rtol=1e-11)


def test_the_capsule_is_that_of_a_golden_scene():
    scene = switching_scene("capsule")
    system = vx.models.capsule_robot(1.05, 1.2, friction=0.6)
    sol = vx.simulate(system, scene.data["t0"], scene.data["t1"])
    np.testing.assert_allclose(sol.x1, scene.data["x1"], rtol=0, atol=scene.state_tolerance)
    np.testing.assert_allclose(sol.v1, scene.data["v1"], rtol=0, atol=scene.state_tolerance)


@pytest.mark.slow
def test_the_speed_of_the_capsule_has_a_derivative_by_the_stiffness_of_its_plate():
    def speed(stiffness):
        system = vx.models.capsule_robot(1.05, 1.2, friction=0.6, stiffness=stiffness)
        return vx.simulate(system, 0.0, 20 * 2 * np.pi / 1.05, throw=False).x1[1]

    ends = [speed(15.0 + h) for h in (-1e-5, 1e-5)]
    np.testing.assert_allclose(jax.jacfwd(speed)(15.0), (ends[1] - ends[0]) / 2e-5, rtol=1e-6)
