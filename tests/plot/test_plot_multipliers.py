"""The plane of multipliers: positions, sides of the unit circle, and completeness."""

import io

import matplotlib as mpl

mpl.use("Agg")

import equinox as eqx
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import SEEN, both_ways, cycle, grey, words_of_legend
from matplotlib.collections import PathCollection
from matplotlib.patches import Circle

import vijax as vx

PATH = "forcing.frequency"


@pytest.fixture(scope="module")
def orbit() -> vx.PeriodicOrbit:
    return cycle(vx.models.wagg_bishop_b(0.25), [0.0, 0.0], [0.0, 0.0])


@pytest.fixture(scope="module")
def orbits() -> xr.Dataset:
    """Orbits as from a sweep of three frequencies, none found at the second."""
    multipliers = np.multiply.outer([1.3, np.nan, 0.6], [0.9, 0.5j, -0.5j, 0.1])
    columns = {"converged": (PATH, [True, False, True]), "multipliers": ((PATH, "multiplier"), multipliers)}
    return xr.Dataset(columns, {PATH: [0.8, 1.1, 1.4]})


def with_multipliers(orbit: vx.PeriodicOrbit, *values: complex) -> vx.PeriodicOrbit:
    return eqx.tree_at(lambda o: o.multipliers, orbit, jnp.array(values, complex))


def plane(ax) -> list[tuple[list[complex], list[bool], str]]:
    """Positions, fill and label of each group of marks."""
    groups = [c for c in ax.collections if isinstance(c, PathCollection)]
    places = [np.asarray(c.get_offsets()) @ [1, 1j] for c in groups]
    filled = [(c.get_facecolors()[:, 3] > 0).tolist() for c in groups]
    return [(a.tolist(), b, str(c.get_label())) for a, b, c in zip(places, filled, groups, strict=True)]


def test_multipliers_are_filled_inside_of_the_unit_circle(orbit):
    values = [-2.5, 1.0, 0.5 + 0.5j, 0.5 - 0.5j, 0.0]
    ax = vx.plot.multipliers(with_multipliers(orbit, *values))
    ((places, filled, _),) = plane(ax)
    assert places == values
    assert filled == [False, False, True, True, True]
    (circle,) = (p for p in ax.patches if isinstance(p, Circle))
    assert (circle.center, circle.radius) == ((0, 0), 1)
    assert ax.get_aspect() == 1
    assert ax.get_xlim() == ax.get_ylim()
    assert ax.get_xlim()[1] == pytest.approx(1.15 * 2.5)
    assert ax.get_legend() is None
    assert vx.plot.multipliers(orbit).get_xlim()[1] == pytest.approx(1.15)


def test_the_multipliers_of_several_orbits_are_told_apart_in_grey_too(orbit):
    ax = vx.plot.multipliers([with_multipliers(orbit, value) for value in (0.1, 0.2, -0.3)])
    assert [(places, words) for places, _, words in plane(ax)] == [
        ([0.1], "orbit 0"),
        ([0.2], "orbit 1"),
        ([-0.3], "orbit 2"),
    ]
    assert words_of_legend(ax) == ["orbit 0", "orbit 1", "orbit 2"]
    greys = [grey(c.get_edgecolors()[0][:3]) for c in ax.collections if isinstance(c, PathCollection)]
    assert min(np.diff(greys)) > 0.1
    ax = vx.plot.multipliers([orbit] * 6)
    assert len(plane(ax)) == 6
    assert ax.get_legend() is None


def test_points_have_the_marker_and_the_size_that_curves_would_have(orbit):
    ax = vx.plot.multipliers(orbit, marker="x", markersize=5.0, color="red")
    (marks,) = (c for c in ax.collections if isinstance(c, PathCollection))
    assert marks.get_sizes().tolist() == [25.0]
    assert {tuple(color) for color in marks.get_edgecolors()} == {(1.0, 0.0, 0.0, 1.0)}


def test_multipliers_far_away_are_counted_on_the_edge(orbit):
    far = with_multipliers(orbit, np.inf, -40.0, 3.0 + 4.0j, 3.0 - 4.0j, 0.5)
    ax = vx.plot.multipliers(far)
    near, (stars, _, words) = plane(ax)
    assert near[0] == [0.5]
    np.testing.assert_allclose(stars, np.array([1, -1, 0.75 + 1j, 0.75 - 1j]) * ax.get_xlim()[1])
    assert words == "3 farther out,\nup to $|\\mu|$ = 40\n1 infinite"
    assert words_of_legend(ax) == [words]
    assert [a[2] for a in plane(vx.plot.multipliers(far, limit=100.0))][1:] == ["1 infinite"]
    (_, (_, _, words)) = plane(vx.plot.multipliers(with_multipliers(orbit, -40.0, 0.1)))
    assert words == "1 farther out,\nup to $|\\mu|$ = 40"


def test_the_multipliers_of_a_sweep_have_the_colour_of_its_values(orbits):
    ax = vx.plot.multipliers(orbits)
    ((places, filled, _),) = plane(ax)
    assert places == orbits.multipliers.values[[0, 2]].ravel().tolist()
    assert filled == [False] + 7 * [True]
    (bar,) = ax.child_axes
    assert bar.get_ylabel() == r"Forcing frequency $\Omega$"
    assert bar.get_ylim() == pytest.approx((0.8, 1.4))
    (marks,) = (c for c in ax.collections if isinstance(c, PathCollection))
    greys = [grey(color[:3]) for color in marks.get_edgecolors()]
    assert greys == 4 * [greys[0]] + 4 * [greys[-1]]
    assert greys[-1] - greys[0] > 0.4
    both = plane(vx.plot.multipliers(both_ways(orbits)))
    assert [words for *_, words in both] == ["swept up", "swept down"]
    assert both[0][0] == both[1][0] == places


def test_multipliers_that_cannot_be_drawn_are_refused(orbit, orbits):
    with pytest.raises(ValueError, match="holds no orbit that was found: give one or more"):
        vx.plot.multipliers([])
    with pytest.raises(ValueError, match="holds no orbit that was found"):
        vx.plot.multipliers(orbits.assign(converged=orbits.converged & False))
    with pytest.raises(ValueError, match=r"`limit` must be greater than 1, the unit circle, but is 1\.0"):
        vx.plot.multipliers(orbit, limit=1.0)
    grid = xr.concat([orbits, orbits], dim="x0[1]")
    with pytest.raises(ValueError, match="A picture of multipliers needs one swept quantity, but there are"):
        vx.plot.multipliers(grid)


def test_multipliers_are_seen_on_a_dark_background(orbit, orbits):
    with plt.style.context("dark_background"):
        planes = [vx.plot.multipliers(orbits), vx.plot.multipliers([orbit, orbit])]
    marks = [c for ax in planes for c in ax.collections if isinstance(c, PathCollection)]
    assert min(grey(color[:3]) for c in marks for color in c.get_edgecolors()) > SEEN
    assert max(grey(ax.patches[0].get_facecolor()[:3]) for ax in planes) < SEEN


def test_a_picture_of_multipliers_leaves_the_current_axes_alone_and_can_be_printed(orbits):
    figure, (current, other) = plt.subplots(1, 2)
    plt.sca(current)
    assert vx.plot.multipliers(orbits, ax=other) is other
    assert plt.gca() is current
    assert len(plt.get_fignums()) == 1
    figure.savefig(io.BytesIO(), format="pdf")
