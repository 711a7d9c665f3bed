"""Insets enlarge what is drawn, where nothing else is."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import vijax as vx


def drawn():
    """A rising line, with a marker in its middle, a line without points and a vertical one."""
    ax = plt.subplots()[1]
    x = np.linspace(0.0, 1.0, 101)
    ax.plot(x, x, color="tab:red", linestyle="--", label="rising")
    ax.plot([0.5], [0.5], "o", label="middle")
    ax.plot([], [], label="nothing")
    ax.axvline(0.5, linewidth=0.5)
    ax.legend()
    return ax


def test_an_inset_has_the_lines_of_the_picture_and_the_limits_given():
    ax = drawn()
    small = vx.plot.inset(ax, (0.4, 0.6))
    assert small.get_xlim() == (0.4, 0.6)
    low, high = small.get_ylim()
    assert 0.38 < low < 0.4
    assert 0.6 < high < 0.62
    rising, middle, vertical = small.lines
    assert (rising.get_color(), rising.get_linestyle()) == ("tab:red", "--")
    np.testing.assert_array_equal(middle.get_xydata(), [[0.5, 0.5]])
    assert list(vertical.get_ydata()) == [0, 1]
    ax.figure.canvas.draw()
    # A vertical line spans the inset, whatever its limits.
    ends = vertical.get_transform().transform(vertical.get_xydata())
    np.testing.assert_allclose(ends[:, 1], small.bbox.intervaly)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["rising", "middle", "nothing"]


def test_an_inset_lies_in_an_empty_part_unless_a_place_is_given():
    ax = drawn()
    small = vx.plot.inset(ax, (0.4, 0.6))
    ax.figure.canvas.draw()
    frame = small.get_position()
    whole = ax.get_position()
    left, low = (frame.x0 - whole.x0) / whole.width, (frame.y0 - whole.y0) / whole.height
    # The line leaves two corners empty.
    assert (left < 0.4) != (low < 0.4)
    given = vx.plot.inset(ax, (0.4, 0.6), (0.3, 0.7), place=(0.5, 0.1, 0.3, 0.2))
    ax.figure.canvas.draw()
    assert given.get_ylim() == (0.3, 0.7)
    np.testing.assert_allclose((given.get_position().x0 - whole.x0) / whole.width, 0.5)


def test_insets_are_refused_where_nothing_is_drawn():
    ax = drawn()
    with pytest.raises(ValueError, match="Nothing is drawn for x in"):
        vx.plot.inset(ax, (2.0, 3.0))
    with pytest.raises(ValueError, match="a lower and a higher end"):
        vx.plot.inset(ax, (0.6, 0.4))
