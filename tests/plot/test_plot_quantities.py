"""Pictures of quantities: of a sweep and of branches, by mass or by stop."""

import warnings

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import PATH, branch_of, named, points, words_of_legend

import vijax as vx
from vijax.plot._labels import axis_label

VALUES = [0.7, 0.8]


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def ds() -> xr.Dataset:
    """A sweep, with numbers made up for the quantities."""
    found = vx.sweep(
        vx.models.wagg_bishop_a(0.8), {"W": (PATH, VALUES)}, transient=1, record=2, progress=False
    )
    made_up = np.arange(1.0, 5.0).reshape(2, 2)
    return found.assign(
        max_position=(("W", "mass"), made_up),
        max_force=(("W", "stop"), 10 * made_up),
        impulse=(("W", "period", "stop"), np.stack([made_up, 2 * made_up], axis=1)),
    )


def with_columns(branch: vx.Branch, **columns) -> vx.Branch:
    return vx.Branch(branch.points.assign(columns))


def drawn(ax) -> list[tuple[float, float]]:
    rows = np.concatenate(
        [line.get_xydata() for line in ax.lines if line.get_linestyle() != "None" or line.get_xydata().size]
    )
    return [tuple(row) for row in rows]


def test_a_diagram_shows_a_quantity_of_a_mass(ds):
    ax = vx.plot.bifurcation(ds, ordinate="max_position", mass=1, units={"length": "mm"})
    assert drawn(ax) == [(0.7, 2.0), (0.8, 4.0)]
    assert ax.get_ylabel() == "Largest position $x_{1}$ (mm)"


def test_a_diagram_shows_a_quantity_of_every_stop_and_period(ds):
    first, second = vx.plot.bifurcation(ds, None, ordinate="impulse")
    assert drawn(first) == [(0.7, 1.0), (0.7, 2.0), (0.8, 3.0), (0.8, 6.0)]
    assert drawn(second) == [(0.7, 2.0), (0.7, 4.0), (0.8, 4.0), (0.8, 8.0)]
    ax = vx.plot.bifurcation(ds, 1, ordinate="max_force", units={"force": "N"})
    assert drawn(ax) == [(0.7, 20.0), (0.8, 40.0)]
    assert ax.get_ylabel().endswith("(N)")


def test_words_and_limits_are_those_of_the_user(ds):
    labels = {PATH: "Drive", "max_position": "Amplitude"}
    branch = branch_of([[(0.2, 1, 0.5)]] * 3)
    branch = with_columns(branch, max_position=(("point", "mass"), np.ones((3, 2))))
    for ax in (
        vx.plot.bifurcation(ds, ordinate="max_position", labels=labels, xlim=(0.5, 2.0)),
        vx.plot.branch(branch, ordinate="max_position", labels=labels, xlim=(0.5, 2.0)),
    ):
        assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_xlim()) == ("Drive", "Amplitude", (0.5, 2.0))


def test_a_branch_shows_a_quantity_with_gaps_where_it_is_not_known():
    branch = branch_of([[(0.2, 1, 0.5)]] * 5)
    values = np.array([[1.0, 5.0], [2.0, 6.0], [np.nan, np.nan], [3.0, 7.0], [4.0, 8.0]])
    branch = with_columns(branch, max_position=(("point", "mass"), values), energy=(("point",), values[:, 0]))
    ax = vx.plot.branch(branch, ordinate="max_position", mass=1)
    line = max(ax.lines, key=lambda line: len(line.get_xdata()))
    known = line.get_xydata()[np.isfinite(line.get_xydata()[:, 0])]
    np.testing.assert_array_equal(known, [[1, 5], [2, 6], [4, 7], [5, 8]])
    own = vx.plot.branch(branch, ordinate="energy")
    assert own.get_ylabel() == "Energy"


def test_a_bifurcation_at_which_a_quantity_is_not_known_is_marked_at_the_end_of_its_line():
    branch = branch_of([[(0.2, 1, 0.5)]] * 6, ["gr", "", "fold", "", "", "gr"])
    branch.points["energy"] = ("point", [np.nan, 5.0, np.nan, 6.0, 7.0, np.nan])
    ax = vx.plot.branch(branch, ordinate="energy")
    values = branch.values
    assert points(*named(ax, "grazing")) == {(values[0], 5.0), (values[5], 7.0)}
    assert points(*named(ax, "fold")) == {(values[2], 5.0)}


@pytest.mark.slow
def test_many_branches_are_named_by_their_motions():
    once, twice = ([[(0.2, 1, 0.5)]] * 3, [[(0.2, 1, 0.5), (0.6, 0, 0.3)]] * 3)
    several = [branch_of(one, num_periods=n) for n in (1, 2) for one in (twice, once) for _ in range(30)]
    for one in several:
        counts = np.zeros((3, 2), int)
        counts[:, 0] = one.points.sizes["event"]
        one.points["num_impacts"] = (("point", "stop"), counts)
    ax = vx.plot.branch(several, stop=1)
    assert words_of_legend(ax) == ["1 in 1", "2 in 1", "1 in 2", "2 in 2", "stable"]


def test_what_is_not_there_to_draw_is_refused_with_what_to_do(ds):
    branch = branch_of([[(0.2, 1, 0.5)]] * 3)
    with pytest.raises(ValueError, match=r'give `vx.sweep` `quantities=\["rms_position"\]`'):
        vx.plot.bifurcation(ds, ordinate="rms_position")
    with pytest.raises(ValueError, match=r'give `vx.continuation` `quantities=\["rms_position"\]`'):
        vx.plot.branch(branch, ordinate="rms_position")
    with pytest.raises(ValueError, match=r'one of "velocity", "section_position".*, but is "nonsense"'):
        vx.plot.branch(branch, ordinate="nonsense")
    with pytest.raises(ValueError, match="`mass` must lie in 0 to 1, but is 2"):
        vx.plot.bifurcation(ds, ordinate="max_position", mass=2)


@pytest.mark.thorough
def test_an_empty_diagram_is_explained():
    system = vx.models.soft_impact_oscillator(0.8)
    ds = vx.sweep(system, {"forcing.frequency": [0.7, 0.8]}, transient=2, record=2, progress=False)
    with pytest.warns(UserWarning, match=r'`ordinate="section_position"` shows the motion'):
        vx.plot.bifurcation(ds)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ax = vx.plot.bifurcation(ds, ordinate="section_position")
    drawn = np.concatenate([np.asarray(line.get_xydata()) for line in ax.lines])
    recorded = {(w, x) for w, own in zip([0.7, 0.8], ds.section_x.values[..., 0], strict=True) for x in own}
    assert recorded <= set(map(tuple, drawn.tolist()))


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("friction[0].force", "Friction force of element 0 (N)"),
        ("friction[*].force", "Friction force of elements (N)"),
        ("stops[1].stiffness", "Stiffness of stop 1 (N/m)"),
        ("stops[0].position", "Clearance of contact 0 $s_{0}$ (m)"),
        ("stops[1].position", "Stop position $s_{1}$ (m)"),
        ("stops[*].position", "Stop position $s$ (m)"),
        ("stops[1].restitution", "Restitution $r_{1}$"),
    ],
)
def test_axes_name_swept_quantities_in_words(path, words):
    ds = xr.Dataset(coords={"stop_mass": ("stop", [-1, 0])})
    assert axis_label(path, {"length": "m", "force": "N", "time": "s"}, ds) == words
