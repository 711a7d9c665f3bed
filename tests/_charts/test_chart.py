"""A chart equals the full grid where it was run, and is run where the motion changes."""

import warnings

import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._charts.refinement import refined as refine

PLANE = {"forcing.frequency": np.linspace(0.6, 1.6, 37), "forcing.amplitude[0]": np.linspace(0.2, 0.6, 23)}


def refined(kind, shape: tuple[int, int], stride: int) -> tuple[xr.Dataset, list[int]]:
    """Chart of a function of row and column, and the points that were run, in order."""
    due = []

    def run(where):
        for part in np.array_split(where, 3):
            due.extend(part.tolist())
            row, col = np.unravel_index(part, shape)
            columns = {
                "motion": ("start", kind(row, col).astype(np.int8)),
                "num_periods": ("start", np.ones(len(part), int)),
                "num_impacts": (("start", "stop"), np.full((len(part), 1), np.nan)),
            }
            yield part, xr.Dataset(columns)

    axes = {"a": np.arange(shape[0], dtype=float), "b": np.arange(shape[1], dtype=float)}
    return refine(axes, stride, run, ("motion", "num_periods", "num_impacts")), due


def disc(row, col):
    return (row - 100) ** 2 + (col - 70) ** 2 < 50**2


@pytest.mark.parametrize("shape", [(257, 193), (250, 200)])
def test_a_region_is_found_to_the_point_by_a_fraction_of_them(shape):
    chart, due = refined(disc, shape, 16)
    row, col = np.indices(shape)
    np.testing.assert_array_equal(chart.motion, disc(row, col))
    assert len(due) == len(set(due)) == int(chart.is_computed.sum())
    assert len(due) < 0.06 * row.size


def test_of_a_finer_grid_a_smaller_share_is_run():
    shares = [len(refined(disc, (n, n), 8)[1]) / n**2 for n in (201, 401, 801)]
    assert shares[1] < 0.7 * shares[0]
    assert shares[2] < 0.8 * shares[1]


def test_with_a_stride_of_one_every_point_is_run():
    chart, due = refined(lambda row, col: (7 * row + 5 * col) % 11, (9, 14), 1)
    assert sorted(due) == list(range(9 * 14))
    assert chart.is_computed.all()


def test_what_is_filled_has_the_motion_of_a_corner():
    chart, _ = refined(lambda row, col: (row > 20) + 2 * (col > 11), (33, 33), 16)
    row, col = np.indices((33, 33))
    np.testing.assert_array_equal(chart.motion, (row > 20) + 2 * (col > 11))
    assert not chart.is_computed.all()


def test_a_chart_says_for_how_long_its_motions_must_run_on():
    system = vx.models.impact_oscillator(1.0, position=0.2, damping_ratio=0.01, restitution=0.8)
    plane = {"forcing.frequency": [1.8, 1.9], "stops[0].position": [0.2, 0.21]}
    told = r"[1-4] of 4 motions have not settled. Run on for about \d+ forcing periods more"
    with pytest.warns(UserWarning, match=told) as said:
        vx.chart(system, plane, transient=30, record=16, stride=1, progress=False)
    more = int(str(said[0].message).split("about ")[1].split()[0])
    chart = vx.chart(system, plane, transient=30 + 2 * more, record=16, stride=1, progress=False)
    assert (chart.num_periods > 0).all()


@pytest.mark.thorough
def test_a_machine_has_the_motions_of_its_sweep_where_it_was_run():
    system = vx.models.wagg_bishop_a(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chart = vx.chart(system, PLANE, stride=8, progress=False)
        whole = vx.classify(vx.sweep(system, PLANE, progress=False))
    is_run = chart.is_computed.values
    assert 0.05 < is_run.mean() < 0.8
    for name in ("motion", "num_periods", "num_impacts"):
        np.testing.assert_array_equal(chart[name].values[is_run], whole[name].values[is_run])
    assert (chart.motion == whole.motion).mean() > 0.95
    assert vx.plot.regions(chart).get_legend() is not None


def test_quantities_are_linear_between_corners_and_counts_are_those_of_the_nearest():
    row, col = np.indices((33, 33))

    def run(where):
        r, c = np.unravel_index(where, (33, 33))
        columns = {
            "motion": ("start", (r > 15).astype(int)),
            "plane": ("start", 2.0 * r - 3.0 * c),
            "turning": ("start", (1.0 + r + c) * np.exp(1j)),
            "erased": ("start", np.where(c == 32, -np.inf, 1.0)),
        }
        yield where, xr.Dataset(columns)

    ds = refine({"a": np.arange(33.0), "b": np.arange(33.0)}, 16, run, ("motion",))
    assert not ds.is_computed.all()
    np.testing.assert_allclose(ds.plane, 2 * row - 3 * col, atol=1e-12)
    np.testing.assert_allclose(ds.turning, (1 + row + col) * np.exp(1j), rtol=1e-12)
    assert set(np.unique(ds.erased)) == {-np.inf, 1.0}


def test_other_than_two_quantities_are_refused():
    system = vx.models.wagg_bishop_a(1.0)
    with pytest.raises(ValueError, match=r"A chart needs two paths .* `forcing.frequency` of shape \(37,\)"):
        vx.chart(system, {"forcing.frequency": PLANE["forcing.frequency"]})
    with pytest.raises(ValueError, match="`stride` must be a whole number, 1 or more"):
        vx.chart(system, PLANE, stride=0)
    with pytest.raises(ValueError, match="with `starts` both paths must be of the machine"):
        vx.chart(system, {"x0[0]": [0.0, 0.1], "forcing.frequency": [0.8, 0.9]}, starts=3)
