"""Nonsmooth modes: families of conservative machines against closed forms, and what is refused."""

import numpy as np
import pytest

import vijax as vx

# Rounding of periods along a family.
ROUNDING = 1e-11


def oscillator(*stops, **parts) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], stops=list(stops), **parts)


@pytest.mark.slow
def test_the_period_of_a_mass_at_a_rigid_stop_is_that_of_the_closed_form():
    ds = vx.nonsmooth_modes(oscillator(vx.Stop(0, 1.0, "upper", 1.0)), 5.0, progress=False)
    amplitude = np.sqrt(2 * ds.energy.values)
    period = np.where(amplitude > 1, 2 * (np.pi - np.arccos(np.minimum(1, 1 / amplitude))), 2 * np.pi)
    np.testing.assert_allclose(ds.period, period, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ds.frequency, 2 * np.pi / period, rtol=0, atol=ROUNDING)
    assert (np.diff(ds.energy) > 0).all()
    assert float(ds.energy[-1]) > 5.0 > float(ds.energy[-2])
    np.testing.assert_allclose(ds.multipliers, 1, rtol=0, atol=1e-9)
    assert ds.is_stable.all()
    touch = ds.where(ds.bifurcation == "gr", drop=True)
    np.testing.assert_allclose(touch.energy, 0.5)
    np.testing.assert_array_equal(ds.num_impacts[:, 0], (amplitude > 1 + 1e-9).astype(int))
    assert ds.attrs["ends"] == "0: energy"


@pytest.mark.slow
def test_the_period_of_a_bilinear_oscillator_is_that_of_the_closed_form():
    spring = 3.0
    ds = vx.nonsmooth_modes(oscillator(vx.CompliantStop(0, 1.0, "upper", spring)), 5.0, progress=False)
    energy = ds.energy.values
    amplitude, speed = np.sqrt(2 * energy), np.sqrt(np.maximum(2 * energy - 1, 0))
    free = 2 * (np.pi - np.arccos(np.minimum(1, 1 / amplitude)))
    fast = np.sqrt(1 + spring)
    # In contact about x = spring / (1 + spring), from x = 1 with this speed until it is back.
    closed = 2 * np.arctan2(speed / fast, 1 - spring / (1 + spring)) / fast
    np.testing.assert_allclose(ds.period, free + np.where(amplitude > 1, closed, 0), rtol=0, atol=ROUNDING)
    assert ds.sizes["point"] > 40


@pytest.mark.slow
def test_both_modes_of_a_chain_keep_their_energy_through_impacts():
    stiffness = [[2.0, -1.0], [-1.0, 2.0]]
    stop = vx.Stop(1, 1.0, "upper", 1.0)
    system = vx.ImpactSystem([1.0, 1.0], [[0.0] * 2] * 2, stiffness, stops=[stop])
    ds = vx.nonsmooth_modes(system, 4.0, progress=False)
    touch = ds.where((ds.bifurcation == "gr") & (ds.num_impacts.sum("stop") == 0), drop=True)
    # The amplitude at which both masses touch is 1, so the energies are w^2.
    np.testing.assert_allclose(touch.energy, [1.0, 3.0])
    np.testing.assert_allclose(touch.frequency, [1.0, np.sqrt(3.0)])
    for k in range(2):
        one = ds.where(ds["mode"] == k, drop=True)
        assert one.energy.max() > 3.5
        near = np.sort(np.abs(one.multipliers.values - 1), axis=1)
        assert near[:, 1].max() < 1e-5
        # A run of the machine over the period comes back.
        for j in range(0, one.sizes["point"], 12):
            point = one.isel(point=j)
            sol = vx.simulate(system, 0.0, float(point.period), point.x0.values, point.v0.values)
            end = np.concatenate([sol.x1, sol.v1])
            start = np.concatenate([point.x0.values, point.v0.values])
            assert np.abs(end - start).max() < 1e-9


@pytest.mark.parametrize(
    ("system", "words"),
    [
        (vx.ImpactSystem([1.0], [[0.1]], [[1.0]], stops=[]), "a `damping`"),
        (vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([0.3], 1.0), []), "a load"),
        (vx.ImpactSystem([1.0], [[0.0]], [[-1.0]], stops=[]), "negative stiffness"),
        (oscillator(vx.Stop(0, 1.0, "upper", 0.9)), "`restitution` 1"),
        (oscillator(vx.CompliantStop(0, 1.0, "upper", 3.0, 0.1)), "`damping` and `preload` 0"),
        (oscillator(vx.Stop(0, 1.0, "upper", 1.0), hysteresis=[vx.Jenkins(0, 1.0, 0.2)]), "Jenkins elements"),
        (oscillator(vx.Stop(0, 0.0, "upper", 1.0)), "touches the machine at rest"),
    ],
)
def test_machines_that_do_not_keep_their_energy_are_refused(system, words: str):
    with pytest.raises(ValueError, match=words):
        vx.nonsmooth_modes(system, 1.0, progress=False)


def test_a_mode_that_does_not_exist_is_refused_and_one_below_its_touch_is_linear():
    system = oscillator(vx.Stop(0, 1.0, "upper", 1.0))
    with pytest.raises(ValueError, match="the modes that vibrate"):
        vx.nonsmooth_modes(system, 1.0, modes=[1], progress=False)
    ds = vx.nonsmooth_modes(system, 0.4, progress=False)
    np.testing.assert_allclose(ds.period, 2 * np.pi)
    assert float(ds.energy[-1]) == pytest.approx(0.4)
    assert (ds.bifurcation == "").all()


def test_a_mode_that_touches_two_stops_at_once_is_followed_up_to_them():
    stops = [vx.Stop(0, 1.0, "upper", 1.0), vx.Stop(1, 1.0, "upper", 1.0)]
    system = vx.ImpactSystem([1.0, 1.0], [[0.0] * 2] * 2, [[2.0, -1.0], [-1.0, 2.0]], stops=stops)
    ds = vx.nonsmooth_modes(system, 2.0, modes=[0], progress=False)
    assert ds.attrs["ends"] == "0: several_impacts"
    assert float(ds.energy[-1]) == pytest.approx(1.0)
