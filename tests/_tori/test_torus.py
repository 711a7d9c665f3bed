"""Invariant circles of machines: against long runs, refusals, pictures."""

import equinox as eqx
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest

import vijax as vx
from vijax._tori.circle import interpolation, rates

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
def test_the_size_of_the_circle_is_that_of_the_normal_form(system, branch, torus):
    """At the phase of the orbit, x is that of the orbit plus xi e^{i angle} q plus the complex conjugate."""
    (point,) = (a for a in branch.bifurcations if a.kind == "ns")
    form, variances = point.normal_form, []
    for k in (0, 1):
        frequency = float(torus[FREQUENCY][k])
        machine = eqx.tree_at(lambda s: s.forcing.frequency, system, jnp.asarray(frequency))
        times = torus.attrs["phase"] / frequency, (2 * np.pi + float(point.orbit.phase)) / frequency
        states = zip(torus.x[k].values, torus.v[k].values, strict=True)
        ends = [vx.simulate(machine, *times, x, v, max_events=8).x1[0] for x, v in states]
        variances.append(np.var(ends))
    away = torus[FREQUENCY].values[:2] - point.value
    growth = np.array(variances) / away
    told = -form.rate / form.coefficient * 2 * abs(form.direction[0]) ** 2
    assert (form.criticality, form.side) == ("supercritical", "below")
    at_zero = growth[0] - away[0] * (growth[1] - growth[0]) / (away[1] - away[0])
    assert at_zero == pytest.approx(told, rel=1e-2)


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
