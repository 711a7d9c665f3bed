"""Time series and phase portraits show the motion, its events, and the sticking phases."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawings import discs, events, named, words_of_legend
from matplotlib.collections import LineCollection
from shaken import MAGNIFIED, ball, table

import vijax as vx

END = 25.0
SAMPLES = 100


@pytest.fixture(scope="module")
def held() -> vx.Solution:
    """A mass that sticks at the start, is released, and sticks again."""
    load = vx.Harmonic([1.0], 0.5)
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [vx.Stop(0, 0.0, "upper", 0.5)])
    return vx.simulate(system, 0.0, END)


@pytest.fixture(scope="module")
def sticking() -> vx.Solution:
    """Case (b) of the paper, where both masses stick."""
    return vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)


def test_a_time_series_is_the_motion_and_meets_the_events_exactly(held):
    line = vx.plot.time_series(held, num_samples=SAMPLES).lines[0]
    t, x = line.get_data()
    np.testing.assert_array_equal(x, held.evaluate(t)[0][:, 0])
    events = np.asarray(held.events.t[: int(held.num_events)])
    assert len(events) > 3
    assert np.isin(events, t).all()
    assert np.isin(np.linspace(0.0, END, SAMPLES), t).all()
    assert (np.diff(t) >= 0).all()


def test_a_time_series_draws_every_mass_and_every_stop():
    sol = vx.simulate(vx.models.wagg_bishop_b(0.8), 0.0, END)
    ax = vx.plot.time_series(sol, num_samples=SAMPLES)
    masses, stops = ax.lines[:2], ax.lines[2:4]
    assert [line.get_ydata()[0] for line in stops] == [-0.3, 0.1]
    for stop, mass in zip(stops, masses, strict=True):
        np.testing.assert_array_equal(stop.get_color(), mass.get_color())
    assert not np.array_equal(masses[0].get_color(), masses[1].get_color())
    assert {text.get_text() for text in ax.get_legend().get_texts()} >= {"$x_{0}$", "$x_{1}$"}
    assert ax.get_xlim() == (0.0, END)


def held_intervals(ax):
    """First and last times of the unbroken parts of the lines that mark sticking."""
    lines = [line.get_data() for line in ax.lines if "held" in line.get_label()]
    runs = [np.ma.clump_unmasked(np.ma.masked_invalid(x)) for _, x in lines]
    return [[(t[run][0], t[run][-1]) for run in of_line] for (t, _), of_line in zip(lines, runs, strict=True)]


def test_a_time_series_marks_where_a_mass_is_held(held):
    ax = vx.plot.time_series(held, num_samples=SAMPLES)
    (drawn,) = held_intervals(ax)
    kind, t = np.asarray(held.events.kind), np.asarray(held.events.t)
    sticks, releases = t[kind == vx.STICK], t[kind == vx.RELEASE]
    assert len(sticks) > 0
    starts = [0.0, *sticks]
    ends = [*releases, END] if held.stuck1[0] else [*releases]
    assert drawn == list(zip(starts, ends, strict=True))


def test_a_time_series_marks_the_impacts_on_the_lines_of_their_masses(sticking):
    ax = vx.plot.time_series(sticking, span=(20.0, 60.0), num_samples=SAMPLES)
    (marks,) = named(ax, "impact")
    hits = [events(sticking, vx.IMPACT, j) for j in range(2)]
    expected = [(t, place) for j, place in enumerate((-0.3, 0.1)) for t in hits[j] if 20.0 <= t <= 60.0]
    assert len(expected) > 10
    np.testing.assert_allclose(np.transpose(marks.get_data()), expected, rtol=0, atol=1e-12)
    bands = [line for line in ax.lines if "held" in line.get_label()]
    assert [band.get_solid_capstyle() for band in bands] == ["butt"] * 2


def test_a_time_series_goes_into_the_axes_given(held):
    _, ax = plt.subplots()
    assert vx.plot.time_series(held, ax=ax, num_samples=SAMPLES) is ax
    assert len(plt.get_fignums()) == 1


def test_a_close_up_of_a_time_series_shows_its_span_only(sticking):
    stick, release = events(sticking, vx.STICK, 1)[1], events(sticking, vx.RELEASE, 1)[1]
    span = (stick - 1.0, (stick + release) / 2)
    ax = vx.plot.time_series(sticking, span=span, num_samples=SAMPLES)
    assert ax.get_xlim() == span
    t, x = ax.lines[0].get_data()
    assert (t[0], t[-1]) == span
    np.testing.assert_array_equal(x, sticking.evaluate(t)[0][:, 0])
    assert held_intervals(ax)[-1] == [(stick, span[1])]


@pytest.mark.parametrize("span", [(-1.0, 5.0), (5.0, 81.0), (5.0, 5.0), (6.0, 5.0)])
def test_a_span_outside_the_trajectory_is_refused(sticking, span):
    with pytest.raises(ValueError, match=r"must be two times in order within \[0.0, 80.0\]"):
        vx.plot.time_series(sticking, span=span)


def test_a_phase_portrait_is_the_motion_broken_at_impacts(sticking):
    ax = vx.plot.phase_portrait(sticking, 1, num_samples=SAMPLES)
    x, v = (np.asarray(a) for a in ax.lines[0].get_data())
    is_hit = np.asarray((sticking.events.kind == vx.IMPACT) & (sticking.events.stop == 1))
    minus, plus = (
        np.asarray(a)[is_hit] for a in (sticking.events.velocity_minus, sticking.events.velocity_plus)
    )
    (gaps,) = np.nonzero(np.isnan(v))
    assert len(gaps) == is_hit.sum() > 10
    np.testing.assert_array_equal(v[gaps - 1], minus)
    np.testing.assert_array_equal(x[gaps - 1], 0.1)
    # After the last impact before a stick the mass is at rest.
    bounces = minus > 1e-5
    np.testing.assert_allclose(v[gaps + 1][bounces], plus[bounces], rtol=1e-9)
    t = np.sort(np.append(np.linspace(0, 80, SAMPLES), np.nan_to_num(sticking.events.t, nan=80.0)))
    drawn = set(zip(x.tolist(), v.tolist(), strict=True))
    for state in zip(*(np.asarray(a)[:, 1].tolist() for a in sticking.evaluate(t)), strict=True):
        assert state in drawn


def test_a_phase_portrait_dashes_the_jumps_and_marks_stop_and_rest(sticking):
    ax = vx.plot.phase_portrait(sticking, 0, num_samples=SAMPLES)
    (jumps,) = (c for c in ax.collections if isinstance(c, LineCollection))
    is_hit = np.asarray((sticking.events.kind == vx.IMPACT) & (sticking.events.stop == 0))
    minus, plus = (
        np.asarray(a)[is_hit] for a in (sticking.events.velocity_minus, sticking.events.velocity_plus)
    )
    found = np.array([[start[1], end[1]] for start, end in jumps.get_segments()])
    np.testing.assert_array_equal(found, np.stack([minus, plus], axis=1))
    assert jumps.get_linestyle()[0][1] is not None
    assert words_of_legend(ax) == ["impact", "stop 0", "held by stop 0", "stick", "release"]
    assert discs(ax, filled=False) == [(-0.3, 0.0)]
    assert discs(ax, filled=True) == 2 * [(-0.3, 0.0)]
    # The dot of the release lies in the disc of the sticking mass, and that in the circle of the stick.
    marks = [named(ax, words)[0] for words in ("release", "held by stop 0", "stick")]
    assert [mark.get_markersize() for mark in marks] == sorted(mark.get_markersize() for mark in marks)
    assert [mark.get_zorder() for mark in marks] == sorted(
        (mark.get_zorder() for mark in marks), reverse=True
    )
    with pytest.raises(ValueError, match="Argument `mass` must lie in 0 to 1, but is 2"):
        vx.plot.phase_portrait(sticking, 2)


@pytest.mark.thorough
def test_a_phase_portrait_marks_where_a_moving_stop_catches_its_mass_and_lets_it_go():
    sol = vx.simulate(ball(), 0.0, 12.0, [1.0], [0.5])
    ax = vx.plot.phase_portrait(sol, span=(3.0, 12.0), num_samples=SAMPLES)
    for words, kind in (("stick", vx.STICK), ("release", vx.RELEASE)):
        t = events(sol, kind, 0)
        t = t[t >= 3.0]
        (mark,) = named(ax, words)
        assert len(t) > 1
        assert len(mark.get_xdata()) == len(t)
        # A sticking mass has the position and the velocity of its stop.
        for found, expected in zip(mark.get_data(), table(t), strict=True):
            np.testing.assert_allclose(found, expected, rtol=0, atol=MAGNIFIED)


def test_a_phase_portrait_without_contacts_is_one_line():
    sol = vx.simulate(vx.models.wagg_bishop_b(0.8, 0.01), 0.0, END)
    ax = vx.plot.phase_portrait(sol, num_samples=SAMPLES)
    assert not np.isnan(ax.lines[0].get_ydata()).any()
    assert discs(ax, filled=True) == []
