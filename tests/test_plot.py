"""The pictures show what is there, in the axes they are given."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import LineCollection

import vijax as vx

FREQUENCIES = [0.8, 1.1, 1.4]
END = 25.0
SAMPLES = 100


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def swept() -> xr.Dataset:
    system = vx.models.wagg_bishop_b(1.0)
    return vx.sweep(system, {"forcing.frequency": FREQUENCIES}, transient=3, record=4, progress=False)


@pytest.fixture(scope="module")
def held() -> vx.Solution:
    """A mass that starts held by its stop, is let go, and held again."""
    load = vx.Harmonic([1.0], 0.5)
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [vx.Stop(0, 0.0, "upper", 0.5)])
    return vx.simulate(system, 0.0, END)


def points(line) -> set[tuple[float, float]]:
    return set(zip(*(np.asarray(a).tolist() for a in line.get_data()), strict=True))


@pytest.mark.parametrize("stop", [0, 1])
def test_a_bifurcation_diagram_has_a_point_for_every_impact_of_its_stop(swept, stop):
    line = vx.plot.bifurcation(swept, stop).lines[0]
    expected = [
        (frequency, velocity)
        for frequency, velocities, stops in zip(
            FREQUENCIES, swept.impact_velocity.values, swept.impact_stop.values, strict=True
        )
        for velocity, of in zip(velocities, stops, strict=True)
        if of == stop
    ]
    assert len(line.get_xdata()) == len(expected) == int(swept.num_impacts.sel(stop=stop).sum()) > 0
    assert points(line) == set(expected)


def test_a_bifurcation_diagram_goes_into_the_axes_given(swept):
    _, (left, right) = plt.subplots(1, 2)
    assert vx.plot.bifurcation(swept, ax=right) is right
    assert right.lines
    assert not left.lines
    assert len(plt.get_fignums()) == 1


def test_a_bifurcation_diagram_makes_axes_where_none_are_given(swept):
    first, second = vx.plot.bifurcation(swept), vx.plot.bifurcation(swept, 1)
    assert first is not second
    assert first.figure is not second.figure


def test_a_bifurcation_diagram_names_its_axes_and_spans_the_sweep(swept):
    ax = vx.plot.bifurcation(swept, 1)
    assert ax.get_xlabel() == r"Forcing frequency $\Omega$ (rad / time)"
    assert "stop 1" in ax.get_ylabel()
    assert ax.get_xlim() == (FREQUENCIES[0], FREQUENCIES[-1])


def test_a_bifurcation_diagram_of_one_slice_of_a_grid_is_drawn(swept):
    grid = xr.concat([swept, swept], dim="x0[1]").assign_coords({"x0[1]": [0.0, 0.1]})
    whole, slice_ = vx.plot.bifurcation(swept), vx.plot.bifurcation(grid.sel({"x0[1]": 0.1}))
    assert points(slice_.lines[0]) == points(whole.lines[0])


def test_a_bifurcation_diagram_of_two_quantities_is_refused(swept):
    grid = xr.concat([swept, swept], dim="x0[1]")
    with pytest.raises(ValueError, match="needs one swept quantity, but there are"):
        vx.plot.bifurcation(grid)


@pytest.mark.parametrize("stop", [-1, 2])
def test_a_bifurcation_diagram_of_no_stop_is_refused(swept, stop):
    with pytest.raises(ValueError, match=f"Argument `stop` must lie in 0 to 1, but is {stop}."):
        vx.plot.bifurcation(swept, stop)


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
    masses, stops = ax.lines[:2], ax.lines[2:]
    assert [line.get_ydata()[0] for line in stops] == [-0.3, 0.1]
    for stop, mass in zip(stops, masses, strict=True):
        np.testing.assert_array_equal(stop.get_color(), mass.get_color())
    assert not np.array_equal(masses[0].get_color(), masses[1].get_color())
    assert {text.get_text() for text in ax.get_legend().get_texts()} >= {"$x_{0}$", "$x_{1}$"}
    assert ax.get_xlim() == (0.0, END)


def test_a_time_series_marks_where_a_mass_is_held(held):
    ax = vx.plot.time_series(held, num_samples=SAMPLES)
    (drawn,) = (c for c in ax.collections if isinstance(c, LineCollection))
    kind, t = np.asarray(held.events.kind), np.asarray(held.events.t)
    sticks, releases = t[kind == vx.STICK], t[kind == vx.RELEASE]
    assert len(sticks) > 0
    starts = [0.0, *sticks]
    ends = [*releases, END] if held.stuck1[0] else [*releases]
    found = [(start, end) for (start, _), (end, _) in drawn.get_segments()]
    assert found == list(zip(starts, ends, strict=True))


def test_a_time_series_goes_into_the_axes_given(held):
    _, ax = plt.subplots()
    assert vx.plot.time_series(held, ax=ax, num_samples=SAMPLES) is ax
    assert len(plt.get_fignums()) == 1
