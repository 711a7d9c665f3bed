"""Machines with a force by Taylor series: golden scenes, each rule of the steps, derivatives, units, what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.special
from analytic_scenes import NAMES, args_of, errors, machine_of, scene

import vijax as vx
from vijax._flow import force_choice, force_flow
from vijax._flow.choose import choose_flow
from vijax._flow.diffrax_flow import DiffraxFlow
from vijax._flow.series_length import motion_limit
from vijax._machine.first_state import state_before_contact
from vijax._machine.numbers import numbers_of
from vijax._machine.preparation import prepare
from vijax._system.system import bound

pytestmark = pytest.mark.thorough

# Compiled in every run of the thorough tests; the others belong to the long runs.
_OFTEN = ("drag_two", "duffing_stop", "quake_table")


@pytest.mark.parametrize(
    "name", [name if name in _OFTEN else pytest.param(name, marks=pytest.mark.slow) for name in NAMES]
)
def test_golden_scenes_are_met_to_rounding(name):
    given = scene(name)
    solution = vx.simulate(
        machine_of(given), given["t0"], given["t1"], given["x0"], given["v0"], args=args_of(given)
    )
    end, times = errors(given, solution)
    assert end < 1e-12
    assert times < 1e-12


def pendulum(t, x, v, args):
    return -jnp.sin(x)


def flow_map_of(force, span, *, stiffness=0.0, damping=0.0):
    """End of a smooth motion as a function of its start, by steps in one compiled loop."""
    system = bound(vx.ImpactSystem([1.0], [[damping]], [[stiffness]], None, [], force=force), None)
    flow = choose_flow(system, can_stick=False)
    numbers = numbers_of(system)

    def end(z):
        machine = prepare(numbers, jnp.asarray(span), (jnp.zeros(()), z[:1], z[1:]), can_stick=False)
        none = jnp.zeros(0, bool)
        state = state_before_contact(machine, machine.phase_at_start(jnp.zeros(())), z[:1], z[1:], none)
        moved = flow.flow_map(machine, state, machine.hold(none), jnp.asarray(span), 0 * state.phase)
        return z + jnp.concatenate(moved)

    return end


def without_second_rule(machine, x, by_x, by_v, tolerance, *, has_powers):
    del by_x, by_v, has_powers
    return jnp.minimum(motion_limit(machine, x, tolerance), 1e3 * machine.timescale)


def test_derivatives_at_rest_need_the_bound_of_neighbours(monkeypatch):
    span, rest = 4 * np.pi, jnp.zeros(2)
    right = scipy.linalg.expm(span * np.array([[0.0, 1.0], [-1.0, -0.1]]))
    found = jax.jacfwd(flow_map_of(pendulum, span, damping=0.1))(rest)
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-13)
    monkeypatch.setattr(force_flow, "_limit", without_second_rule)
    wrong = jax.jacfwd(flow_map_of(lambda t, x, v, args: -jnp.sin(x), span, damping=0.1))(rest)
    assert not np.abs(wrong - right).max() < 1


def test_a_sleeping_exponential_needs_its_bound_or_the_check_at_the_end_of_a_step(monkeypatch):
    wall = lambda t, x, v, args: -jnp.exp(200 * (x - 1))  # noqa: E731
    start = jnp.array([0.0, 1.0])

    def energy(z):
        return z[1] ** 2 / 2 + jnp.exp(200 * (z[0] - 1)) / 200

    lost = lambda force: float(energy(flow_map_of(force, 3.0)(start)) - energy(start))  # noqa: E731
    assert abs(lost(wall)) < 1e-11
    monkeypatch.setattr(force_flow, "_bounded", lambda *args: args[4])
    assert abs(lost(lambda t, x, v, args: wall(t, x, v, args))) < 1e-11
    monkeypatch.setattr(force_flow, "_consistent", lambda *args: args[6])
    assert not abs(lost(lambda t, x, v, args: -jnp.exp(200 * (x - 1)))) < 1e-6


def jumps(t, x, v, args):
    return -0.7 * jnp.where(x > args["place"], 1.0, 0.0) + 0.3 * jnp.where(t > args["time"], 1.0, 0.0)


def test_derivatives_pass_jumps_of_a_force_in_place_and_in_time():
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.5], 0.9), [], force=jumps)
    numbers, h = {"place": 0.11, "time": 3.3}, 1e-4
    end = lambda args: vx.simulate(machine, 0.0, 12.0, args=args).x1[0]  # noqa: E731
    found = jax.grad(end)(numbers)
    for name in numbers:
        at = lambda k, name=name: float(end(numbers | {name: numbers[name] + k * h}))  # noqa: E731
        differences = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)
        np.testing.assert_allclose(found[name], differences, rtol=1e-9)


def scaled(length: float, time: float, mass: float) -> vx.ImpactSystem:
    """Driven Duffing oscillator with a stop in other units."""
    force = mass * length / time**2
    return vx.ImpactSystem(
        [mass],
        [[0.1 * mass / time]],
        [[mass / time**2]],
        vx.Harmonic([0.5 * force], 0.9 / time),
        [vx.Stop(0, 0.3 * length, "upper", 0.8)],
        force=cubic,
    )


def cubic(t, x, v, args):
    return -args * x**3


def test_results_scale_with_the_units():
    own = vx.simulate(scaled(1.0, 1.0, 1.0), 0.0, 25.0, args=1.0)
    length, time, mass = 1e-6, 1e-3, 1e4
    other = vx.simulate(scaled(length, time, mass), 0.0, 25.0 * time, args=mass / (time * length) ** 2)
    assert int(own.num_events) == int(other.num_events) > 3
    count = int(own.num_events)
    np.testing.assert_allclose(other.events.t[:count] / time, own.events.t[:count], rtol=1e-12)
    np.testing.assert_allclose(other.x1 / length, own.x1, rtol=1e-11)


BESIDE = {
    "friction": {"friction": [vx.Friction(0, 0.2)]},
    "compliant": {"stops": [vx.CompliantStop(0, 0.3, "upper", 20.0, 0.1)]},
    "both": {"stops": [vx.Stop(0, 0.3, "upper", 0.7)], "friction": [vx.Friction(0, 0.1)]},
    "sticking": {"stops": [vx.Stop(0, 0.5, "upper", 0.5)]},
    "moving": {"stops": [vx.Stop(0, 0.4, "upper", 0.6, motion=vx.Harmonic([0.1], 0.9))]},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BESIDE)
def test_what_stands_beside_a_force_has_the_events_of_diffrax(name):
    load = vx.Harmonic([1.5], 0.9, mean=[1.0]) if name == "sticking" else vx.Harmonic([0.5], 0.9)
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, **({"stops": []} | BESIDE[name]), force=cubic)
    exact, stepped = (vx.simulate(machine, 0.0, 20.0, args=0.5, flow=f) for f in (None, vx.DiffraxFlow()))
    count = int(exact.num_events)
    kinds = [np.asarray(s.events.kind)[: int(s.num_events)] for s in (exact, stepped)]
    if name != "sticking":  # a chatter has as many bounces as digits
        np.testing.assert_array_equal(kinds[0], kinds[1])
        np.testing.assert_allclose(exact.events.t[:count], stepped.events.t[:count], rtol=0, atol=1e-9)
    np.testing.assert_allclose(exact.x1, stepped.x1, rtol=0, atol=1e-9)
    np.testing.assert_allclose(exact.v1, stepped.v1, rtol=0, atol=1e-9)


def stairs(t, x, v, args):
    return -jnp.floor(x)


def test_a_force_without_series_moves_by_diffrax_and_says_so(monkeypatch):
    monkeypatch.setattr(force_choice, "_warned", set())
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.5], 0.9), [], force=stairs)
    with pytest.warns(UserWarning, match="`floor`"):
        assert isinstance(choose_flow(bound(machine, None), can_stick=False), DiffraxFlow)
    with pytest.raises(ValueError, match="`floor`"):
        vx.simulate(machine, 0.0, 1.0, flow=vx.TaylorFlow())


def end_after_pulse(width):
    """Position 30 time units after a Gaussian pulse at t = 30: its momentum, spread over its width."""
    root = complex(-0.05, np.sqrt(1 - 0.05**2))
    push = 100 * np.sqrt(np.pi) * width * np.exp(30 * root + (root * width / 2) ** 2)
    return (push / root.imag).imag


def pulse(t, x, v, args):
    return 100 * jnp.exp(-(((t - 30) / args) ** 2)) + 0 * x


def test_a_machine_at_rest_feels_a_pulse_that_comes_late():
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [], force=pulse)
    for width in (0.05, 0.01, 3e-3):
        end = vx.simulate(machine, 0.0, 60.0, args=width)
        np.testing.assert_allclose(end.x1[0], end_after_pulse(width), rtol=1e-11)


def test_lanes_feel_a_pulse_that_comes_late():
    machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [], force=pulse)
    widths = np.array([0.05, 0.01, 0.02])
    ends = jax.vmap(lambda width: vx.simulate(machine, 0.0, 60.0, args=width).x1[0])(widths)
    np.testing.assert_allclose(ends, [end_after_pulse(width) for width in widths], rtol=1e-11)


def test_a_pulse_needs_its_bound_on_complex_times(monkeypatch):
    short, rest = lambda t, x, v, args: pulse(t, x, v, 0.01), jnp.zeros(2)
    end = lambda: float(flow_map_of(short, 60.0, stiffness=1.0, damping=0.1)(rest)[0])  # noqa: E731
    np.testing.assert_allclose(end(), end_after_pulse(0.01), rtol=1e-11)
    monkeypatch.setattr(force_flow, "time_limit", lambda *args: args[4])
    assert abs(end() - end_after_pulse(0.01)) > 1e-3


def power_spring(exponent):
    """Force of a contact, or of both sides of a root, and the duration of half a swing of unit speed, by the beta function."""
    p = exponent
    top = ((p + 1) / 2) ** (1 / (p + 1))
    return (
        2
        * top
        * np.sqrt(np.pi)
        * scipy.special.gamma(1 + 1 / (p + 1))
        / scipy.special.gamma(0.5 + 1 / (p + 1))
    )


@pytest.mark.parametrize(
    "exponent", [1.5, pytest.param(2.5, marks=pytest.mark.slow), pytest.param(1.25, marks=pytest.mark.slow)]
)
def test_a_contact_with_a_power_and_its_derivatives_have_their_closed_form(exponent):
    contact = power_spring(exponent)
    span = contact + 2.0
    motion = flow_map_of(lambda t, x, v, args: -(jnp.maximum(x, 0.0) ** exponent), span)

    def exact(z):
        duration = contact * z[1] ** ((1 - exponent) / (1 + exponent))
        return jnp.stack([-z[1] * (span - duration) - z[0], -z[1]])

    start = jnp.array([-1.0, 1.3])
    slopes, end = jax.jit(jax.jacfwd(lambda z: (motion(z),) * 2, has_aux=True))(start)
    np.testing.assert_allclose(end, exact(start), rtol=0, atol=1e-12)
    np.testing.assert_allclose(slopes, jax.jacfwd(exact)(start), rtol=0, atol=4e-12)


@pytest.mark.slow
def test_a_root_times_what_vanishes_with_it_is_passed_at_its_beginning():
    machine = vx.ImpactSystem(
        [1.0], [[0.0]], [[0.0]], None, [], force=lambda t, x, v, args: -x * jnp.sqrt(jnp.abs(x))
    )
    end = vx.simulate(machine, 0.0, 10 * power_spring(1.5), [0.0], [1.0])
    np.testing.assert_allclose([end.x1[0], end.v1[0]], [0.0, 1.0], rtol=0, atol=1e-11)


def test_a_root_of_infinite_slope_moves_by_diffrax(monkeypatch):
    monkeypatch.setattr(force_choice, "_warned", set())
    machine = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], None, [], force=lambda t, x, v, args: -jnp.sqrt(jnp.maximum(x, 0.0))
    )
    with pytest.warns(UserWarning, match="slope is infinite"):
        assert isinstance(choose_flow(bound(machine, None), can_stick=False), DiffraxFlow)


def test_a_pendulum_at_rest_upright_falls_as_its_rounding_says():
    end = flow_map_of(pendulum, 10.0)(jnp.array([np.pi, 0.0]))
    falls = np.sin(np.pi) * np.cosh(10.0)  # the angle is not pi, but the double beside it
    assert abs(float(end[0] - np.pi)) < 10 * falls + 1e-11


@pytest.mark.parametrize(("order", "tolerance"), [(3, 1e-12), (16, 0.0), (50, 1e-12), (16, 2.0)])
def test_orders_and_tolerances_are_checked(order, tolerance):
    with pytest.raises(ValueError, match="must be"):
        vx.TaylorFlow(order, tolerance)
