"""Manifolds are drawn in the phase plane, and over basins without changing their axes."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax.plot._colors import lightness_of
from vijax.plot._legend import add_legend


def curves(masses: int = 1) -> xr.Dataset:
    """Curves as from `vx.manifolds`: both sides of an unstable manifold, one of a stable one."""
    x = np.array([[0.0, 1.0, np.nan, 2.0], [0.0, -1.0, -2.0, np.nan], [0.0, 0.5, 1.0, 2.0]])
    states = np.repeat(x[..., None], masses, axis=2)
    columns = {
        "x0": (("branch", "point", "mass"), states),
        "v0": (("branch", "point", "mass"), states**2),
        "piece": (("branch", "point"), np.where(np.isnan(x), -1, 0)),
        "kind": ("branch", np.array(["unstable", "unstable", "stable"], np.dtypes.StringDType())),
    }
    return xr.Dataset(columns)


def test_kinds_differ_in_lightness_and_cuts_are_open():
    ax = vx.plot.manifolds(curves(), units={"length": "mm", "time": "s"})
    *lines, saddle = ax.lines
    colors = [mpl.colors.to_hex(line.get_color()) for line in lines]
    assert colors[0] == colors[1] != colors[2]
    assert np.isnan(lines[0].get_xdata()[2])
    assert set(np.asarray(saddle.get_xdata()).tolist()) == {0.0}
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert words == ["unstable manifold", "stable manifold", "saddle"]
    assert ax.get_xlabel().endswith("(mm)")


def test_axes_with_content_keep_their_limits_and_their_legend():
    ax = plt.subplots()[1]
    ax.plot([0, 0.1], [0, 0.1], label="basin")
    ax.set(xlim=(0, 0.1), ylim=(0, 0.1), xlabel="own")
    ax.legend()
    vx.plot.manifolds(curves(2), mass=1, ax=ax, color="red", linewidth=3)
    assert (*ax.get_xlim(), *ax.get_ylim()) == (0, 0.1, 0, 0.1)
    assert ax.get_xlabel() == "own"
    assert (ax.lines[1].get_color(), ax.lines[1].get_linewidth()) == ("red", 3)
    legends = [one for one in ax.get_children() if isinstance(one, mpl.legend.Legend)]
    words = [[text.get_text() for text in one.get_texts()] for one in legends]
    assert sorted(words) == [["basin"], ["unstable manifold", "stable manifold", "saddle"]]


def test_what_cannot_be_drawn_is_told():
    with pytest.raises(ValueError, match=r"`curves` must be what `vx.manifolds` returned"):
        vx.plot.manifolds(xr.Dataset({"x0": ("point", [0.0])}))
    with pytest.raises(ValueError, match="`mass` must lie in 0 to 0, but is 1"):
        vx.plot.manifolds(curves(), mass=1)


def test_legends_leave_small_areas_and_each_other_free():
    ax = plt.subplots(figsize=(9, 5))[1]
    share = np.zeros((20, 20))
    share[-3:, -3:] = 1  # a small basin in the upper right corner
    mesh = ax.pcolormesh(np.linspace(-3, 3, 21), np.linspace(-1, 5, 21), share)
    ax.plot([], [], "s", label="basin")
    add_legend(ax)
    vx.plot.manifolds(curves(), ax=ax)
    ax.figure.draw_without_rendering()
    boxes = [one.get_window_extent() for one in ax.get_children() if isinstance(one, mpl.legend.Legend)]
    assert len(boxes) == 2
    assert not boxes[0].overlaps(boxes[1])
    low, high = mesh.get_transform().transform([(2.1, 4.1), (3, 5)])
    assert not any(box.overlaps(mpl.transforms.Bbox([low, high])) for box in boxes)


def test_unstable_manifolds_are_light_on_a_dark_background():
    with plt.style.context("dark_background"):
        ax = vx.plot.manifolds(curves())
        assert 0.7 < lightness_of(ax.lines[0].get_color()) < lightness_of(ax.lines[2].get_color())
