"""Periodic orbits and sweeps of a machine with a Jenkins element; all in one machine, so that few programs are compiled."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow
_LIMIT, _STIFFNESS = 0.5, 2.0


@pytest.fixture(scope="module")
def machine() -> vx.ImpactSystem:
    load, joint = vx.Harmonic([1.0], 0.8), vx.Jenkins(0, _STIFFNESS, _LIMIT)
    return vx.ImpactSystem([1.0], [[0.05]], [[1.0]], load, hysteresis=[joint])


@pytest.fixture(scope="module")
def orbit(machine) -> vx.PeriodicOrbit:
    return vx.periodic_orbit(machine, [1.2], [0.1])


def test_the_orbit_closes_and_slips_twice_each_way(orbit):
    assert bool(orbit.is_admissible)
    assert float(orbit.residual) < 1e-12
    sol = vx.simulate(orbit.system, 0.0, orbit.period, orbit.x0, orbit.v0)
    assert np.allclose(sol.x1, orbit.x0[:1], rtol=0, atol=1e-11)
    assert np.allclose(sol.sliders1, orbit.x0[0] - orbit.v0[1], rtol=0, atol=1e-11)
    kinds = np.asarray(orbit.events.kind)
    assert sorted(kinds[kinds >= 0].tolist()) == [vx.STICK, vx.STICK, vx.SLIP, vx.SLIP]


def test_its_multipliers_are_those_of_the_monodromy_matrix_and_two_are_zero(orbit):
    matrix = np.asarray(vx.monodromy_matrix(orbit.system, orbit.x0, orbit.v0))
    found, expected = (np.asarray(a, complex) for a in (orbit.multipliers, np.linalg.eigvals(matrix)))
    found, expected = np.sort_complex(found), np.sort_complex(expected)
    assert np.allclose(found, expected, rtol=0, atol=1e-10)
    assert np.count_nonzero(np.asarray(orbit.multipliers)) == 2


def test_the_orbit_moves_with_the_limit_as_differences_say(machine, orbit):
    def start(limit):
        other = eqx.tree_at(lambda s: s.hysteresis[0].limit, machine, limit)
        return vx.periodic_orbit(other, orbit.x0, orbit.v0).x0[0]

    limit, step = jnp.array(_LIMIT), 1e-5
    difference = (start(limit + step) - start(limit - step)) / (2 * step)
    assert np.allclose(jax.jacfwd(start)(limit), difference, rtol=1e-7)


def test_a_sweep_follows_the_same_motion_and_adds_up_its_loss(machine, orbit):
    ds = vx.sweep(
        machine,
        {"hysteresis[0].limit": [0.3, _LIMIT], "x0[0]": [0.0, 0.4]},
        transient=60,
        record=2,
        quantities=["hysteresis_energy", "max_position", "min_position"],
    )
    at = ds.sel({"hysteresis[0].limit": _LIMIT})
    assert np.allclose(at.x.values, np.asarray(orbit.x0), rtol=0, atol=1e-10)
    assert np.allclose(at.v.values, np.asarray(orbit.v0), rtol=0, atol=1e-10)
    amplitude = (ds.max_position - ds.min_position).values[..., 0] / 2
    limit = np.array([[0.3], [_LIMIT]])
    area = 4 * limit * (amplitude - limit / _STIFFNESS)
    assert np.allclose(ds.hysteresis_energy.values[..., 0], area, rtol=1e-9)
    assert (ds.num_slider_sticks.values == 4).all()


def test_sliders_that_stick_all_along_stay_where_the_guess_has_them():
    """Such an orbit is one of a family, one for each place of the sliders: that of springs, shifted by theirs."""
    amplitude, frequency, stiffness = 0.1, 1.7, np.array([1.0, 0.5])
    sliders = [vx.Jenkins(0, k, limit) for k, limit in zip(stiffness, [0.3, 0.2], strict=True)]
    load = vx.Harmonic([amplitude], frequency)
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, hysteresis=sliders)
    response = amplitude / (1.0 + stiffness.sum() - frequency**2 + 0.1j * frequency)
    for place in ([0.0, 0.0], [0.05, -0.02]):
        # From rest, with the springs stretched to these places.
        x0, v0 = [0.0, 0.0, 0.0], [0.0, -place[0], -place[1]]
        orbit = vx.periodic_orbit(system, x0, v0)
        shift = stiffness @ place / (1.0 + stiffness.sum())
        x = response.real + shift
        np.testing.assert_allclose(orbit.x0, [x, 0, 0], rtol=0, atol=1e-14)
        np.testing.assert_allclose(orbit.v0[1:], x - np.array(place), rtol=0, atol=1e-14)
        assert orbit.is_admissible
        assert np.sum(np.abs(np.asarray(orbit.multipliers) - 1) < 1e-12) == 2
