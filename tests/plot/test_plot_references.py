"""What pictures say beside the data: natural frequencies, percentages, single points beside clouds."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import vijax as vx
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
