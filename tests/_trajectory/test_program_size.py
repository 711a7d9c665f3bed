"""The size of programs, in lines of their lowered text, by the kind of machine: time to compile follows it, on any machine."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._flow.choose import choose_flow
from vijax._machine.numbers import numbers_of
from vijax._orbits.find import _search_in_one, solution_of_search
from vijax._orbits.search import StroboscopicMap

pytestmark = pytest.mark.thorough

# Lines of one trajectory and of a batch with JAX 0.10; 0.12 writes fewer. A change that needs more says so here. The parts of
# one trajectory are kernels, whose boundaries are a tenth of its lines; it compiles sooner than without them. Of machines of three
# kinds 290 lines tell forces and speeds of what rests from rounding, in any unit.
MOST = {
    "friction": (9708, 14109),
    "compliant": (11912, 19484),
    "mixed": (15950, 31700),
}
SLACK = 1.1
# Machines with rigid contacts alone, which nothing of the others may enlarge: not a line more. The third number is that of a
# search for a periodic orbit with its result. Of contacts, nine lines find speeds that are rounding beside an impact, 43 those
# that are rounding of what equal forces give to bodies in touch, and 15 that all speeds of an instant are rounding.
OF_JAX_10 = {
    "1 stop": (3990, 6413, 9571),
    "2 stops": (4976, 8904, 11352),
    "contact": (8344, 12845, 13504),
}
OF_JAX_12 = {
    "1 stop": (4081, 6537, 8636),
    "2 stops": (5193, 9187, 10363),
    "contact": (8564, 13170, 12577),
}
RIGID = OF_JAX_10 if jax.__version_info__ < (0, 11) else OF_JAX_12


def stop(mass: int) -> vx.Stop:
    return vx.Stop(mass, 0.5 + 0.1 * mass, "upper", 0.7)


def soft(mass: int) -> vx.CompliantStop:
    return vx.CompliantStop(mass, 0.5 + 0.1 * mass, "upper", 20.0, 0.1)


def machine(n: int, limits=(), friction=()) -> vx.ImpactSystem:
    load = vx.Harmonic([1.0] + [0.0] * (n - 1), 0.9)
    own = vx.chain([1.0 + 0.1 * k for k in range(n)], [0.05] * n, [1.0] * n, load, list(limits))
    return vx.ImpactSystem(own.mass, own.damping, own.stiffness, load, own.stops, friction=list(friction))


MACHINES = {
    "1 stop": machine(1, [stop(0)]),
    "2 stops": machine(2, [stop(0), stop(1)]),
    "contact": machine(2, [vx.Contact({0: 1.0, 1: -1.0}, 0.9, 0.5)]),
    "friction": machine(2, (), [vx.Friction(0, 0.1)]),
    "compliant": machine(2, [soft(0), soft(1)]),
    "mixed": machine(2, [stop(0), soft(0)], [vx.Friction(0, 0.1)]),
}


def lines(function, *arguments) -> int:
    return jax.jit(function).lower(*arguments).as_text().count("\n")


def lines_of_runs(system: vx.ImpactSystem) -> tuple[int, int]:
    """Lines of the program of one trajectory, and of that of a batch."""
    n = system.num_masses
    end = lambda x: vx.simulate(system, 0.0, 10.0, x, jnp.zeros(n), throw=False)  # noqa: E731
    return lines(end, jnp.zeros(n)), lines(jax.vmap(end), jnp.zeros((64, n)))


def lines_of_search(system: vx.ImpactSystem) -> int:
    """Lines of the program of a search for a periodic orbit."""
    flow = choose_flow(system, can_stick=True)
    strobe = StroboscopicMap(numbers_of(system), flow.compact(), np.asarray(1.0), np.asarray(0.0), 32)
    find = lambda strobe, guess: solution_of_search(strobe, _search_in_one(strobe, guess))  # noqa: E731
    return lines(find, strobe, jnp.zeros(2 * system.num_masses))


@pytest.mark.parametrize("name", MOST)
def test_programs_are_no_larger_than_known(name):
    for found, most in zip(lines_of_runs(MACHINES[name]), MOST[name], strict=True):
        assert 0.5 * most < found <= SLACK * most


# A process of its own, without the checks and settings of tests, which write lines too.
COUNT = """
import json, sys
sys.path.insert(0, sys.argv[1])
import jax
jax.config.update("jax_enable_x64", True)
from test_program_size import MACHINES, RIGID, lines_of_runs, lines_of_search
print(json.dumps({name: [*lines_of_runs(MACHINES[name]), lines_of_search(MACHINES[name])] for name in RIGID}))
"""


def test_programs_of_rigid_machines_do_not_grow():
    own = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    command = [sys.executable, "-c", COUNT, str(Path(__file__).parent)]
    done = subprocess.run(command, env=own, check=True, capture_output=True, text=True)
    for name, found in json.loads(done.stdout).items():
        for lines_now, most in zip(found, RIGID[name], strict=True):
            assert 0.5 * most < lines_now <= most, (name, found)
