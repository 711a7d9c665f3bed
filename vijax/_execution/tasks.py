"""Tasks given to an executor, on any machine, and their answers as they come.

An executor is any `concurrent.futures.Executor`: processes of this machine, Dask, MPI. Only its `submit` is used, and
of its futures `add_done_callback`, `result` and `cancel`: executors promise no more.

An error in a task comes back as its answer, so whatever a future raises is an error of the executor: a worker was
killed, or cannot read what it was sent. Such a task is submitted again, a few times. An executor that takes no more
tasks is given up, because only its owner can make another.

Tasks are taken from an iterator, a bounded number at a time: there may be more than fit into memory.
"""

import contextlib
import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, cast

import jax
import numpy as np

from .._dataset_attributes import versions
from .._jax.xla import PLAIN

# Most attempts at a task. A task that was lost so often, by as many workers perhaps, is what kills them.
_ATTEMPTS = 4
# Seconds between two checks for an interrupt by the user.
_TURN = 0.5


def as_executor(executor: object) -> Executor:
    """The given executor, or that of a client of Dask.

    Raises:
        ValueError: if it is neither, or one of forked processes, which would hang.
    """
    if callable(get_executor := getattr(executor, "get_executor", None)):
        executor = get_executor()
    if not isinstance(executor, Executor):
        raise ValueError(
            "Argument `executor` must be a `concurrent.futures.Executor`, as `ProcessPoolExecutor` or "
            f"`mpi4py.futures.MPIPoolExecutor`, or a client of Dask, but is {executor!r}."
        )
    context = getattr(executor, "_mp_context", None)
    if isinstance(executor, ProcessPoolExecutor) and context and context.get_start_method() == "fork":
        raise ValueError(
            "Argument `executor` copies this process by `os.fork`, which hangs after JAX was used: give it "
            '`mp_context=multiprocessing.get_context("spawn")`.'
        )
    return executor


class _Task(NamedTuple):
    """Key of a task, arguments for a worker, and number of attempts so far."""

    key: Any
    args: tuple
    attempts: int = 0


class _Answer(NamedTuple):
    """Value that a function returned, or error that it raised."""

    value: Any
    error: Exception | None = None


def run_tasks(
    executor: Executor | None,
    function: Callable,
    tasks: Iterable[tuple[Any, tuple]],
    in_flight: int,
) -> Iterator[tuple[Any, Any]]:
    """Call a function with the arguments of every task, on workers.

    Args:
        executor: gives tasks to workers; None calls the function here, one task after another.
        function: a function of a module, which workers import.
        tasks: for each a key, which stays here, and the arguments; the next is taken when there is room for it.
        in_flight: most tasks that the executor has at a time.

    Yields:
        The key and the returned value, in the order in which they come. When the iteration is left, tasks that no
        worker has begun are cancelled.

    Raises:
        RuntimeError: if the executor takes no more tasks, or loses one again and again.
        ValueError: if a task cannot be sent, or the versions or settings of a worker differ.
        Exception: whatever the function raises.
    """
    if executor is None:
        for key, args in tasks:
            yield key, function(*args)
        return
    pool = _TaskPool(executor, function, (_Task(*task) for task in tasks), max(in_flight, 1))
    try:
        while pool.submit_more():
            task, answer = pool.next_answer()
            if answer is None:
                pool.again.append(task)
            elif answer.error is not None:
                raise answer.error
            else:
                yield task.key, answer.value
    finally:
        for future in pool.given:
            future.cancel()
    if pool.closed is not None:
        raise pool.closed


class _TaskPool:
    """Tasks given to an executor, and their answers.

    Attributes:
        again: tasks that were lost.
        given: tasks that the executor has.
        closed: error with which the executor refused a task. The tasks that it has are still awaited.
    """

    def __init__(self, executor: Executor, function: Callable, more: Iterator[_Task], room: int):
        self.again: list[_Task] = []
        self.given: dict[Future, _Task] = {}
        self.closed: RuntimeError | None = None
        self._executor, self._function, self._more, self._room = executor, function, more, room
        self._done: SimpleQueue[Future] = SimpleQueue()

    def submit_more(self) -> bool:
        """Submit tasks while there are any and there is room; True if the executor has any."""
        while self.closed is None and len(self.given) < self._room:
            task = self.again.pop() if self.again else next(self._more, None)
            if task is None:
                break
            try:
                future = _submit(self._executor, self._function, task)
            except RuntimeError as error:
                self.closed = error
                break
            self.given[future] = task._replace(attempts=task.attempts + 1)
            future.add_done_callback(self._done.put)
        return bool(self.given)

    def next_answer(self) -> tuple[_Task, _Answer | None]:
        """Wait for a task to end, in short intervals, so that an interrupt is noticed."""
        while True:
            with contextlib.suppress(Empty):
                future = self._done.get(timeout=_TURN)
                task = self.given.pop(future)
                return task, _answer(future, task)


def _submit(executor: Executor, function: Callable, task: _Task) -> Future:
    # A process where 64-bit numbers are still off reads a JAX array as 32 bits.
    args = jax.tree.map(lambda a: np.asarray(a) if isinstance(a, jax.Array) else a, task.args)
    environment = jax.config.read("jax_enable_x64"), _environment()
    try:
        return executor.submit(_run, function, args, *environment)
    except Exception as error:
        _refuse_unsendable(task.args)
        raise RuntimeError(
            f"The executor takes no more tasks ({type(error).__name__}: {error}): a worker may have been killed. Make a "
            "new one and call again; what a `store` or `out` has by now is not computed again."
        ) from error


def _answer(future: Future, task: _Task) -> _Answer | None:
    """Answer to a task; None if the executor lost it."""
    try:
        return cast(_Answer, future.result())
    except Exception as error:
        _refuse_unsendable(task.args)
        if task.attempts < _ATTEMPTS:
            return None
        raise RuntimeError(
            f"The executor lost the same task {_ATTEMPTS} times ({type(error).__name__}: {error}). Look whether its workers "
            "can import vijax, and what they need of memory."
        ) from error


def _refuse_unsendable(args: tuple) -> None:
    """Raise an error that says what is wrong, if the arguments cannot be sent."""
    try:
        pickle.dumps(args)
    except Exception as error:
        raise ValueError(
            "The machine cannot be sent to another process: a `force`, `flow` or family of your own must be a class or a function at the "
            "top level of a module that can be imported there, no lambda and nothing defined inside of a function. (Dask "
            f"sends those too.) {type(error).__name__}: {error}"
        ) from error


def _environment() -> dict[str, object]:
    """Versions and settings that, beside the processor, determine the last bits."""
    libraries: dict[str, object] = {name: a for name, a in versions().items() if name != "python_version"}
    return libraries | {"device": jax.default_backend(), "VIJAX_PLAIN": PLAIN}


def _run(function: Callable, args: tuple, x64: bool, environment: dict[str, object]) -> _Answer:
    """Call a function as it would be called where the task comes from; run by a worker."""
    try:
        for name, here in _environment().items():
            if here != environment[name]:
                raise ValueError(
                    f"A worker has `{name}` {here}, but {environment[name]} is where the call was made: results would differ. "
                    "Give all machines the same environment."
                )
        with jax.enable_x64(x64):
            return _Answer(function(*args))
    except Exception as error:
        error.add_note(f"Raised by a worker: {traceback.format_exc()}")
        return _Answer(None, error)
