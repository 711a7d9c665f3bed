"""Machines whose damping and stiffness are asymmetric or indefinite: rotors, followers, negative stiffness, feedback."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vijax as vx
from vijax._flow.choose import choose_flow
from vijax._machine.numbers import numbers_of
from vijax._machine.rate_bounds import _bound_between, _norm
from vijax._orbits.rigid_modes import free_shifts
from vijax._sections.non_impacting_proof import never_hits
from vijax._sections.section_side import machines_of_lanes

pytestmark = pytest.mark.thorough

LOAD = vx.Harmonic([1.0, 0.5], 1.3, [0.0, -np.pi / 2])
STOPS = [vx.Stop(0, 0.4, "upper", 0.8), vx.Stop(1, -0.3, "lower", 0.6)]
# A damped rotor: gyroscopic forces in C, circulatory ones of internal damping in K.
DAMPING, STIFFNESS = np.array([[0.3, 0.9], [-0.9, 0.4]]), np.array([[1.0, 0.25], [-0.25, 2.0]])
ROTOR = vx.ImpactSystem(np.ones(2), DAMPING, STIFFNESS, LOAD, STOPS)
# Closed forms lose some roundings; the reference solver is asked for 1e-13.
ROUNDING, REFERENCE = 1e-14, 2e-11


def test_a_mass_on_negative_stiffness_meets_its_stop_at_the_exact_time():
    """x = x0 cosh(k t) reaches 1 at t = arcosh(1 / x0) / k."""

    def impact(k):
        system = vx.ImpactSystem([1.0], [[0.0]], jnp.reshape(-k * k, (1, 1)), stops=[vx.Stop(0, 1.0)])
        log = vx.simulate(system, 0.0, 1.5, [0.5], [0.0]).events
        return log.t[0], log.velocity_minus[0]

    k = 1.2
    time, speed = impact(jnp.asarray(k))
    assert abs(time - np.arccosh(2.0) / k) < ROUNDING
    assert abs(speed - k * np.sqrt(0.75)) < ROUNDING
    slope = jax.jacfwd(impact)(k)
    np.testing.assert_allclose(slope, (-np.arccosh(2.0) / k**2, np.sqrt(0.75)), rtol=0, atol=10 * ROUNDING)


@pytest.mark.slow
def test_a_rotor_between_stops_moves_as_an_independent_solver_says():
    end, first = 30.0, np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]])

    def rate(t, y):
        return first @ y + np.array([0.0, 0.0, np.cos(1.3 * t), 0.5 * np.sin(1.3 * t)])

    gaps = [lambda t, y: 0.4 - y[0], lambda t, y: y[1] + 0.3]
    for gap in gaps:
        gap.terminal, gap.direction = True, -1
    t, y, times = 0.0, np.zeros(4), []
    while True:
        run = solve_ivp(rate, (t, end), y, "DOP853", rtol=1e-13, atol=1e-13, events=gaps, max_step=0.1)
        t, y = run.t[-1], run.y[:, -1].copy()
        if run.status != 1:
            break
        times.append(t)
        hit = int(not len(run.t_events[0]))
        y[2 + hit] *= -(0.8, 0.6)[hit]
    sol = vx.simulate(ROTOR, 0.0, end)
    assert len(times) > 10
    np.testing.assert_allclose(sol.events.t[: int(sol.num_events)], times, rtol=0, atol=REFERENCE)
    np.testing.assert_allclose(np.concatenate([sol.x1, sol.v1]), y, rtol=0, atol=10 * REFERENCE)


@pytest.mark.slow
def test_an_orbit_of_a_rotor_closes_with_the_multipliers_of_its_map():
    period = ROTOR.forcing.period
    sol = vx.simulate(ROTOR, 0.0, 60 * period, max_events=2000)
    orbit = vx.periodic_orbit(ROTOR, sol.x1, sol.v1, 1)
    assert orbit.is_stable
    assert orbit.num_impacts.sum() > 0
    once = vx.simulate(ROTOR, 0.0, period, orbit.x0, orbit.v0)
    np.testing.assert_allclose(once.x1, orbit.x0, atol=1e-13)
    of_map = np.linalg.eigvals(vx.monodromy_matrix(ROTOR, orbit.x0, orbit.v0))
    np.testing.assert_allclose(np.sort(np.abs(of_map)), np.sort(np.abs(orbit.multipliers)), atol=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_rates_bound_the_norms_of_any_matrices(seed):
    rng = np.random.default_rng(seed)
    for a in (rng.normal(size=(3, 3)), np.triu(rng.normal(size=(3, 3)), 1), -np.eye(3)):
        assert np.linalg.norm(a, 2) <= float(_norm(jnp.asarray(a))) * (1 + 1e-12)
        springs = [rng.normal(size=(3, 1)) for _ in range(2)]
        springs = [9 * row @ row.T for row in springs]
        bound = float(_bound_between(jnp.asarray(a), jnp.asarray(a + sum(springs))))
        assert all(
            np.linalg.norm(a + own, 2) <= bound * (1 + 1e-12) for own in (0 * a, *springs, sum(springs))
        )


@pytest.mark.parametrize(
    ("damping", "stiffness", "is_modal"),
    [
        (0.1 * np.eye(2), np.diag([1.0, 2.0]), True),
        (-0.1 * np.eye(2), np.diag([1.0, 2.0]), False),
        (0.1 * np.eye(2), np.diag([-1.0, 2.0]), False),
        (0.1 * np.eye(2), STIFFNESS, False),
        (DAMPING, np.diag([1.0, 2.0]), False),
    ],
)
def test_modes_serve_machines_whose_energy_never_grows(damping, stiffness, is_modal):
    system = vx.ImpactSystem(np.ones(2), damping, stiffness, LOAD, STOPS)
    assert isinstance(choose_flow(system, can_stick=True), vx.ModalFlow) == is_modal


def test_a_negative_spring_as_strong_as_a_stop_leaves_no_shift_free():
    system = vx.ImpactSystem([1.0], [[0.1]], [[-1.0]], vx.Harmonic([1.0], 1.0), [vx.Stop(0, 1.0)])
    assert not free_shifts(numbers_of(system)).any()


@pytest.mark.slow
def test_quiet_is_proved_with_gyroscopic_forces_and_never_where_energy_may_grow():
    """The modes of the last machine are damped, but its vibration first grows, up to the stop."""
    gyroscopic, follower = np.array([[0.1, 0.8], [-0.8, 0.1]]), np.array([[1.0, 40.0], [0.0, 1.5]])
    still, start = vx.Harmonic([0.0, 0.0], 1.0), (np.array([[0.0, 0.1]]), np.zeros((1, 2)))
    for damping, stiffness, is_quiet in ((gyroscopic, np.eye(2), True), (0.1 * np.eye(2), follower, False)):
        system = vx.ImpactSystem(np.ones(2), damping, stiffness, still, [vx.Stop(0, 1.0)])
        machine = machines_of_lanes(jax.tree.map(lambda a: np.asarray(a)[..., None], system))
        assert never_hits(machine, 0.0, *start)[0][0] == is_quiet
        assert (vx.simulate(system, 0.0, 40.0, *(a[0] for a in start)).num_events == 0) == is_quiet
