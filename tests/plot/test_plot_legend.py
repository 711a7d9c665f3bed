"""Legends leave the axes their size, and stand where they cover nothing."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawings import branch_of

import vijax as vx
from vijax.plot._axes import break_long_labels, create_axes
from vijax.plot._legend import add_legend

QUIET = [[(0.2, 0, 0.5), (0.7, 1, 0.25)], [(0.3, 0, 0.75), (0.8, 1, 0.5)], [(0.4, 0, 1.0), (0.9, 1, 0.75)]]
# Sizes of axes after layouts, relative.
LAYOUT = 5e-3


def size_of(ax) -> np.ndarray:
    """Width and height of axes in inches, after the layout."""
    ax.figure.draw_without_rendering()
    return np.array(ax.get_window_extent().size) / ax.figure.dpi


def filled(ax, words: str = "a curve"):
    """Axes that a curve fills."""
    t = np.linspace(0, 200, 4001)
    ax.plot(t, np.sin(t), label=words)
    ax.plot(t, np.cos(1.1 * t), label="another curve")
    return ax


@pytest.mark.parametrize("draw", [filled, lambda ax: vx.plot.branch(branch_of(QUIET), ax=ax)])
def test_axes_keep_their_size_in_new_figures_and_in_panels(draw):
    sizes = []
    for is_shown in (False, True):
        _, (left, right) = plt.subplots(1, 2, figsize=(6.5, 2.6), layout="constrained")
        new = create_axes()
        for ax in (left, right, new):
            draw(ax)
            if ax.get_legend():
                ax.get_legend().remove()
            add_legend(ax, is_shown=is_shown)
            assert (ax.get_legend() is not None) == is_shown
        sizes.append([size_of(ax) for ax in (left, right, new)])
        if is_shown:
            for ax in (left, right):
                legend, frame = ax.get_legend().get_window_extent(), ax.get_window_extent()
                assert frame.x0 <= legend.x0 < legend.x1 <= frame.x1
                assert frame.y0 <= legend.y0 < legend.y1 <= frame.y1
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=LAYOUT)


def test_a_legend_stands_where_nothing_is_drawn_and_beside_a_full_picture_once():
    empty = create_axes()
    empty.plot([0, 1, 2], [1, 0, 0], label="low")
    empty.plot([0, 1, 2], [1, 1, 0], label="high")
    add_legend(empty)
    legend = empty.get_legend()
    width = empty.figure.get_size_inches()[0]
    assert legend.get_frame_on()
    full = filled(create_axes())
    for _ in range(3):
        add_legend(full)
    wider = full.figure.get_size_inches()[0]
    full.figure.draw_without_rendering()
    legend = full.get_legend()
    extent, apart = legend.get_window_extent(), legend.borderaxespad * legend.prop.get_size() / 72
    assert extent.x0 >= full.get_window_extent().x1
    assert wider - width == pytest.approx(extent.width / full.figure.dpi + apart, rel=LAYOUT)


def test_a_legend_of_a_panel_takes_small_letters_and_columns_where_it_is_long():
    ax = plt.subplots(figsize=(3.2, 2.0), layout="constrained")[1]
    for k in range(14):
        ax.plot([0, 1], [k, k], label=f"motion {k}")
    add_legend(ax)
    legend, frame = ax.get_legend().get_window_extent(), ax.get_window_extent()
    assert legend.height < frame.height
    assert legend.width < frame.width
    assert len(ax.get_legend().get_texts()) == 14


def test_over_an_area_that_fills_the_axes_a_legend_keeps_its_letters_and_avoids_the_lines():
    _, ax = plt.subplots(figsize=(9, 5))
    ax.pcolormesh(np.arange(11.0), np.arange(11.0), np.zeros((10, 10)))
    ax.plot([0.0, 10.0], [9.5, 9.5], label="a line above")
    add_legend(ax)
    legend, frame = ax.get_legend(), ax.get_window_extent()
    assert legend.get_texts()[0].get_fontsize() == mpl.rcParams["font.size"]
    assert legend.get_window_extent().y1 < frame.y0 + 0.95 * frame.height


def test_pictures_without_a_legend_have_none():
    assert vx.plot.branch(branch_of(QUIET), legend=False).get_legend() is None
    points = np.zeros((3, 1)), np.ones((3, 1))
    assert vx.plot.section({"a": points, "b": points}, legend=False).get_legend() is None
    assert vx.plot.section({"a": points, "b": points}).get_legend() is not None


def test_a_long_label_is_broken_in_low_axes_but_not_within_a_formula():
    words = "Speed of approach $v_0 + v_1$ before impact at contact 0"
    for height, lines in ((6.0, 1), (2.0, 2)):
        ax = plt.subplots(figsize=(3.0, height))[1]
        ax.set_ylabel(words)
        break_long_labels([ax])
        shown = ax.get_ylabel()
        assert shown.replace("\n", " ") == words
        assert len(shown.split("\n")) == lines
        assert all(line.count("$") % 2 == 0 for line in shown.split("\n"))
