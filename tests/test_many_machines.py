"""A process survives many machines of different make: every compiled program takes memory maps of its own."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import vijax as vx

def maps():
    with open("/proc/self/maps") as file:
        return sum(1 for _ in file)

rng = np.random.default_rng(1)
before, shapes = None, set()
for k in range(int(sys.argv[1])):
    n = int(rng.integers(1, 6))
    places = [(i, side) for i in range(n) for side in (1, -1) if rng.random() < 0.6]
    stops = [
        vx.Stop(i, side * rng.uniform(0.1, 0.5), "upper" if side > 0 else "lower", rng.uniform(0.3, 0.9))
        for i, side in places
    ]
    load = vx.Harmonic(rng.uniform(0.2, 1.0, n), rng.uniform(0.3, 2.0))
    system = vx.chain(rng.uniform(0.5, 2, n), rng.uniform(0.05, 0.2, n), rng.uniform(0.5, 2, n), load, stops)
    sol = vx.simulate(system, 0.0, 20.0)
    assert np.isfinite(sol.x1).all()
    shapes.add((n, tuple(places)))
    before = maps() if before is None else before
print(len(shapes), (maps() - before) / max(len(shapes) - 1, 1))
"""
# A process has 65,530: then 300 machines take less than all.
MOST_MAPS = 200


def run(count: int) -> tuple[int, float]:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(count)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    shapes, maps = done.stdout.split()
    return int(shapes), float(maps)


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux lists the maps of a process")
@pytest.mark.slow
def test_a_program_takes_few_memory_maps():
    shapes, maps = run(4)
    assert shapes > 1
    assert 0 < maps < MOST_MAPS


@pytest.mark.slow
def test_three_hundred_machines_are_simulated_in_one_process():
    shapes, _ = run(300)
    assert shapes > 100
