"""Cycles of machines that nothing drives, against closed forms: clocks, a mass on a belt, negative damping."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import vijax as vx

pytestmark = pytest.mark.thorough

# Closed forms lose some roundings.
ROUNDING = 1e-13


def bouncing(restitution=0.6, damping=-0.1):
    """Negative damping, and a stop that takes the energy out."""
    return vx.ImpactSystem([1.0], [[damping]], [[1.0]], stops=[vx.Stop(0, 1.0, "upper", restitution)])


def next_speed(u, r, zeta):
    """Time and speed of the impact after one at speed u with a stop at 1, x'' - 2 zeta x' + x = 0."""
    w = np.sqrt(1 - zeta**2)

    def motion(t):
        grown, c, s = np.exp(zeta * t), np.cos(w * t), np.sin(w * t)
        x = grown * (c - (r * u + zeta) / w * s)
        return x - 1, grown * (-r * u * c - (zeta * r * u + 1) / w * s)

    t = brentq(lambda t: motion(t)[0], np.pi / w, 1.999 * np.pi / w, xtol=1e-15)
    return t, motion(t)[1]


def test_a_cycle_of_negative_damping_and_impacts_has_its_period_speed_and_multiplier():
    orbit = vx.periodic_orbit(bouncing(), [0.5], [0.0])
    u = float(orbit.events.velocity_minus[0])
    period, speed = next_speed(u, 0.6, 0.05)
    assert abs(orbit.period - period) < ROUNDING
    assert abs(speed - u) < ROUNDING
    h = 1e-5
    multiplier = (next_speed(u + h, 0.6, 0.05)[1] - next_speed(u - h, 0.6, 0.05)[1]) / (2 * h)
    np.testing.assert_allclose(orbit.multipliers, [1.0, multiplier], rtol=0, atol=1e-9)
    assert orbit.multipliers[0] == 1
    assert orbit.is_stable
    assert orbit.num_periods == 0
    sol = orbit.solution()
    np.testing.assert_allclose([sol.x1[0], sol.v1[0]], [orbit.x0[0], orbit.v0[0]], rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_the_period_is_differentiable_by_the_numbers_of_the_machine():
    def of(r):
        return vx.periodic_orbit(bouncing(r), [0.5], [0.0]).period

    h = 1e-5
    assert abs(jax.jacfwd(of)(0.6) - (of(0.6 + h) - of(0.6 - h)) / (2 * h)) < 1e-8


@pytest.mark.slow
def test_a_branch_of_cycles_is_the_closed_form_at_every_point():
    orbit = vx.periodic_orbit(bouncing(), [0.5], [0.0])
    branch = vx.continuation(orbit, "stops[0].restitution", (0.3, 0.72), progress=False)
    assert branch.ends == ("bounds", "bounds")
    points = branch.points
    for r, u, period in zip(
        branch.values, points["impact_speed"].values[:, 0], points["period"].values, strict=True
    ):
        known, speed = next_speed(u, r, 0.05)
        assert abs(period - known) < ROUNDING
        assert abs(speed - u) < ROUNDING
    np.testing.assert_array_equal(points["multipliers"].values[:, 0], 1)
    last = branch.orbit(len(branch) - 1)
    assert last.num_periods == 0
    assert last.system.forcing.frequency == 0
    again = vx.periodic_orbit(last.system, last.x0, last.v0)
    np.testing.assert_allclose(again.period, last.period, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_mass_on_a_belt_sticks_and_slips_with_the_exact_period():
    """T = 2 pi - 2 atan(D / V) + 2 D / V, D what static friction exceeds the kinetic one by; a stick forgets its past."""
    gap, kinetic = 0.4, 0.6

    def orbit_at(speed):
        friction = vx.Friction({0: 1.0}, kinetic, static=kinetic + gap, velocity=speed)
        return vx.periodic_orbit(vx.ImpactSystem([1.0], [[0.0]], [[1.0]], friction=[friction]), [0.0], [0.0])

    v = 0.3
    orbit = orbit_at(v)
    assert abs(orbit.period - (2 * np.pi - 2 * np.arctan(gap / v) + 2 * gap / v)) < ROUNDING
    np.testing.assert_allclose(orbit.multipliers, [1, 0], rtol=0, atol=ROUNDING)
    slope = jax.jacfwd(lambda v: orbit_at(v).period)(jnp.asarray(v))
    assert abs(slope - (2 * gap / (v**2 + gap**2) - 2 * gap / v**2)) < 1e-12


@pytest.mark.slow
def test_quantities_and_monitors_of_cycles_on_a_belt_are_those_in_closed_form():
    """The slip is half a circle about the kinetic friction through the point at which the stick ends."""
    gap, kinetic = 0.4, 0.6
    friction = vx.Friction({0: 1.0}, kinetic, static=kinetic + gap, velocity=0.3)
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], friction=[friction])
    length = lambda sol: float(sol.t1 - sol.t0)  # noqa: E731
    names = ("max_position", "min_position", "max_velocity")
    branch = vx.continuation(
        vx.periodic_orbit(system, [0.0], [0.0]),
        "friction[0].velocity",
        (0.2, 0.5),
        quantities={name: name for name in names} | {"length": length},
        monitor={"slow": lambda sol: length(sol) - 7.5},
        progress=False,
    )
    speed, points = branch.values, branch.points
    size = np.hypot(gap, speed)
    for name, exact in zip(names, (kinetic + size, kinetic - size, speed), strict=True):
        np.testing.assert_allclose(np.squeeze(points[name]), exact, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(points["length"], points["period"])
    (zero,) = branch.special_points
    assert zero.kind == "monitor:slow"
    assert abs(2 * np.pi - 2 * np.arctan(gap / zero.value) + 2 * gap / zero.value - 7.5) < 1e-12


@pytest.mark.slow
def test_the_unstable_cycle_of_negative_damping_and_dry_friction_is_that_in_closed_form():
    """A half cycle takes the amplitude A to (A - F) q - F, q = exp(zeta pi / w)."""
    zeta, force = 0.05, 0.2
    w = np.sqrt(1 - zeta**2)
    q = np.exp(zeta * np.pi / w)
    amplitude = force * (1 + q) / (q - 1)
    system = vx.ImpactSystem([1.0], [[-2 * zeta]], [[1.0]], friction=[vx.Friction({0: 1.0}, force)])
    orbit = vx.periodic_orbit(system, [0.99 * amplitude], [0.0])
    assert abs(orbit.period - 2 * np.pi / w) < ROUNDING
    np.testing.assert_allclose(orbit.multipliers, [q * q, 1], rtol=0, atol=ROUNDING)
    assert not orbit.is_stable


@pytest.mark.slow
def test_stick_slip_ends_where_the_slip_just_reaches_the_belt():
    c, kinetic, static = 0.1, 0.6, 1.0
    friction = vx.Friction({0: 1.0}, kinetic, static=static, velocity=0.3)
    system = vx.ImpactSystem([1.0], [[c]], [[1.0]], friction=[friction])
    orbit = vx.periodic_orbit(system, [0.0], [0.0], max_events=64)
    branch = vx.continuation(orbit, "friction[0].velocity", (0.1, 3.0), progress=False)
    (end,) = branch.bifurcations
    assert end.kind == "grazing_sliding"

    w = np.sqrt(1 - c * c / 4)

    def touch(unknown):  # the slip reaches the belt's velocity without acceleration
        v, t = unknown
        y, rate = static - kinetic - c * v, v
        b = (rate + c / 2 * y) / w
        fade, cos, sin = np.exp(-c / 2 * t), np.cos(w * t), np.sin(w * t)
        x = fade * (y * cos + b * sin)
        speed = -c / 2 * x + fade * w * (b * cos - y * sin)
        return speed - v, x + c * v

    v = np.asarray(fsolve(touch, [0.44, 5.2], xtol=1e-12))[0]
    assert abs(end.value - v) < 1e-10


def test_what_has_no_cycle_says_so():
    damped = bouncing(damping=0.1)
    assert vx.periodic_orbit(damped, [0.5], [2.0], throw=False).result == vx.ORBIT_RESULTS.not_converged
    with pytest.raises(ValueError, match=r"outside of `jax.jit`"):
        jax.jit(lambda x: vx.periodic_orbit(bouncing(), x, [0.0]).period)(jnp.array([0.5]))
    orbit = vx.periodic_orbit(bouncing(), [0.5], [0.0])
    with pytest.raises(ValueError, match="nothing drives the machine"):
        vx.continuation(orbit, "forcing.frequency", (0.1, 1.0), progress=False)


@pytest.mark.slow
def test_a_cycle_fed_by_a_controller_repeats_in_an_independent_solver():
    """x'' + 0.05 x' + x = -0.6 z, z' = x - 0.5 z: the lag of the controller feeds the vibration, a stop bounds it."""
    mass = vx.ImpactSystem([1.0], [[0.05]], [[1.0]], stops=[vx.Stop(0, 1.0, "upper", 0.5)])
    system = vx.with_states(mass, [[-0.5]], [[-0.6]], of_positions=[[1.0]])
    orbit = vx.periodic_orbit(system, [0.5, 0.0], [0.0, 0.0])
    matrix = np.array([[0.0, 1.0, 0.0], [-1.0, -0.05, -0.6], [1.0, 0.0, -0.5]])
    start = np.array([orbit.x0[0], *orbit.v0])

    def gap(t, y):
        return 1 - y[0]

    gap.terminal, gap.direction = True, -1
    solver = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    first = solve_ivp(lambda t, y: matrix @ y, (0, 2 * orbit.period), start, events=gap, **solver)
    bounced = first.y[:, -1] * [1, -0.5, 1]
    last = solve_ivp(lambda t, y: matrix @ y, (first.t[-1], float(orbit.period)), bounced, **solver)
    assert abs(first.t[-1] - float(orbit.events.t[0])) < 1e-11
    np.testing.assert_allclose(last.y[:, -1], start, rtol=0, atol=1e-11)
