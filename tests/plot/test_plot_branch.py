"""Pictures of branches: unbroken lines of impacts, stable and unstable, with their bifurcations."""

import json

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import PATH, SEEN, both_ways, branch_of, grey, named, points, words_of_legend
from exact_orbits import Table
from matplotlib.colors import same_color, to_hex, to_rgb

import vijax as vx

PALE = 0.2
# A velocity is the sum of an impact speed and the stop's velocity, a sum of a few products.
ROUNDING = 1e-14


def parts(ax, style: str, color: str = "black") -> list[list[tuple[float, float]]]:
    """Unbroken parts of the curves in a style and a colour, without those of the legend."""
    found = []
    for line in ax.lines:
        if (
            line.get_linestyle() == style
            and same_color(line.get_color(), color)
            and not line.get_label()[0].isalpha()
        ):
            xy = np.stack(line.get_data(), axis=1)
            gaps = np.flatnonzero(np.isnan(xy[:, 0]))
            found += [
                [tuple(row) for row in part[~np.isnan(part[:, 0])].tolist()] for part in np.split(xy, gaps)
            ]
    return [part for part in found if part]


# One impact at each stop, at the lower one first.
QUIET = [[(0.2, 0, 0.5), (0.7, 1, 0.25)], [(0.3, 0, 0.75), (0.8, 1, 0.5)], [(0.4, 0, 1.0), (0.9, 1, 0.75)]]


@pytest.mark.parametrize(("stop", "velocities"), [(0, [-0.5, -0.75, -1.0]), (1, [0.25, 0.5, 0.75])])
def test_the_line_of_an_impact_is_its_signed_velocity(stop, velocities):
    ax = vx.plot.branch(branch_of(QUIET), stop=stop)
    assert parts(ax, "-") == [list(zip([1.0, 2.0, 3.0], velocities, strict=True))]
    assert parts(ax, "--") == []
    assert ax.get_xlim() == (1.0, 3.0)
    assert ax.get_xlabel() == r"Forcing frequency $\Omega$"
    assert f"stop {stop}" in ax.get_ylabel()
    assert words_of_legend(ax) == ["stable"]


@pytest.mark.parametrize("at_fold", [True, False])
def test_a_line_is_dashed_behind_a_fold_whatever_rounding_says_there(at_fold):
    cycles = [[(0.2, 1, speed)] for speed in (0.1, 0.2, 0.3, 0.4, 0.5)]
    made = branch_of(
        cycles,
        ["", "", "fold", "", ""],
        [True, True, at_fold, False, False],
        values=[1.0, 2.0, 2.5, 2.0, 1.5],
    )
    ax = vx.plot.branch(made, stop=1)
    assert parts(ax, "-") == [[(1.0, 0.1), (2.0, 0.2), (2.5, 0.3)]]
    assert parts(ax, "--") == [[(2.5, 0.3), (2.0, 0.4), (1.5, 0.5)]]
    assert words_of_legend(ax) == ["stable", "unstable", "fold"]
    assert ax.get_xlim() == (1.0, 2.5)


def test_stable_and_unstable_parts_that_alternate_are_not_joined():
    stable = [True, True, False, True, True]
    ax = vx.plot.branch(branch_of([[(0.2, 1, 0.5)]] * 5, ["", "pd", "", "pd", ""], stable), stop=1)
    assert [[x for x, _ in part] for part in parts(ax, "-")] == [[1, 2], [4, 5]]
    assert [[x for x, _ in part] for part in parts(ax, "--")] == [[2, 3, 4]]


def test_lines_go_on_where_the_cycle_begins_with_another_impact():
    ahead = [
        [(0.02, 1, 0.5), (0.5, 1, 0.3)],
        [(0.01, 1, 0.6), (0.5, 1, 0.2)],
        [(0.5, 1, 0.1), (0.99, 1, 0.7)],
    ]
    expected = [[(1, 0.5), (2, 0.6), (3, 0.7)], [(1, 0.3), (2, 0.2), (3, 0.1)]]
    assert sorted(parts(vx.plot.branch(branch_of(ahead), stop=1), "-")) == sorted(expected)
    # Over two periods of the load: 1.99 is close to 0.01, 0.99 is not.
    longer = [[(0.01, 1, 0.5), (1.1, 1, 0.3)], [(1.05, 1, 0.2), (1.99, 1, 0.6)]]
    ax = vx.plot.branch(branch_of(longer, num_periods=2), stop=1)
    assert sorted(parts(ax, "-")) == [[(1, 0.3), (2, 0.2)], [(1, 0.5), (2, 0.6)]]


@pytest.mark.parametrize("is_told", [True, False])
def test_an_impact_comes_and_goes_without_speed_and_the_others_go_on(is_told):
    """The grazing point may or may not contain the impact."""
    alone, both = [(0.5, 1, 0.8)], [(0.1, 1, 0.05), (0.5, 1, 0.8)]
    grazing = [(0.1, 1, 0.0), (0.5, 1, 0.8)] if is_told else alone
    for way in (1, -1):
        made = branch_of(
            [alone, grazing, both, both][::way], ["", "gr", "", ""][::way], values=[1, 2, 3, 4][::way]
        )
        ax = vx.plot.branch(made, stop=1)
        light, strong = [(2, 0.0), (3, 0.05), (4, 0.05)], [(1, 0.8), (2, 0.8), (3, 0.8), (4, 0.8)]
        assert sorted(parts(ax, "-")) == [
            part[::way] for part in sorted([light, strong], key=lambda a: a[::way])
        ]
        (mark,) = named(ax, "grazing")
        assert points(mark) == {(2, 0.0), (2, 0.8)}


def test_bounces_of_a_chatter_come_and_go_and_its_lines_stay_whole():
    def chatter(begin, count):
        """Bounces that get lighter, down to the least counted one; then one unrelated impact."""
        bounces = [(begin + 0.2 * (1 - 0.5**i), 1, 0.5**i) for i in range(count)]
        return [*bounces, (begin + 0.4, 1, 0.3)]

    counts, begins = [6, 7, 6, 8], [0.1, 0.13, 0.17, 0.2]
    ax = vx.plot.branch(branch_of([chatter(*a) for a in zip(begins, counts, strict=True)]), stop=1)
    found = parts(ax, "-")
    assert sorted(part[0][1] for part in found) == sorted([0.5**i for i in range(6)] + [0.3])
    assert all(part == [(k, part[0][1]) for k in (1, 2, 3, 4)] for part in found)


def test_parts_without_impacts_are_left_out():
    cycles = [[(0.5, 1, 0.1)], [(0.5, 1, 0.0)], [], [], [], [(0.2, 1, 0.3)]]
    ax = vx.plot.branch(branch_of(cycles, ["", "gr", "", "fold", "gr", ""]), stop=1)
    assert parts(ax, "-") == [[(1, 0.1), (2, 0.0)], [(5, 0.0), (6, 0.3)]]
    # The fold is of orbits that are not drawn.
    assert words_of_legend(ax) == ["stable", "grazing"]


def test_nothing_to_draw_is_told():
    with pytest.raises(ValueError, match="There are no impacts at stop 1 to draw"):
        vx.plot.branch(branch_of([[(0.5, 0, 0.1)]] * 3), stop=1)
    with pytest.raises(ValueError, match="There are no impacts at stop 0 to draw"):
        vx.plot.branch([branch_of([[], []])] * 2)


def test_the_velocity_at_a_stop_that_moves_is_that_in_space():
    table = Table(1, 0.8, 9.81, 0.6)
    system = table.later(0.3).system  # at 0.7 of a flight before the impact
    values = table.frequency * np.array([1.0, 2.0])
    ax = vx.plot.branch(branch_of([[(0.7, 0, table.speed)]] * 2, values=values, system=system))
    # At twice the frequency the table moves twice as fast; the speed relative to it is the same.
    of_table = values * (table.speed - table.fall) / table.frequency
    (line,) = parts(ax, "-")
    np.testing.assert_allclose(line, np.stack([values, of_table - table.speed], axis=1), rtol=ROUNDING)


def test_the_last_point_of_a_closed_branch_is_joined_to_the_first():
    cycles = [[(0.5, 1, speed)] for speed in (0.1, 0.2, 0.3, 0.2)]
    ax = vx.plot.branch(branch_of(cycles, values=[1, 2, 1, 0], ends=json.dumps(["closed", "closed"])), stop=1)
    assert parts(ax, "-") == [[(1, 0.1), (2, 0.2), (1, 0.3), (0, 0.2), (1, 0.1)]]


def test_each_kind_of_bifurcation_has_its_mark_on_every_line():
    told = {
        "fold": "fold",
        "pd": "period doubling",
        "ns": "Neimark-Sacker",
        "bp": "branch point",
        "pitchfork": "pitchfork",
        "gr": "grazing",
        "double_impact": "double impact",
        "force_zero": "force zero",
        "chatter_completion": "chatter completion",
        "one of these days": "one of these days",
    }
    kinds, words = list(told), list(told.values())
    made = branch_of([[(0.2, 1, 0.5), (0.6, 1, 0.25)]] * len(kinds), kinds)
    ax = vx.plot.branch(made, stop=1)
    assert words_of_legend(ax) == ["stable", *words]
    marks = [line for kind in words for line in named(ax, kind)]
    assert [points(mark) for mark in marks] == [{(k, 0.5), (k, 0.25)} for k in range(1, len(kinds) + 1)]
    assert len({mark.get_marker() for mark in marks}) == len(kinds)


def test_a_dict_names_branches_in_the_legend():
    one, other = branch_of([[(0.2, 1, 0.5)]] * 3), branch_of([[(0.2, 1, 0.25)]] * 3)
    ax = vx.plot.branch({"1 in 2": one, "2 in 2": other}, stop=1)
    assert words_of_legend(ax) == ["1 in 2", "2 in 2", "stable"]
    unnamed = vx.plot.branch([one, other], stop=1)
    assert words_of_legend(unnamed) == ["branch 0", "branch 1", "stable"]
    for a, b in zip(ax.lines, unnamed.lines, strict=True):
        np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())
        assert same_color(a.get_color(), b.get_color())
    single = vx.plot.branch({"1 in 2": one}, stop=1, label="r = 0.7")
    assert words_of_legend(single) == ["r = 0.7, 1 in 2", "stable"]
    with pytest.raises(ValueError, match="empty"):
        vx.plot.branch({})


def test_several_branches_are_told_apart():
    other = branch_of([[(0.5, 1, 0.6)]] * 2, stable=[False, False], values=[0.5, 2.0])
    ax = vx.plot.branch([branch_of(QUIET), other], stop=1)
    assert words_of_legend(ax) == ["branch 0", "branch 1", "stable", "unstable"]
    first, second = (named(ax, f"branch {k}")[0].get_color() for k in (0, 1))
    assert abs(grey(first) - grey(second)) > PALE
    assert parts(ax, "-", first) == [[(1, 0.25), (2, 0.5), (3, 0.75)]]
    assert parts(ax, "--", second) == [[(0.5, 0.6), (2, 0.6)]]
    assert ax.get_xlim() == (0.5, 3.0)


@pytest.fixture(scope="module")
def swept() -> xr.Dataset:
    return vx.sweep(
        vx.models.wagg_bishop_b(1.0), {PATH: [0.8, 1.1, 1.4]}, transient=3, record=4, progress=False
    )


def test_a_sweep_is_paler_and_lies_under_its_branches(swept):
    alone = vx.plot.bifurcation(both_ways(swept), 1)
    _, ax = plt.subplots()
    before = ax.plot([1, 2], [0, 1], color="red")[0]
    vx.plot.branch(branch_of(QUIET), both_ways(swept), 1, ax=ax)
    curves = [
        line
        for line in ax.lines
        if line.get_linestyle() == "-" and line is not before and len(line.get_xdata()) > 2
    ]
    assert curves
    for words in ("swept down", "swept up"):
        (strong,), (pale,) = named(alone, words), named(ax, words)
        assert points(pale) == points(strong)
        assert grey(pale.get_color()) > grey(strong.get_color()) + PALE / 2
        assert same_color(pale.get_markerfacecolor(), pale.get_color())
        assert all(pale.get_zorder() < curve.get_zorder() for curve in curves)
    assert named(ax, "swept down")[0].get_markersize() > named(ax, "swept up")[0].get_markersize()
    assert same_color(before.get_color(), "red")
    assert ax.get_xlim() == (0.8, 3.0)
    assert words_of_legend(ax) == ["swept down", "swept up", "stable"]


@pytest.mark.parametrize("style", ["default", "dark_background"])
def test_all_stops_have_a_panel_each_and_one_legend(swept, style):
    """The impact at stop 0 vanishes at a grazing; the later fold is visible at stop 1 only."""
    cycles = [[(0.2, 0, speed), (0.7, 1, 0.5)] for speed in (0.4, 0.2, 0.0)] + [[(0.7, 1, 0.5)]] * 3
    made = branch_of(cycles, ["", "", "gr", "", "fold", ""])
    with plt.style.context(style):
        top, bottom = vx.plot.branch(made, both_ways(swept), stop=None)
        alone = vx.plot.branch(made, both_ways(swept), stop=1)
    assert words_of_legend(top) == ["swept down", "swept up", "stable", "grazing", "fold"]
    assert bottom.get_legend() is None
    for ax, stop in ((top, 0), (bottom, 1)):
        assert f"stop {stop}" in ax.get_ylabel()
    assert (top.get_xlabel(), bottom.get_xlabel()) == ("", alone.get_xlabel())
    drawn = [[np.asarray(line.get_xydata()).tolist() for line in ax.lines] for ax in (bottom, alone)]
    np.testing.assert_equal(*drawn)
    for text in top.get_legend().get_texts():
        assert (grey(text.get_color()) > SEEN) == (style == "dark_background")


def test_a_branch_goes_into_the_axes_given():
    _, (left, right) = plt.subplots(1, 2)
    assert vx.plot.branch(branch_of(QUIET), ax=right) is right
    assert right.lines
    assert not left.lines
    assert len(plt.get_fignums()) == 1


def test_what_does_not_belong_together_is_refused(swept):
    made = branch_of(QUIET)
    with pytest.raises(ValueError, match="Argument `branches` is empty: give one or more"):
        vx.plot.branch([])
    with pytest.raises(ValueError, match="Argument `stop` must lie in 0 to 1, but is 2"):
        vx.plot.branch(made, stop=2)
    other = vx.Branch(made.points.rename({PATH: "mass[0]"}).assign_attrs(path="mass[0]"))
    with pytest.raises(ValueError, match=r"these follow \['forcing.frequency', 'mass\[0\]'\]"):
        vx.plot.branch([made, other])
    with pytest.raises(ValueError, match=r"`mass\[0\]`, but sweeps \['forcing.frequency'\]"):
        vx.plot.branch(other, swept)
    with pytest.raises(ValueError, match=r"of one machine, but have \[1, 2\] stops"):
        vx.plot.branch(made, swept.isel(stop=[0]))
    grid = xr.concat([swept, swept], dim="x0[1]")
    with pytest.raises(ValueError, match="needs one swept quantity, but there are"):
        vx.plot.branch(made, grid)


def test_branches_are_seen_on_a_dark_background(swept):
    with plt.style.context("dark_background"):
        pictures = [
            vx.plot.branch(branch_of(QUIET, ["", "fold", ""]), both_ways(swept), stop=1),
            vx.plot.branch([branch_of(QUIET), branch_of(QUIET, stable=[False] * 3)], swept, stop=1),
        ]
    assert min(grey(line.get_color()) for ax in pictures for line in ax.lines) > SEEN


@pytest.mark.slow
def test_the_lines_of_a_branch_go_through_the_impacts_of_its_orbits():
    system = vx.models.wagg_bishop_a(0.8)
    orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
    made = vx.continuation(orbit, PATH, (0.7, 0.9), progress=False)
    ax = vx.plot.branch(made, stop=1)
    (line,) = parts(ax, "-")
    for k in (0, len(made) // 2, len(made) - 1):
        log = made.orbit(k).events
        (velocity,) = np.asarray(log.velocity_minus)[np.asarray((log.kind == vx.IMPACT) & (log.stop == 1))]
        np.testing.assert_allclose(line[k], (made.values[k], velocity), rtol=ROUNDING)


def test_a_branch_on_another_says_so_and_colours_differ_from_all_that_is_there(swept):
    moved = [[(t, j, 1.3 * v) for t, j, v in cycle] for cycle in QUIET]
    several = {"first": branch_of(QUIET), "twin": branch_of(QUIET), "other": branch_of(moved)}
    ax = vx.plot.bifurcation(both_ways(swept), 1)
    taken = {to_hex(line.get_color()) for line in ax.lines}
    vx.plot.branch(several, stop=1, ax=ax)
    assert words_of_legend(ax)[2:5] == ["first", "twin (on first)", "other"]
    drawn = [to_hex(named(ax, words)[0].get_color()) for words in words_of_legend(ax)[2:5]]
    assert len({*drawn, *taken}) == len(drawn) + len(taken)


def test_sweeps_under_branches_are_grey(swept):
    ax = vx.plot.branch({"first": branch_of(QUIET), "second": branch_of(QUIET)}, both_ways(swept), 1)
    red, green, blue = np.array(
        [to_rgb(named(ax, f"swept {way}")[0].get_color()) for way in ("down", "up")]
    ).T
    np.testing.assert_array_equal(red, green)
    np.testing.assert_array_equal(green, blue)
    assert len(set(red)) == 2


def test_markers_at_the_limits_are_whole():
    ax = vx.plot.branch(branch_of(QUIET, ["fold", "", ""]), stop=0)
    (marks,) = (line for line in named(ax, "fold") if len(line.get_xdata()))
    ax.figure.draw_without_rendering()
    box, frame = marks.get_clip_box(), ax.bbox
    assert box.x0 < frame.x0 - marks.get_markersize()
    assert box.x1 > frame.x1 + marks.get_markersize()
    ax.set_xlim(-5, 5)
    assert marks.get_clip_box().x0 == box.x0
