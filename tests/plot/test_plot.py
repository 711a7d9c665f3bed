"""Pictures show the data, in the axes they are given."""

import io

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import SEEN, discs, events, grey, points, words_of_legend
from matplotlib.colors import same_color

import vijax as vx

FREQUENCIES = [0.8, 1.1, 1.4]
END = 25.0
SAMPLES = 100


@pytest.fixture(scope="module")
def swept() -> xr.Dataset:
    system = vx.models.wagg_bishop_b(1.0)
    return vx.sweep(system, {"forcing.frequency": FREQUENCIES}, transient=3, record=4, progress=False)


@pytest.fixture(scope="module")
def sticking() -> vx.Solution:
    """Case (b) of the paper, where both masses stick."""
    return vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)


@pytest.fixture(scope="module")
def both_ways(swept) -> xr.Dataset:
    """Sweep as from `carry="both"`, with other velocities on the way down."""
    down = swept.assign(impact_velocity=swept.impact_velocity / 2)
    return xr.concat([swept, down], dim="direction").assign_coords(direction=["up", "down"])


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


def test_a_panel_without_a_point_says_that_its_stop_has_no_impact(swept):
    quiet = swept.assign(num_impacts=swept.num_impacts.where(swept.stop != 1, 0))
    with pytest.warns(UserWarning, match="no impact at stop 1 was recorded"):
        vx.plot.bifurcation(quiet, 1)
    assert vx.plot.bifurcation(quiet, 0).lines
    assert all(ax.lines for ax in np.ravel(vx.plot.bifurcation(quiet, None)))


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
    assert ax.get_xlabel() == r"Forcing frequency $\Omega$"
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["bifurcation", "time_series", "phase_portrait", "impact_map", "relative_motion", "sticking_region"],
)
def test_a_picture_leaves_the_current_axes_alone_and_can_be_printed(name, swept, sticking):
    arguments = {"bifurcation": (swept,), "sticking_region": (sticking, 1)}.get(name, (sticking,))
    figure, (current, other) = plt.subplots(1, 2)
    plt.sca(current)
    assert getattr(vx.plot, name)(*arguments, ax=other) is other
    assert plt.gca() is current
    assert not current.lines
    assert len(plt.get_fignums()) == 1
    assert other.get_xlabel()
    assert other.get_ylabel()
    for ending in ("png", "svg", "pdf"):
        figure.savefig(io.BytesIO(), format=ending)


def test_a_bifurcation_diagram_of_all_stops_has_a_panel_for_each(swept):
    column = vx.plot.bifurcation(swept, stop=None)
    assert len(column) == 2
    for stop, ax in enumerate(column):
        assert points(ax.lines[0]) == points(vx.plot.bifurcation(swept, stop).lines[0])
        assert f"stop {stop}" in ax.get_ylabel()
    assert [ax.get_xlabel() != "" for ax in column] == [False, True]


def test_a_bifurcation_diagram_of_all_stops_goes_into_the_axes_given(swept):
    _, axes = plt.subplots(2)
    assert list(vx.plot.bifurcation(swept, None, ax=axes)) == list(axes)
    with pytest.raises(ValueError, match="Argument `ax` must hold 2 axes, but holds 1"):
        vx.plot.bifurcation(swept, None, ax=[axes[0]])


def test_a_bifurcation_diagram_tells_up_from_down_in_grey_too(both_ways, swept):
    ax = vx.plot.bifurcation(both_ways, 1)
    lines = {line.get_label(): line for line in ax.lines if line.get_marker() == "."}
    up, down = lines["swept up"], lines["swept down"]
    assert points(up) == points(vx.plot.bifurcation(swept, 1).lines[0])
    assert points(down) == {(x, v / 2) for x, v in points(up)}
    assert grey(down.get_color()) - grey(up.get_color()) > 0.4
    assert up.get_rasterized()
    # Where both agree, the dark points lie on the light ones, and are smaller.
    assert up.get_markersize() < down.get_markersize()
    assert list(ax.lines).index(up) > list(ax.lines).index(down)
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"swept up", "swept down"}


@pytest.mark.parametrize("mass", [0, 1])
@pytest.mark.parametrize(
    ("ordinate", "variable"), [("section_position", "section_x"), ("section_velocity", "section_v")]
)
def test_a_bifurcation_diagram_can_show_the_section_of_a_mass(swept, mass, ordinate, variable):
    ax = vx.plot.bifurcation(swept, ordinate=ordinate, mass=mass, units={"length": "mm", "time": "s"})
    values = swept[variable].isel(mass=mass).values
    expected = {(f, a) for f, row in zip(FREQUENCIES, values, strict=True) for a in row}
    assert points(ax.lines[0]) == expected
    assert f"_{{{mass}}}" in ax.get_ylabel()
    assert ax.get_ylabel().endswith("(mm/s)" if variable == "section_v" else "(mm)")
    # Periods that were not reached have no points.
    partly = swept.assign({variable: swept[variable].where(swept.period < 2)})
    assert len(vx.plot.bifurcation(partly, ordinate=ordinate, mass=mass).lines[0].get_xdata()) == 2 * 3


def test_a_section_against_a_quantity_has_one_panel_and_marks_its_orbits(swept, both_ways):
    column = vx.plot.bifurcation(swept, None, ordinate="section_position")
    assert column.shape == (1,)
    orbits = vx.periodic_orbits(swept, progress=False)
    ax = vx.plot.bifurcation(swept, ordinate="section_velocity", orbits=orbits)
    assert len(points(ax.lines[0])) == 4 * int((~orbits.converged).sum())
    assert set(words_of_legend(vx.plot.bifurcation(both_ways, ordinate="section_position"))) == {
        "swept up",
        "swept down",
    }


def test_a_section_that_cannot_be_drawn_is_refused(swept):
    with pytest.raises(ValueError, match="`mass` must lie in 0 to 1, but is 2"):
        vx.plot.bifurcation(swept, ordinate="section_position", mass=2)
    orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
    with pytest.raises(ValueError, match="at their impacts only"):
        vx.plot.bifurcation(swept, ordinate="section_position", orbits=orbit)


def test_a_bifurcation_diagram_can_show_phases(swept):
    ax = vx.plot.bifurcation(swept, 1, ordinate="phase")
    expected = swept.impact_phase.values[swept.impact_stop.values == 1]
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), expected)
    assert ax.get_ylim() == (0, 2 * np.pi)
    with pytest.raises(
        ValueError, match=r'"velocity", "relative velocity", "phase", "section_.*, but is "time"'
    ):
        vx.plot.bifurcation(swept, ordinate="time")


@pytest.mark.parametrize("stop", [0, 1])
def test_an_impact_map_has_the_phase_and_velocity_of_every_impact(sticking, stop):
    ax = vx.plot.impact_map(sticking, stop, origin=0.0)
    is_hit = np.asarray((sticking.events.kind == vx.IMPACT) & (sticking.events.stop == stop))
    phase = np.mod(0.2 * np.asarray(sticking.events.t), 2 * np.pi)[is_hit]
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), phase)
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), sticking.events.velocity_minus[is_hit])
    assert ax.lines[0].get_rasterized()
    assert ax.get_xlim() == (0, 2 * np.pi)
    assert f"stop {stop}" in ax.get_ylabel()


def test_an_impact_map_of_a_sweep_is_of_one_machine_and_any_starts(swept):
    one = swept.sel({"forcing.frequency": 1.1})
    found = points(vx.plot.impact_map(one, 1, origin=0.0).lines[0])
    is_ours = one.impact_stop.values == 1
    phases, velocities = (one[name].values[is_ours].tolist() for name in ("impact_phase", "impact_velocity"))
    assert found == set(zip(phases, velocities, strict=True))
    starts = xr.concat([one, one.assign(impact_phase=one.impact_phase / 2)], dim="x0[1]")
    assert points(vx.plot.impact_map(starts, 1, origin=0.0).lines[0]) == found | {
        (p / 2, v) for p, v in found
    }
    with pytest.raises(ValueError, match=r"is of one machine, but \['forcing.frequency'\] are swept"):
        vx.plot.impact_map(swept, 1)


def test_the_global_impact_map_tells_the_stops_apart_without_colour_too(sticking):
    ax = vx.plot.impact_map(sticking, stop=None, origin=0.0)
    for stop in (0, 1):
        assert points(ax.lines[stop]) == points(vx.plot.impact_map(sticking, stop, origin=0.0).lines[0])
    first, second = ax.lines[:2]
    assert first.get_marker() != second.get_marker()
    assert [same_color(one.get_color(), f"C{k}") for k, one in enumerate((first, second))] == [True] * 2
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["stop 0", "stop 1"]


def test_an_impact_map_without_impacts_or_stop_is_refused(sticking):
    quiet = vx.simulate(vx.models.wagg_bishop_b(0.8, 0.01), 0.0, END)
    with pytest.raises(ValueError, match="There are no impacts at stop 1 to draw"):
        vx.plot.impact_map(quiet, 1)
    with pytest.raises(ValueError, match="There are no impacts at any stop to draw"):
        vx.plot.impact_map(quiet, None)
    with pytest.raises(ValueError, match="Argument `stop` must lie in 0 to 1, but is 2"):
        vx.plot.impact_map(sticking, 2)


def boundaries(ax) -> list[tuple[float, float]]:
    """Slope and intercept of every infinite line."""
    lines = [line for line in ax.lines if isinstance(line, mpl.lines.AxLine)]
    ends = [(*line.get_xy1(), *line.get_xy2()) for line in lines]
    return [((v2 - v1) / (x2 - x1), v1 - x1 * (v2 - v1) / (x2 - x1)) for x1, v1, x2, v2 in ends]


@pytest.mark.thorough
def test_sticking_orbits_end_on_the_boundary_of_fig_12(sticking):
    ax = vx.plot.sticking_region(sticking, 1, num_samples=SAMPLES)
    (line,) = boundaries(ax)
    np.testing.assert_allclose(line, (-10, 1), rtol=1e-13)
    for filled, kind in ((False, vx.STICK), (True, vx.RELEASE)):
        x, v = (np.asarray(a)[:, 0] for a in sticking.evaluate(events(sticking, kind, 1)))
        assert len(x) >= 2
        assert set(discs(ax, filled=filled)) == set(zip(x.tolist(), v.tolist(), strict=True))
    released = np.array(discs(ax, filled=True))
    np.testing.assert_allclose(released[:, 1], -10 * released[:, 0] + 1, atol=1e-12)
    assert "x_{0}" in ax.get_xlabel()
    words = words_of_legend(ax)
    assert "exit boundary $\\partial S$:\n$\\dot x_{0} = -10 x_{0} + 1$" in words
    assert {"region $S$", "stick", "release"} <= set(words)


def test_a_boundary_that_the_load_moves_is_drawn_at_each_release(sticking):
    ax = vx.plot.sticking_region(sticking, 0, num_samples=SAMPLES)
    released, lines = np.array(discs(ax, filled=True)), np.array(boundaries(ax))
    assert len(lines) == len(released) >= 2
    for x, v in released:
        assert np.abs(lines[:, 0] * x + lines[:, 1] - v).min() < 1e-12
    assert np.ptp(lines[:, 1]) > 0.01


@pytest.mark.thorough
def test_the_orbits_of_a_sticking_region_are_the_motion_while_the_mass_is_held(sticking):
    stick, release = events(sticking, vx.STICK, 1)[1], events(sticking, vx.RELEASE, 1)[1]
    ax = vx.plot.sticking_region(sticking, 1, span=(stick - 0.5, release + 0.5), num_samples=SAMPLES)
    x, v = sticking.evaluate(np.linspace(stick, release, SAMPLES))
    assert set(zip(x[:, 0].tolist(), v[:, 0].tolist(), strict=True)) <= points(ax.lines[0])
    assert len(discs(ax, filled=True)) == 1
    cut = vx.plot.sticking_region(sticking, 1, span=(stick + 0.1, release - 0.1), num_samples=SAMPLES)
    assert discs(cut, filled=True) == discs(cut, filled=False) == []


@pytest.mark.slow
def test_a_boundary_that_depends_on_a_third_mass_is_left_out():
    stops = [vx.Stop(1, 0.0, "upper", 0.5), vx.Stop(2, 0.0, "upper", 0.5)]
    load = vx.Harmonic([0.0, 0.0, 0.0], 1.0, mean=[0.1, 0.5, 1.0])
    system = vx.chain([1.0] * 3, [0.1] * 3, [1.0] * 3, load, stops)
    middle_and_end = vx.simulate(system, 0.0, 3.0)
    assert boundaries(vx.plot.sticking_region(middle_and_end, 0, mass=2, num_samples=SAMPLES)) == []
    # The last mass is coupled only to the one before it.
    assert boundaries(vx.plot.sticking_region(middle_and_end, 1, mass=0, num_samples=SAMPLES)) == []
    (line,) = boundaries(vx.plot.sticking_region(middle_and_end, 1, mass=1, num_samples=SAMPLES))
    # 0.1 v + x - 0 + 1 = 0.
    np.testing.assert_allclose(line, (-10, -10), rtol=1e-13)
    with pytest.raises(ValueError, match=r"Argument `mass` must be one of \[0, 2\]: name the mass"):
        vx.plot.sticking_region(middle_and_end, 0)


def test_a_sticking_region_that_cannot_be_drawn_is_refused(sticking):
    with pytest.raises(ValueError, match="Argument `sols` is empty"):
        vx.plot.sticking_region([], 0)
    with pytest.raises(ValueError, match="Stop 1 holds its mass at no time that is to be drawn"):
        vx.plot.sticking_region(sticking, 1, span=(0.0, 1.0))
    with pytest.raises(ValueError, match=r"must be one of \[0\], but 1 is the mass of stop 1"):
        vx.plot.sticking_region(sticking, 1, mass=1)
    with pytest.raises(ValueError, match="Argument `stop` must lie in 0 to 1, but is 5"):
        vx.plot.sticking_region(sticking, 5)


def test_curves_and_points_are_seen_on_a_dark_background(swept, both_ways, sticking):
    with plt.style.context("dark_background"):
        drawn = [
            vx.plot.bifurcation(swept),
            vx.plot.bifurcation(both_ways),
            vx.plot.impact_map(sticking),
            vx.plot.impact_map(sticking, stop=None),
            vx.plot.time_series(sticking),
            vx.plot.phase_portrait(sticking, mass=1),
            vx.plot.sticking_region(sticking, stop=0),
        ]
    lines = [line for ax in drawn for line in ax.lines]
    assert min(grey(line.get_color()) for line in lines) > SEEN
