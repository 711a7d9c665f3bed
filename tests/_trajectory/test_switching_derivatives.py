"""Derivatives of golden scenes with friction and compliant stops, along a direction that changes every number at once."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import ROUNDING
from switching_scenes import scene_names, switching_scene

import vijax as vx

# Of a derivative, relative to the largest one.
ERROR = 1e-9
# Steps of the differences, as shares of the reciprocal of the amplification.
STEPS = 2.0, 2e-1, 2e-2, 4e-3, 1e-3, 2e-4, 4e-5
# The longest step: longer ones may make masses negative.
LONGEST = 1e-2
# Growth of all speeds along the direction.
FASTER = 0.3


@pytest.mark.slow
# One scene begins with friction at its bound: on one side it slips at once.
@pytest.mark.parametrize("name", [name for name in scene_names() if name != "damper_between"])
def test_derivatives_by_every_number_agree_with_differences(name: str):
    run, here, way = problem(name)
    now, change = jax.jvp(lambda *numbers: run(*numbers)[0], here, way)
    largest = float(jnp.abs(change).max())
    amplification = max(switching_scene(name).data["amplification_worst_restart_events"], 1)
    # Long steps have errors of their own, short ones roundings.
    errors = [
        float(jnp.abs(change - expected).max())
        for share in STEPS
        if (expected := difference(run, here, way, min(share / amplification, LONGEST))) is not None
    ]
    assert min(errors) < ERROR * largest
    weights = jnp.asarray(np.random.default_rng(1).normal(size=len(now)))
    back = jax.grad(lambda numbers: weights @ run(*numbers)[0])(here)
    reverse = sum(jnp.vdot(a, b) for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(way), strict=True))
    assert abs(float(reverse - weights @ change)) < ROUNDING * float(jnp.abs(weights) @ jnp.abs(change))


def problem(name: str) -> tuple:
    """The end state and the event times of a scene with its events, the numbers they depend on, and a direction in these.

    Zeros of the machine stay zeros. All speeds grow by one factor, those of belts too: an element at rest would slide.
    Static friction that is that of slip stays so: below it there is no motion to compare with.
    """
    scene, rng = switching_scene(name), np.random.default_rng(0)
    moving, still = eqx.partition(jax.tree.map(as_real, scene.system), eqx.is_inexact_array)
    span, start = (scene.data["t0"], scene.data["t1"]), (scene.data["x0"], scene.data["v0"])
    here = moving, *(jnp.asarray(a, float) for a in (*span, *start))

    def run(moving, t0, t1, x0, v0) -> tuple:
        sol = vx.simulate(eqx.combine(moving, still), t0, t1, x0, v0)
        times = jnp.where(jnp.isfinite(sol.events.t), sol.events.t, 0)
        return jnp.concatenate([sol.x1, sol.v1, times]), (sol.events.kind, sol.events.stop)

    def part(a):
        share = rng.normal(size=a.shape)
        return a * (share + share.T) / 2 if a.ndim == 2 and a.shape[0] == a.shape[1] else a * share

    machine, x0, v0 = jax.tree.map(part, moving), here[3], here[4]
    pairs = zip(moving.friction, machine.friction, strict=True)
    friction = tuple(
        eqx.tree_at(
            lambda element: (element.velocity, element.static),
            way,
            (FASTER * own.velocity, way.force if own.static == own.force else way.static),
        )
        for own, way in pairs
    )
    if friction:
        machine = eqx.tree_at(lambda system: system.friction, machine, type(moving.friction)(friction))
    return run, here, (machine, jnp.asarray(0.3), jnp.asarray(-0.4), jnp.ones_like(x0), FASTER * v0)


def as_real(a):
    return jnp.asarray(a) if isinstance(a, np.ndarray) and np.issubdtype(a.dtype, np.floating) else a


def difference(run, here, way, step: float):
    """Central difference of sixth order; None if events change on the way."""
    _, events = run(*here)
    found = {k: run(*jax.tree.map(partial(moved, k * step), here, way)) for k in (-3, -2, -1, 1, 2, 3)}
    others = [other for _, own in found.values() for other in zip(own, events, strict=True)]
    if not all(np.array_equal(*pair) for pair in others):
        return None
    first, second, third = ((found[k][0] - found[-k][0]) / (2 * k * step) for k in (1, 2, 3))
    return 1.5 * first - 0.6 * second + 0.1 * third


def moved(step: float, here, way):
    return here + step * way


@pytest.mark.slow
def test_derivatives_of_many_runs_by_many_numbers_compile_under_jit():
    """XLA refuses kernels with large sums, as products of matrices of contacts become under many tangents."""
    stops, pads = [vx.CompliantStop(0, 0.3, "upper", 20.0, 0.2)], [vx.Friction(1, 0.1)]
    damping, stiffness = [[0.2, -0.1], [-0.1, 0.1]], [[2.0, -1.0], [-1.0, 1.0]]
    system = vx.ImpactSystem(
        [1.0, 0.7], damping, stiffness, vx.Harmonic([1.0, 0.2], 0.9), stops, friction=pads
    )
    moving, still = eqx.partition(jax.tree.map(as_real, system), eqx.is_inexact_array)
    end = lambda moving, x0: vx.simulate(eqx.combine(moving, still), 0.0, 20.0, x0, [0.1, 0.2]).x1  # noqa: E731
    x0 = np.random.default_rng(0).normal(size=(256, 2)) * 0.05
    many = jax.jit(jax.vmap(jax.jacfwd(end), (None, 0)))(moving, jnp.asarray(x0))
    one = jax.jacfwd(end)(moving, jnp.asarray(x0[7]))
    for a, b in zip(jax.tree.leaves(many), jax.tree.leaves(one), strict=True):
        np.testing.assert_allclose(a[7], b, rtol=1e-9, atol=1e-9 * float(jnp.abs(b).max()))
