"""Attractors along a parameter: continuation, births and deaths."""

import numpy as np
import pytest
from coexisting_motions import MIRRORED, box, machine

import vijax as vx
from vijax._attractors.attractor import Attractor
from vijax._attractors.attractor_matching import branch_numbers
from vijax._attractors.distances import set_distance

FREQUENCY = "forcing.frequency"
# Cycles are polished by a program that takes long to compile.
polishes = pytest.mark.thorough


@polishes
def test_attractors_go_on_along_a_parameter_begin_and_end():
    values = [1.5, 1.75, 2.0, 2.25]  # far apart, so that attractors move far
    starts = box(24)
    ds = vx.follow_attractors(machine(1.0), FREQUENCY, values, starts, threshold=1.0, progress=False)
    # The two mirror images merge into one motion, which is its own mirror image.
    on = int(ds.is_found.values[1].argmax())
    np.testing.assert_array_equal(ds.is_found[:, on], True)
    np.testing.assert_array_equal(ds.is_found[:, 1 - on], [1, 0, 0, 0])
    np.testing.assert_array_equal(ds.is_found[:, 2], [0, 0, 1, 1])
    np.testing.assert_array_equal(ds.birth, [np.nan, np.nan, 2.0])
    np.testing.assert_array_equal(ds.death[[on, 1 - on, 2]], [np.nan, 1.75, np.nan])
    assert ds.successor.values[[on, 1 - on, 2]].tolist() == [-1, on, -1]
    np.testing.assert_array_equal(ds.num_impacts.sum("stop", skipna=False)[2:, [on, 2]], [[2, 0]] * 2)
    for k, value in enumerate(values):
        single = vx.attractors(machine(value), starts, progress=False)
        shares = np.sort(ds.share[k].values[ds.share[k] > 0])
        np.testing.assert_allclose(shares, np.sort(single.share), atol=1e-12)


@polishes
def test_an_attractor_is_not_lost_where_no_start_leads_to_it_any_more():
    values, starts = [3.0, 2.5, 2.1], box(60)
    first, last = (vx.attractors(machine(w), starts, progress=False) for w in (3.0, 2.1))
    is_quiet = [(ds.num_impacts.sum("stop") == 0).values[ds.label.values] for ds in (first, last)]
    chosen = starts[~is_quiet[1]][:12]
    share = is_quiet[0][~is_quiet[1]][:12].mean()
    ds = vx.follow_attractors(machine(1.0), FREQUENCY, values, chosen, threshold=1.0, progress=False)
    assert ds.is_found.all()
    quiet = ds.num_impacts.sum("stop").values[0].tolist().index(0)
    np.testing.assert_array_equal(ds.num_impacts[:, quiet], 0)
    assert float(ds.share[0, quiet]) == pytest.approx(share)
    assert 0 == ds.share[-1, quiet] < share


@polishes
@pytest.mark.slow
def test_an_attractor_dies_where_a_stop_comes_to_graze_it_and_leads_to_the_one_that_is_left():
    """At phase 0 the motion without impacts is at its highest, beyond the moved stop."""
    response = 1 / (1 - 3.0**2 + 0.05j * 3.0)
    grazing = abs(response)
    load = vx.Harmonic([1.0], 3.0, [-np.angle(response)])
    stops = [vx.Stop(0, -0.5, "lower", 0.8), vx.Stop(0, 0.5, "upper", 0.8)]
    system = vx.ImpactSystem([1.0], [[0.05]], [[1.0]], load, stops)
    near = np.tile([0.98 * grazing, 0.0], (4, 1))
    values = [1.1 * grazing, 1.01 * grazing, 0.99 * grazing]
    starts = np.concatenate([near, box(8) * [0.2, 1.0]])
    ds = vx.follow_attractors(system, "stops[1].position", values, starts, progress=False)
    quiet = ds.num_impacts.sum("stop", skipna=False).values[0].tolist().index(0)
    assert ds.is_found.values[:, [quiet, 1 - quiet]].tolist() == [[True, True], [True, True], [False, True]]
    assert float(ds.death[quiet]) == values[2]
    assert int(ds.successor[quiet]) == 1 - quiet


def motion(value: int, points: list, impacts: float = 1.0) -> Attractor:
    """A made-up cycle at a value of the parameter."""
    rows, nothing = np.array(points, float), np.zeros(2)
    return Attractor(value, rows, 1.0, len(rows), 1, np.array([impacts]), nothing, nothing + 0j, 0.0)


def test_the_nearest_goes_on_those_with_the_same_impacts_first():
    before = [motion(0, [[0.0, 0.0]]), motion(0, [[0.5, 0.0]], 2.0)]
    after = [motion(1, [[0.1, 0.0]], 2.0), motion(1, [[0.15, 0.0]]), motion(1, [[0.9, 0.0]])]
    assert branch_numbers([*before, *after], 2, 0.2).tolist() == [0, 1, 2, 0, 3]
    assert branch_numbers([*before, *after], 2, 0.5).tolist() == [0, 1, 1, 0, 2]


def test_sets_are_as_far_apart_as_their_points_are_in_the_mean():
    assert set_distance(np.zeros((1, 2)), np.array([[1.0, 0.0], [3.0, 0.0]])) == pytest.approx(2.0)


def test_following_anything_else_is_refused():
    with pytest.raises(ValueError, match=r"Argument `values` must have shape \(values,\)"):
        vx.follow_attractors(MIRRORED, FREQUENCY, 1.0, 3)
    with pytest.raises(ValueError, match="names nothing"):
        vx.follow_attractors(MIRRORED, "x0[0]", [0.1], 3)
    with pytest.raises(ValueError, match="Argument `threshold` must be positive"):
        vx.follow_attractors(MIRRORED, FREQUENCY, [1.0], 3, threshold=0.0)
