"""A region chart shows every motion at its parameters, in colours that differ as greys too."""

import io
from itertools import pairwise

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import rgb_to_hsv, to_rgb

import vijax as vx

# Least difference of greys, from black 0 to white 1, that differ visibly in print.
GREY_STEP = 0.05
PLANE = ("forcing.frequency", "forcing.amplitude[0]")
MOTIONS = ("non_impacting", "periodic", "chattering", "non_periodic", "not_settled", "failed")


def chart(motion: list[list[int]], num_periods: list[list[int]], num_impacts: list) -> xr.Dataset:
    """A classified sweep of two quantities, the frequency in falling order."""
    flags = {"flag_values": np.arange(6, dtype=np.int8), "flag_meanings": " ".join(MOTIONS)}
    tables = {
        "motion": (PLANE, np.asarray(motion, np.int8), flags),
        "num_periods": (PLANE, num_periods),
        "num_impacts": ((*PLANE, "stop"), num_impacts),
    }
    frequency = np.arange(len(motion), 0, -1) / 10
    return xr.Dataset(tables, {PLANE[0]: frequency, PLANE[1]: 0.3 + 0.1 * np.arange(len(motion[0]))})


@pytest.fixture(scope="module")
def classes() -> xr.Dataset:
    """Frequencies 0.3, 0.2, 0.1 by two amplitudes; the motions of the six points differ except for one pair."""
    impacts = [[[0, 0], [1, 2]], [[1, 2], [-1, 3]], [[7, 8], [5, 5]]]
    return chart([[0, 1], [1, 2], [3, 4]], [[1, 1], [1, 2], [0, 0]], impacts)


def grey(color) -> float:
    return float(np.dot([0.299, 0.587, 0.114], to_rgb(color)))


def legend_colors(ax) -> dict:
    legend = ax.get_legend()
    names = [text.get_text() for text in legend.get_texts()]
    colors = (patch.get_facecolor() for patch in legend.get_patches())
    # Names of families have no colour.
    return {name: color for name, color in zip(names, colors, strict=True) if color[3]}


def drawn_classes(ax) -> dict[tuple[float, float], str]:
    """Legend entry for the colour of every cell, by the middle of the cell."""
    ax.figure.canvas.draw()
    (mesh,) = (c for c in ax.collections if isinstance(c, QuadMesh))
    corners = np.asarray(mesh.get_coordinates())
    middles = (corners[:-1, :-1] + corners[1:, 1:]) / 2
    words = {tuple(np.round(color, 6)): name for name, color in legend_colors(ax).items()}
    assert len(words) == len(legend_colors(ax))
    rows = np.round(mesh.get_facecolors().reshape(*middles.shape[:2], 4), 6)
    return {
        tuple(np.round(middle, 9)): words[tuple(color)]
        for middle, color in zip(middles.reshape(-1, 2), rows.reshape(-1, 4), strict=True)
    }


def test_a_region_chart_shows_every_motion_where_it_is(classes):
    ax = vx.plot.regions(classes)
    assert drawn_classes(ax) == {
        (0.3, 0.3): "no impact",
        (0.3, 0.4): "1 | 2 in 1",
        (0.2, 0.3): "1 | 2 in 1",
        (0.2, 0.4): r"$\infty$ | 3 in 2",
        (0.1, 0.3): "non-periodic",
        (0.1, 0.4): "not settled",
    }
    assert ax.get_xlabel() == r"Forcing frequency $\Omega$"
    assert ax.get_ylabel() == "Forcing amplitude $A_{0}$"
    assert ax.get_legend().get_title().get_text() == "impacts at stop 0 | 1\nin forcing periods"


def test_what_has_not_settled_is_hatched_and_nothing_else(classes):
    ax = vx.plot.regions(classes)
    (hatched,) = (c for c in ax.collections if isinstance(c, PolyCollection) and c.get_hatch())
    (box,) = (path.vertices for path in hatched.get_paths())
    np.testing.assert_allclose((box.min(axis=0), box.max(axis=0)), [(0.05, 0.35), (0.15, 0.45)], atol=1e-12)
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    hatches = [patch.get_hatch() for patch in ax.get_legend().get_patches()]
    assert [name for name, hatch in zip(names, hatches, strict=True) if hatch] == ["not settled"]


def test_the_legend_groups_motions_by_the_family_whose_hue_they_share(classes):
    ax = vx.plot.regions(classes)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "no impact", "repeats after 1", "1 | 2 in 1", "chatters, then sticks", r"$\infty$ | 3 in 2",
        "non-periodic", "not settled",
    ]  # fmt: skip
    hues = [rgb_to_hsv(legend_colors(ax)[name][:3])[0] for name in ("1 | 2 in 1", r"$\infty$ | 3 in 2")]
    np.testing.assert_allclose(hues, [rgb_to_hsv(to_rgb(f"C{k}"))[0] for k in (0, 1)], atol=1e-6)


def test_a_motion_is_named_in_the_plane_where_there_is_room():
    motion = np.ones((40, 40), int)
    motion[20:], motion[:3, :3] = 0, 3
    ones = np.ones((40, 40), int)
    ax = vx.plot.regions(chart(motion.tolist(), ones.tolist(), np.stack([ones, 2 * ones], axis=-1)))
    found = {text.get_text(): text.get_position()[0] for text in ax.texts}
    assert found.keys() == {"1 | 2 in 1", "no impact"}  # too few non-periodic points for a label
    assert found["no impact"] < 2.0 < found["1 | 2 in 1"]  # frequencies fall


def test_infinite_and_unknown_numbers_of_impacts_have_words():
    impacts = [[[1.0, 0.0], [np.inf, 12.0]], [[np.nan, np.nan], [np.nan, np.nan]]]
    drawn = drawn_classes(vx.plot.regions(chart([[1, 2], [1, 1]], [[1, 1], [3, 3]], impacts)))
    assert drawn == {
        (0.2, 0.3): "1 | 0 in 1",
        (0.2, 0.4): r"$\infty$ | 12 in 1",
        (0.1, 0.3): "not counted, in 3",
        (0.1, 0.4): "not counted, in 3",
    }


def test_a_region_chart_calls_the_rare_motions_other(classes):
    drawn = drawn_classes(vx.plot.regions(classes, max_classes=1))
    assert drawn[0.3, 0.3] == "no impact"
    assert drawn[0.3, 0.4] == drawn[0.2, 0.3] == "1 | 2 in 1"
    assert drawn[0.2, 0.4] == "other"
    assert drawn[0.1, 0.3] == "non-periodic"
    assert drawn[0.1, 0.4] == "not settled"


def test_the_colours_of_a_region_chart_differ_in_grey(classes):
    motion = [[0, 1, 1, 1], [1, 1, 1, 1], [1, 1, 2, 3]]
    impacts = np.stack([np.arange(12).reshape(3, 4), np.ones((3, 4), int)], axis=-1)
    ax = vx.plot.regions(chart(motion, np.ones((3, 4), int).tolist(), impacts.tolist()))
    greys = sorted(grey(color) for color in legend_colors(ax).values())
    assert len(greys) == 9
    assert min(b - a for a, b in pairwise(greys)) > GREY_STEP


def test_a_region_chart_goes_into_the_axes_given_and_can_be_printed(classes):
    figure, (left, right) = plt.subplots(1, 2)
    assert vx.plot.regions(classes, ax=right) is right
    assert not left.collections
    assert right.collections[0].get_rasterized()
    figure.savefig(io.BytesIO(), format="pdf")


def test_a_region_chart_of_anything_else_is_refused(classes):
    with pytest.raises(ValueError, match="needs the variable `num_periods`"):
        vx.plot.regions(classes.drop_vars("num_periods"))
    with pytest.raises(ValueError, match="needs two swept quantities, but there are"):
        vx.plot.regions(classes.isel({PLANE[0]: 0}))
    with pytest.raises(ValueError, match="needs two values or more of each quantity"):
        vx.plot.regions(classes.isel({PLANE[0]: [0]}))
    with pytest.raises(ValueError, match="Argument `max_classes` must be 0 or more, but is -1"):
        vx.plot.regions(classes, max_classes=-1)
    without_flags = classes.assign(motion=(PLANE, classes.motion.values))
    with pytest.raises(ValueError, match="must have the attributes `flag_values` and `flag_meanings`"):
        vx.plot.regions(without_flags)
