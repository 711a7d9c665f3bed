"""More elements at rest than all sets are tried of: the search finds what all sets give."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

pytestmark = pytest.mark.slow

# Rows of four bodies in touch on rough ground, with and without a wall, and stacks of seven blocks. Static friction exceeds the other.
RUN = """
import json, sys
import jax, numpy as np
import vijax as vx
import vijax._hybrid.decision as decision

jax.config.update("jax_enable_x64", True)
decision._ENUMERATED = int(sys.argv[1])

def friction(rng, row, least, most):
    force = rng.uniform(least, most)
    return vx.Friction(row, force, force * rng.uniform(1.0, 2.0))

def machine(kind, seed):
    rng, n = np.random.default_rng([7, seed]), 7 if kind == "stack" else 4
    mass, load = rng.uniform(0.5, 2, n), vx.Harmonic(rng.uniform(-1, 1, n), 0.7, rng.uniform(0, 6, n), rng.uniform(-0.5, 0.5, n))
    stops = []
    if kind != "stack":
        stops = [vx.Contact({i: 1, i + 1: -1}, 0.0, 0.5) for i in range(n - 1)]
    if kind == "row at a wall":
        stops.append(vx.Contact({n - 1: 1}, 0.0, 0.5))
    rows = [0] + [{i: 1, i + 1: -1} for i in range(n - 1)] if kind == "stack" else range(n)
    sizes = (0.2, 0.8) if kind == "stack" else (0.1, 0.6)
    rubs = [friction(rng, row, *sizes) for row in rows]
    return vx.ImpactSystem(mass, 0.05 * np.eye(n), 0.3 * np.eye(n), load, stops, friction=rubs)

@jax.jit
def run(system):
    rest = np.zeros(system.mass.shape[0])
    sol = vx.simulate(system, 0.0, 8.0, rest, rest, throw=False, max_events=512)
    return sol.x1, sol.v1, sol.num_events

found = [run(machine(sys.argv[2], seed)) for seed in map(int, sys.argv[3].split(","))]
print(json.dumps([[np.asarray(a).tolist() for a in one] for one in found]))
"""
# In one stack two sets, in which as many stick, stand beside each other: it is left out.
SEEDS = {"row": range(20), "row at a wall": range(20), "stack": [k for k in range(20) if k != 12]}


def found(enumerated: int, kind: str, folder) -> list:
    """States and numbers of events in a process and with programs of its own: kept programs do not know the number."""
    environment = {key: value for key, value in os.environ.items() if "CACHE" not in key}
    environment |= {"VIJAX_PROGRAMS": str(folder)}
    arguments = [str(enumerated), kind, ",".join(map(str, SEEDS[kind]))]
    run = subprocess.run(
        [sys.executable, "-c", RUN, *arguments], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout)


@pytest.mark.parametrize("kind", SEEDS)
def test_seven_and_eight_elements_at_rest_do_what_the_best_of_all_sets_has(kind, tmp_path):
    listed, searched = (found(number, kind, tmp_path / str(number)) for number in (8, 6))
    assert sum(events for *_, events in listed) > 30
    for one, other in zip(listed, searched, strict=True):
        assert one[2] == other[2]
        np.testing.assert_allclose(one[0], other[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(one[1], other[1], rtol=0, atol=1e-12)
