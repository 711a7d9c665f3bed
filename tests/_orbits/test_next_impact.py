"""The impact map: closed forms, the log of a trajectory, derivatives, multipliers, motions without a next impact."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exact_orbits import Table, exact_orbit
from shaken import two_masses

import vijax as vx

# Some hundred roundings of 1e-16; for derivatives, magnified by an impact or two.
ROUNDING, OF_DERIVATIVES = 1e-13, 1e-11
# Tolerances of steps, and the remainder of a transient.
SOLVER = 1e-8
# Error of a central difference of order 8.
DIFFERENCE = 1e-10
STENCIL = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
FLOW = vx.TaylorFlow()  # one program for all machines of one mass, fastest to compile

R, GRAVITY = 0.8, 10.0
BALL = vx.models.bouncing_ball(R, gravity=GRAVITY)


def packed(impact) -> jax.Array:
    """Time, positions and velocities in one vector."""
    t, x, v = impact
    return jnp.concatenate([t[None], x, v])


def mapped(system: vx.ImpactSystem, y: jax.Array, stop: int, num_impacts: int = 1, **options) -> jax.Array:
    """Impact map as a function of one vector."""
    n = system.num_masses
    return packed(vx.next_impact(system, y[0], y[1 : n + 1], y[n + 1 :], stop, num_impacts, **options))


def multipliers(jacobian: jax.Array) -> np.ndarray:
    """Eigenvalues without the smallest, which belongs to the position at the stop."""
    values = np.linalg.eigvals(np.asarray(jacobian))
    values = values[np.argsort(np.abs(values))]
    assert abs(values[0]) < ROUNDING
    return np.sort_complex(values[1:])


def difference(function, spacing: float) -> np.ndarray:
    """Central difference at 0."""
    steps = spacing * np.arange(1, len(STENCIL) + 1)
    terms = [
        w * (np.asarray(function(h)) - np.asarray(function(-h))) for w, h in zip(STENCIL, steps, strict=True)
    ]
    return sum(terms) / spacing


# Closed forms


@pytest.mark.parametrize("num_impacts", [1, 4])
@pytest.mark.slow
def test_a_ball_comes_back_after_its_time_of_flight_and_so_do_its_derivatives(num_impacts):
    start = jnp.array([0.3, 0.0, -5.0])
    shares = R ** np.arange(1, num_impacts + 1)
    of_times = 2 * shares.sum() / GRAVITY
    found = mapped(BALL, start, 0, num_impacts, flow=FLOW)
    np.testing.assert_allclose(found, [0.3 + 5.0 * of_times, 0.0, -5.0 * shares[-1]], rtol=0, atol=ROUNDING)
    slopes = jax.jacfwd(lambda y: mapped(BALL, y, 0, num_impacts, flow=FLOW))(start)
    expected = [[1.0, 0.0, -of_times], [0.0, 0.0, 0.0], [0.0, 0.0, shares[-1]]]
    np.testing.assert_allclose(slopes, expected, rtol=0, atol=ROUNDING)


def test_a_start_in_flight_comes_to_its_first_impact():
    t, x, v = vx.next_impact(BALL, 1.0, [0.2], [3.0], 0, flow=FLOW)
    speed = np.sqrt(9.0 + 2 * GRAVITY * 0.2)
    np.testing.assert_allclose([t, x[0], v[0]], [1.0 + (3.0 + speed) / GRAVITY, 0.0, -speed], atol=ROUNDING)


def test_a_mass_that_moves_out_has_had_its_impact():
    into = vx.next_impact(BALL, 0.3, [0.0], [-5.0], 0, flow=FLOW)
    out = vx.next_impact(BALL, 0.3, [0.0], [R * 5.0], 0, flow=FLOW)
    np.testing.assert_array_equal(packed(into), packed(out))


def test_a_plastic_impact_forgets_the_velocity():
    system, impact = machine(restitution=0.0), jnp.array([1.0, 1.0, 1.7])
    slopes = jax.jacfwd(lambda y: mapped(system, y, 0, flow=FLOW))(impact)
    np.testing.assert_array_equal(slopes[:, 1:], 0)
    assert np.abs(slopes[:, 0]).max() > 0.1


def machine(amplitude=1.0, restitution=0.8, frequency=1.0):
    load = vx.Harmonic([amplitude], frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 1.0, "upper", restitution)])


@pytest.mark.slow
def test_a_published_orbit_is_a_fixed_point_with_the_multipliers_of_the_stroboscopic_map():
    orbit = exact_orbit(0.1, 1.0, 1.0, 1.0, 1.0, 0.8, 2 * np.pi, 1)
    assert orbit.speed == pytest.approx(1.6957329375949, rel=1e-13)
    impact = jnp.array([orbit.angle, 1.0, orbit.speed])
    found = mapped(machine(), impact, 0, flow=FLOW)
    np.testing.assert_allclose(found - impact, [2 * np.pi, 0, 0], rtol=0, atol=ROUNDING)
    ours = multipliers(jax.jacfwd(lambda y: mapped(machine(), y, 0, flow=FLOW))(impact))
    np.testing.assert_allclose(ours, np.sort_complex(np.linalg.eigvals(orbit.step)), rtol=0, atol=ROUNDING)
    angle, (x, v) = orbit.start(2.0)
    strobe = vx.monodromy_matrix(machine(), [x], [v], phase=angle)
    np.testing.assert_allclose(
        ours, np.sort_complex(np.linalg.eigvals(np.asarray(strobe))), rtol=0, atol=OF_DERIVATIVES
    )


@pytest.mark.slow
def test_a_ball_on_a_moving_table_comes_back_after_a_period_of_the_table():
    table = Table(1, 0.8, 9.81, 0.6)
    system, span = table.system(0.0), 2 * np.pi / table.frequency
    height = table.amplitude * np.cos(table.angle)
    impact = jnp.array([table.angle / table.frequency, height, -table.fall])
    found = mapped(system, impact, 0, flow=FLOW)
    np.testing.assert_allclose(found - impact, [span, 0, 0], rtol=0, atol=ROUNDING)
    slopes = jax.jacfwd(lambda y: mapped(system, y, 0, flow=FLOW))(impact)
    # The ball leaves at u = (1 + r) y' - r v and returns later by D du / speed, D the time of flight.
    by_time, by_velocity = -(1 + table.restitution) * height * table.frequency**2, -table.restitution
    later = span / table.speed * np.array([by_time, by_velocity])
    expected = [np.add(later, [1, 0]), [by_time, by_velocity] - table.gravity * later]
    np.testing.assert_allclose(slopes[::2, ::2], expected, rtol=0, atol=OF_DERIVATIVES)
    # The table moves in that time, and the ball is on it at the impact.
    slope = -table.amplitude * table.frequency * np.sin(table.angle)
    np.testing.assert_allclose(slopes[1, ::2], slope * expected[0], rtol=0, atol=OF_DERIVATIVES)
    np.testing.assert_array_equal(slopes[:, 1], 0)


# Two masses and two stops, with all kinds of events between impacts

CHATTERING = vx.models.wagg_bishop_b(0.25)


@pytest.fixture(scope="module")
def chattering() -> vx.Solution:
    """Motion with impacts of both stops, complete chatter, sticking and release of both."""
    return vx.simulate(CHATTERING, 0.0, 45.0, max_events=256)


@pytest.mark.parametrize("stop", [0, 1])
def test_from_impact_to_impact_it_goes_through_the_log_of_a_trajectory(stop, chattering):
    log, mass = chattering.events, CHATTERING.stops[stop].mass
    kinds = np.asarray(log.kind[log.stop == stop])
    assert (kinds == vx.STICK).any()
    assert (kinds == vx.RELEASE).any()
    is_ours = np.asarray((log.stop == stop) & (log.kind == vx.IMPACT))
    impact, found = (0.0, np.zeros(2), np.zeros(2)), []
    for _ in range(is_ours.sum()):
        impact = vx.next_impact(CHATTERING, *impact, stop)
        found.append([impact[0], impact[2][mass]])
    expected = np.stack([log.t[is_ours], log.velocity_minus[is_ours]], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
    x, v = chattering.evaluate(expected[-1, 0])
    np.testing.assert_allclose(impact[1], x, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(impact[2][1 - mass], v[1 - mass], rtol=0, atol=ROUNDING)
    last = vx.next_impact(CHATTERING, 0.0, np.zeros(2), np.zeros(2), stop, len(found))
    np.testing.assert_allclose(packed(last), packed(impact), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_derivatives_go_through_chatter_sticking_and_release_at_another_stop(chattering):
    log, t0 = chattering.events, 20.0
    start = packed((jnp.asarray(t0), *chattering.evaluate(t0)))
    after = lambda y: mapped(CHATTERING, y, 0)  # noqa: E731
    is_between = np.asarray((log.t > t0) & (log.t < after(start)[0]) & (log.stop == 1))
    assert {*np.asarray(log.kind)[is_between].tolist()} == {vx.IMPACT, vx.STICK, vx.RELEASE}
    expected = [difference(lambda h, e=e: after(start + h * e), 1e-3) for e in np.eye(5)]
    np.testing.assert_allclose(jax.jacfwd(after)(start), np.transpose(expected), rtol=0, atol=DIFFERENCE)


@pytest.mark.slow
@pytest.mark.parametrize(("system", "stop"), [(vx.models.wagg_bishop_a(0.8), 1), (CHATTERING, 0)])
def test_on_a_periodic_orbit_its_multipliers_are_those_of_the_orbit(system, stop):
    settled = vx.simulate(system, 0.0, 100 * float(system.forcing.period), max_events=0, throw=False)
    orbit = vx.periodic_orbit(system, settled.x1, settled.v1)
    num_impacts = int(orbit.num_impacts[stop])
    impact = packed(vx.next_impact(system, 0.0, orbit.x0, orbit.v0, stop))
    found = mapped(system, impact, stop, num_impacts)
    np.testing.assert_allclose(found[0] - impact[0], orbit.period, rtol=0, atol=OF_DERIVATIVES)
    np.testing.assert_allclose(found[1:], impact[1:], rtol=0, atol=OF_DERIVATIVES)
    ours = np.linalg.eigvals(np.asarray(jax.jacfwd(lambda y: mapped(system, y, stop, num_impacts))(impact)))
    expected = np.append(np.asarray(orbit.multipliers), 0)
    np.testing.assert_allclose(np.sort_complex(ours), np.sort_complex(expected), rtol=0, atol=OF_DERIVATIVES)


# Motions without a next impact, and lanes


def test_a_motion_that_never_comes_back_is_told():
    response = machine(amplitude=0.05)
    for system, start in ((response, ([0.0], [0.0])), (BALL, ([0.0], [-1e-8]))):
        with pytest.raises(vx.SimulationError, match=r"comes to no such impact before `t1`: .*later `t1`"):
            vx.next_impact(system, 0.0, *start, 0, t1=40.0, flow=FLOW)
        found = vx.next_impact(system, 0.0, *start, 0, t1=40.0, flow=FLOW, throw=False)
        assert np.isnan(packed(found)).all()


def test_too_many_steps_are_told():
    with pytest.raises(vx.SimulationError, match="max_steps_reached: "):
        vx.next_impact(machine(), 0.0, [0.0], [0.0], 0, flow=FLOW, max_steps=2)


WRONG = {
    "stop": ({"stop": 1}, "Argument `stop` must be less than the number of stops, 1, but is 1"),
    "side of a stop": ({"stop": -1}, "Argument `stop` must be a whole number, 0 or more"),
    "no impact": ({"num_impacts": 0}, "Argument `num_impacts` must be a whole number, 1 or more"),
    "positions": ({"x0": [0.0, 0.0]}, r"Argument `x0` must have shape \(1,\), but has shape \(2,\)"),
    "times": ({"t0": np.zeros(2)}, r"Argument `t0` must have shape \(\), but has shape \(2,\)"),
    "beyond": ({"x0": [1.1]}, "The start lies beyond a stop: `x0\\[0\\]` is past `stops\\[0\\]`"),
    "an array": ({"t1": np.ones(2)}, r"Argument `t1` must have shape \(\), but has shape \(2,\)"),
    "before": ({"t1": -1.0}, "Argument `t1` must not lie before `t0`"),
    "endless": ({"t1": np.inf}, "Argument `t1` must be finite"),
    "steps back": (
        {"max_reverse_steps": 0},
        "Argument `max_reverse_steps` must be a whole number, 1 or more",
    ),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("throw", [True, False])
def test_wrong_arguments_are_refused(name, throw):
    wrong, sentence = WRONG[name]
    asked = {"t0": 0.0, "x0": [0.0], "v0": [0.0], "stop": 0} | wrong
    with pytest.raises(ValueError, match=sentence):
        vx.next_impact(machine(), **asked, throw=throw)


def test_without_a_frequency_one_says_how_long_to_wait():
    ball = vx.models.bouncing_ball(R, gravity=GRAVITY, frequency=0.0)
    with pytest.raises(ValueError, match="The load has no frequency: say by `t1` how long to wait"):
        vx.next_impact(ball, 0.3, [0.0], [-5.0], 0)
    found = mapped(ball, jnp.array([0.3, 0.0, -5.0]), 0, 2, t1=10.0, flow=FLOW)
    np.testing.assert_allclose(found, [0.3 + (R + R**2), 0.0, -5.0 * R**2], rtol=0, atol=ROUNDING)


# One lane has no next impact, one takes more steps than allowed, one starts beyond the stop, one at NaN.
STARTS = jnp.array([0.9, 0.2, 0.0, 1.5, jnp.nan, 0.3])
AMPLITUDES = jnp.array([1.0, 0.05, 1.0, 1.0, 1.0, 0.9])
BOUNDS = jnp.array([1000, 1000, 3, 1000, 1000, 1000])
IS_KNOWN = np.array([True, False, False, False, False, True])
LANES = STARTS, AMPLITUDES, BOUNDS
SOUND = tuple(jnp.where(IS_KNOWN, a, a[0]) for a in LANES)


def arrival(x0, amplitude, bound, restitution):
    names = lambda s: (s.forcing.amplitude, s.stops[0].restitution)  # noqa: E731
    system = eqx.tree_at(names, machine(), (amplitude[None], restitution))
    options = {"t1": 30.0, "flow": FLOW, "max_steps": bound, "throw": False}
    return packed(vx.next_impact(system, 0.1, x0[None], [0.5], 0, 2, **options))


def total(restitution, lanes):
    """Sum over the lanes that have a next impact."""
    found = jax.vmap(arrival, (0, 0, 0, None))(*lanes, restitution)
    return jnp.where(IS_KNOWN[:, None], found, 0).sum(), found


@pytest.mark.slow
def test_what_never_comes_back_is_nan_in_its_lane_alone():
    slopes = jax.jit(lambda *a: (total(*a)[1], jax.jacfwd(lambda r: total(r, *a[1:]))(a[0])))
    found, (of_total, of_lanes) = slopes(R, LANES)
    expected, (of_sound_total, of_sound_lanes) = slopes(R, SOUND)
    for ours, theirs in ((found, expected), (of_lanes, of_sound_lanes)):
        assert (np.isnan(ours) == ~IS_KNOWN[:, None]).all()
        np.testing.assert_allclose(ours[IS_KNOWN], theirs[IS_KNOWN], rtol=ROUNDING)
    np.testing.assert_allclose(of_total, of_sound_total, rtol=ROUNDING)
    assert abs(of_total) > 0.1


def test_under_jit_it_is_told_by_any_lane():
    run = jax.jit(
        jax.vmap(lambda x0: vx.next_impact(machine(0.05), 0.1, x0[None], [0.5], 0, t1=30.0, flow=FLOW)[0])
    )
    assert np.isfinite(run(jnp.array([0.9, 0.95]))).all()
    for wrong, sentence in (
        (0.0, "comes to no such impact before `t1`"),
        (1.5, "The start lies beyond a stop"),
    ):
        with pytest.raises((RuntimeError, ValueError), match=sentence):
            jax.block_until_ready(run(jnp.array([0.9, wrong])))


@pytest.mark.slow
def test_backwards_derivatives_are_those_forwards_and_lanes_that_are_left_out_spoil_none():
    slopes = jax.jit(jax.grad(lambda *a: total(*a)[0], (0, 1), allow_int=True))
    by_restitution, (by_start, by_amplitude, _) = slopes(R, LANES)
    forwards = jax.jit(jax.jacfwd(lambda r: total(r, SOUND)[0]))(R)
    np.testing.assert_allclose(by_restitution, forwards, rtol=OF_DERIVATIVES)
    assert (by_start == 0).tolist() == (by_amplitude == 0).tolist() == (~IS_KNOWN).tolist()
    of_lanes = jax.vmap(jax.grad(lambda *a: arrival(*a).sum(), (0, 1, 3)), (0, 0, 0, None))(*LANES, R)
    assert all((np.isnan(slope) == ~IS_KNOWN).all() for slope in of_lanes)
    np.testing.assert_allclose(of_lanes[0][IS_KNOWN], by_start[IS_KNOWN], rtol=OF_DERIVATIVES)


@pytest.mark.slow
def test_in_a_shaken_slot_it_goes_through_the_log_of_a_trajectory():
    system = two_masses()
    sol = vx.simulate(system, 0.0, 20.0)
    for stop in (1, 2):
        is_ours = (sol.events.stop == stop) & (sol.events.kind == vx.IMPACT)
        expected = np.stack([sol.events.t[is_ours], sol.events.velocity_minus[is_ours]], axis=1)
        impact, found = (0.0, np.zeros(2), np.zeros(2)), []
        for _ in expected:
            impact = vx.next_impact(system, *impact, stop)
            found.append([impact[0], impact[2][1]])
        assert len(found) > 3
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_of_a_machine_with_a_force_it_has_the_multipliers_of_the_stroboscopic_map():
    system = vx.models.duffing_oscillator(1.5, damping=0.1, cubic_stiffness=0.5)
    sol = vx.simulate(system, 0.0, 60 * float(system.forcing.period), max_events=0, throw=False)
    impact = packed(vx.next_impact(system, 0.0, sol.x1, sol.v1, 0))
    found = mapped(system, impact, 0)
    np.testing.assert_allclose(found - impact, [float(system.forcing.period), 0, 0], rtol=0, atol=SOLVER)
    ours = multipliers(jax.jacfwd(lambda y: mapped(system, y, 0))(impact))
    strobe = np.linalg.eigvals(np.asarray(vx.monodromy_matrix(system, sol.x1, sol.v1)))
    np.testing.assert_allclose(ours, np.sort_complex(strobe), rtol=0, atol=SOLVER)


@pytest.mark.thorough
def test_a_slider_starts_where_it_does_in_simulate():
    """From 0 at the speed 2 on a spring of 4 up to its limit 1 at x = .25, then against the force 1 up to the stop at .6."""
    stop, joint = vx.Stop(0, 0.6, "upper", 0.7), vx.Jenkins(0, 4.0, 1.0)
    still = vx.Harmonic([0.0], 1.0)
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], still, [stop], hysteresis=[joint])
    speed = np.sqrt(4.0 - 0.25)
    expected = np.arcsin(0.25) / 2 + speed - np.sqrt(speed**2 - 0.7)
    for t, x, v in (
        vx.next_impact(system, 0.0, [0.0], [2.0], stop=0, t1=9.0),
        vx.next_crossing(system, 0.0, [0.0], [2.0], mass=0, position=0.6 - 1e-15, t1=9.0),
    ):
        assert float(t) == pytest.approx(expected, rel=1e-13)
        assert x.shape == v.shape == (2,)
        assert float(v[0]) == pytest.approx(np.sqrt(speed**2 - 0.7), rel=1e-13)
