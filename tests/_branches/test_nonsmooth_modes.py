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


def pair(*stops, exchange=True) -> vx.ImpactSystem:
    """Two equal masses of a chain: both modes have a symmetry, the first with frequency 1, the second with the square root of 3."""
    mass = [1.0, 1.0] if exchange else [1.0, 2.0]
    return vx.ImpactSystem(mass, [[0.0] * 2] * 2, [[2.0, -1.0], [-1.0, 2.0]], stops=list(stops))


def between(mass: int, gap: float) -> list[vx.Stop]:
    """Stops on both sides of a mass."""
    return [vx.Stop(mass, gap, "upper", 1.0), vx.Stop(mass, -gap, "lower", 1.0)]


def turned(frequency: float, time: float) -> np.ndarray:
    """Matrix of a free oscillator over a time."""
    c, s = np.cos(frequency * time), np.sin(frequency * time)
    return np.array([[c, s / frequency], [-frequency * s, c]])


def assert_multipliers(ds, closed) -> None:
    """Compare the multipliers of every point with two of 1 and those of a matrix of the amplitude, (2, 2)."""
    amplitude = np.sqrt(ds.energy.values) / ds.frequency.values[0]
    for a, found, is_stable in zip(amplitude, ds.multipliers.values, ds.is_stable.values, strict=True):
        own = np.linalg.eigvals(closed(a))
        size = max(1, np.abs(own).max())
        for one in own:
            assert np.abs(found - one).min() < 1e-6 * size
        assert np.sort(np.abs(found - 1))[:2].max() < 1e-5 * size
        assert is_stable == (np.abs(own).max() < 1 + 1e-6)


@pytest.mark.slow
def test_the_period_of_a_mass_between_equal_stops_is_that_of_the_closed_form():
    ds = vx.nonsmooth_modes(oscillator(*between(0, 1.0)), 5.0, progress=False)
    amplitude = np.sqrt(2 * ds.energy.values)
    np.testing.assert_allclose(ds.period, 4 * np.arcsin(np.minimum(1, 1 / amplitude)), rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(ds.num_impacts.values[amplitude > 1 + 1e-9], 1)
    assert ds.attrs["ends"] == "0: energy"


@pytest.mark.slow
@pytest.mark.parametrize("mode", [0, 1])
def test_a_mode_of_two_equal_masses_between_equal_stops_is_that_of_one_mass(mode: int):
    stops = [stop for k in range(2) for stop in between(k, 1.0)]
    ds = vx.nonsmooth_modes(pair(*stops), 9.0, modes=[mode], progress=False)
    own, other = np.sqrt([1.0, 3.0])[[mode, 1 - mode]]
    amplitude = np.sqrt(ds.energy.values) / own
    hits = amplitude > 1 + 1e-9
    period = 2 * np.pi / own * np.ones(len(amplitude))
    period[hits] = 4 * np.arcsin(1 / amplitude[hits]) / own
    np.testing.assert_allclose(ds.period, period, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(ds.num_impacts.values[hits], 1)
    np.testing.assert_allclose(ds.x0[:, 1], ds.x0[:, 0] * (1 - 2 * mode), rtol=0, atol=1e-12)
    assert ds.attrs["ends"] == f"{mode}: energy"

    def closed(a: float) -> np.ndarray:
        """Differences of the masses from the mode move with the other frequency; an impact turns them and pulls them by 2 a / v."""
        if a <= 1 + 1e-9:
            return turned(other, 2 * np.pi / own)
        speed, time = own * np.sqrt(a * a - 1), 2 * np.arcsin(1 / a) / own
        matrix = np.array([[-1.0, 0.0], [-2 * own**2 / speed, -1.0]]) @ turned(other, time)
        return matrix @ matrix

    assert_multipliers(ds, closed)
    assert not ds.is_stable.all()


@pytest.mark.slow
def test_a_mode_of_two_equal_masses_at_compliant_stops_is_that_of_one_mass():
    spring = 3.0
    stops = [vx.CompliantStop(k, 1.0, "upper", spring) for k in range(2)]
    ds = vx.nonsmooth_modes(pair(*stops), 5.0, modes=[0], progress=False)
    amplitude = np.sqrt(ds.energy.values)
    fast = np.sqrt(1 + spring)

    def times(a: float) -> tuple[float, float]:
        """Durations without contact and in it."""
        if a <= 1 + 1e-9:
            return 2 * np.pi, 0.0
        speed = np.sqrt(a * a - 1)
        return 2 * (np.pi - np.arccos(1 / a)), 2 * np.arctan2(speed / fast, 1 - spring / (1 + spring)) / fast

    period = [sum(times(a)) for a in amplitude]
    np.testing.assert_allclose(ds.period, period, rtol=0, atol=ROUNDING)
    assert ds.attrs["ends"] == "0: energy"

    def closed(a: float) -> np.ndarray:
        free, touching = times(a)
        return turned(np.sqrt(3.0), free) @ turned(np.sqrt(3.0 + spring), touching)

    assert_multipliers(ds, closed)


@pytest.mark.slow
def test_a_symmetric_mode_of_a_chain_goes_through_grazings_of_pairs_of_stops():
    stiffness = 2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    stops = [vx.Stop(k, gap, "upper", 1.0) for k, gap in enumerate([0.9, 1.2, 1.2, 0.9])]
    system = vx.ImpactSystem([1.0] * 4, np.zeros((4, 4)), stiffness, stops=stops)
    ds = vx.nonsmooth_modes(system, 12.0, modes=[0], max_points=150, progress=False)
    beyond = ds.where(ds.num_impacts.sum("stop") > 0, drop=True)
    # First the inner masses touch their stops, then the outer ones too.
    assert (beyond.num_impacts[0] == [0, 1, 1, 0]).all()
    assert (beyond.num_impacts.values > 0).all(axis=1).any()
    np.testing.assert_array_equal(beyond.num_impacts, beyond.num_impacts.values[:, ::-1])
    plain = beyond.where(beyond.bifurcation == "", drop=True)
    for j in range(0, plain.sizes["point"], 15):
        point = plain.isel(point=j)
        sol = vx.simulate(system, 0.0, float(point.period), point.x0.values, point.v0.values)
        back = np.concatenate([sol.x1 - point.x0.values, sol.v1 - point.v0.values])
        # A run leaves an unstable motion by as much as its largest multiplier.
        assert np.abs(back).max() < 1e-11 * max(1, np.abs(point.multipliers.values).max())
    # Product of the multipliers of a motion without losses.
    product = np.prod(beyond.multipliers.values, axis=1)
    assert np.nanmax(np.abs(product - 1) / np.abs(beyond.multipliers.values).max(axis=1) ** 2) < 1e-8


def test_a_mode_that_touches_two_stops_at_once_without_a_symmetry_is_followed_up_to_them():
    free = pair(exchange=False)
    first = vx.nonsmooth_modes(free, 1.0, modes=[0], progress=False).x0.values[0]
    first = first / np.abs(first).max() * np.sign(first[0])
    stops = [vx.Stop(k, a, "upper", 1.0) for k, a in enumerate(first)]
    system = pair(*stops, exchange=False)
    ds = vx.nonsmooth_modes(system, 9.0, modes=[0], progress=False)
    assert ds.attrs["ends"] == "0: several_impacts"
    np.testing.assert_allclose(np.abs(ds.x0[-1]), first)


@pytest.mark.slow
def test_a_mode_between_equal_stops_hits_both_half_a_period_apart():
    # A run from the touch hits one stop, is thrown off by it, and misses the other.
    stops = [vx.Stop(1, 1.0, "upper", 1.0), vx.Stop(1, -1.0, "lower", 1.0)]
    system = vx.ImpactSystem([1.0, 1.3], np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 2.0]], stops=stops)
    families = vx.nonsmooth_modes(system, max_points=40, progress=False)
    for k in (0, 1):
        one = families.where(families.mode == k, drop=True)
        beyond = one.isel(point=slice(20, None))
        assert beyond.sizes["point"] > 5
        assert (beyond.num_impacts == 1).all()
        for point in (beyond.isel(point=0), beyond.isel(point=-1)):
            half = vx.simulate(
                system, 0.0, float(point.period) / 2, point.x0.values, point.v0.values, max_events=8
            )
            np.testing.assert_allclose(half.x1, -point.x0, atol=1e-9)
            np.testing.assert_allclose(half.v1, -point.v0, atol=1e-9)
    touch = families.energy.where(families.mode == 0, drop=True)[19:21]
    assert 0 < float(touch[1] / touch[0]) - 1 < 1e-3
