"""Peaks along branches: a linear oscillator in closed form, the best absorber, and an impact oscillator."""

import jax
import numpy as np
import pytest

import vijax as vx
from vijax._branches.peak_quantities import checked_peak_quantities

# Rounding of frequencies and of heights relative to their size.
ROUNDING = 1e-12
DAMPING = 0.1


def linear(damping) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[damping]], [[1.0]], vx.Harmonic([1.0], 0.7), [])


def frequency_of(damping) -> float:
    return np.sqrt(1 - damping**2 / 2)


def height_of(damping) -> float:
    return 1 / (damping * np.sqrt(1 - damping**2 / 4))


@pytest.fixture(scope="module")
def resonance() -> vx.Branch:
    orbit = vx.periodic_orbit(linear(DAMPING), [0.0], [0.0])
    wanted = ["max_position[0]", "peak_to_peak", "max_velocity"]
    return vx.continuation(orbit, "forcing.frequency", (0.5, 1.6), peaks=wanted, progress=False)


@pytest.mark.thorough
def test_the_resonance_of_a_linear_oscillator_is_that_of_the_closed_form(resonance):
    found = {peak.quantity: peak for peak in resonance.peaks}
    assert len(resonance.peaks) == len(found) == 3
    exact = {
        "max_position[0]": (frequency_of(DAMPING), height_of(DAMPING)),
        "peak_to_peak[0]": (frequency_of(DAMPING), 2 * height_of(DAMPING)),
        "max_velocity[0]": (1.0, 1 / DAMPING),
    }
    for name, (frequency, height) in exact.items():
        peak = found[name]
        assert (peak.kind, peak.event) == ("maximum", "")
        assert peak.value == pytest.approx(frequency, abs=ROUNDING)
        assert peak.height == pytest.approx(height, rel=ROUNDING)
        assert float(peak.orbit.system.forcing.frequency) == peak.value
    assert "maximum 10.0125" in repr(found["max_position[0]"])
    assert resonance.bifurcations == []
    with pytest.raises(ValueError, match=r"one of `branch\.peaks`"):
        vx.peak_height(vx.Bifurcation(resonance, 0), linear(DAMPING))
    column = resonance.points.max_position.sel(mass=0)
    assert float(column.max()) == pytest.approx(height_of(DAMPING), rel=1e-9)


def damped_by_joint(frequency) -> vx.ImpactSystem:
    load = vx.Harmonic([0.5], frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, hysteresis=[vx.Jenkins(0, 1.0, 0.2)])


def fastest(frequency) -> float:
    """Largest velocity of a machine with a Jenkins element, once its motion is settled."""
    period = 2 * np.pi / frequency
    sol = vx.simulate(damped_by_joint(frequency), 0.0, 81 * period, max_events=1000)
    return float(sol.evaluate(period * np.linspace(80, 81, 20_001))[1].max())


@pytest.mark.slow
def test_velocities_of_machines_with_hysteresis_have_peaks_where_simulations_are_fastest():
    sol = vx.simulate(damped_by_joint(1.0), 0.0, 160 * np.pi, max_events=1000)
    orbit = vx.periodic_orbit(damped_by_joint(1.0), sol.x1, sol.v1)
    branch = vx.continuation(orbit, "forcing.frequency", (0.8, 1.4), peaks=["max_velocity"], progress=False)
    (peak,) = branch.peaks
    assert (peak.kind, peak.quantity, peak.event) == ("maximum", "max_velocity[0]", "")
    assert peak.height == pytest.approx(fastest(peak.value), rel=1e-7)
    assert peak.height > max(fastest(peak.value * factor) for factor in (0.997, 1.003))


@pytest.mark.thorough
@pytest.mark.parametrize("phase", [0.02, -0.02, 0.1])
def test_an_extreme_beside_the_beginning_of_the_cycle_is_found_on_either_side_of_it(phase):
    # At its resonance the velocity is in phase with the load: largest at the begin of the cycle, but for the phase.
    load = vx.Harmonic([1.0], 0.7, phase=[phase])
    orbit = vx.periodic_orbit(vx.ImpactSystem([1.0], [[DAMPING]], [[1.0]], load, []), [0.0], [0.0])
    wanted = ["max_velocity", "min_velocity"]
    branch = vx.continuation(orbit, "forcing.frequency", (0.5, 1.6), peaks=wanted, progress=False)
    found = {peak.quantity: peak for peak in branch.peaks}
    assert len(branch.peaks) == len(found) == 2
    for name, kind, sign in (("max_velocity[0]", "maximum", 1), ("min_velocity[0]", "minimum", -1)):
        assert found[name].kind == kind
        assert found[name].value == pytest.approx(1.0, abs=ROUNDING)
        assert found[name].height == pytest.approx(sign / DAMPING, rel=ROUNDING)


@pytest.mark.slow
def test_place_and_height_of_a_resonance_have_derivatives_by_the_machine(resonance):
    peak = next(one for one in resonance.peaks if one.quantity == "max_position[0]")
    height = lambda damping: vx.peak_height(peak, linear(damping))  # noqa: E731
    place = lambda damping: vx.bifurcation_value(peak, linear(damping))  # noqa: E731
    c = 0.12
    assert float(height(c)) == pytest.approx(height_of(c), rel=ROUNDING)
    assert float(place(c)) == pytest.approx(frequency_of(c), abs=ROUNDING)
    of_place = -c / 2 / frequency_of(c)
    of_height = -height_of(c) / c + height_of(c) ** 3 * c**3 / 4
    for derivative in (jax.grad, jax.jacfwd):
        assert float(derivative(place)(c)) == pytest.approx(of_place, rel=1e-11)
        assert float(derivative(height)(c)) == pytest.approx(of_height, rel=1e-11)


@pytest.mark.slow
def test_a_curve_follows_the_resonance_over_the_damping(resonance):
    peak = next(one for one in resonance.peaks if one.quantity == "max_position[0]")
    bounds = {"forcing.frequency": (0.5, 1.6), "damping[0][0]": (0.05, 0.5)}
    curve = vx.bifurcation_curve(peak, "damping[0][0]", bounds, progress=False)
    c = curve["damping[0][0]"].values
    np.testing.assert_allclose(curve["forcing.frequency"], frequency_of(c), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(curve.peak_height, height_of(c), rtol=ROUNDING)
    assert curve.attrs["quantity"] == "max_position[0]"
    assert curve.attrs["ends"] == '["bounds", "bounds"]'


@pytest.mark.slow
def test_both_peaks_of_the_best_absorber_are_equal():
    """O. Nishihara and T. Asami, J. Vib. Acoust. 124 (2002) 576: its tuning and damping in closed form."""
    mu = 0.1
    root = np.sqrt(4 + 3 * mu)
    tuning = (
        2
        / (1 + mu)
        * np.sqrt(2 * (16 + 23 * mu + 9 * mu**2 + 2 * (2 + mu) * root) / (3 * (64 + 80 * mu + 27 * mu**2)))
    )
    share = np.sqrt((8 + 9 * mu - 4 * root) / (1 + mu)) / 4
    k, c = mu * tuning**2, 2 * share * mu * tuning
    stiffness, damping = np.array([[1 + k, -k], [-k, k]]), np.array([[c, -c], [-c, c]])
    system = vx.ImpactSystem([1.0, mu], damping, stiffness, vx.Harmonic([1.0, 0.0], 0.7), [])
    orbit = vx.periodic_orbit(system, [0.0, 0.0], [0.0, 0.0])
    branch = vx.continuation(
        orbit, "forcing.frequency", (0.5, 1.6), peaks=["max_position[0]"], progress=False
    )
    assert [peak.kind for peak in branch.peaks] == ["maximum", "minimum", "maximum"]
    first, valley, second = branch.peaks
    assert first.height == pytest.approx(second.height, rel=1e-12)
    # A little above the fixed points, through which all dampers pass.
    assert valley.height < np.sqrt(1 + 2 / mu) < first.height < 1.002 * np.sqrt(1 + 2 / mu)


@pytest.mark.slow
def test_peaks_of_an_impact_oscillator_are_those_of_a_dense_branch():
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([0.5], 1.3), [vx.Stop(0, 1.0, "upper", 0.8)]
    )
    ds = vx.sweep(system, {"forcing.frequency": [1.3]}, progress=False)
    orbit = vx.periodic_orbit(system, ds.x.values[0], ds.v.values[0])
    wanted = ["peak_to_peak", "max_position"]
    branch = vx.continuation(orbit, "forcing.frequency", (0.6, 3.0), peaks=wanted, progress=False)
    # At the stop the largest position is constant, hence has no peak.
    assert {peak.quantity for peak in branch.peaks} == {"peak_to_peak[0]"}
    kinks = [peak for peak in branch.peaks if peak.event]
    (grazing,) = [point for point in branch.bifurcations if abs(point.value - 0.710687) < 1e-3]
    assert [(peak.event, peak.kind, peak.value) for peak in kinks] == [("gr", "maximum", grazing.value)]
    assert kinks[0].height == pytest.approx(2.0, abs=1e-9)
    for function in (vx.bifurcation_value, vx.peak_height):
        with pytest.raises(ValueError, match="has a kink"):
            function(kinks[0], system)
    peak = max((one for one in branch.peaks if not one.event), key=lambda one: one.height)
    near = peak.value - 2e-3, peak.value + 2e-3
    dense = vx.continuation(
        peak.orbit, "forcing.frequency", near, quantities=["peak_to_peak"], step=1e-4, progress=False
    )
    heights = dense.points.peak_to_peak.values[:, 0]
    k = int(np.nanargmax(heights))
    # The parabola through the three highest points.
    three = np.polyfit(dense.values[k - 1 : k + 2] - peak.value, heights[k - 1 : k + 2] - peak.height, 2)
    assert -three[1] / (2 * three[0]) == pytest.approx(0.0, abs=1e-7)
    assert three[2] - three[1] ** 2 / (4 * three[0]) == pytest.approx(0.0, abs=1e-11)


def test_names_of_quantities_are_checked():
    two = vx.ImpactSystem([1.0, 1.0], np.zeros((2, 2)), np.eye(2))
    found = checked_peak_quantities(["peak_to_peak", "max_position[1]"], two)
    assert [one.words for one in found] == ["peak_to_peak[0]", "peak_to_peak[1]", "max_position[1]"]
    for wanted, words in (
        (["peak_to_peek"], "did you mean"),
        (["max_position[2]"], "there are 2 masses"),
        ("max_position", "a list of names"),
    ):
        with pytest.raises(ValueError, match=words):
            checked_peak_quantities(wanted, two)
