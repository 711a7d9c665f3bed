"""A picture of basins shows each start in the colour of its attractor, and the section points of the attractors."""

import io

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import grey, words_of_legend
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import same_color
from matplotlib.lines import Line2D

import vijax as vx

# Least difference in one of red, green and blue, from 0 to 1, of colours that differ visibly on a screen.
COLOUR_STEP = 0.15
# Least difference of greys, from black 0 to white 1, that differ visibly in print.
GREY_STEP = 0.06
MOTIONS = ("non_impacting", "periodic", "chattering", "non_periodic", "not_settled", "failed")
RIGHT, UP = "v0[0]", "x0[1]"


def basins(label, attractors: int = 3) -> xr.Dataset:
    """Basins over v0[0] and x0[1], with up to three kinds of attractors."""
    label = np.asarray(label)
    flags = {"flag_values": np.arange(6, dtype=np.int8), "flag_meanings": " ".join(MOTIONS)}
    kinds = np.resize([1, 3, 0], attractors)
    section_x = np.full((attractors, 3, 2), np.nan)
    section_v = np.full((attractors, 3, 2), np.nan)
    for k in range(attractors):
        section_x[k, : 1 + k % 3] = 0.1 * (k + 1)
        section_v[k, : 1 + k % 3] = 0.2
    counts = np.array([(label == k).sum() for k in range(attractors)])
    return xr.Dataset(
        {
            "label": ((RIGHT, UP), label),
            "motion": (("attractor",), kinds.astype(np.int8), flags),
            "num_periods": (("attractor",), np.where(kinds == 3, 0, 2)),
            "num_impacts": (("attractor", "stop"), np.where(kinds == 1, [[1.0], [3.0]], 0).T),
            "share": (("attractor",), counts / label.size),
            "section_x": (("attractor", "section", "mass"), section_x),
            "section_v": (("attractor", "section", "mass"), section_v),
        },
        {RIGHT: np.linspace(0.5, 0.0, label.shape[0]), UP: np.linspace(0.0, 0.5, label.shape[1])},
    )


PLANE = [[0, 0, 0, -1], [0, 1, 1, 1], [2, 2, 0, 0]]


def colors_of_cells(ax) -> dict[tuple[float, float], tuple]:
    ax.figure.canvas.draw()
    (mesh,) = (c for c in ax.collections if isinstance(c, QuadMesh))
    corners = np.asarray(mesh.get_coordinates())
    middles = (corners[:-1, :-1] + corners[1:, 1:]) / 2
    colors = mesh.get_facecolors().reshape(-1, 4)
    return {tuple(np.round(m, 9)): tuple(c) for m, c in zip(middles.reshape(-1, 2), colors, strict=True)}


def color_of_entry(ax, words: str):
    legend = ax.get_legend()
    (place,) = (k for k, text in enumerate(legend.get_texts()) if text.get_text() == words)
    return legend.get_patches()[place].get_facecolor()


@pytest.mark.parametrize("style", ["default", "dark_background"])
def test_every_start_has_the_colour_of_its_attractor(style):
    with plt.style.context(style):
        ax = vx.plot.basins(basins(PLANE))
        names = {0: "1 | 3 in 2, 50 %", 1: "non-periodic, 25 %", 2: "no impact, 17 %", -1: "not known"}
        assert words_of_legend(ax) == list(names.values())
        cells = colors_of_cells(ax)
        ds = basins(PLANE)
        for right in ds[RIGHT].values:
            for up in ds[UP].values:
                name = names[int(ds.label.sel({RIGHT: right, UP: up}))]
                cell = cells[tuple(np.round((right, up), 9))]
                assert same_color(cell, color_of_entry(ax, name))


def test_starts_that_lead_to_no_known_attractor_are_hatched_in_the_plane_and_the_legend():
    ax = vx.plot.basins(basins(PLANE))
    (hatched,) = (c for c in ax.collections if isinstance(c, PolyCollection) and c.get_hatch())
    (cell,) = hatched.get_paths()
    # Last cell of the first row: v0[0] from 0.375 to 0.625, x0[1] from 5/12 to 7/12.
    assert cell.get_extents().extents == pytest.approx((0.375, 5 / 12, 0.625, 7 / 12))
    assert [patch.get_hatch() for patch in ax.get_legend().get_patches()] == [None] * 3 + [
        hatched.get_hatch()
    ]
    assert not [c for c in vx.plot.basins(basins(np.abs(PLANE))).collections if c.get_hatch()]


def test_axes_and_legend_say_what_is_drawn():
    ax = vx.plot.basins(basins(PLANE))
    assert ax.get_xlabel() == r"Start velocity $\dot x_{0}$"
    assert ax.get_ylabel() == "Start position $x_{1}$"
    assert ax.get_legend().get_title().get_text().startswith("impacts at stop 0 | 1\nin forcing periods")


def test_the_sections_of_the_attractors_are_drawn_where_they_are():
    ax = vx.plot.basins(basins(PLANE))
    drawn = [list(zip(*(np.asarray(a).tolist() for a in line.get_data()), strict=True)) for line in ax.lines]
    assert drawn == [[(0.2, 0.1)], [(0.2, 0.2)] * 2, [(0.2, pytest.approx(0.3))] * 3]
    assert len({line.get_marker() for line in ax.lines}) == 3
    assert not vx.plot.basins(basins(PLANE), points=False).lines


def test_what_lies_outside_of_the_plane_changes_neither_it_nor_the_legend():
    ds = basins(PLANE)
    far = ds.assign(section_x=ds.section_x + 10)
    inside, outside = vx.plot.basins(ds), vx.plot.basins(far)
    # The limits are half a cell beyond the first and the last start.
    for ax in (inside, outside):
        np.testing.assert_allclose([*ax.get_xlim(), *ax.get_ylim()], [-0.125, 0.625, -1 / 12, 7 / 12])
    assert [len(line.get_xdata()) for line in outside.lines] == [0, 0, 0]
    marks = [
        [h for h in ax.get_legend().findobj(Line2D) if h.get_marker() != "None"] for ax in (inside, outside)
    ]
    assert [len(of_axes) for of_axes in marks] == [3, 0]


def test_attractors_beyond_those_with_a_colour_are_others():
    label = np.arange(12).reshape(4, 3) % 10
    ax = vx.plot.basins(basins(label, 10))
    words = words_of_legend(ax)
    assert len(words) == 9
    assert words[-1] == "other"
    patches = [patch.get_facecolor()[:3] for patch in ax.get_legend().get_patches()]
    apart = np.abs(np.array(patches)[:, None] - np.array(patches)[None]).max(axis=2)
    assert (apart + np.eye(len(patches))).min() > COLOUR_STEP
    # The colours differ as greys in print, the first ones most, and black points with white edges are visible on all.
    greys = [*map(grey, patches)]
    assert np.diff(sorted(greys)).min() > GREY_STEP
    assert np.diff(sorted(greys[:4])).min() > 2 * GREY_STEP
    assert min(map(grey, patches)) > 0.3
    assert words_of_legend(vx.plot.basins(basins(label, 10), max_attractors=1))[1:] == ["other"]


def test_a_picture_of_basins_goes_into_the_axes_given_and_can_be_printed():
    figure, (left, right) = plt.subplots(1, 2)
    assert vx.plot.basins(basins(PLANE), ax=right) is right
    assert not left.collections
    assert right.collections[0].get_rasterized()
    figure.savefig(io.BytesIO(), format="pdf")


def test_a_picture_of_anything_else_is_refused():
    ds = basins(PLANE)
    with pytest.raises(ValueError, match="needs the variable `label`"):
        vx.plot.basins(ds.drop_vars("label"))
    with pytest.raises(ValueError, match="needs two start quantities, but there are"):
        vx.plot.basins(ds.isel({RIGHT: 0}))
    with pytest.raises(ValueError, match="two values or more of each quantity"):
        vx.plot.basins(ds.isel({RIGHT: [0]}))
    with pytest.raises(ValueError, match="Argument `max_attractors` must lie in 0 to 8, but is 9"):
        vx.plot.basins(ds, max_attractors=9)
