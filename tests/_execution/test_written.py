"""Sweeps that are written as they run, and read lazily, equal those in memory, bit for bit."""

import os
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from test_executors import Closed, Here, sweep
from test_store import FREQUENCIES, FREQUENCY

import vijax as vx

pytest.importorskip("zarr")


@pytest.fixture(scope="module")
def plain() -> xr.Dataset:
    """Sweep in memory."""
    return sweep()


def assert_same_when_read(found: xr.Dataset, expected: xr.Dataset):
    """Compare every bit; in attributes, Zarr stores arrays as lists."""
    expected = expected.copy()
    expected.steps.attrs.pop("lane_steps", None)
    for variable in expected.variables.values():
        variable.attrs = {
            key: a.tolist() if isinstance(a, np.ndarray) else a for key, a in variable.attrs.items()
        }
    xr.testing.assert_identical(found.load(), expected)
    for name, variable in expected.variables.items():
        assert found[name].dtype == variable.dtype


def test_a_sweep_that_is_written_is_that_in_memory(plain, tmp_path):
    found = sweep(out=tmp_path / "a.zarr")
    assert (found.impact_time.chunks is not None) == (find_spec("dask") is not None)
    assert_same_when_read(found, plain)
    again = Here()
    assert_same_when_read(sweep(out=tmp_path / "a.zarr", executor=again), plain)
    assert again.given == 1  # all points are read; none is left to run


@pytest.mark.thorough
def test_a_sweep_that_is_written_goes_on_where_it_ended(plain, tmp_path):
    with pytest.raises(RuntimeError, match="takes no more tasks"):
        sweep(out=tmp_path, executor=Closed())
    partly = xr.open_zarr(tmp_path, consolidated=False)
    assert int((partly.result == 0).sum()) in (4, 5)
    assert int((partly.result == -1).sum()) in (19, 20)
    executor = Here()
    assert_same_when_read(sweep(out=tmp_path, executor=executor), plain)
    assert executor.given == 1 + 4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["x", "result", "impact_time"])
def test_what_was_lost_of_a_folder_is_run_again(plain, tmp_path, name):
    sweep(out=tmp_path)
    block = tmp_path / name / "c" / "1"
    (block if block.is_file() else next(file for file in block.rglob("*") if file.is_file())).unlink()
    executor = Here()
    assert_same_when_read(sweep(out=tmp_path, executor=executor), plain)
    assert executor.given == 1 + 1


@pytest.mark.slow
def test_blocks_of_several_swept_quantities_are_put_where_they_belong(tmp_path):
    pytest.importorskip("dask")
    values = {"v0[1]": [0.0, 0.1, 0.2], FREQUENCY: FREQUENCIES[:7], "x0[0]": [0.0, -0.1]}
    found = sweep(out=tmp_path, values=values)
    assert found.result.chunks == ((1, 1, 1), (2, 2, 2, 1), (2,))
    assert_same_when_read(found, sweep(values=values))


@pytest.mark.parametrize("options", [{"carry": "up"}, {"store": "other"}, {"carry_from": xr.Dataset()}])
def test_what_is_written_starts_by_itself(tmp_path, options):
    with pytest.raises(ValueError, match="leave out `store`, `carry` and `carry_from`"):
        sweep(out=tmp_path, **options)


@pytest.mark.thorough
def test_a_folder_of_another_sweep_is_not_written_to(tmp_path):
    sweep(out=tmp_path / "a", transient=0)
    with pytest.raises(ValueError, match="holds another sweep: `transient` is 0 there, but 1 here"):
        sweep(out=tmp_path / "a", transient=1)
    with pytest.raises(ValueError, match="`out` must name a new or empty folder"):
        sweep(out=tmp_path, transient=0)
    with pytest.raises(ValueError, match="`store` must name a new or empty folder"):
        sweep(tmp_path / "a", transient=0)


@pytest.mark.slow
def test_the_motion_between_events_is_chosen_for_all_blocks(tmp_path):
    """The modal flow suits most points, but not those of the last block: then it runs none."""
    own = vx.models.wagg_bishop_b(1.0)
    damping = np.array(np.broadcast_to(own.damping, (7, 2, 2)))
    damping[-1, 0, 0] *= 1.5
    values = {"damping": damping}
    expected, found = sweep(values=values), sweep(values=values, out=tmp_path)
    assert (sweep(values={"damping": damping[:-1]}).flow, expected.flow) == ("ModalFlow", "TaylorFlow")
    assert_same_when_read(found, expected)


@pytest.mark.thorough
def test_who_finds_a_folder_begun_meanwhile_goes_on_with_it(plain, tmp_path, monkeypatch):
    replace, met = os.replace, []

    def second(part, path):
        if Path(path) == tmp_path / "a" and not met:
            met.append(1)
            sweep(out=tmp_path / "a")
        replace(part, path)

    monkeypatch.setattr(os, "replace", second)
    assert_same_when_read(sweep(out=tmp_path / "a"), plain)
    assert met
    assert [file.name for file in tmp_path.iterdir()] == ["a"]
