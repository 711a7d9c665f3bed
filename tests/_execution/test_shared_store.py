"""Several processes share a store and its work at the same time, and each returns the whole sweep, bit for bit."""

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import jax
import pytest
import xarray as xr
from test_store import NUM_CHUNKS, assert_same, chunks_of, sweep

from vijax._execution import store as stores
from vijax._execution.threads import Threads

# Waits until all are ready, so that they begin at the same moment; returns the number of chunks it made.
CHILD = """
import pickle, sys, time
from pathlib import Path
import jax
tests, store, cache, transient, ready, go, out = sys.argv[1:]
sys.path.insert(0, tests)
jax.config.update("jax_enable_x64", True)
if cache != "None":
    jax.config.update("jax_compilation_cache_dir", cache)
import test_store
from vijax._execution.threads import Threads
run, made = Threads.run, []
Threads.run = lambda *args: made.append(1) or run(*args)
Path(ready).touch()
while not Path(go).exists():
    time.sleep(1e-3)
ds = test_store.sweep(store, transient=int(transient))
Path(out).write_bytes(pickle.dumps((ds, len(made))))
"""


@pytest.fixture(scope="module")
def plain() -> xr.Dataset:
    return sweep()


def run_at_once(folder: Path, store: Path, transients: list[int]) -> list[tuple[int, str, Path]]:
    """Run processes that begin at the same moment; return their codes, error outputs and result files."""
    here, cache, go = str(Path(__file__).parent), str(jax.config.jax_compilation_cache_dir), folder / "go"
    ready = [folder / f"ready {k}" for k in range(len(transients))]
    out = [folder / f"out {k}" for k in range(len(transients))]
    children = [
        subprocess.Popen(
            [sys.executable, "-c", CHILD, here, store, cache, str(transient), ready[k], go, out[k]],
            stderr=subprocess.PIPE,
            text=True,
        )
        for k, transient in enumerate(transients)
    ]
    while not all(file.exists() for file in ready) and all(child.poll() is None for child in children):
        time.sleep(1e-3)
    go.touch()
    told = [child.communicate()[1] for child in children]
    return [(child.returncode, *rest) for child, *rest in zip(children, told, out, strict=True)]


@pytest.mark.slow
def test_two_processes_find_the_same_in_one_store(plain, tmp_path):
    for code, told, out in run_at_once(tmp_path, tmp_path / "store", [10, 10]):
        assert code == 0, told
        ds, made = pickle.loads(out.read_bytes())
        assert_same(ds, plain)
        assert made <= NUM_CHUNKS
    assert len(chunks_of(tmp_path / "store")) == NUM_CHUNKS
    assert len(list((tmp_path / "store").iterdir())) == NUM_CHUNKS + 1


@pytest.mark.slow
def test_of_two_processes_with_different_sweeps_one_is_refused(tmp_path):
    ends = run_at_once(tmp_path, tmp_path / "store", [10, 11])
    assert sorted(code for code, _, _ in ends) == [0, 1]
    (told,) = (told for code, told, _ in ends if code)
    assert "holds another sweep: `transient` is" in told


def between(monkeypatch, owner, name: str, other) -> None:
    """Run another sweep completely just before the first call of a function."""
    original, met = getattr(owner, name), []

    def first_other(*args, **options):
        if not met:
            met.append(1)
            other()
        return original(*args, **options)

    monkeypatch.setattr(owner, name, first_other)


def test_a_chunk_that_another_process_wrote_meanwhile_is_no_obstacle(plain, tmp_path, monkeypatch):
    replace = stores.os.replace
    (tmp_path / "store").mkdir()

    def is_chunk(part, file):
        if file.suffix == ".npz" and not file.exists():
            monkeypatch.setattr(os, "replace", replace)
            sweep(tmp_path / "store")
        replace(part, file)

    monkeypatch.setattr(os, "replace", is_chunk)
    assert_same(sweep(tmp_path / "store"), plain)
    assert_same(sweep(tmp_path / "store"), plain)


def test_chunks_that_another_process_made_meanwhile_are_not_made_again(plain, tmp_path, monkeypatch):
    made, run = [], Threads.run
    monkeypatch.setattr(Threads, "run", lambda *args: made.append(1) or run(*args))
    between(monkeypatch, Threads, "run", lambda: sweep(tmp_path))
    assert_same(sweep(tmp_path), plain)
    # All chunks of the other sweep, and the one that this sweep was about to make.
    assert len(made) == NUM_CHUNKS + 1


def test_who_finds_a_store_begun_meanwhile_goes_on_with_it_or_is_refused(plain, tmp_path, monkeypatch):
    for transient, name in ((10, "same"), (1, "other")):
        with monkeypatch.context() as patch:
            between(
                patch, Path, "mkdir", lambda at=(tmp_path / name, transient): sweep(at[0], transient=at[1])
            )
            if name == "same":
                assert_same(sweep(tmp_path / name), plain)
                continue
            with pytest.raises(ValueError, match="holds another sweep: `transient` is 1 there, but 10 here"):
                sweep(tmp_path / name)


def test_a_file_system_without_links_is_served_as_well(plain, tmp_path, monkeypatch):
    def refuse(*args):
        raise OSError("no links here")

    monkeypatch.setattr(os, "link", refuse)
    assert_same(sweep(tmp_path), plain)
    with pytest.raises(ValueError, match="holds another sweep"):
        sweep(tmp_path, transient=1)


@pytest.mark.thorough
def test_processes_visit_the_chunks_in_different_orders(tmp_path):
    orders = []
    for k in range(6):
        with pytest.MonkeyPatch.context() as patch:
            order, run = [], Threads.run
            patch.setattr(
                Threads,
                "run",
                lambda self, points, which, tell, order=order, run=run: (
                    order.append(int(which[0])) or run(self, points, which, tell)
                ),
            )
            sweep(tmp_path / str(k))
        orders.append(tuple(order))
    # All six of 120 orders are equal by chance once in 2e10 times.
    assert len(set(orders)) > 1
