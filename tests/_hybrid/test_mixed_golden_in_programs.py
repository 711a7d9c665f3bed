"""Golden scenes of touching bodies in a user's program, beside others in a batch, and as points of a sweep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from switching_scenes import scene_names, switching_scene

import vijax as vx

pytestmark = pytest.mark.slow


@pytest.fixture(params=scene_names("golden_mixed"))
def scene(request):
    return switching_scene(request.param)


def test_under_jit_and_vmap_the_end_is_that_of_the_scene(scene):
    data = scene.data
    end = jax.jit(lambda x0, v0: vx.simulate(scene.system, data["t0"], data["t1"], x0, v0))
    x0, v0 = jnp.array(data["x0"]), jnp.array(data["v0"])
    one = end(x0, v0)
    scene.check_end(one)
    scene.check_events(one)
    # A lane beside one that moves otherwise, and one that rests longer.
    lanes = jax.vmap(end)(jnp.stack([x0, x0, x0]), jnp.stack([v0, 0.9 * v0, v0]))
    for k in (0, 2):
        lane = jax.tree.map(lambda a, k=k: a[k], lanes)
        scene.check_end(lane)
        scene.check_events(lane)


def test_points_of_a_sweep_end_as_the_scene_does(scene):
    data = scene.data
    if data["t0"] != 0:
        pytest.skip("A sweep begins at 0.")
    v0 = float(data["v0"][0])
    ds = vx.sweep(
        scene.system,
        {"v0[0]": [v0, v0 + 0.01, v0]},
        x0=data["x0"],
        v0=data["v0"],
        duration=data["t1"],
        progress=False,
    )
    assert (ds.result == 0).all()
    for k in (0, 2):
        at_end = ds.isel({"v0[0]": k})
        for name, right in (("x", data["x1"]), ("v", data["v1"])):
            found = at_end[name].values.reshape(-1, len(right))[-1]
            np.testing.assert_allclose(found, right, rtol=0, atol=scene.state_tolerance)
