"""The recorded impacts of sweeps as tables: a row an impact, none for padding."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import vijax as vx

FREQUENCY, RESTITUTION = "forcing.frequency", "stops[*].restitution"
SYSTEM = vx.models.wagg_bishop_b(0.8)
PLAIN = ["stop", "time", "phase", "velocity"]


def sweep(values: dict, system: vx.ImpactSystem = SYSTEM, **options) -> xr.Dataset:
    return vx.sweep(system, values, transient=4, record=3, progress=False, **options)


@pytest.fixture(scope="module")
def grid() -> xr.Dataset:
    """Two quantities, up and down; some points have more impacts than others."""
    return sweep({FREQUENCY: [0.3, 0.8, 1.4], RESTITUTION: [0.5, 0.9]}, carry="both")


def assert_lists(table: pd.DataFrame, ds: xr.Dataset):
    """Compare with the dataset, point by point."""
    dims, row = ds.result.dims, 0
    for index in np.ndindex(ds.result.shape):
        point = ds.isel(dict(zip(dims, index, strict=True)))
        for k in range(int(point.num_impacts.sum())):
            found = table.iloc[row]
            assert [found[dim] for dim in dims] == [point[dim].item() for dim in dims]
            for name in PLAIN:
                assert found[name] == float(point[f"impact_{name}"][k])
            row += 1
    assert row == len(table) > 0


def test_every_impact_of_a_grid_has_one_row(grid):
    counts = grid.num_impacts.sum("stop")
    assert int(counts.min()) < int(counts.max())  # so that there is padding
    table = vx.impacts(grid)
    assert list(table.columns) == ["direction", FREQUENCY, RESTITUTION, *PLAIN]
    assert table.dtypes[["stop"]].map(lambda kind: kind.kind).tolist() == ["i"]
    assert_lists(table, grid)


def test_the_rows_of_a_point_are_in_the_order_of_time(grid):
    table = vx.impacts(grid)
    later = table.groupby(["direction", FREQUENCY, RESTITUTION], sort=False).time.diff().dropna()
    assert len(later) > 0
    assert (later >= 0).all()


def test_the_order_of_dimensions_in_memory_does_not_matter(grid):
    ds = grid.sel(direction="up").transpose("impact", RESTITUTION, FREQUENCY, ...)
    table = vx.impacts(ds)
    own = ["direction", RESTITUTION, FREQUENCY]
    expected = vx.impacts(grid.sel(direction="up")).sort_values([RESTITUTION, FREQUENCY], kind="stable")
    pd.testing.assert_frame_equal(table[[*own, *PLAIN]], expected[[*own, *PLAIN]].reset_index(drop=True))


def test_one_point_has_the_values_that_were_selected(grid):
    point = grid.isel({"direction": 0, FREQUENCY: 1, RESTITUTION: 0})
    table = vx.impacts(point)
    assert len(table) == int(point.num_impacts.sum()) > 0
    assert set(table[FREQUENCY]) == {0.8}
    assert set(table[RESTITUTION]) == {0.5}


def test_points_without_impacts_have_no_rows():
    ds = sweep({"stops[*].position": [1e3, 0.1]}, vx.models.wagg_bishop_a(0.8))
    table = vx.impacts(ds)
    assert set(table["stops[*].position"]) == {0.1}
    none = vx.impacts(ds.isel({"stops[*].position": [0]}))
    assert len(none) == 0
    assert list(none.columns) == ["stops[*].position", *PLAIN]


def test_moving_stops_have_relative_velocities():
    ds = sweep({"stops[0].restitution": [0.3, 0.5]}, vx.models.ball_on_table(6.0, 0.5))
    table = vx.impacts(ds)
    assert list(table.columns) == ["stops[0].restitution", *PLAIN, "relative_velocity"]
    expected = ds.impact_relative_velocity.values[ds.impact_stop.values >= 0]
    np.testing.assert_array_equal(table.relative_velocity, expected)
    assert not np.allclose(table.relative_velocity, table.velocity)


def test_unrecorded_impacts_are_reported():
    with pytest.warns(UserWarning, match="max_impacts"):
        ds = sweep({FREQUENCY: [0.8]}, max_impacts=2)
    with pytest.warns(UserWarning, match="max_impacts"):
        assert len(vx.impacts(ds)) == 2


def test_another_dataset_is_refused(grid):
    with pytest.raises(ValueError, match=r"what `vx\.sweep` returned, but has no .*impact_stop"):
        vx.impacts(vx.stroboscopic_section(grid))


def test_a_dataset_from_a_file_has_the_same_impacts(grid, tmp_path):
    path = tmp_path / "grid.nc"
    grid.to_netcdf(path)
    with xr.open_dataset(path) as back:
        pd.testing.assert_frame_equal(vx.impacts(back), vx.impacts(grid))
