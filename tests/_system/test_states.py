"""First-order states beside the masses, by the piezoelectric harvester x'' + 2 xi x' + x - chi V = cos W t, V' + lambda V + kappa x' = 0."""

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import vijax as vx
from vijax._system.description import build, describe

pytestmark = pytest.mark.thorough

XI, CHI, LAMBDA, KAPPA, SPEED = 0.01, 0.05, 0.05, 0.5, 0.8
PERIOD = 2 * np.pi / SPEED
# The linear motion of x, x', V.
MATRIX = np.array([[0.0, 1.0, 0.0], [-1.0, -2 * XI, CHI], [0.0, -KAPPA, -LAMBDA]])
STOP = vx.Stop(0, 1.5, "upper", 0.7)
# Closed forms lose some roundings; the reference solver is asked for 1e-13.
ROUNDING, REFERENCE = 5e-14, 1e-11


def harvester(stops=(), frequency=SPEED):
    beam = vx.ImpactSystem([1.0], [[2 * XI]], [[1.0]], vx.Harmonic([1.0], frequency), stops)
    return vx.with_states(beam, [[-LAMBDA]], [[CHI]], of_velocities=[[-KAPPA]])


@pytest.fixture(scope="module")
def settled():
    """The harvester with a stop, and the state on which it settles."""
    system = harvester([STOP])
    sol = vx.simulate(system, 0.0, 200 * PERIOD, max_events=1000)
    return system, sol


def test_without_stops_the_orbit_is_the_phasor_and_the_multipliers_those_of_the_circuit():
    orbit = vx.periodic_orbit(harvester(), [0.3, 7.0], [0.0, 0.0])
    s = 1j * SPEED
    x = 1 / (1 - SPEED**2 + 2j * XI * SPEED + CHI * KAPPA * s / (s + LAMBDA))
    np.testing.assert_allclose(orbit.x0, [x.real, 0.0], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(
        orbit.v0, [(s * x).real, (-KAPPA * s * x / (s + LAMBDA)).real], rtol=0, atol=ROUNDING
    )
    known = np.append(np.linalg.eigvals(expm(MATRIX * PERIOD)), 0)
    np.testing.assert_allclose(np.sort(np.abs(orbit.multipliers)), np.sort(np.abs(known)), rtol=0, atol=1e-12)
    assert orbit.is_stable


def test_with_a_stop_it_moves_as_an_independent_solver_says():
    def gap(t, y):
        return 1.5 - y[0]

    gap.terminal, gap.direction = True, -1
    end, t, y, times = 12 * PERIOD, 0.0, np.zeros(3), []
    while True:
        rate = lambda t, y: MATRIX @ y + np.array([0.0, np.cos(SPEED * t), 0.0])  # noqa: E731
        run = solve_ivp(rate, (t, end), y, "DOP853", rtol=1e-13, atol=1e-13, events=gap)
        t, y = run.t[-1], run.y[:, -1].copy()
        if run.status != 1:
            break
        times.append(t)
        y[1] *= -0.7
    sol = vx.simulate(harvester([STOP]), 0.0, end)
    np.testing.assert_allclose(sol.events.t[: int(sol.num_events)], times, rtol=0, atol=REFERENCE)
    assert len(times) == 12
    np.testing.assert_allclose([sol.x1[0], *sol.v1], y, rtol=0, atol=REFERENCE)
    assert sol.x1[1] == 0
    x, _ = sol.evaluate(np.linspace(0, float(end), 7))
    assert not np.asarray(x)[:, 1].any()


@pytest.mark.slow
def test_orbits_branches_exponents_and_classes_are_those_of_any_machine(settled):
    system, sol = settled
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
    np.testing.assert_allclose(orbit.v0, sol.v1, rtol=0, atol=1e-9)
    flight, (impact,) = float(orbit.events.t[0]), orbit.num_impacts
    assert impact == 1
    # Flights by the matrix exponential, the impact by its saltation matrix.
    before = vx.simulate(system, 0.0, flight * (1 - 1e-15), orbit.x0, orbit.v0)
    speed, r = float(orbit.events.velocity_minus[0]), 0.7
    push = -1.5 + CHI * float(before.v1[1]) + np.cos(SPEED * flight)
    a_minus, a_plus = push - 2 * XI * speed, push + 2 * XI * r * speed
    jump = np.diag([-r, -r, 1.0])
    jump[1, 0] = (r * a_minus + a_plus) / speed
    jump[2, 0] = KAPPA * (1 + r)
    product = expm(MATRIX * (PERIOD - flight)) @ jump @ expm(MATRIX * flight)
    known = np.append(np.linalg.eigvals(product), 0)
    np.testing.assert_allclose(np.sort(np.abs(orbit.multipliers)), np.sort(np.abs(known)), rtol=0, atol=1e-10)
    exponents = vx.lyapunov_exponents(system, sol.x1, sol.v1, progress=False)
    assert exponents[-1] == -np.inf
    assert abs(exponents[0] - np.log(np.abs(known).max()) / PERIOD) < 1e-3
    ds = vx.sweep(system, {"damping[1][1]": [LAMBDA, 0.06]}, transient=150, record=8, progress=False)
    assert (vx.classify(ds)["num_periods"] == 1).all()
    branch = vx.continuation(orbit, "damping[1][1]", (0.04, 0.06), progress=False)
    assert list(branch.ends) == ["bounds", "bounds"]
    last = branch.orbit(int(np.argmax(branch.values)))
    assert abs(last.system.damping[1, 1] - 0.06) < 1e-12
    np.testing.assert_allclose(last.v0, ds["section_v"].values[1, -1], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_derivatives_by_the_numbers_of_the_circuit_are_those_of_differences():
    def voltage(kappa):
        beam = vx.ImpactSystem([1.0], [[2 * XI]], [[1.0]], vx.Harmonic([1.0], SPEED), [STOP])
        system = vx.with_states(beam, [[-LAMBDA]], [[CHI]], of_velocities=[[-kappa]])
        return vx.simulate(system, 0.0, 3 * PERIOD).v1[1]

    h = 1e-5
    difference = (voltage(KAPPA + h) - voltage(KAPPA - h)) / (2 * h)
    assert abs(jax.jacfwd(voltage)(KAPPA) - difference) < 1e-8


def test_it_goes_to_a_file_and_back_and_prints_its_states():
    system = harvester([STOP])
    again = build(describe(system), "float64")
    assert again.num_states == 1
    assert repr(again) == repr(system)
    assert "1 mass, 1 first-order state and 1 stop" in repr(system)


def test_a_second_load_is_a_pair_of_states():
    """Without stops the motion is the sum of both responses; both phases of the second load are neutral."""
    first, second, drag = 0.8, 0.8 * np.sqrt(2), 0.1
    load = vx.Harmonic([0.2], first)
    alone = vx.ImpactSystem([1.0], [[drag]], [[1.0]], load, [])
    machine = vx.with_states(alone, [[0.0, second], [-second, 0.0]], [[0.1, 0.0]])
    ts = np.linspace(300, 310, 50) * float(load.period)
    sol = vx.simulate(machine, 0.0, ts[-1], v0=[0.0, 1.0, 0.0], ts=ts)
    pairs = ((first, 0.2), (second, 0.1))
    response = sum((a * np.exp(1j * w * ts) / (1 - w**2 + 1j * drag * w)).real for w, a in pairs)
    np.testing.assert_allclose(sol.xs[:, 0], response, rtol=0, atol=1e-12)
    found = vx.lyapunov_exponents(machine, v0=[0.0, 1.0, 0.0], transient=50, num_periods=100, progress=False)
    np.testing.assert_allclose(found[:4], [0, 0, -drag / 2, -drag / 2], rtol=0, atol=1e-2)
