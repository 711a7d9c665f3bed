"""Bifurcation curves are drawn in their plane, with their special points."""

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
import xarray as xr

import vijax as vx

FREQUENCY, POSITION = "forcing.frequency", "stops[0].position"


def curve(kind: str, special: list[str], second: str = POSITION) -> xr.Dataset:
    """A curve as from `vx.bifurcation_curve`."""
    w = np.linspace(0.8, 1.1, len(special))
    columns = {FREQUENCY: ("point", w), second: ("point", w**2), "special": ("point", np.array(special))}
    return xr.Dataset(columns, attrs={"kind": kind}).set_coords([FREQUENCY, second])


def test_kinds_have_colours_and_special_points_marks():
    two = [curve("fold", ["", "cusp", "", ""]), curve("gr", ["", "", "resonant_grazing"])]
    ax = vx.plot.curves([*two, curve("fold", ["", "", "cusp"])], units={"time": "s"})
    lines = [line for line in ax.lines if line.get_linestyle() != "None"]
    marks = [line for line in ax.lines if line.get_linestyle() == "None"]
    np.testing.assert_array_equal(lines[1].get_xydata(), np.stack([two[1][FREQUENCY], two[1][POSITION]], 1))
    colors = [mpl.colors.to_hex(line.get_color()) for line in lines]
    assert colors[0] == colors[2] != colors[1]
    assert [len(mark.get_xdata()) for mark in marks] == [2, 1]
    assert marks[0].get_marker() != marks[1].get_marker()
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert words == ["fold", "grazing", "cusp", "resonant grazing"]
    assert ax.get_xlabel().endswith("(rad/s)")


def test_words_of_matplotlib_are_its_own():
    ax = vx.plot.curves(curve("pd", ["", ""]), color="red", linewidth=3)
    assert (ax.lines[0].get_color(), ax.lines[0].get_linewidth()) == ("red", 3)


def test_what_cannot_be_drawn_is_told():
    with pytest.raises(ValueError, match="Argument `curves` is empty: give one or more"):
        vx.plot.curves([])
    with pytest.raises(ValueError, match="one plane of two parameters"):
        vx.plot.curves([curve("fold", ["", ""]), curve("fold", ["", ""], "mass[0]")])
