"""Moving stops, against closed forms, machines in the frame of the stop, and an independent integration."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from shaken import GRAVITY, MAGNIFIED, A, R, W, ball, seen_from_the_table, table, two_masses

import vijax as vx

# Rounding of 1e-16 in some hundred steps, and of the phase W t at t of some ten.
EXACT = 2e-14
# DOP853 at rtol 1e-13, its events located by Brent's method in the dense output of a step.
INTEGRATED = 2e-10
# Error of derivatives of bounces, each of which magnifies rounding.
DERIVATIVES = 1e-12


@pytest.fixture(scope="module")
def both():
    """A trajectory with impacts, chatter, sticking and release, in the fixed frame and in that of the table."""
    x, v = table(0.0)
    start = [1.0], [0.5]
    from_table = [1.0 - x], [0.5 - v]
    one = vx.simulate(ball(), 0.0, 30.0, *start)
    return one, vx.simulate(seen_from_the_table(), 0.0, 30.0, *from_table)


@pytest.mark.thorough
def test_a_ball_moves_in_space_as_it_does_seen_from_the_table(both):
    space, relative = both
    kinds = np.asarray(relative.events.kind)
    assert {vx.IMPACT, vx.STICK, vx.RELEASE} <= set(kinds.tolist())
    np.testing.assert_array_equal(space.events.kind, kinds)
    np.testing.assert_allclose(space.events.t, relative.events.t, rtol=0, atol=EXACT)
    np.testing.assert_allclose(space.events.impulse, relative.events.impulse, rtol=0, atol=EXACT)
    t = np.linspace(0.0, 30.0, 601)
    for own, other, stop in zip(space.evaluate(t), relative.evaluate(t), table(t), strict=True):
        np.testing.assert_allclose(own[:, 0], other[:, 0] + stop, rtol=0, atol=MAGNIFIED)


def test_velocities_of_events_are_those_in_space_and_a_held_mass_moves_with_its_stop(both):
    space, relative = both
    _, speed = table(space.events.t)
    for name in ("velocity_minus", "velocity_plus"):
        expected = getattr(relative.events, name) + speed
        np.testing.assert_allclose(getattr(space.events, name), expected, rtol=0, atol=MAGNIFIED)


def test_a_solution_tells_where_its_stops_are(both):
    space, relative = both
    t = np.linspace(0.0, 30.0, 8).reshape(2, 4)
    for found, expected in zip(space.evaluate_stops(t), table(t), strict=True):
        np.testing.assert_allclose(found[..., 0], expected, rtol=0, atol=EXACT)
    assert not np.any(relative.evaluate_stops(t))


def test_the_contact_force_of_a_moving_stop_is_the_weight_and_the_inertia():
    t = np.linspace(0.0, 2.0, 9)
    x, v = table(0.0, amplitude=0.1)
    solution = vx.simulate(ball(0.1, mass=1.5), 0.0, 2.0, [x], [v])
    assert solution.num_events == 0
    inertia = -(W**2) * table(t, amplitude=0.1)[0]
    np.testing.assert_allclose(solution.contact_force(t)[:, 0], 1.5 * (GRAVITY + inertia), rtol=EXACT)


def test_a_ball_is_thrown_off_where_the_table_falls_faster_than_it():
    phase = -np.pi / 2  # y = A sin(W t)
    solution = vx.simulate(ball(A, phase=phase), 0.0, 1.5, [0.0], [A * W])
    release = np.arcsin(GRAVITY / (A * W**2)) / W
    assert solution.events.kind[0] == vx.RELEASE
    assert float(solution.events.t[0]) == pytest.approx(release, abs=EXACT)
    x, v = A * np.sin(W * release), A * W * np.cos(W * release)

    def gap(t):
        s = t - release
        return x + v * s - GRAVITY * s**2 / 2 - A * np.sin(W * t)

    assert solution.events.kind[1] == vx.IMPACT
    impact = brentq(gap, release + 0.1, 1.5, xtol=1e-15, rtol=1e-15)
    assert float(solution.events.t[1]) == pytest.approx(impact, abs=MAGNIFIED)
    velocity = v - GRAVITY * (impact - release)
    assert float(solution.events.velocity_minus[1]) == pytest.approx(velocity, abs=MAGNIFIED)


@pytest.mark.slow
def test_a_held_mass_is_held_where_a_late_trajectory_goes_on():
    whole = vx.simulate(ball(), 0.0, 302.0, [1.0], [0.5], max_events=4096)
    last = int(whole.num_events) - 1
    kinds, times = np.asarray(whole.events.kind), np.asarray(whole.events.t)
    stick = max(k for k in range(last) if kinds[k] == vx.STICK)
    assert kinds[stick + 1] == vx.RELEASE
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        t = times[stick] + share * (times[stick + 1] - times[stick])
        x, v = whole.evaluate(t)
        on = vx.simulate(ball(), t, t + 1.0, x, v)
        assert on.events.kind[0] == vx.RELEASE
        assert float(on.events.t[0]) == pytest.approx(times[stick + 1], abs=2 * np.spacing(W * t))


# Two masses, the second between walls that are shaken by two harmonics


def integrated(until):
    """State and impacts of the two masses by a general solver, in the fixed frame."""
    m, c, k = (np.asarray(a) for a in (two_masses().mass, two_masses().damping, two_masses().stiffness))

    def wall(t, derivative=0):
        turn = derivative * np.pi / 2
        return sum(
            a * (h * 1.3) ** derivative * np.cos(h * 1.3 * t + p + turn)
            for h, a, p in ((1, 0.1, 0.2), (2, 0.04, 1.0))
        ) + (0.02 if derivative == 0 else 0)

    def field(t, y):
        load = np.array([0.5 * np.cos(1.3 * t), 0.0])
        return np.concatenate([y[2:], (load - c @ y[2:] - k @ y[:2]) / m])

    events = [
        lambda t, y: 0.4 - y[0],
        lambda t, y: 0.25 + wall(t) - y[1],
        lambda t, y: y[1] + 0.35 - wall(t),
    ]
    for event in events:
        event.terminal, event.direction = True, -1
    t, y, impacts = 0.0, np.zeros(4), []
    while True:
        part = solve_ivp(field, (t, until), y, "DOP853", events=events, rtol=1e-13, atol=1e-14)
        t, y = part.t[-1], part.y[:, -1]
        if part.status == 0:
            return y, np.array(impacts)
        j = next(j for j, times in enumerate(part.t_events) if len(times))
        i, r, speed = [(2, 0.7, 0.0), (3, 0.6, wall(t, 1)), (3, 0.8, wall(t, 1))][j]
        impacts.append((t, j, y[i]))
        y[i] = -r * y[i] + (1 + r) * speed


@pytest.mark.thorough
def test_two_masses_and_shaken_walls_agree_with_a_general_solver():
    y, impacts = integrated(25.0)
    solution = vx.simulate(two_masses(), 0.0, 25.0)
    log = solution.events
    assert solution.num_events == len(impacts) > 15
    assert len(set(impacts[:, 1])) == 3
    n = len(impacts)
    np.testing.assert_array_equal(log.stop[:n], impacts[:, 1])
    np.testing.assert_allclose(log.t[:n], impacts[:, 0], rtol=0, atol=INTEGRATED)
    np.testing.assert_allclose(log.velocity_minus[:n], impacts[:, 2], rtol=0, atol=INTEGRATED)
    np.testing.assert_allclose(jnp.concatenate([solution.x1, solution.v1]), y, rtol=0, atol=INTEGRATED)


@pytest.mark.slow
def test_a_force_beside_the_springs_is_one_of_positions_and_velocities_in_space():
    exact = vx.simulate(two_masses(), 0.0, 10.0)
    k, c = jnp.asarray([0.5, 0.3]), 0.02
    soft = two_masses(force=lambda t, x, v, args: k * x + c * v - args * jnp.cos(1.3 * t))
    stiff = eqx.tree_at(
        lambda s: (s.stiffness, s.damping, s.forcing.amplitude),
        soft,
        (soft.stiffness + jnp.diag(k), soft.damping + c * jnp.eye(2), soft.forcing.amplitude + 0.1),
    )
    solution = vx.simulate(stiff, 0.0, 10.0, args=0.1)
    np.testing.assert_array_equal(solution.events.stop, exact.events.stop)
    np.testing.assert_allclose(solution.events.t, exact.events.t, rtol=0, atol=INTEGRATED)
    np.testing.assert_allclose(solution.v1, exact.v1, rtol=0, atol=INTEGRATED)


# Derivatives


PARAMETERS = {"amplitude": A, "frequency": W, "phase": 0.3, "restitution": R}


@pytest.fixture(scope="module")
def derivatives():
    """Derivatives of the end state in the fixed frame by parameters of the motion, computed in both frames."""

    def in_space(p):
        solution = vx.simulate(ball(**p), 0.0, 3.0, [1.0], [0.5])
        return jnp.concatenate([solution.x1, solution.v1])

    def from_table(p):
        motion = {name: p[name] for name in ("amplitude", "frequency", "phase")}
        (x, v), (x1, v1) = table(0.0, **motion), table(3.0, **motion)
        solution = vx.simulate(seen_from_the_table(**p), 0.0, 3.0, [1.0 - x], [0.5 - v])
        return jnp.concatenate([solution.x1 + x1, solution.v1 + v1])

    p = jax.tree.map(jnp.asarray, PARAMETERS)
    return jax.jacfwd(in_space)(p), jax.jacfwd(from_table)(p)


@pytest.mark.slow
@pytest.mark.parametrize("name", PARAMETERS)
def test_derivatives_are_those_seen_from_the_table(derivatives, name):
    found, expected = (each[name] for each in derivatives)
    assert np.abs(expected).max() > 1e-2
    np.testing.assert_allclose(found, expected, rtol=DERIVATIVES, atol=DERIVATIVES)


@pytest.mark.slow
def test_one_frequency_drives_load_and_stops(derivatives):
    def end(w):
        system = eqx.tree_at(lambda s: s.forcing.frequency, ball(), w)
        solution = vx.simulate(system, 0.0, 3.0, [1.0], [0.5])
        return jnp.concatenate([solution.x1, solution.v1])

    found = jax.jacfwd(end)(jnp.asarray(W))
    np.testing.assert_allclose(found, derivatives[0]["frequency"], rtol=DERIVATIVES)


def test_the_saltation_matrix_of_a_moving_stop_is_that_seen_from_it():
    x, v = table(0.7)
    found = vx.saltation_matrix(ball(), 0.7, [x], [-0.4], 0)
    expected = vx.saltation_matrix(seen_from_the_table(), 0.7, [0.0], [-0.4 - v], 0)
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_the_sticking_region_is_left_where_the_ball_is_thrown_off():
    region = vx.sticking_region(ball(phase=-np.pi / 2), held=0)
    angle = np.arcsin(GRAVITY / (A * W**2))
    nothing = np.zeros((2, 0))
    force = region.contact_force([angle, 0.0], nothing, nothing)
    np.testing.assert_allclose(force[:, 0], [0, GRAVITY], rtol=0, atol=EXACT)
    assert region.contains([angle - 1e-6, angle + 1e-6], nothing, nothing).tolist() == [True, False]


# Refused arguments


def test_a_motion_of_another_frequency_than_the_load_is_refused():
    stop = vx.Stop(0, 0.0, "lower", 0.5, vx.Harmonic([0.1], 2.0))
    with pytest.raises(ValueError, match=r"`stops\[0\].motion` must be that of the load"):
        vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([1.0], 3.0), [stop])

    def frequency(w):
        load = vx.Harmonic([1.0], 3.0)
        stop = vx.Stop(0, 0.0, "lower", 0.5, vx.Harmonic([0.1], w))
        return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [stop]).forcing.frequency

    build = eqx.filter_jit(frequency)
    assert float(build(jnp.asarray(3.0))) == 3.0
    # JAX turns an error inside `jit` into a RuntimeError or a ValueError, depending on the version.
    with pytest.raises((RuntimeError, ValueError), match="must be that of the load"):
        build(jnp.asarray(2.0))


def test_a_frequency_that_a_motion_is_given_later_is_refused_too():
    load, stop = vx.Harmonic([1.0], 3.0), vx.Stop(0, 0.0, "lower", 0.5, vx.Harmonic([0.1], 3.0))
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [stop])
    other = eqx.tree_at(lambda s: s.stops[0].motion, system, vx.Harmonic([0.1], 5.0))
    for run in (lambda: vx.simulate(other, 0.0, 1.0, [1.0]), lambda: vx.sweep(other, {"x0[0]": [1.0]})):
        with pytest.raises(ValueError, match=r"`stops\[0\].motion` must be that of the load"):
            run()
    with pytest.raises(ValueError, match=r"ask for `forcing.period` of the machine"):
        _ = system.stops[0].motion.period


def test_two_stops_of_one_mass_that_move_alike_are_a_slot_and_others_are_not():
    load, walls = vx.Harmonic([1.0], 3.0), []
    for motion in (None, vx.Harmonic([0.1], 3.0), vx.Harmonic([0.2], 3.0), vx.Harmonic([[0.1], [0.2]], 3.0)):
        walls.append([vx.Stop(0, -0.5, "lower", 0.5, motion), vx.Stop(0, 0.5, "upper", 0.5, motion)])
    for one, other in pairwise(walls):
        assert vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [one[0], other[1]]).is_coupled
    slot = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, walls[1])
    same = [walls[1][0], vx.Stop(0, 0.5, "upper", 0.5, vx.Harmonic([[0.1]], 3.0))]
    assert not slot.is_coupled
    assert not vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, same).is_coupled


def test_a_motion_is_that_of_one_stop():
    with pytest.raises(ValueError, match="Argument `motion` must move one stop"):
        vx.Stop(0, 0.0, "lower", 0.5, vx.Harmonic([0.1, 0.2], 2.0))
    with pytest.raises(ValueError, match=r"Argument `amplitude` must be a number, but has shape \(1,\)"):
        vx.models.ball_on_table(6.0, np.array([0.1]))


def test_a_start_beyond_a_moving_stop_is_refused():
    x, _ = table(0.0)
    with pytest.raises(ValueError, match="The start lies beyond a stop"):
        vx.simulate(ball(), 0.0, 1.0, [x - 1e-6])
    with pytest.raises(ValueError, match="Some points start beyond a stop"):
        vx.sweep(ball(), {"forcing.frequency": [1.0, 2.0]}, x0=[x - 1e-6], progress=False)
    x, _ = table(0.4)
    with pytest.raises(ValueError, match="The start lies beyond a stop"):
        vx.simulate(ball(), 0.4, 1.0, [x - 1e-6])


@pytest.mark.slow
def test_a_stop_may_shake_at_the_natural_frequency_of_its_mass():
    """The free motion x = x0 cos(2 W t) of an undamped mass whose stop moves at 2 W, out of its reach."""
    wall = vx.Stop(0, 1.0, "upper", 0.7, vx.Harmonic([[0.0], [0.1]], W))
    natural = 2 * W
    system = vx.ImpactSystem([1.0], [[0.0]], [[natural**2]], vx.Harmonic([0.0], W), [wall])
    t = np.linspace(0.0, 4.0, 9)
    solution = vx.simulate(system, 0.0, 4.0, [0.5], ts=t)
    np.testing.assert_allclose(solution.xs[:, 0], 0.5 * np.cos(natural * t), rtol=0, atol=MAGNIFIED)
    ds = vx.sweep(system, {"x0[0]": [0.5, 0.25]}, transient=0, record=3, progress=False)
    np.testing.assert_allclose(ds.x[:, 0], ds["x0[0]"], rtol=0, atol=MAGNIFIED)
    # Velocities are larger by the natural frequency.
    np.testing.assert_allclose(ds.v[:, 0], 0.0, rtol=0, atol=natural * MAGNIFIED)


@pytest.mark.slow
def test_derivatives_by_the_state_between_stops_that_move_alike():
    """Whether the stops move alike is known outside of the derivatives only."""
    stops = [
        vx.Stop(0, side * 0.3, name, 0.7, vx.Harmonic([0.1], 1.0))
        for side, name in ((1, "upper"), (-1, "lower"))
    ]
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.5], 1.0), stops)
    matrix, h = vx.monodromy_matrix(system, [0.0], [0.3]), 1e-5
    end = lambda x, v: np.concatenate(vx.stroboscopic_map(system, [x], [v]))  # noqa: E731
    differences = [(end(h, 0.3) - end(-h, 0.3)) / (2 * h), (end(0.0, 0.3 + h) - end(0.0, 0.3 - h)) / (2 * h)]
    np.testing.assert_allclose(matrix, np.transpose(differences), rtol=1e-6, atol=1e-6)
