"""Machines of single precision while 64-bit numbers are on: built before that, passed in, or read from a dataset."""

import json
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from documents import ROOT

import vijax as vx
from vijax._system.checks import is_semidefinite
from vijax._system.description import build, describe

PROGRAM = """
import json, warnings
import jax, jax.numpy as jnp
import vijax as vx

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    old, load = vx.models.wagg_bishop_b(0.2), vx.Harmonic([0.1], 0.3)
jax.config.update("jax_enable_x64", True)
point = [0.3, 0.1], [0.5, 0.0]
doors = {
    "simulate": lambda s: vx.simulate(s, 0.0, 20.0),
    "sweep": lambda s: vx.sweep(s, {"x0[0]": [0.0, 0.1]}, transient=0, record=1, progress=False).x,
    "stroboscopic_map": lambda s: vx.stroboscopic_map(s, *point),
    "monodromy_matrix": lambda s: vx.monodromy_matrix(s, *point),
    "saltation_matrix": lambda s: vx.saltation_matrix(s, 1.0, *point, stop=0),
    "next_impact": lambda s: vx.next_impact(s, 0.0, *point, stop=0),
    "sticking_region": lambda s: vx.sticking_region(s, held=1),
    "a constructor": lambda s: vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load),
    "inside jit": lambda s: jax.jit(lambda s: vx.simulate(s, 0.0, 1.0).x1)(s),
}
found = {}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for name, door in doors.items():
        out = door(old)
        leaves = jax.tree.leaves(out) if name != "sweep" else [out.values]
        found[name] = sorted({str(a.dtype) for a in leaves if jnp.issubdtype(a.dtype, jnp.floating)})
    r = float(old.stops[0].restitution)
print(json.dumps([found, [str(w.message) for w in caught], r]))
"""


@pytest.fixture(scope="module")
def outcome():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_a_machine_built_before_is_converted_at_every_door(outcome):
    found, _, restitution = outcome
    assert restitution != 0.7, "it is a machine of single precision"
    assert all(dtypes == ["float64"] for dtypes in found.values())


@pytest.mark.slow
def test_it_is_told_once_and_what_to_do(outcome):
    _, messages, _ = outcome
    assert len(messages) == 1
    assert "built while 64-bit numbers were off" in messages[0]
    assert "Build it again" in messages[0]


def test_arrays_of_any_precision_make_a_machine_of_one():
    """The user chose these numbers, so no warning is due."""
    load = vx.Harmonic(np.array([0.1], "float32"), np.float32(0.3), jnp.zeros(1, "float16"))
    stop = vx.Stop(0, jnp.float32(0.1), "upper", np.float16(0.5))
    system = vx.ImpactSystem(np.ones(1, "float32"), [[0.0]], jnp.ones((1, 1), "bfloat16"), load, [stop])
    assert {a.dtype for a in jax.tree.leaves(system)} == {np.dtype("float64")}
    assert float(system.forcing.frequency) == float(np.float32(0.3))


def test_rounding_of_single_precision_does_not_make_a_matrix_wrong():
    rows = np.random.default_rng(0).normal(size=(2, 5)).astype("float32")
    singular = rows.T @ rows
    assert np.linalg.eigvalsh(singular.astype("float64"))[0] < -1e-10
    assert is_semidefinite(singular.astype("float64"))
    assert not is_semidefinite(singular.astype("float64") - 1e-4 * np.eye(5))


def test_a_machine_of_a_dataset_of_single_precision_stays_as_it_was():
    motion = vx.Harmonic([0.1], 0.3)
    stops = [vx.Stop(0, 0.1, "upper", 0.7, motion)]
    system = vx.ImpactSystem([0.1], [[0.1]], [[0.3]], vx.Harmonic([1 / 3], 0.3), stops)
    narrow = jax.tree.map(lambda a: jnp.asarray(a, "float32"), system)
    found = build(json.loads(json.dumps(describe(narrow))), "float32")
    assert eqx.tree_equal(found, narrow, typematch=True)
