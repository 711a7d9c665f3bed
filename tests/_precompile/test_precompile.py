"""Programs made ahead of time are those that calls need, and are made once, whatever happens to the processes."""

import os
import subprocess
import sys
import time
from pathlib import Path

import equinox as eqx
import families
import pytest

import vijax as vx
from vijax._jax import program_store
from vijax._precompile import process
from vijax._precompile.precompile import CALLS
from vijax._precompile.rehearsals import Rehearsal, _start, rehearse
from vijax._precompile.shipment import packed_shipment

PROCESS = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_enable_compilation_cache", False)
import numpy as np
import vijax as vx
from vijax._jax.program_store import ProgramStore

saved, save = [], ProgramStore.save
ProgramStore.save = lambda self, key, *program: (saved.append(key), save(self, key, *program))
system = vx.models.impact_oscillator(0.7, restitution=0.6)
{calls}
print(len(saved))
"""
CALLED = {
    "simulate": "vx.simulate(system, 0.0, 40.0, [-0.1], [0.2])",
    "sweep": 'vx.sweep(system, {"forcing.frequency": np.linspace(0.7, 0.8, 50)}, transient=5, progress=False)',
    "periodic_orbit": "vx.periodic_orbit(system, np.zeros(1), np.zeros(1), throw=False)",
    "lyapunov_exponents": "vx.lyapunov_exponents(system, transient=3, num_periods=5, throw=False, progress=False)",
    "basins": 'vx.basins(system, {"x0[0]": np.linspace(-1, 0, 5), "v0[0]": np.linspace(-1, 1, 4)}, progress=False)',
}


@pytest.fixture
def store(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(program_store, "_active", program_store._Active())
    program_store.store_programs(tmp_path)
    return tmp_path


def programs_made_by(calls: list[str], folder: Path) -> int:
    """Number of programs that another process has to make for some calls."""
    script = PROCESS.format(calls="\n".join(CALLED[name] for name in calls))
    environment = os.environ | {"VIJAX_PROGRAMS": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def oscillator() -> vx.ImpactSystem:
    return vx.models.impact_oscillator(0.9, restitution=0.8)


def test_all_calls_can_be_rehearsed():
    assert all(callable(getattr(Rehearsal, name)) for name in CALLS)


@pytest.mark.slow
def test_calls_find_the_programs_that_were_made_for_them(store):
    calls = ["simulate", "periodic_orbit"]
    found = vx.precompile(oscillator(), calls, wait=True)
    assert not found.is_running
    assert programs_made_by(calls, store) == 0
    assert programs_made_by(["lyapunov_exponents"], store) > 0


@pytest.mark.slow
def test_so_do_calls_of_every_kind(store):
    vx.precompile(oscillator(), list(CALLED), wait=True)
    assert programs_made_by(list(CALLED), store) == 0


@pytest.mark.thorough
def test_two_at_once_make_each_program_once_while_a_call_waits_for_it(store):
    both = [vx.precompile(oscillator(), "simulate") for _ in range(2)]
    made: dict[str, set[int]] = {}
    sol = vx.simulate(oscillator(), 0.0, 10.0)
    while any(one.is_running for one in both):
        for file in store.glob("*.program"):
            made.setdefault(file.name, set()).add(file.stat().st_ino)
        time.sleep(0.01)
    for one in both:
        one.wait()
    assert sol.result == vx.RESULTS.successful
    assert made
    assert all(len(files) == 1 for files in made.values())  # a program that is written again is another file
    assert not list(store.glob("*.lock"))
    assert programs_made_by(["simulate"], store) == 0


@pytest.mark.thorough
def test_a_process_that_is_ended_stops_nobody(store):
    found = vx.precompile(oscillator(), "simulate")
    while not list(store.glob("*.lock")) and found.is_running:
        time.sleep(0.01)
    found.stop()
    with pytest.raises(RuntimeError, match="ended from outside"):
        found.wait()
    assert programs_made_by(["simulate"], store) == 1
    assert not list(store.glob("*.lock"))


@pytest.mark.thorough
def test_families_and_forces_that_can_be_imported(store):
    family = vx.Family(families.rotor, frequency=0.8)
    vx.precompile(family, ["simulate"], wait=True)
    assert len(list(store.glob("*.program"))) == 1
    vx.precompile(vx.models.duffing_oscillator(0.9), "simulate", wait=True)
    assert len(list(store.glob("*.program"))) == 2


def test_what_another_process_cannot_import_is_refused(store):
    def inner(frequency):
        return families.rotor(frequency)

    machine = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 0.9), [], force=lambda t, x, v: -(x**3)
    )
    for one in (vx.Family(inner, frequency=0.8), machine):
        with pytest.raises(ValueError, match="put the function of its `force`"):
            vx.precompile(one, "simulate")
    main = sys.modules["__main__"]

    def pull(t, x, v):
        return -x

    pull.__module__, pull.__qualname__ = "__main__", "pull"
    main.pull = pull  # type: ignore[attr-defined]
    try:
        with pytest.raises(ValueError, match="script or notebook itself"):
            packed_shipment(eqx.tree_at(lambda m: m.force, machine, pull), ("simulate",), store)
    finally:
        del main.pull  # type: ignore[attr-defined]


def test_wrong_arguments_are_refused(store):
    with pytest.raises(ValueError, match=r"simulate, sweep.* has 'sweeps'"):
        vx.precompile(oscillator(), ["sweeps"])
    with pytest.raises(ValueError, match="is empty"):
        vx.precompile(oscillator(), [])


def test_without_a_folder_for_programs_it_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(program_store, "_active", program_store._Active())
    monkeypatch.setenv("VIJAX_PROGRAMS", "off")
    with pytest.raises(RuntimeError, match=r"vx\.keep_compiled"):
        vx.precompile(oscillator(), "simulate")
    (tmp_path / "file").write_text("")
    program_store.store_programs(tmp_path / "file" / "programs")
    with pytest.raises(RuntimeError, match="cannot be written"):
        vx.precompile(oscillator(), "simulate")


def test_a_call_that_cannot_be_made_is_told():
    undriven = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [vx.Stop(0, 1.0, "upper", 0.7)])
    assert "frequency" in rehearse(undriven, ("lyapunov_exponents",))["lyapunov_exponents"]
    report = b'\n{"failed": {"sweep": "reason"}}\n'
    assert process._read(report, 0) == {"sweep": "reason"}


def test_starts_lie_between_the_stops():
    stops = [
        vx.Stop(0, 0.5, "lower", 0.7),
        vx.Stop(1, -0.2, "upper", 0.7),
        vx.Contact({0: 1.0, 1: -1.0}, 0.9, 0.5),
    ]
    machine = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], vx.Harmonic([0.3, 0.0], 0.8), stops)
    x, v = _start(machine)
    assert all(stop.gap(x, 0.0) >= 0 for stop in machine.stops)
    assert not v.any()
