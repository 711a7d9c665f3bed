"""One machine of each kind, in every form of program, for each supported release of JAX: see `.ci/releases`."""

import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._jax import unread_argument

pytestmark = pytest.mark.thorough

FREQUENCY = "forcing.frequency"
# Two forms of a program differ in the last digits, which impacts and sticks magnify.
FORMS = 1e-10
# Steps under a force have an error of their own, which depends on where they begin.
STEPS = 1e-7


def load(n: int, frequency: float = 0.9) -> vx.Harmonic:
    return vx.Harmonic([0.5] + [0.0] * (n - 1), frequency)


def cubic(t, x, v, args):
    return -0.3 * x**3


ONE = ([1.0], [[0.1]], [[1.0]])
STOP = vx.Stop(0, 0.3, "upper", 0.7)
MACHINES = {
    "rigid": vx.models.wagg_bishop_a(0.8),
    "contact": vx.chain([1.0, 0.8], [0.1] * 2, [1.0] * 2, load(2), [vx.Contact({0: 1.0, 1: -1.0}, 0.2, 0.6)]),
    "friction": vx.ImpactSystem(*ONE, load(1), [STOP], friction=[vx.Friction(0, 0.1)]),
    "compliant": vx.ImpactSystem(*ONE, load(1), [vx.CompliantStop(0, 0.3, "upper", 20.0, 0.1)]),
    "force": vx.ImpactSystem(*ONE, load(1), [STOP], force=cubic),
    "many": vx.chain([1.0] * 20, [0.1] * 20, [1.0] * 20, load(20), [vx.Stop(i, 0.3) for i in range(20)]),
}  # fmt: skip


@pytest.fixture(params=MACHINES)
def kind(request) -> str:
    return request.param


@pytest.fixture
def machine(kind) -> vx.ImpactSystem:
    return MACHINES[kind]


@pytest.fixture
def tolerance(kind) -> float:
    return STEPS if kind == "force" else FORMS


def at(machine: vx.ImpactSystem, frequency) -> vx.ImpactSystem:
    return eqx.tree_at(lambda m: m.forcing.frequency, machine, jnp.asarray(frequency))


def end(machine: vx.ImpactSystem, frequency, num_periods: int = 3):
    """Positions and velocities after some periods, as a function of the frequency."""
    solution = vx.simulate(at(machine, frequency), 0.0, num_periods * 2 * jnp.pi / frequency)
    return jnp.concatenate([solution.x1, solution.v1])


def test_a_sweep_ends_where_single_runs_do(machine, tolerance):
    frequencies = np.linspace(0.8, 1.1, 5)
    ds = vx.sweep(machine, {FREQUENCY: frequencies}, transient=2, record=1, progress=False)
    single = np.array([end(machine, w) for w in frequencies])
    assert np.abs(np.concatenate([ds.x, ds.v], axis=-1) - single).max() < tolerance


def test_programs_of_the_user_give_the_same(machine, tolerance):
    frequencies = jnp.linspace(0.8, 1.1, 5)
    alone = jnp.stack([end(machine, w) for w in frequencies])
    for run in (jax.vmap(lambda w: end(machine, w)), jax.jit(jax.vmap(lambda w: end(machine, w)))):
        assert float(jnp.abs(run(frequencies) - alone).max()) < tolerance


def test_derivatives_are_those_of_differences_in_both_directions(kind, machine):
    run, w, step = lambda w: end(machine, w, 1), jnp.array(0.93), 1e-5
    by_differences = (run(w + step) - run(w - step)) / (2 * step)
    forward, reverse = jax.jacfwd(run)(w), jax.jacrev(run)(w)
    assert float(jnp.abs(forward - by_differences).max()) < 1e-6 * max(1.0, float(jnp.abs(forward).max()))
    assert float(jnp.abs(forward - reverse).max()) < 1e-12 * max(1.0, float(jnp.abs(forward).max()))


@pytest.mark.parametrize("kind", [kind for kind in MACHINES if kind != "many"])
def test_a_branch_consists_of_motions_that_repeat(kind, machine, tolerance):
    frequency = float(machine.forcing.frequency)
    settled = vx.simulate(machine, 0.0, 400 * 2 * np.pi / frequency, max_events=5000)
    orbit = vx.periodic_orbit(machine, settled.x1, settled.v1)
    bounds = (frequency - 0.01, frequency + 0.01)
    points = vx.continuation(orbit, FREQUENCY, bounds, progress=False).points
    values = points[FREQUENCY].values
    assert (values.min(), values.max()) == pytest.approx(bounds)
    for k in (0, len(values) // 2, -1):
        own, period = at(machine, values[k]), 2 * np.pi / values[k]
        once = vx.simulate(own, 0.0, period, points.x0.values[k], points.v0.values[k])
        assert np.abs(once.x1 - points.x0.values[k]).max() < tolerance
        assert np.abs(once.v1 - points.v0.values[k]).max() < tolerance


def test_the_barrier_keeps_arguments_that_nothing_reads():
    file = Path(unread_argument.__file__)
    done = subprocess.run(
        [sys.executable, str(file), "--barrier"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("[1.68")
