"""With 64-bit numbers off the library warns once, and works to float32 accuracy."""

import json
import subprocess
import sys

import numpy as np
import pytest
from exact_orbits import exact_orbit
from helpers import GOLDEN, load_scene

PROGRAM = """
import json, sys, warnings
import jax
import jax.numpy as jnp

sys.path.append("tests")
import vijax as vx
from helpers import load_scene

assert not jax.config.jax_enable_x64
ends = {}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for name in sys.argv[2:]:
        scene = load_scene(name)
        sol = scene.simulate()
        impacts = int((sol.events.kind == 0).sum())
        ends[name] = [sol.x1.tolist(), sol.v1.tolist(), str(sol.x1.dtype), impacts]
    follow = lambda x0: vx.simulate(scene.system, scene.t0, scene.t1, x0, scene.v0, throw=False).x1
    ends["traced"] = jax.jit(follow)(scene.x0.astype("float32")).tolist()
    load, stop = vx.Harmonic([1.0], 1.0), vx.Stop(0, 1.0, "upper", 0.8)
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [stop])

    def impact_map(y):
        t, x, v = vx.next_impact(system, y[0], y[1:2], y[2:], 0)
        return jnp.stack([t, x[0], v[0]])

    impact = jnp.array(json.loads(sys.argv[1]))
    ends["impacts"] = [impact_map(impact).tolist(), jax.jacfwd(impact_map)(impact).tolist()]
print(json.dumps([ends, [str(w.message) for w in caught]]))
"""
# A process of its own, which compiles all its programs.
pytestmark = pytest.mark.slow

# All whose errors are magnified less than a thousand times, and that graze by more than rounding; then one of a single
# mass, one of several, without sticking.
ALL = [path.stem for path in sorted(GOLDEN.glob("*.json")) if not path.stem.startswith("graze_")]
ALL = [name for name in ALL if load_scene(name).state_amplification < 1e3]
SCENES = ["n1_both_r07", "n2_r03"]
# One impact a period: x'' + 0.1 x' + x = cos(t), x <= 1, r = 0.8.
ORBIT = exact_orbit(0.1, 1.0, 1.0, 1.0, 1.0, 0.8, 2 * np.pi, 1)
# Some hundred roundings of 1e-7 each.
ROUNDING_32 = 1e-5


@pytest.fixture(scope="module")
def outcome(pytestconfig):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps([ORBIT.angle, 1.0, ORBIT.speed]), *ALL, *SCENES],
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


@pytest.mark.parametrize("name", ALL)
def test_a_golden_scene_comes_out_right_to_float32_accuracy(outcome, name):
    x, v, dtype, impacts = outcome[0][name]
    scene = load_scene(name)
    assert dtype == "float32"
    if name in SCENES:  # the last bounces of a chatter are left out sooner
        assert impacts == sum(event.kind == "impact" for event in scene.events)
    tolerance = ROUNDING_32 * scene.state_amplification
    assert tolerance < 1e-2
    np.testing.assert_allclose(x, scene.x1, rtol=0, atol=tolerance)
    np.testing.assert_allclose(v, scene.v1, rtol=0, atol=tolerance)
    if name in SCENES:  # the numbers are float32: 64-bit numbers would be far closer
        assert np.abs(np.array(v) - scene.v1).max() > 1e-12


def test_under_jit_it_comes_out_as_without(outcome):
    traced, (x, *_) = outcome[0]["traced"], outcome[0][SCENES[-1]]
    np.testing.assert_allclose(
        traced, x, rtol=0, atol=ROUNDING_32 * load_scene(SCENES[-1]).state_amplification
    )


def test_the_impact_map_and_its_derivatives_come_out_right_to_float32_accuracy(outcome):
    impact, slopes = outcome[0]["impacts"]
    expected = [ORBIT.angle + 2 * np.pi, 1.0, ORBIT.speed]
    np.testing.assert_allclose(impact, expected, rtol=0, atol=ROUNDING_32)
    found = np.trace(slopes), np.linalg.det(np.asarray(slopes)[::2, ::2])
    np.testing.assert_allclose(
        found, [np.trace(ORBIT.step), np.linalg.det(ORBIT.step)], rtol=0, atol=ROUNDING_32
    )
    assert abs(impact[2] - ORBIT.speed) > 1e-12
