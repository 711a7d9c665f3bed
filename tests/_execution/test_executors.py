"""Sweeps by any executor equal those in this process, bit for bit; see `test_clusters.py` for real ones."""

import signal
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import jax
import numpy as np
import pytest
import xarray as xr
from helpers import counted
from test_store import (  # noqa: F401
    FREQUENCIES,
    FREQUENCY,
    SMALL_CHUNKS,
    assert_same,
    chunks_of,
    interruptible,
    stop_at_chunk,
    sweep as run_sweep,
)

import vijax as vx
from vijax._execution import tasks
from vijax._execution.threads import Threads

# Short, but not without impacts.
sweep = partial(run_sweep, transient=1, record=2)
ONE_BY_ONE = replace(SMALL_CHUNKS, max_chunk=1)


class Here(Executor):
    """An executor that runs each task at once in this process, and loses some of them."""

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


class Slow(Here):
    """An executor that runs two tasks and leaves the others pending."""

    def __init__(self):
        super().__init__()
        self.waiting = []

    def submit(self, function, /, *args, **options) -> Future:
        if self.given < 2:
            return super().submit(function, *args, **options)
        self.waiting.append(Future())
        return self.waiting[-1]


class Closed(Here):
    """An executor that takes a few tasks and rejects the others."""

    def submit(self, function, /, *args, **options) -> Future:
        if self.given == 2:
            raise BrokenProcessPool("a worker was killed")
        return super().submit(function, *args, **options)


@pytest.fixture(scope="module")
def plain() -> dict[str | None, xr.Dataset]:
    """Sweeps in this process."""
    return {carry: sweep(carry=carry) for carry in (None, "up")}


@pytest.mark.parametrize("carry", [None, "up"])
def test_an_executor_changes_nothing(plain, carry):
    assert_same(sweep(carry=carry, executor=Here()), plain[carry])


def test_tasks_share_the_program_of_the_whole(plain):
    with counted() as compilations:
        sweep(executor=Here(), values={FREQUENCY: FREQUENCIES[:6]})  # chunks of 3
        sweep(executor=Here(), values={FREQUENCY: FREQUENCIES[:6]}, settings=ONE_BY_ONE)
    assert compilations == []


@pytest.mark.thorough
def test_points_one_by_one_are_the_same(plain):
    values = {FREQUENCY: FREQUENCIES[:6]}
    assert_same(sweep(executor=Here(), values=values, settings=ONE_BY_ONE), sweep(values=values))


def test_no_more_tasks_are_given_out_than_are_asked_for():
    most = []

    class Watched(Here):
        def submit(self, function, /, *args, **options) -> Future:
            future = super().submit(function, *args, **options)
            self.open = getattr(self, "open", 0) + 1
            most.append(self.open)
            result = future.result

            def told(*args):
                self.open -= 1
                return result(*args)

            future.result = told
            return future

    sweep(executor=Watched(), settings=replace(SMALL_CHUNKS, in_flight=2))
    assert (len(most), max(most)) == (5, 2)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_cancels_what_waits_and_keeps_what_is_done(tmp_path):
    executor = Slow()
    with pytest.MonkeyPatch.context() as patch:
        stop_at_chunk(2, patch, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, executor=executor)
    assert len(executor.waiting) == 3
    assert all(future.cancelled() for future in executor.waiting)
    assert len(chunks_of(tmp_path)) == 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:vijax works in float32")
def test_an_executor_of_this_process_works_in_the_precision_of_the_call():
    with jax.enable_x64(False), ThreadPoolExecutor(1) as executor:
        system = vx.models.wagg_bishop_b(1.0)
        here, there = (sweep(system=system, executor=one) for one in (None, executor))
    assert here.x.dtype == np.float32
    assert_same(there, here)


def test_what_a_task_raises_is_raised_here(monkeypatch):
    def fail(*args):
        raise ValueError("all is lost")

    monkeypatch.setattr(Threads, "run", fail)
    with pytest.raises(ValueError, match="all is lost") as raised:
        sweep(executor=Here())
    assert "Raised by a worker" in raised.value.__notes__[0]


def test_a_worker_with_other_versions_is_refused(monkeypatch):
    def other(function, /, *args) -> Future:
        monkeypatch.setattr(tasks, "versions", lambda: {"jax_version": "0.1"})
        return Here.submit(Here(), function, *args)

    executor = Here()
    monkeypatch.setattr(executor, "submit", other)
    with pytest.raises(
        ValueError, match=r"A worker has `jax_version` 0.1, but .* Give all machines the same"
    ):
        sweep(executor=executor)


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


WRONG = {
    "no executor": (lambda: 4, "must be a `concurrent.futures.Executor`"),
    "fork": (lambda: ProcessPoolExecutor(1, get_context("fork")), "give it `mp_context="),
}


@pytest.mark.parametrize("what", WRONG)
def test_an_executor_that_cannot_serve_is_refused(what):
    made, sentence = WRONG[what]
    with pytest.raises(ValueError, match=sentence):
        sweep(executor=made())


@pytest.mark.thorough
def test_a_chart_is_the_same():
    plane = {FREQUENCY: np.linspace(1.5, 2.0, 3), "x0[0]": np.linspace(-0.1, 0.0, 2)}
    executor = Here()
    found, expected = (
        vx.chart(vx.models.wagg_bishop_b(1.0), plane, transient=2, record=4, executor=one, progress=False)
        for one in (executor, None)
    )
    xr.testing.assert_identical(found, expected)
    assert executor.given > 0


START = {"x0[0]": [0.0, -0.1], "v0[0]": [0.0, 0.1]}
SEARCHES = {
    "attractors": lambda executor: vx.attractors(vx.models.wagg_bishop_b(1.0), START, executor=executor),
    "basins": lambda executor: vx.basins(vx.models.wagg_bishop_b(1.0), START, executor=executor),
    "follow_attractors": lambda executor: vx.follow_attractors(
        vx.models.wagg_bishop_b(1.0), FREQUENCY, [1.0, 1.1], np.zeros((2, 4)), executor=executor
    ),
}


@pytest.mark.parametrize("search", SEARCHES)
def test_searches_run_their_starts_by_the_executor(search):
    with pytest.raises(RuntimeError, match="lost the same task 4 times"):
        SEARCHES[search](Here(lost=tuple(range(10))))
