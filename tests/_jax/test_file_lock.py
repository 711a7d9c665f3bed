"""One process or thread at a time makes a program; a dead one does not stop the others."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from vijax._jax import program_store
from vijax._jax.announcing import Stage, announced_to
from vijax._jax.file_lock import locked
from vijax._jax.program_store import ProgramStore
from vijax._jax.programs import Programs

HOLDER = """
import sys, time
from vijax._jax.file_lock import locked
with locked(__import__("pathlib").Path(sys.argv[1]), lambda: None):
    print("held", flush=True)
    time.sleep(100)
"""


def nothing() -> None:
    """Nothing is told."""


def test_a_lock_is_held_by_one_and_leaves_no_file(tmp_path):
    inside, most = [], []

    def enter(k):
        with locked(tmp_path / "one.lock", nothing):
            inside.append(k)
            most.append(len(inside))
            time.sleep(0.01)
            inside.remove(k)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(enter, range(24)))
    assert most == [1] * 24
    assert not list(tmp_path.iterdir())


def test_the_lock_of_a_killed_process_is_no_obstacle(tmp_path):
    file, waits = tmp_path / "one.lock", []
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(file)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"

        def kill() -> None:
            waits.append(1)
            os.kill(process.pid, signal.SIGKILL)

        with locked(file, kill):
            assert waits == [1]
    assert not file.exists()


def test_where_no_lock_can_be_made_there_is_none(tmp_path):
    (tmp_path / "file").write_text("")
    lock, waits = tmp_path / "file" / "one.lock", []
    with locked(lock, lambda: waits.append("first")), locked(lock, lambda: waits.append("second")):
        assert not lock.exists()
    assert waits == []


@pytest.mark.usefixtures("no_other_cache")
@pytest.mark.parametrize("name", ["double", None])
def test_threads_that_need_a_program_at_once_compile_it_once(tmp_path, monkeypatch, name):
    monkeypatch.setattr(program_store, "_active", program_store._Active())
    program_store.store_programs(tmp_path)
    saved, save = [], ProgramStore.save
    monkeypatch.setattr(ProgramStore, "save", lambda self, key, *a: (saved.append(key), save(self, key, *a)))
    works: list[Stage] = []

    def twice(x):
        time.sleep(0.1)  # while it is traced
        return 2 * x

    def call(_):
        return Programs(twice, lambda: None, name=name)(np.arange(3.0) + 0.5)

    with announced_to(works.append), ThreadPoolExecutor(4) as threads:
        for found in threads.map(call, range(4)):
            np.testing.assert_array_equal(found, [1, 3, 5])
    assert len(saved) == 1
    assert works.count(Stage.COMPILES if name else Stage.TRACES) == (1 if name else 4)
    assert not list(tmp_path.glob("*.lock"))
