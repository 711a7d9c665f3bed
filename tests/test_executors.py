"""Sweeps on other processes, by any executor, find the same as on this one, bit for bit."""

from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
import xarray as xr
from test_store import FREQUENCIES, FREQUENCY, assert_same, chunks_of, sweep as run_sweep

# Short, but not without impacts.
sweep = partial(run_sweep, transient=1, record=2)


class Here(Executor):
    """Runs each task at once, in this process, but loses some of them."""

    def __init__(self, lost: tuple[int, ...] = ()):
        self.lost, self.given = lost, 0

    def submit(self, function, /, *args, **options) -> Future:
        self.given += 1
        future = Future()
        if self.given in self.lost:
            future.set_exception(BrokenProcessPool("a worker was killed"))
        else:
            future.set_result(function(*args, **options))
        return future


class Closed(Here):
    """Takes a few tasks, then none."""

    def submit(self, function, /, *args, **options) -> Future:
        if self.given == 2:
            raise BrokenProcessPool("a worker was killed")
        return super().submit(function, *args, **options)


@pytest.fixture(scope="module")
def plain() -> dict[str | None, xr.Dataset]:
    """The sweeps on this process."""
    return {carry: sweep(carry=carry) for carry in (None, "up")}


@pytest.mark.parametrize("carry", [None, "up"])
def test_an_executor_changes_nothing(plain, carry):
    assert_same(sweep(carry=carry, executor=Here()), plain[carry])


def test_tasks_that_were_lost_are_given_out_again(plain):
    executor = Here(lost=(1, 3, 4))
    assert_same(sweep(executor=executor), plain[None])
    assert executor.given == 5 + 3


def test_a_task_that_is_always_lost_is_given_up():
    executor = Here(lost=tuple(range(100)))
    with pytest.raises(RuntimeError, match=r"lost the same task 4 times .* a worker was killed"):
        sweep(executor=executor)


def test_what_a_store_has_is_kept_from_an_executor_that_ends(plain, tmp_path):
    with pytest.raises(RuntimeError, match=r"takes no more tasks .* a worker was killed.*\. Make a new one"):
        sweep(tmp_path, executor=Closed())
    assert len(chunks_of(tmp_path)) == 2
    executor = Here()
    assert_same(sweep(tmp_path, executor=executor), plain[None])
    assert executor.given == 3


def assert_same_when_read(found: xr.Dataset, expected: xr.Dataset):
    """Every bit; Zarr keeps lists for arrays among attributes."""
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
    pytest.importorskip("zarr")
    found = sweep(out=tmp_path / "a.zarr")
    assert found.impact_time.chunks is not None
    assert_same_when_read(found, plain[None])
    again = Here()
    assert_same_when_read(sweep(out=tmp_path / "a.zarr", executor=again), plain[None])
    assert again.given == 1  # a look at all points; nothing is left to run


def test_a_sweep_that_is_written_goes_on_where_it_ended(plain, tmp_path):
    with pytest.raises(RuntimeError, match="takes no more tasks"):
        sweep(out=tmp_path, executor=Closed())
    partly = xr.open_zarr(tmp_path, consolidated=False)
    assert int((partly.result == 0).sum()) in (4, 5)
    assert int((partly.result == -1).sum()) in (19, 20)
    executor = Here()
    assert_same_when_read(sweep(out=tmp_path, executor=executor), plain[None])
    assert executor.given == 1 + 4


def test_blocks_of_several_swept_quantities_are_put_where_they_belong(tmp_path):
    values = {"v0[1]": [0.0, 0.1, 0.2], FREQUENCY: FREQUENCIES[:7], "x0[0]": [0.0, -0.1]}
    found = sweep(out=tmp_path, values=values)
    assert found.result.chunks == ((1, 1, 1), (2, 2, 2, 1), (2,))
    assert_same_when_read(found, sweep(values=values))


@pytest.mark.parametrize("options", [{"carry": "up"}, {"store": "other"}, {"carry_from": xr.Dataset()}])
def test_what_is_written_starts_by_itself(tmp_path, options):
    with pytest.raises(ValueError, match="leave out `store`, `carry` and `carry_from`"):
        sweep(out=tmp_path, **options)


def test_a_folder_of_another_sweep_is_not_written_to(tmp_path):
    sweep(out=tmp_path / "a", transient=0)
    with pytest.raises(ValueError, match="holds another sweep: `transient` is 0 there, but 1 here"):
        sweep(out=tmp_path / "a", transient=1)
    with pytest.raises(ValueError, match="`out` must name a new or empty folder"):
        sweep(out=tmp_path, transient=0)
    with pytest.raises(ValueError, match="`store` must name a new or empty folder"):
        sweep(tmp_path / "a", transient=0)


WRONG = {
    "no executor": (lambda: 4, "must be a `concurrent.futures.Executor`"),
    "fork": (lambda: ProcessPoolExecutor(1, get_context("fork")), "give it `mp_context="),
}


@pytest.mark.parametrize("what", WRONG)
def test_an_executor_that_cannot_serve_is_refused(what):
    made, sentence = WRONG[what]
    with pytest.raises(ValueError, match=sentence):
        sweep(executor=made())
