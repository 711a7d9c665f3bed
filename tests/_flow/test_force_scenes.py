"""Forces held against other codes: tables in position, friction by tanh, units, a linear machine written as a force."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

import vijax as vx

pytestmark = pytest.mark.thorough

POINTS = np.linspace(-2, 2, 9)
VALUES = POINTS + 0.3 * POINTS**3


def table(t, x, v, args):
    return -jnp.interp(x, POINTS, VALUES)


def _rates(t, y, known, slope):
    spring = 0.3 * y[0] + VALUES[known] + slope * (y[0] - POINTS[known])
    return [y[1], 0.8 * np.cos(1.1 * t) - 0.1 * y[1] - spring]


def between_knots(start, span):
    """End of the motion under the table by steps that end at its knots."""
    t, y = 0.0, np.array(start)
    slopes = np.concatenate([[0.0], np.diff(VALUES) / np.diff(POINTS), [0.0]])
    events = [lambda t, y, p=p: y[0] - p for p in POINTS]
    for event in events:
        event.terminal = True
    while t < span:
        x, v = y
        at = np.flatnonzero(np.abs(POINTS - x) < 1e-9)
        is_right = v > 0 if v else 0.8 * np.cos(1.1 * t) - 0.3 * x - np.interp(x, POINTS, VALUES) > 0
        piece = at[0] + is_right if len(at) else np.searchsorted(POINTS, x)
        rates = partial(_rates, known=max(piece - 1, 0), slope=slopes[piece])
        for k, event in enumerate(events):  # from a knot back to it alone
            event.direction = 0 if k not in at else -1 if is_right else 1
        run = scipy.integrate.solve_ivp(
            rates, (t, span), y, "DOP853", events=events, rtol=1e-13, atol=1e-14, max_step=0.05
        )
        t, y = run.t[-1], run.y[:, -1]
    return y


def test_tables_in_position_have_the_motion_between_their_knots():
    machine = vx.ImpactSystem([1.0], [[0.1]], [[0.3]], vx.Harmonic([0.8], 1.1), [], force=table)
    starts = np.array([[0.2, 0.3], [0.0, 0.0], [1.0, 0.5], [-0.5, -1.2], [2.3, 0.0], [-1.7, 2.0]])
    found = jax.vmap(lambda z: vx.simulate(machine, 0.0, 9.0, z[:1], z[1:]))(starts)
    ends = np.concatenate([found.x1, found.v1], axis=1)
    for start, end in zip(starts, ends, strict=True):
        np.testing.assert_allclose(end, between_knots(start, 9.0), rtol=0, atol=1e-10)


def sliding(t, x, v, args):
    force, width = args
    return -force * jnp.tanh(v / width)


def sliding_machine(length, time, mass):
    """Oscillator with friction by tanh and a stop in other units, and its arguments."""
    load = vx.Harmonic([0.9 * mass * length / time**2], 1.1 / time)
    machine = vx.ImpactSystem(
        [mass],
        [[0.05 * mass / time]],
        [[mass / time**2]],
        load,
        [vx.Stop(0, 0.7 * length, "upper", 0.8)],
        force=sliding,
    )
    return machine, (0.2 * mass * length / time**2, 0.003 * length / time)


def test_friction_by_tanh_scales_with_the_units():
    machine, args = sliding_machine(1.0, 1.0, 1.0)
    own = vx.simulate(machine, 0.0, 30.0, [0.2], [0.1], args=args)
    count = int(own.num_events)
    assert count > 3
    for length, time, mass in ((3.0, 1 / 7, 1e3), (1e-6, 1e3, 1 / 7), (1e3, 3.0, 1e-6)):
        machine, args = sliding_machine(length, time, mass)
        other = vx.simulate(machine, 0.0, 30.0 * time, [0.2 * length], [0.1 * length / time], args=args)
        assert int(other.num_events) == count
        np.testing.assert_allclose(other.events.t[:count] / time, own.events.t[:count], rtol=1e-12)
        np.testing.assert_allclose(other.x1 / length, own.x1, rtol=0, atol=1e-11)
        np.testing.assert_allclose(other.v1 / length * time, own.v1, rtol=0, atol=1e-11)


def spring(t, x, v, args):
    return -args @ x


def two_masses(*, has_force):
    whole, part = np.array([[2.0, -1.0], [-1.0, 2.0]]), np.array([[0.7, -0.2], [-0.2, 0.5]])
    load, stops = (
        vx.Harmonic([0.6, 0.2], 0.8),
        [vx.Stop(0, 0.3, "upper", 0.7), vx.Stop(1, -0.5, "lower", 0.9)],
    )
    stiffness = whole - part if has_force else whole
    own = vx.ImpactSystem(
        [1.0, 1.5], 0.05 * np.eye(2), stiffness, load, stops, force=spring if has_force else None
    )
    return own, (part if has_force else None)


@pytest.mark.slow
def test_derivatives_of_lanes_of_a_spring_written_as_a_force_are_those_of_the_spring():
    starts = jnp.array([[0.1, 0.2, 0.3, -0.4], [-0.3, 0.1, 0.5, 0.2], [0.0, 0.0, 1.0, -1.0]])
    found = []
    for has_force in (True, False):
        machine, args = two_masses(has_force=has_force)

        def end(z, machine=machine, args=args):
            run = vx.simulate(machine, 0.0, 12.0, z[:2], z[2:], args=args)
            return jnp.concatenate([run.x1, run.v1])

        found.append(jax.jit(jax.vmap(jax.jacfwd(end)))(starts))
    assert np.abs(found[1]).max() > 1
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-10)
