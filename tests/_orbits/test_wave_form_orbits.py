"""Orbits, branches and sweeps of machines under wave forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# A few hundred roundings.
ROUNDING = 1e-12
# Central differences with a step of 1e-5.
DIFFERENCES = 1e-6
# A spline of 32 knots through a cosine is off by 4e-6.
SPLINE = 1e-4
STOP = [vx.Stop(0, 0.4, "upper", 0.7)]


def machine(frequency=0.8, height=1.0, kind: str = "previous") -> vx.ImpactSystem:
    wave = vx.Waveform([0.0, np.pi], jnp.array([[1.0], [-1.0]]) * height, frequency, kind)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], wave, STOP)


@pytest.fixture(scope="module")
def orbit() -> vx.PeriodicOrbit:
    system = machine()
    sol = vx.simulate(system, 0.0, 60 * system.forcing.period)
    return vx.periodic_orbit(system, sol.x1, sol.v1)


@pytest.mark.slow
def test_an_orbit_closes_and_has_the_multipliers_of_the_map(orbit):
    system = orbit.system
    x, v = vx.stroboscopic_map(system, orbit.x0, orbit.v0)
    np.testing.assert_allclose([x, v], [orbit.x0, orbit.v0], rtol=0, atol=ROUNDING)
    matrix = vx.monodromy_matrix(system, orbit.x0, orbit.v0)
    np.testing.assert_allclose(np.poly(orbit.multipliers), np.poly(matrix), rtol=0, atol=ROUNDING)
    loss = np.exp(-0.1 * float(system.forcing.period)) * 0.7 ** (
        2 * int(np.sum(np.asarray(orbit.events.kind) == 0))
    )
    assert float(np.prod(orbit.multipliers).real) == pytest.approx(loss, abs=ROUNDING)


@pytest.mark.thorough
def test_an_orbit_at_another_phase_is_the_same(orbit):
    system, phase = orbit.system, 1.9
    sol = vx.simulate(system, 0.0, phase / 0.8, orbit.x0, orbit.v0)
    later = vx.periodic_orbit(system, sol.x1, sol.v1, phase=phase)
    np.testing.assert_allclose(later.x0, sol.x1, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(np.poly(later.multipliers), np.poly(orbit.multipliers), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_derivatives_of_an_orbit_by_frequency_and_height(orbit):
    start = lambda w, h: vx.periodic_orbit(machine(w, h), orbit.x0, orbit.v0).x0[0]  # noqa: E731
    here = jnp.array(0.8), jnp.array(1.0)
    for k in (0, 1):
        step = [1e-5 * (j == k) for j in (0, 1)]
        up, down = (start(*(a + s * d for a, d in zip(here, step, strict=True))) for s in (1, -1))
        for of in (jax.jacfwd, jax.grad):
            assert float(of(start, k)(*here)) == pytest.approx(float((up - down) / 2e-5), abs=DIFFERENCES)


@pytest.mark.slow
def test_a_branch_has_the_bifurcations_of_the_wave_that_it_approximates():
    phases = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    wave = vx.Waveform(phases, np.cos(phases)[:, None], 2.8, "cubic")
    stop, branches = [vx.Stop(0, 0.0, "upper", 0.8)], []
    for load in (wave, vx.Harmonic([1.0], 2.8)):
        system = vx.ImpactSystem([1.0], [[0.05]], [[1.0]], load, stop)
        sol = vx.simulate(system, 0.0, 300 * system.forcing.period, [-0.1], [0.0])
        orbit = vx.periodic_orbit(system, sol.x1, sol.v1)
        branches.append(vx.continuation(orbit, "forcing.frequency", (2.4, 3.2), progress=False))
    found, expected = ([(b.kind, b.value) for b in branch.bifurcations] for branch in branches)
    assert [kind for kind, _ in found] == [kind for kind, _ in expected] != []
    values = [[value for _, value in one] for one in (found, expected)]
    np.testing.assert_allclose(*values, rtol=0, atol=SPLINE)


def test_a_sweep_and_its_orbits_agree_with_single_runs():
    values = np.array([0.7, 0.8, 1.1])
    ds = vx.sweep(machine(), {"forcing.frequency": values}, transient=50, record=5, progress=False)
    for frequency, x in zip(values, ds.x.values[:, 0], strict=True):
        system = machine(frequency)
        sol = vx.simulate(system, 0.0, 55 * system.forcing.period)
        assert float(sol.x1[0]) == pytest.approx(float(x), abs=ROUNDING)
