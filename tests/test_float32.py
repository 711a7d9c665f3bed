"""With 64-bit numbers off the library says so once, and works to float32 accuracy."""

import json
import subprocess
import sys

import numpy as np
import pytest
from helpers import load_scene

PROGRAM = """
import json, sys, warnings
import jax

sys.path.append("tests")
import vijax as vx
from helpers import load_scene

assert not jax.config.jax_enable_x64
ends = {}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for name in sys.argv[1:]:
        scene = load_scene(name)
        sol = scene.simulate()
        impacts = int((sol.events.kind == 0).sum())
        ends[name] = [sol.x1.tolist(), sol.v1.tolist(), str(sol.x1.dtype), impacts]
    follow = lambda x0: vx.simulate(scene.system, scene.t0, scene.t1, x0, scene.v0, throw=False).x1
    ends["traced"] = jax.jit(follow)(scene.x0.astype("float32")).tolist()
print(json.dumps([ends, [str(w.message) for w in caught]]))
"""
# Without sticking, and hardly magnifying errors; one of a single mass, one of several.
SCENES = ["n1_both_r07", "n2_r03"]
# Some hundred roundings of 1e-7 each.
ROUNDING_32 = 1e-5


@pytest.fixture(scope="module")
def outcome(pytestconfig):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *SCENES],
        capture_output=True,
        text=True,
        check=False,
        cwd=pytestconfig.rootpath,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_it_warns_exactly_once_and_says_what_to_do(outcome):
    _, messages = outcome
    about = [m for m in messages if "float32" in m]
    assert len(about) == 1
    assert "jax.config.update('jax_enable_x64', True)" in about[0]
    assert messages == about, "other warnings came with it"


@pytest.mark.parametrize("name", SCENES)
def test_a_golden_scene_comes_out_right_to_float32_accuracy(outcome, name):
    x, v, dtype, impacts = outcome[0][name]
    scene = load_scene(name)
    assert dtype == "float32"
    assert impacts == sum(event.kind == "impact" for event in scene.events)
    tolerance = ROUNDING_32 * scene.state_amplification
    assert tolerance < 1e-2
    np.testing.assert_allclose(x, scene.x1, rtol=0, atol=tolerance)
    np.testing.assert_allclose(v, scene.v1, rtol=0, atol=tolerance)
    # It is float32 indeed: 64-bit numbers would be far closer.
    assert np.abs(np.array(v) - scene.v1).max() > 1e-12


def test_under_jit_it_comes_out_as_without(outcome):
    traced, (x, *_) = outcome[0]["traced"], outcome[0][SCENES[-1]]
    np.testing.assert_allclose(
        traced, x, rtol=0, atol=ROUNDING_32 * load_scene(SCENES[-1]).state_amplification
    )
