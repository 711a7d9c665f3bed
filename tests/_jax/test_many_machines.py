"""A process survives many machines of different shapes: every compiled program takes memory maps."""

import subprocess
import sys

import jax
import pytest

from vijax._jax import memory_maps

MACHINES = """
import sys
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import vijax as vx
from vijax._jax import memory_maps
from vijax._jax.memory_maps import num_maps

def machine(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    places = [(i, side) for i in range(n) for side in (1, -1) if rng.random() < 0.6]
    stops = [
        vx.Stop(i, side * rng.uniform(0.1, 0.5), "upper" if side > 0 else "lower", rng.uniform(0.3, 0.9))
        for i, side in places
    ]
    load = vx.Harmonic(rng.uniform(0.2, 1.0, n), rng.uniform(0.3, 2.0))
    return vx.chain(rng.uniform(0.5, 2, n), rng.uniform(0.05, 0.2, n), rng.uniform(0.5, 2, n), load, stops)

def swept(system):
    values = {"forcing.frequency": np.array([0.9, 1.1])}
    return vx.sweep(system, values, transient=1, record=2, progress=False)
"""
SIMULATED = """
before, shapes = None, set()
for seed in range(int(sys.argv[1])):
    system = machine(seed)
    sol = vx.simulate(system, 0.0, 20.0)
    assert np.isfinite(sol.x1).all()
    shapes.add((system.num_masses, len(system.stops)))
    before = num_maps() if before is None else before
print(len(shapes), (num_maps() - before) / max(len(shapes) - 1, 1))
"""
SWEPT = """
first = swept(machine(0))
most = num_maps() + 1000  # some ten sweeps
memory_maps.most_maps = lambda: most
for seed in range(1, int(sys.argv[1])):
    swept(machine(seed))
    assert num_maps() < most, (seed, num_maps())
assert first.identical(swept(machine(0)))
print(memory_maps._taken.others > 0)
"""
# A process has 65,530; with this limit 300 machines take fewer.
MOST_MAPS = 200

on_linux = pytest.mark.skipif(
    sys.platform != "linux", reason="the kernel of Linux lists the maps of a process"
)


def run(program: str, count: int) -> list[str]:
    command = [sys.executable, "-c", MACHINES + program, str(count)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.split()


@pytest.mark.slow
@on_linux
def test_a_program_takes_few_memory_maps():
    shapes, maps = run(SIMULATED, 4)
    assert int(shapes) > 1
    assert 0 < float(maps) < MOST_MAPS


@pytest.mark.slow
def test_four_hundred_machines_are_simulated_in_one_process():
    shapes, _ = run(SIMULATED, 400)
    assert int(shapes) > 20


@pytest.mark.slow
@on_linux
def test_programs_are_dropped_before_the_maps_are_used_up():
    assert run(SWEPT, 16) == ["True"]


@on_linux
def test_programs_are_dropped_when_maps_run_short_and_not_again_and_again(monkeypatch):
    dropped, now = [], [1000]
    monkeypatch.setattr(memory_maps, "most_maps", lambda: 10_000)
    monkeypatch.setattr(memory_maps, "num_maps", lambda: now[0])
    monkeypatch.setattr(memory_maps, "_taken", memory_maps._MapCounts())
    monkeypatch.setattr(jax, "clear_caches", lambda: dropped.append(now[0]))

    def after_many_programs(maps: int) -> int:
        memory_maps._taken.new, now[0] = 100, maps
        memory_maps.make_room()
        return len(dropped)

    assert [after_many_programs(maps) for maps in (7000, 8000, 8500, 9500)] == [0, 1, 1, 2]
    now[0] = 30_000
    memory_maps.make_room()  # nothing was compiled
    memory_maps._taken.new = 100
    jax.jit(lambda x: [memory_maps.make_room(), x][1])(1.0)  # programs being traced are not disturbed
    assert len(dropped) == 2
