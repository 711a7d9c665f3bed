"""Sweeps on other processes, by any executor, find the same as on this one, bit for bit."""

from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool

import pytest
import xarray as xr
from test_store import SMALL_CHUNKS, assert_same, chunks_of, sweep


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
        sweep(tmp_path, executor=Closed(), settings=SMALL_CHUNKS)
    assert len(chunks_of(tmp_path)) == 2
    executor = Here()
    assert_same(sweep(tmp_path, executor=executor), plain[None])
    assert executor.given == 3
