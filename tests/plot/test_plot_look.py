"""Common properties of all pictures: given units, colours of the style, user-defined looks, several datasets."""

import json
import subprocess
import sys

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import PATH, grey, named, points, words_of_legend
from matplotlib.colors import same_color

import vijax as vx

UNITS = {"length": "mm", "time": "s", "force": "N", "mass": "kg"}
# Least difference of greys that differ visibly, of 1 from black to white.
TOLD_APART = 0.15
SAMPLES = 60


@pytest.fixture(scope="module")
def sticking() -> vx.Solution:
    """Case (b) of the paper, where both masses stick."""
    return vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)


def sweep(velocity: float, path: str = PATH, values=(1.0, 2.0), phases=(0.5, 1.0)) -> xr.Dataset:
    """Impacts at one of two stops, one at each value."""
    count = len(values)
    return xr.Dataset(
        {
            "impact_velocity": ((path, "impact"), np.full((count, 1), velocity)),
            "impact_phase": ((path, "impact"), np.resize(phases, (count, 1))),
            "impact_stop": ((path, "impact"), np.zeros((count, 1), int)),
            "result": ((path,), np.zeros(count, int)),
            "num_impacts": ((path, "stop"), np.ones((count, 2), int)),
        },
        {path: np.asarray(values, float), "stop_mass": ("stop", [0, 1])},
        {"max_impacts": 10},
    )


def test_units_are_those_that_are_given_and_no_others(sticking):
    ax = vx.plot.time_series(sticking, units=UNITS, num_samples=SAMPLES)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Time $t$ (s)", "Position $x_i$ (mm)")
    ax = vx.plot.phase_portrait(sticking, 1, units={"length": "mm"}, num_samples=SAMPLES)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Position $x_{1}$ (mm)", r"Velocity $\dot x_{1}$")
    ax = vx.plot.impact_map(sticking)
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        r"Phase $\varphi$ of impact (rad)",
        "Velocity $v^-$ before impact at stop 0",
    )


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (PATH, r"Forcing frequency $\Omega$ (rad/s)"),
        ("forcing.amplitude[1]", "Forcing amplitude $A_{1}$ (N)"),
        ("stiffness[0,0]", "Stiffness $K$ (N/mm)"),
        ("damping[0,0]", "Damping $C$ (N s/mm)"),
        ("stops[1].restitution", "Restitution $r_{1}$"),
        ("force.cubic", "force.cubic (N/mm^3)"),
    ],
)
def test_a_swept_quantity_has_a_unit_made_of_those_given(path, words):
    units = UNITS | {"force.cubic": "N/mm^3"}
    assert vx.plot.bifurcation(sweep(0.3, path), units=units).get_xlabel() == words
    assert "(" not in vx.plot.bifurcation(sweep(0.3, path)).get_xlabel()


def test_a_unit_of_nothing_is_refused(sticking):
    with pytest.raises(ValueError, match=r"must name units of length, time, mass, force.*\['lenght'\]"):
        vx.plot.time_series(sticking, units={"lenght": "mm"}, num_samples=SAMPLES)


@pytest.mark.parametrize("style", ["default", "dark_background", "grayscale"])
def test_curves_have_the_colours_of_the_style_and_are_told_apart_in_grey(sticking, style):
    with plt.style.context(style):
        lines = vx.plot.time_series(sticking, num_samples=SAMPLES).lines[:2]
        for k, line in enumerate(lines):
            assert same_color(line.get_color(), f"C{k}")
        greys = [grey(line.get_color()) for line in lines]
        strokes = [line.get_linestyle() for line in lines]
        assert abs(greys[0] - greys[1]) >= TOLD_APART or strokes[0] != strokes[1]


def test_curves_of_one_lightness_differ_in_their_strokes(sticking):
    with plt.rc_context({"axes.prop_cycle": plt.cycler(color=["#d62728", "#1f77b4"])}):
        lines = vx.plot.time_series(sticking, num_samples=SAMPLES).lines[:2]
    assert [line.get_linestyle() for line in lines] == ["-", "--"]


def test_curves_of_one_colour_differ_in_their_strokes_too(sticking):
    lines = vx.plot.time_series(sticking, num_samples=SAMPLES, color="red").lines[:2]
    assert [line.get_linestyle() for line in lines] == ["-", "--"]


def test_every_picture_takes_a_look(sticking):
    look = {"color": "red", "lw": 3.0, "label": "mine"}
    drawn = [
        vx.plot.time_series(sticking, num_samples=SAMPLES, **look).lines[:2],
        vx.plot.phase_portrait(sticking, num_samples=SAMPLES, **look).lines[:1],
        vx.plot.relative_motion(sticking, num_samples=SAMPLES, **look).lines[:1],
        vx.plot.sticking_region(sticking, 1, num_samples=SAMPLES, **look).lines[:1],
    ]
    for line in (line for lines in drawn for line in lines):
        assert same_color(line.get_color(), "red")
        assert line.get_linewidth() == 3.0
    points_of = {"color": "red", "marker": "x", "ms": 9.0}
    drawn = [
        vx.plot.impact_map(sticking, **points_of).lines[0],
        vx.plot.section(sticking, **points_of).lines[0],
        vx.plot.bifurcation(sweep(0.3), **points_of).lines[0],
    ]
    for line in drawn:
        assert same_color(line.get_color(), "red")
        assert (line.get_marker(), line.get_markersize()) == ("x", 9.0)
    box = vx.plot.machine(vx.models.wagg_bishop_b(0.2), facecolor="red").patches[0]
    assert same_color(box.get_facecolor(), "red")


def test_several_sweeps_are_drawn_in_one_axes_by_their_names():
    several = {"r = 0.7": sweep(0.3), "r = 0.8": sweep(0.4, values=(1.5, 3.0))}
    ax = vx.plot.bifurcation(several)
    assert words_of_legend(ax) == list(several)
    for k, (name, ds) in enumerate(several.items()):
        (line,) = named(ax, name)
        assert points(line) == points(vx.plot.bifurcation(ds).lines[0])
        assert same_color(line.get_color(), f"C{k}")
    assert ax.get_xlim() == (1.0, 3.0)
    with pytest.raises(ValueError, match="sweep one quantity of machines with as many stops"):
        vx.plot.bifurcation({"one": sweep(0.3), "other": sweep(0.3, "forcing.amplitude[0]")})
    with pytest.raises(ValueError, match="There is no dataset to draw"):
        vx.plot.bifurcation({})


def test_what_is_drawn_into_axes_widens_what_they_show():
    ax = vx.plot.bifurcation(sweep(0.3), label="one")
    vx.plot.bifurcation(sweep(0.4, values=(0.5, 1.5)), ax=ax, color="C1", label="other")
    assert ax.get_xlim() == (0.5, 2.0)
    assert words_of_legend(ax) == ["one", "other"]


@pytest.mark.parametrize(
    ("phases", "begin"),
    [((3.0, 3.2), 0.0), ((0.1, 6.2), -np.pi), ((1.0, 2.0, 3.0, 4.0, 5.0, 5.9), 0.0)],
)
def test_the_phases_begin_where_no_set_is_split(phases, begin):
    one = sweep(0.3, "x0[0]", np.arange(len(phases)), phases)
    ax = vx.plot.impact_map(one)
    assert ax.get_xlim() == pytest.approx((begin, begin + 2 * np.pi))
    drawn = ax.lines[0].get_xdata()
    np.testing.assert_allclose(np.mod(drawn, 2 * np.pi), phases, atol=1e-12)
    assert np.ptp(drawn) < np.ptp(phases) + 1e-12
    assert vx.plot.impact_map(one, origin=1.0).get_xlim() == pytest.approx((1.0, 1.0 + 2 * np.pi))


def test_many_points_in_one_place_are_faint_and_few_are_not():
    x = np.random.default_rng(0).normal(size=(20_000, 1))
    dense = vx.plot.section((x, 1e-3 * x)).lines[0]
    sparse = vx.plot.section((x[:50], x[:50])).lines[0]
    assert dense.get_alpha() < 0.5
    assert sparse.get_alpha() is None
    assert dense.get_markersize() < sparse.get_markersize()


def test_a_section_is_the_motion_at_the_ends_of_forcing_periods(sticking):
    (line,) = vx.plot.section(sticking, mass=0, units=UNITS).lines
    found = vx.stroboscopic_section(sticking)
    assert points(line) == set(zip(found.x.values[:, 0].tolist(), found.v.values[:, 0].tolist(), strict=True))
    assert len(points(line)) == 2
    ax = vx.plot.section({"dataset": found, "points": (found.x.values, found.v.values)}, mass=0)
    assert words_of_legend(ax) == ["dataset", "points"]
    assert points(ax.lines[0]) == points(ax.lines[1]) == points(line)


def test_attractors_are_told_apart_in_a_section():
    flags = {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": "non_impacting periodic chattering"}
    section = np.array([[[0.1, 0.2], [np.nan, np.nan]], [[0.3, 0.4], [0.5, 0.6]]])
    found = xr.Dataset(
        {
            "motion": ("attractor", np.array([0, 1], np.int8), flags),
            "num_periods": ("attractor", [1, 2]),
            "num_impacts": (("attractor", "stop"), [[0.0], [3.0]]),
            "section_x": (("attractor", "section", "mass"), section),
            "section_v": (("attractor", "section", "mass"), -section),
        }
    )
    ax = vx.plot.section(found, mass=1)
    assert words_of_legend(ax) == ["no impact", "3 in 2"]
    assert [points(line) for line in ax.lines] == [{(0.2, -0.2)}, {(0.4, -0.4), (0.6, -0.6)}]


def test_what_is_no_section_is_refused(sticking):
    points_of = np.zeros((3, 2))
    with pytest.raises(ValueError, match="Argument `mass` must lie in 0 to 1, but is 2"):
        vx.plot.section(sticking, mass=2)
    with pytest.raises(ValueError, match=r"one shape, \(points, n\), but have \(3, 2\) and \(2, 2\)"):
        vx.plot.section((points_of, points_of[:2]))
    with pytest.raises(ValueError, match="There are no points to draw"):
        vx.plot.section((points_of[:0], points_of[:0]))
    with pytest.raises(ValueError, match="needs the variables `section_x` and `section_v`"):
        vx.plot.section(sweep(0.3))
    two = vx.stroboscopic_section(sticking).expand_dims({PATH: [1.0, 2.0]})
    with pytest.raises(ValueError, match=r"is of one machine, but \['forcing.frequency'\] are swept"):
        vx.plot.section(two)


@pytest.mark.parametrize("style", ["default", "dark_background"])
def test_points_of_several_sweeps_are_told_apart_in_grey(style):
    with plt.style.context(style):
        several = {str(k): sweep(0.1 * k) for k in range(3)}
        greys = [grey(line.get_color()) for line in vx.plot.bifurcation(several).lines[:3]]
    assert np.diff(sorted(greys)).min() >= TOLD_APART


def test_points_of_few_values_are_larger():
    few, many = (vx.plot.bifurcation(sweep(0.3, values=np.arange(count))).lines[0] for count in (100, 800))
    assert few.get_markersize() == 2 * many.get_markersize()


@pytest.mark.parametrize("picture", ["bifurcation", "section"])
def test_a_cross_is_drawn_where_a_disc_has_no_edge(picture):
    draw, drawn = (
        getattr(vx.plot, picture),
        sweep(0.3) if picture == "bifurcation" else (np.eye(2), np.eye(2)),
    )
    assert draw(drawn).lines[0].get_markeredgewidth() == 0
    assert draw(drawn, marker="x").lines[0].get_markeredgewidth() > 0
    assert draw(drawn, marker="x", mew=3.0).lines[0].get_markeredgewidth() == 3.0


# Calls with what the picture does not take, and words of the sentence that says so.
MISTAKEN = {
    "time_series": ("ds", "one trajectory, what `vx.simulate` returned"),
    "phase_portrait": ("ds", "one trajectory"),
    "section": ("system", "one trajectory"),
    "impact_map": ("system", "several by their names in a dict"),
    "bifurcation": ("sol", "`ds` must be what `vx.sweep` returned"),
    "lyapunov": ("sol", "`ds` must be what `vx.sweep` returned"),
    "branch": ("ds", "`branches` must be what `vx.continuation` returned"),
    "multipliers": ("sol", "`orbits` must be a periodic orbit"),
    "curves": ("sol", "`curves` must be a dataset"),
    "regions": ("sol", "`classes` must be a dataset"),
    "basins": ("sol", "`basins` must be a dataset"),
    "shares": ("sol", "`followed` must be a dataset"),
    "erosion": ("sol", "`followed` must be a dataset"),
    "machine": ("sol", "`system` must be a machine"),
}


@pytest.mark.thorough
def test_a_picture_of_something_else_is_refused_in_a_sentence():
    """In a process where annotations are not checked, as in the programs of users."""
    program = (
        "import json, sys, xarray as xr, vijax as vx\n"
        "given = {'ds': xr.Dataset({'x': 1.0}), 'sol': 3.0, 'system': vx.models.wagg_bishop_a(0.8)}\n"
        "for name, (kind, words) in json.loads(sys.argv[1]).items():\n"
        "    try:\n"
        "        getattr(vx.plot, name)(given[kind])\n"
        "    except ValueError as error:\n"
        "        assert words in str(error), (name, error)\n"
        "    else:\n"
        "        raise AssertionError(name)\n"
    )
    command = [sys.executable, "-c", program, json.dumps(MISTAKEN)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
