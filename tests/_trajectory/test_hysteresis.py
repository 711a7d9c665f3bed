"""Jenkins elements against closed forms, and beside stops and friction."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._trajectory.simulate import simulate_all

ROUNDING = 1e-13
_NO_LOAD = vx.Harmonic([0.0], 1.0)


def _mass_on(element: vx.Jenkins, stiffness: float = 1.0, load: vx.Harmonic = _NO_LOAD) -> vx.ImpactSystem:
    """One mass; all machines of this kind share one program."""
    return vx.ImpactSystem([1.0], [[0.0]], [[stiffness]], load, hysteresis=[element])


def _log(sol: vx.Solution) -> list[tuple[float, int, int]]:
    n = int(sol.num_events)
    return list(
        zip(
            *(np.asarray(a)[:n].tolist() for a in (sol.events.t, sol.events.stop, sol.events.kind)),
            strict=True,
        )
    )


@pytest.mark.thorough
def test_a_released_mass_sticks_slips_and_sticks_at_the_times_of_the_closed_form():
    # Stretched by its largest stretch .25 and released: x = 7/6 + 5/6 cos(sqrt(3) t) until the stretch is -.25.
    sol = vx.simulate(_mass_on(vx.Jenkins(0, 2.0, 0.5, slider=1.75)), 0.0, 3.0, [2.0], [0.0])
    slip = np.arccos(0.4) / np.sqrt(3)
    speed = -5 / 6 * np.sqrt(3) * np.sqrt(0.84)
    stick = slip + np.pi + np.arctan(speed)  # x = .5 + cos(t) + speed sin(t) behind it
    lowest = 0.5 - np.hypot(1.0, speed)
    later = np.sqrt(3) * (3.0 - stick)
    centre = 2 * (lowest + 0.25) / 3
    assert [kind for _, _, kind in _log(sol)] == [vx.SLIP, vx.STICK]
    assert np.allclose([t for t, _, _ in _log(sol)], [slip, stick], rtol=0, atol=ROUNDING)
    assert np.allclose(sol.sliders1, lowest + 0.25, rtol=0, atol=ROUNDING)
    assert np.allclose(sol.x1, centre + (lowest - centre) * np.cos(later), rtol=0, atol=ROUNDING)


def test_at_its_limit_it_slips_at_once_where_the_load_pulls_that_way():
    load = vx.Harmonic([0.0], 1.0, mean=[0.8])
    machine = _mass_on(vx.Jenkins(0, 2.0, 0.5, slider=0.0), 0.0, load)
    sol = vx.simulate(machine, 0.0, 1.0, [0.25], [0.0])
    assert np.allclose(sol.x1, 0.25 + 0.15, rtol=0, atol=ROUNDING)
    assert np.allclose(sol.sliders1, 0.15, rtol=0, atol=ROUNDING)
    assert int(sol.num_events) == 0  # it slips from t0
    balanced = vx.simulate(
        eqx.tree_at(lambda s: s.forcing.mean, machine, jnp.array([0.5])), 0.0, 50.0, [0.25], [0.0]
    )
    assert float(balanced.x1[0]) == 0.25
    assert int(balanced.num_events) == 0


def test_a_slider_that_starts_too_far_away_has_followed():
    load = vx.Harmonic([0.0], 1.0, mean=[0.8])
    sol = vx.simulate(_mass_on(vx.Jenkins(0, 2.0, 0.5, slider=-7.0), 0.0, load), 0.0, 1.0, [3.0], [0.0])
    assert np.allclose(sol.evaluate_sliders(0.0), 2.75, rtol=0, atol=ROUNDING)
    assert np.allclose(sol.x1, 3.15, rtol=0, atol=ROUNDING)


def test_the_loop_has_the_area_of_the_closed_form():
    load = vx.Harmonic([1.0], 0.8)
    machine = eqx.tree_at(
        lambda s: s.damping, _mass_on(vx.Jenkins(0, 2.0, 0.5), load=load), jnp.array([[0.05]])
    )
    period = float(load.period)
    sol = vx.simulate(machine, 0.0, 60 * period, [0.0], [0.0])
    t = np.linspace(59 * period, 60 * period, 4001)
    x, v = (np.asarray(a)[:, 0] for a in sol.evaluate(t))
    force, amplitude = np.asarray(sol.hysteresis_force(t))[:, 0], np.ptp(x) / 2
    assert np.allclose(np.trapezoid(force * v, t), 4 * 0.5 * (amplitude - 0.25), rtol=1e-6)
    assert np.abs(force).max() <= 0.5


@pytest.mark.slow
def test_derivatives_are_those_of_the_closed_form():
    def end(limit, slider):
        element = vx.Jenkins(0, 2.0, limit, slider)
        return vx.simulate(_mass_on(element), 0.0, 3.0, [2.0], [0.0]).x1[0]

    def exact(limit, slider):
        reach, rate = limit / 2, jnp.sqrt(3.0)
        middle = 2 * slider / 3
        angle = jnp.arccos((slider - reach - middle) / (2 - middle))
        start, speed = slider - reach - limit, -(2 - middle) * rate * jnp.sin(angle)
        stick = angle / rate + jnp.pi + jnp.arctan(speed / start)
        lowest = limit - jnp.hypot(start, speed)
        centre = 2 * (lowest + reach) / 3
        return centre + (lowest - centre) * jnp.cos(rate * (3.0 - stick))

    at = 0.5, 1.76
    assert np.allclose(end(*at), exact(*at), rtol=0, atol=ROUNDING)
    found, expected = (jax.grad(f, argnums=(0, 1))(*at) for f in (end, exact))
    assert np.allclose(found, expected, rtol=0, atol=1e-11)


@pytest.fixture(scope="module")
def beside_others():
    """A function of the elements: two masses with a rigid and a compliant stop and friction."""
    load = vx.Harmonic([1.0, 0.3], 0.9)
    stops = [vx.Stop(0, 0.5, "upper", 0.6), vx.CompliantStop(1, -0.4, "lower", 6.0, 0.2)]
    rubbing = [vx.Friction({0: 1.0, 1: -1.0}, 0.12, static=0.15)]
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.5]])

    def run(elements, more=0.0):
        machine = vx.ImpactSystem(
            [1.0, 0.8],
            [[0.06, -0.02], [-0.02, 0.05]],
            stiffness + more,
            load,
            stops,
            friction=rubbing,
            hysteresis=elements,
        )
        return vx.simulate(machine, 0.0, 40.0, [0.1, -0.2], [0.3, 0.1])

    return run


@pytest.mark.slow
def test_beside_stops_and_friction_it_is_a_spring_nothing_or_its_halves(beside_others):
    row, k = {0: 1.0, 1: 0.5}, 0.7
    rigid = beside_others([vx.Jenkins(row, k, 1e3)])
    spring = beside_others([], k * np.outer([1.0, 0.5], [1.0, 0.5]))
    offset = vx.Jenkins(row, k, 1e3, slider=0.0)
    assert int(rigid.num_events) > 0
    held = beside_others([offset])
    assert np.allclose(held.x1, spring.x1, rtol=0, atol=1e-12)
    nothing, without = beside_others([vx.Jenkins(row, k, 0.0)]), beside_others([])
    assert np.allclose(nothing.x1, without.x1, rtol=0, atol=1e-12)
    others = np.array([e for e in _log(nothing) if e[1] < 3])
    assert np.allclose(others, np.array(_log(without)), rtol=0, atol=1e-10)
    halves = beside_others([vx.Jenkins(row, k, 0.1)] * 2)
    whole = beside_others([vx.Jenkins(row, 2 * k, 0.2)])
    assert np.allclose(halves.x1, whole.x1, rtol=0, atol=1e-12)
    t = np.linspace(0.0, 40.0, 2001)
    force, slider = (np.asarray(f(t))[:, 0] for f in (whole.hysteresis_force, whole.evaluate_sliders))
    assert np.allclose(force, 2 * k * (np.asarray(whole.evaluate(t)[0]) @ [1.0, 0.5] - slider), atol=1e-12)
    moved, at_limit = np.diff(slider), np.minimum(np.abs(force[1:]), np.abs(force[:-1])) > 0.2 - 1e-9
    assert (moved * np.sign(force[1:]) >= -1e-12).all()
    assert np.abs(moved[np.maximum(np.abs(force[1:]), np.abs(force[:-1])) < 0.2 - 1e-9]).max() < 1e-12
    assert at_limit.any()


@pytest.mark.parametrize("stretch", [0.2, np.nextafter(0.2, 0.0), -0.2, -np.nextafter(0.2, 0.0)])
def test_a_slider_that_starts_at_its_limit_slips_at_once_whatever_the_rounding(stretch):
    machine = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([0.5], 1.0), hysteresis=[vx.Jenkins(0, 1.0, 0.2)]
    )
    run = simulate_all(machine, 0.0, 0.1, [0.4 * np.sign(stretch), 0.0], [np.sign(stretch), stretch])
    assert int(run.num_events) == 0
    assert float(run.v1[1]) == np.sign(stretch) * 0.2
