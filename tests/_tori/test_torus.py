"""Invariant circles of machines: against long runs, refusals, pictures."""

from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest

import vijax as vx
from vijax._tori.circle import interpolation, rates
from vijax._tori.torus import _section_of

mpl.use("Agg")

FREQUENCY = "forcing.frequency"
PERIODS, LEFT_OUT = 3000, 2000


@pytest.fixture(scope="module")
def system():
    """Two masses in a chain whose orbit of one impact a period loses its stability to a torus, at 1.5549."""
    load, stop = vx.Harmonic([1.0, 0.0], 1.6), vx.Stop(0, 0.11, "upper", 0.8)
    return vx.chain([1.0, 1.29], [0.02, 0.02], [1.0, 1.1], load, [stop])


@pytest.fixture(scope="module")
def branch(system):
    run = vx.simulate(system, 0.0, 500 * system.forcing.period)
    orbit = vx.periodic_orbit(system, run.x1, run.v1)
    return vx.continuation(orbit, FREQUENCY, (1.5, 1.7), progress=False)


@pytest.fixture(scope="module")
def torus(branch):
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    return vx.follow_torus(point, (1.54, 1.6), progress=False)


@pytest.mark.slow
def test_a_long_run_stays_on_the_circle_and_has_its_rotation_number(system, torus):
    k = int(np.flatnonzero(torus.is_stable.values)[-1])
    frequency, phase = float(torus[FREQUENCY][k]), torus.attrs["phase"]
    machine = eqx.tree_at(lambda s: s.forcing.frequency, system, jnp.asarray(frequency))
    period = 2 * np.pi / frequency
    start = phase / frequency
    ts = start + period * np.arange(LEFT_OUT, LEFT_OUT + PERIODS)
    x, v = torus.x[k, 0].values, torus.v[k, 0].values
    sol = vx.simulate(machine, start, ts[-1], x, v, ts=ts, max_events=0, throw=False)
    states = np.concatenate([sol.xs, sol.vs], axis=1)
    curve = np.concatenate([torus.x[k].values, torus.v[k].values], axis=1)
    num, slope = len(curve), rates(curve)
    fine = interpolation(np.arange(2000) / 2000, num) @ curve
    angles = np.array([np.abs(fine - z).max(axis=1).argmin() for z in states]) / 2000
    for _ in range(5):  # to the nearest angle, by Gauss and Newton
        weights = interpolation(angles, num)
        way = weights @ slope
        angles += np.sum((states - weights @ curve) * way, axis=1) / np.sum(way**2, axis=1)
    assert np.abs(states - interpolation(angles, num) @ curve).max() < 1e-7
    # Weighted average of the gain of the angle (Das et al. 2017): its error is below rounding.
    gains, place = np.diff(angles) % 1.0, np.linspace(0, 1, PERIODS + 1)[1:-1]
    shares = np.exp(-1 / (place * (1 - place)))
    assert float(torus.rotation_number[k]) == pytest.approx(shares @ gains / shares.sum(), abs=1e-12)


@pytest.mark.slow
def test_a_circle_under_a_harmonic_load_and_a_wave_form_is_mapped_to_itself(system):
    """A period later a state of the circle is at its angle further by the rotation number."""

    def both(frequency):
        heights = np.array([[0.05, 0.0], [0.0, 0.0], [-0.05, 0.0], [0.0, 0.0]])
        load = vx.Harmonic([1.0, 0.0], frequency) + vx.Waveform(np.pi / 2 * np.arange(4), heights, frequency)
        return vx.ImpactSystem(system.mass, system.damping, system.stiffness, load, system.stops)

    run = vx.simulate(both(1.6), 0.0, 500 * both(1.6).forcing.period, max_events=8, throw=False)
    orbit = vx.periodic_orbit(both(1.6), run.x1, run.v1)
    branch = vx.continuation(orbit, FREQUENCY, (1.5, 1.7), progress=False)
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    torus, k = vx.follow_torus(point, (1.45, 1.6), progress=False), 3
    frequency = float(torus[FREQUENCY][k])
    curve = np.concatenate([torus.x[k].values, torus.v[k].values], axis=1)
    num, start = len(curve), torus.attrs["phase"] / frequency
    later = (np.arange(num) / num + float(torus.rotation_number[k])) % 1.0
    expected = interpolation(later, num) @ curve
    for j in range(0, num, max(1, num // 8)):
        end = start + 2 * np.pi / frequency
        sol = vx.simulate(both(frequency), start, end, curve[j, :2], curve[j, 2:])
        np.testing.assert_allclose(
            np.concatenate([sol.x1, sol.v1]), expected[j], rtol=0, atol=float(torus.error[k])
        )


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 1.4])
def test_small_circles_grow_and_shrink_as_the_normal_form_says(system, branch, factor):
    """|xi| -> |xi| (1 + rate d + coefficient |xi|^2), a Bernoulli equation. Wider circles reach impacts that graze."""
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    form, away, num = point.normal_form, -5e-6, 8000
    assert (form.criticality, form.side) == ("supercritical", "below")
    frequency = point.value + away
    machine = eqx.tree_at(lambda s: s.forcing.frequency, system, jnp.asarray(frequency))
    orbit, kick = point.orbit, 2 * factor * form.amplitude(away) * form.direction.real
    ts = float(orbit.phase) / frequency + 2 * np.pi / frequency * np.arange(num)
    start = orbit.x0 + kick[:2], orbit.v0 + kick[2:]
    sol = vx.simulate(machine, ts[0], ts[-1], *start, ts=ts, max_events=0, throw=False)
    first, last = (np.var(part) for part in (sol.xs[:400, 0], sol.xs[-400:, 0]))
    shrunk = np.exp(-2 * form.rate * away * (num - 400))
    told = 1 / (1 + (1 / factor**2 - 1) * shrunk)
    assert last / first == pytest.approx(told / factor**2, rel=0.02)
    assert np.sqrt(2 * first) == pytest.approx(
        2 * factor * form.amplitude(away) * abs(form.direction[0]), rel=0.03
    )


@pytest.mark.slow
def test_the_family_begins_at_the_bifurcation_and_ends_at_the_bound(branch, torus):
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    multipliers = np.asarray(point.orbit.multipliers)
    angle = abs(np.angle(multipliers[np.abs(np.abs(multipliers) - 1).argmin()])) / (2 * np.pi)
    values, rotation = torus[FREQUENCY].values, torus.rotation_number.values
    # Both differ from those of the bifurcation by the square of the size of the circle.
    square = np.ptp(torus.x.values[:2, :, 0], axis=1) ** 2
    limits = [a[0] - square[0] * (a[1] - a[0]) / (square[1] - square[0]) for a in (values, rotation)]
    np.testing.assert_allclose(limits, [point.value, angle], rtol=0, atol=1e-5)
    assert (values[-1], torus.attrs["end"]) == (1.54, "bounds")
    assert np.all(torus.error.values <= 1e-8)


@pytest.mark.slow
def test_exponents_are_those_of_a_run(system, torus):
    k = 2
    machine = eqx.tree_at(lambda s: s.forcing.frequency, system, jnp.asarray(torus[FREQUENCY].values[k]))
    start = torus.x.values[k, 0], torus.v.values[k, 0]
    found = vx.lyapunov_exponents(machine, *start, transient=1000, num_periods=4000, progress=False)
    np.testing.assert_allclose(torus.lyapunov_exponents[k], found, rtol=0, atol=2e-3)
    assert torus.lyapunov_exponents.values[k, 0] == 0
    assert bool(torus.is_stable[k])
    assert not bool(torus.is_stable[-1])


@pytest.mark.slow
def test_the_torus_is_stable_once_more_in_a_second_range_as_runs_have_it(system, branch):
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    torus = vx.follow_torus(point, (1.5384, 1.6), progress=False)
    values, is_stable = torus[FREQUENCY].values, torus.is_stable.values
    assert not is_stable[(values > 1.5395) & (values < 1.543)].any()
    again = np.flatnonzero(is_stable & (values < 1.5395))
    assert ((values[again] > 1.5384) & (values[again] < 1.5394)).all()
    k = again[np.argmin(torus.lyapunov_exponents.values[again, 1])]
    machine = eqx.tree_at(lambda s: s.forcing.frequency, system, jnp.asarray(values[k]))
    # From the phase of the section to the end of its period.
    times = torus.attrs["phase"] / values[k], 2 * np.pi / values[k]
    begun = vx.simulate(machine, *times, torus.x.values[k, 0], torus.v.values[k, 0])
    found = vx.lyapunov_exponents(
        machine, begun.x1, begun.v1, transient=1000, num_periods=4000, progress=False
    )
    np.testing.assert_allclose(torus.lyapunov_exponents[k], found, rtol=0, atol=2e-3)
    assert found[1] < -5e-3  # it attracts


@pytest.mark.slow
def test_a_torus_is_drawn(torus):
    numbers, section = vx.plot.torus(torus)
    assert numbers.get_xlabel() == r"Forcing frequency $\Omega$"
    assert [text.get_text() for text in numbers.get_legend().get_texts()] == ["stable", "unstable"]
    assert len(section.lines) == min(torus.sizes["point"], 12)
    with pytest.raises(ValueError, match=r"holds no invariant circle: give what `vx.follow_torus` returned"):
        vx.plot.torus(torus.drop_vars("rotation_number"))


@pytest.mark.slow
def test_what_cannot_be_followed_is_refused(branch):
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    with pytest.raises(ValueError, match=r"`bounds` must contain the bifurcation at 1.5549"):
        vx.follow_torus(point, (1.6, 1.7))
    end = vx.Bifurcation(branch, 0)
    with pytest.raises(ValueError, match='must be of the kind "ns"'):
        vx.follow_torus(end, (1.5, 1.7))


@pytest.mark.thorough
def test_the_section_of_an_orbit_has_the_sliders_of_jenkins_elements():
    load, stop = vx.Harmonic([0.5], 2.2), vx.Stop(0, 0.1, "upper", 0.7)
    joint = vx.Jenkins(0, 0.05, 0.0025)
    system = vx.ImpactSystem([1.0], [[0.1]], [[0.95]], load, [stop], hysteresis=[joint])
    sol = vx.simulate(system, 0.0, 100 * system.forcing.period, max_events=512)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
    point = SimpleNamespace(orbit=orbit, branch=SimpleNamespace(path=FREQUENCY), value=2.2)
    section, state = _section_of(point)
    at = section.phase / 2.2
    x, v = orbit.solution().evaluate(at)
    stretch = x[0] - orbit.solution().evaluate_sliders(at)[0]
    np.testing.assert_allclose(state * section.scale, [x[0], 0.0, v[0], stretch], rtol=0, atol=1e-10)
