"""Chaotic parts of bifurcation diagrams show their density; lines stay opaque."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import PATH, both_ways, grey

import vijax as vx
from vijax.plot._scattered import is_scattered

COLUMNS, RECORDED = 200, 50
# Ordinates below this are dense, those of the line are 2.
DENSE = 0.1


def diagram_of(seed: int = 0) -> xr.Dataset:
    """Sweep of a line, then of chaos: half of its impacts are slower than `DENSE`, the others are spread up to 1."""
    rng = np.random.default_rng(seed)
    half = COLUMNS // 2
    fast = rng.uniform(0.0, 1.0, (half, RECORDED))
    chaos = np.where(rng.uniform(size=fast.shape) < 0.5, DENSE * fast, fast)
    velocity = np.concatenate([np.full((half, RECORDED), 2.0), chaos])
    stop = np.zeros(velocity.shape, int)
    return xr.Dataset(
        {
            "impact_velocity": ((PATH, "impact"), velocity),
            "impact_stop": ((PATH, "impact"), stop),
            "num_impacts": ((PATH, "stop"), np.full((COLUMNS, 1), RECORDED)),
            "result": (PATH, np.zeros(COLUMNS, int)),
            "stop_mass": ("stop", [0]),
        },
        {PATH: np.linspace(1.0, 2.0, COLUMNS)},
        {"path": PATH},
    )


def darkness(ax, low: float, high: float) -> float:
    """Share of ink in the part of a drawing with chaos between two ordinates."""
    ax.set_ylim(0.0, 2.1)
    ax.set_axis_off()
    figure = ax.figure
    figure.canvas.draw()
    picture = np.asarray(figure.canvas.buffer_rgba())[..., 0] / 255
    (left, bottom), (right, top) = ax.transData.transform([[1.6, low], [1.9, high]]).round().astype(int)
    return float(1 - picture[len(picture) - top : len(picture) - bottom, left:right].mean())


def test_lines_are_opaque_and_chaos_is_darker_where_it_is_dense():
    ax = vx.plot.bifurcation(diagram_of())
    line, *chaos = [one for one in ax.lines if one.get_marker() == "."]
    assert set(np.asarray(line.get_ydata())) == {2.0}
    assert line.get_alpha() is None
    assert sum(len(np.asarray(one.get_xdata())) for one in chaos) == COLUMNS // 2 * RECORDED
    dense, sparse = darkness(ax, 0.02, 0.08), darkness(ax, 0.3, 0.9)
    assert 0.1 < sparse < 0.5 * dense
    assert dense < 0.99
    plt.close("all")


def test_the_given_look_is_kept():
    ax = vx.plot.bifurcation(diagram_of(), alpha=0.5, markersize=3.0)
    marks = [one for one in ax.lines if one.get_marker() == "."]
    assert {one.get_alpha() for one in marks} == {0.5}
    assert {one.get_markersize() for one in marks} == {3.0}
    plt.close("all")


def test_chaos_is_seen_on_black_and_under_the_sweep_up():
    with plt.style.context("dark_background"):
        ax = vx.plot.bifurcation(both_ways(diagram_of()))
        chaos = [one for one in ax.lines if one.get_alpha() is not None]
        sizes = {one.get_color(): one.get_markersize() for one in chaos}
        assert len(sizes) == 2
        assert max(sizes, key=grey) == min(sizes, key=sizes.get)
        plt.close("all")


@pytest.mark.parametrize(
    ("what", "repeats"),
    [("chaos", False), ("orbits of 20 impacts", True), ("few points", True), ("chatter", True)],
)
def test_motions_that_repeat_are_lines(what, repeats):
    rng = np.random.default_rng(1)
    count = 2 if what == "few points" else 100
    own = {
        "orbits of 20 impacts": np.tile(rng.uniform(size=(count, 20)), 5),
        "chatter": 0.5 ** np.arange(100),
    }
    y = np.broadcast_to(own.get(what, rng.uniform(size=(count, 100))), (count, 100)).ravel()
    x = np.repeat(np.arange(count), 100)
    assert is_scattered(x, y).any() != repeats
