"""Friction and compliant stops of machines that move by a solver of diffrax."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from switching_scenes import scene_names, switching_scene

import vijax as vx

pytestmark = pytest.mark.thorough

# Period of the oscillation on a belt with a friction of 1 / (1 + 3 |w|), to all printed digits.
_PERIOD, _DIGITS = 12.0010312948, 6e-11
# Growth of a local error of the solver until the end of a scene; the solver keeps some 1e-12 a step.
_SOLVER = 1e-10
_TIES = ("damper_between",)
_QUICK = ("random1_05",)


def _weaker_when_sliding(t, x, v, args):
    """Friction 1 less its value 1 / (1 + 3 |w|), in the direction of the sliding velocity w."""
    w = v - args
    return 3 * w / (1 + 3 * jnp.abs(w))


def _on_a_belt(velocity: float = 0.2) -> vx.ImpactSystem:
    friction = vx.Friction(0, 1.0, velocity=velocity)
    load = vx.Harmonic([0.0], 1.0)
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [], force=_weaker_when_sliding, friction=[friction])


@pytest.mark.slow
def test_a_friction_that_falls_with_the_sliding_velocity_oscillates_with_the_known_period():
    sol = vx.simulate(_on_a_belt(), 0.0, 60.0, [0.5], [0.2], args=0.2)
    sticks = np.asarray(sol.events.t)[np.asarray(sol.events.kind) == vx.STICK]
    assert len(sticks) == 5
    np.testing.assert_allclose(np.diff(sticks), _PERIOD, atol=_DIGITS)


@pytest.mark.slow
def test_derivatives_go_through_sticks_and_slips():
    def slip(stiffness):
        system = vx.ImpactSystem(
            [1.0],
            [[0.0]],
            jnp.stack([stiffness])[None],
            vx.Harmonic([0.0], 1.0),
            force=_weaker_when_sliding,
            friction=[vx.Friction(0, 1.0, velocity=0.2)],
        )
        return vx.simulate(system, 0.0, 20.0, [0.5], [0.2], args=0.2, max_events=8).events.t[2]

    # A stick ends where k x = 1, and x = 0.5 + 0.2 t at the first; the slide between both does not depend on k alone.
    step = 1e-4
    slope = (slip(1.0 + step) - slip(1.0 - step)) / (2 * step)
    np.testing.assert_allclose(jax.jacfwd(slip)(1.0), slope, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(a, marks=[] if a in _QUICK else pytest.mark.slow) for a in scene_names() if a not in _TIES],
)
def test_golden_scenes_agree_to_the_accuracy_of_the_solver(name):
    scene = switching_scene(name)
    data = scene.data
    flow = vx.DiffraxFlow(diffrax.Dopri8(), diffrax.PIDController(rtol=1e-11, atol=1e-13))
    sol = vx.simulate(scene.system, data["t0"], data["t1"], data["x0"], data["v0"], flow=flow)
    key = lambda e: (e.element, e.t)  # noqa: E731
    found, expected = sorted(scene.found(sol), key=key), sorted(scene.expected, key=key)
    assert [(e.element, e.kind) for e in found] == [(e.element, e.kind) for e in expected]
    size = _SOLVER * max(1.0, data["amplification_worst_restart"])
    times = [[e.t for e in events] for events in (found, expected)]
    np.testing.assert_allclose(*times, rtol=0, atol=size)
    np.testing.assert_allclose(sol.x1, data["x1"], rtol=0, atol=size)
    np.testing.assert_allclose(sol.v1, data["v1"], rtol=0, atol=size)
