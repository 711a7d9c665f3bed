"""Real executors with several processes: their results, and recovery after a worker is killed."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from documents import ROOT
from test_executors import Here, interruptible, sweep  # noqa: F401
from test_store import NUM_CHUNKS, SMALL_CHUNKS, assert_same, chunks_of, stop_at_chunk
from test_written import assert_same_when_read

import vijax as vx
from vijax._execution.tasks import run_tasks

pytestmark = pytest.mark.thorough

# The least number that keeps two workers busy: most chunks are not yet submitted when the first is done.
FEW_AT_A_TIME = replace(SMALL_CHUNKS, in_flight=2)
DAMPED = vx.models.wagg_bishop_b(1.0)


@pytest.fixture(scope="module")
def plain() -> xr.Dataset:
    return sweep()


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        yield executor


def test_processes_find_the_same(plain, pool):
    assert_same(sweep(executor=pool), plain)


def test_processes_write_the_same(plain, pool, tmp_path):
    assert_same_when_read(sweep(out=tmp_path, executor=pool), plain)


def test_a_force_that_cannot_be_sent_is_refused(pool):
    system = replace_force(lambda t, x, v, args: -0.1 * x**3)
    with pytest.raises(
        ValueError, match="cannot be sent to another process: a `force`, `flow` or family of your own must be"
    ):
        sweep(system=system, executor=pool)


def replace_force(force) -> vx.ImpactSystem:
    return vx.ImpactSystem(
        DAMPED.mass, DAMPED.damping, DAMPED.stiffness, DAMPED.forcing, DAMPED.stops, force=force
    )


@pytest.mark.usefixtures("interruptible")
def test_interrupted_processes_leave_what_is_done(plain, pool, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        stop_at_chunk(2, patch, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, executor=pool, settings=FEW_AT_A_TIME)
    assert len(chunks_of(tmp_path)) == 1
    assert_same(sweep(tmp_path, executor=pool), plain)


@pytest.mark.slow
def test_the_last_of_a_pool_a_killed_process_ends_it_and_the_store_goes_on(plain, pool, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        stop_at_chunk(1, patch, lambda: kill(pool.submit(os.getpid).result()))
        with pytest.raises(RuntimeError, match=r"takes no more tasks \(BrokenProcessPool"):
            sweep(tmp_path, executor=pool, settings=FEW_AT_A_TIME)
    assert 1 <= len(chunks_of(tmp_path)) < NUM_CHUNKS
    assert_same(sweep(tmp_path, executor=Here()), plain)


def kill(pid: int) -> None:
    """Kill a process, and wait for its supervisor to notice."""
    os.kill(pid, signal.SIGKILL)
    time.sleep(0.5)


@pytest.mark.slow
def test_dask_runs_again_what_a_killed_worker_had(plain, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    killed = []
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):

        def kill_one() -> None:
            killed.append(min(client.run(os.getpid).values()))
            os.kill(killed[0], signal.SIGKILL)

        with pytest.MonkeyPatch.context() as patch:
            stop_at_chunk(1, patch, kill_one)
            assert_same(sweep(tmp_path, executor=client, settings=replace(SMALL_CHUNKS, in_flight=4)), plain)
        assert killed[0] not in client.run(os.getpid).values()
        # Dask can send functions that pickle cannot.
        assert dict(run_tasks(client.get_executor(), lambda k: k + 1, [("one", (1,))], 1)) == {"one": 2}


@pytest.mark.slow
def test_dask_polishes_the_same_orbits():
    swept = vx.sweep(
        vx.models.wagg_bishop_a(1.0),
        {"forcing.frequency": np.linspace(0.7, 0.9, 70)},
        transient=200,
        record=20,
        progress=False,
    )
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        orbits = vx.periodic_orbits(swept, executor=client, progress=False)
    assert orbits["converged"].any()
    xr.testing.assert_identical(orbits, vx.periodic_orbits(swept, progress=False))


RANK_0 = """
import pickle, sys
import jax
jax.config.update("jax_enable_x64", True)
sys.path.insert(0, sys.argv[1])
from mpi4py.futures import MPIPoolExecutor
if __name__ == "__main__":
    from test_executors import sweep
    with MPIPoolExecutor() as executor:
        found = sweep(executor=executor)
        print("workers:", executor.num_workers)
    with open(sys.argv[2], "wb") as file:
        pickle.dump(found, file)
"""


@pytest.mark.slow
def test_two_ranks_of_mpi_find_the_same(plain, tmp_path):
    pytest.importorskip("mpi4py", reason="the extra `cluster` is not installed")
    mpiexec = Path(sys.executable).with_name("mpiexec")
    if not mpiexec.exists():
        pytest.skip("the extra `cluster` is not installed: no mpiexec beside Python")
    script, out = tmp_path / "script.py", tmp_path / "found"
    script.write_text(RANK_0)
    done = subprocess.run(
        [mpiexec, "-n", "2", sys.executable, "-m", "mpi4py.futures", script, Path(__file__).parent, out],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests")))},
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "workers: 1" in done.stdout
    assert_same(pickle.loads(out.read_bytes()), plain)
