"""What pictures say beside the data: natural frequencies, percentages, single points beside clouds."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import vijax as vx
from vijax.plot._grazing_lines import grazing_values
from vijax.plot._percent import percent
from vijax.plot._resonances import natural_frequencies


def test_natural_frequencies_are_those_of_the_closed_form():
    # Two equal masses between walls by three equal springs: 1 and sqrt 3; without the outer ones 0 and sqrt 2.
    np.testing.assert_allclose(
        natural_frequencies(np.ones(2), np.array([[2.0, -1.0], [-1.0, 2.0]])), [1, np.sqrt(3)], rtol=1e-14
    )
    np.testing.assert_allclose(
        natural_frequencies(np.ones(2), np.array([[1.0, -1.0], [-1.0, 1.0]])), [np.sqrt(2)], rtol=1e-14
    )


def test_resonances_are_drawn_on_request_along_the_frequency_alone():
    values = {"forcing.frequency": [0.5, 1.0, 1.5]}
    ds = vx.sweep(vx.models.wagg_bishop_a(0.8), values, transient=2, record=2, progress=False)
    system = vx.system_of(ds)
    known = natural_frequencies(np.asarray(system.mass), np.asarray(system.stiffness))
    ax = vx.plot.bifurcation(ds, resonances=True)
    (left, right), lines = ax.get_xlim(), [line for line in ax.lines if list(line.get_ydata()) == [0, 1]]
    inside = known[(known >= left) & (known <= right)]
    assert inside.size
    np.testing.assert_allclose([line.get_xdata()[0] for line in lines], inside)
    assert "natural frequency" in [text.get_text() for text in ax.get_legend().get_texts()]
    other = vx.sweep(
        vx.models.wagg_bishop_a(0.8),
        {"forcing.amplitude[0]": [0.4, 0.5]},
        transient=2,
        record=2,
        progress=False,
    )
    with pytest.raises(ValueError, match=r"draws natural frequencies along `forcing\.frequency`"):
        vx.plot.bifurcation(other, resonances=True)


def oscillator(stops, **load):
    load = {"amplitude": [1.0], "frequency": 0.5} | load
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic(**load), stops)


def test_the_motion_without_impacts_grazes_where_its_closed_form_says():
    # |1 - W^2 + 0.1 i W| = 1 / s: two frequencies for each stop at distance s.
    both = oscillator([vx.Stop(0, 2.0, "upper", 0.8), vx.Stop(0, -3.0, "lower", 0.8)])
    expected = [np.roots([1, 0.1**2 - 2, 1 - 1 / s**2]) ** 0.5 for s in (2.0, 3.0)]
    found = grazing_values(both, "forcing.frequency", 0.1, 2.0)
    np.testing.assert_allclose(found, np.sort(np.concatenate(expected)), rtol=1e-9)


def test_a_stop_behind_a_compliant_one_that_is_passed_is_not_grazed_by_the_motion_without_it():
    wall, soft = vx.Stop(0, 3.0, "upper", 0.8), vx.CompliantStop(0, 2.0, "upper", 1.0)
    alone = grazing_values(oscillator([soft]), "forcing.frequency", 0.1, 2.0)
    assert alone.size == 2
    np.testing.assert_array_equal(
        grazing_values(oscillator([wall, soft]), "forcing.frequency", 0.1, 2.0), alone
    )
    front = vx.Stop(0, 1.5, "upper", 0.8)
    assert grazing_values(oscillator([front, soft]), "forcing.frequency", 0.1, 2.0).size == 4


def test_grazing_under_a_wave_form_is_refused():
    wave = vx.Waveform([0.0, 3.0], [[1.0], [-1.0]], 0.5)
    for load in (wave, vx.Harmonic([1.0], 0.5) + wave, vx.Harmonic([1.0], 0.5) + vx.Harmonic([1.0], 0.7)):
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 2.0, "upper", 0.8)])
        with pytest.raises(ValueError, match="loads of one frequency alone"):
            grazing_values(system, "damping[0][0]", 0.05, 0.2)


def test_a_motion_that_reaches_no_stop_or_always_one_has_no_grazing():
    assert (
        grazing_values(oscillator([vx.Stop(0, 50.0, "upper", 0.8)]), "forcing.frequency", 0.1, 2.0).size == 0
    )
    assert (
        grazing_values(oscillator([vx.Stop(0, 0.0, "upper", 0.8)]), "forcing.frequency", 0.1, 2.0).size == 0
    )
    assert grazing_values(oscillator([]), "forcing.frequency", 0.1, 2.0).size == 0


def test_grazing_of_a_stop_that_moves_and_of_a_mean_load():
    moving = oscillator([vx.Stop(0, 2.0, "upper", 0.8, motion=vx.Harmonic([0.3], 0.5))])
    # |a X - 0.3| = 2, for the response X to a unit load.
    response = 1 / (1 - 0.25 + 0.05j)
    expected = np.roots([abs(response) ** 2, -0.6 * response.real, 0.09 - 4]).max()
    found = grazing_values(moving, "forcing.amplitude[0]", 0.5, 3.0)
    np.testing.assert_allclose(found, [expected], rtol=1e-9)
    shifted = oscillator([vx.Stop(0, 2.0, "upper", 0.8)], mean=[0.5])
    found = grazing_values(shifted, "forcing.amplitude[0]", 0.5, 3.0)
    np.testing.assert_allclose(found, [1.5 / abs(response)], rtol=1e-9)


@pytest.mark.thorough
def test_grazing_of_a_contact_between_masses_separates_impacts_from_none():
    stops = [vx.Contact({0: 1.0, 1: -1.0}, 0.4, restitution=0.7)]
    load = vx.Harmonic(amplitude=[0.5, 0.0], frequency=0.6)
    system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops)
    (value,) = grazing_values(system, "forcing.amplitude[0]", 0.01, 2.0)
    values = {"forcing.amplitude[0]": value * np.array([1 - 1e-3, 1 + 1e-3])}
    ds = vx.sweep(system, values, transient=300, record=5, progress=False)
    below, above = ds.num_impacts.sum("stop").values.astype(int)
    assert below == 0 < above


def test_grazing_is_drawn_on_request_and_refused_without_a_closed_form():
    system = oscillator([vx.Stop(0, 2.0, "upper", 0.8)])
    ds = vx.sweep(system, {"forcing.frequency": [0.5, 0.8, 1.3]}, transient=2, record=2, progress=False)
    ax = vx.plot.bifurcation(ds, grazing=True)
    lines = [line.get_xdata()[0] for line in ax.lines if list(line.get_ydata()) == [0, 1]]
    np.testing.assert_allclose(lines, grazing_values(system, "forcing.frequency", 0.5, 1.3))
    assert "grazing without impacts" in [text.get_text() for text in ax.get_legend().get_texts()]
    with pytest.raises(ValueError, match="needs a linear machine"):
        grazing_values(vx.models.friction_oscillator(0.8, 1.5), "forcing.frequency", 0.5, 1.0)
    loose = vx.ImpactSystem([1.0], [[0.1]], [[0.0]], vx.Harmonic([1.0], 0.5), system.stops)
    with pytest.raises(ValueError, match="no spring holds some of the masses"):
        grazing_values(loose, "forcing.frequency", 0.5, 1.0)


def test_percentages_have_the_digits_that_their_errors_leave():
    assert percent(0.4321, 0.052) == "43 ± 5 %"
    assert percent(0.4321, 0.0034) == "43.2 ± 0.3 %"
    assert percent(0.4321, 0.12) == "43 ± 12 %"
    assert percent(0.00321, 0.0004) == "0.32 ± 0.04 %"
    assert percent(1.0, 0.0) == "100 %"
    assert percent(0.167) == "17 %"
    assert percent(0.001) == "< 1 %"
    assert percent(0.9999) == "> 99 %"


def test_one_point_beside_a_cloud_of_thousands_is_seen():
    rng = np.random.default_rng(0)
    cloud = rng.uniform(size=(4000, 1)), rng.uniform(size=(4000, 1))
    ax = vx.plot.section({"cycle": (np.zeros((1, 1)), np.zeros((1, 1))), "chaos": cloud})
    one, many = ax.lines
    assert one.get_markersize() == 3 * many.get_markersize()
    handles = [handle.get_markersize() for handle in ax.get_legend().legend_handles]
    assert handles == [7.0, 7.0]
    plt.close("all")
