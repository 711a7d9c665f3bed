"""User-defined flows: a step and the motion inside it suffice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import load_scene, log_of, paired

import vijax as vx
from vijax._flow.approximate_step import Attempt, SteppingFlow
from vijax._flow.bernstein import nodes
from vijax._flow.event_margins import StepInterior
from vijax._system.waves import speeds

# An error of 1e-11 in position moves a light impact by more.
LIGHT = 1e-3


class ExponentialFlow(SteppingFlow):
    """Steps of a linear machine by the matrix exponential: the code that a new flow needs."""

    def attempt(self, machine, state, is_held, step):
        at = lambda u: self.step_by(machine, state, is_held, u)  # noqa: E731
        inside = jax.vmap(at)(step * jnp.asarray(nodes(8)))
        displacement, gain = at(step)
        return Attempt(displacement, gain, StepInterior(*inside), jnp.array(True), 0.5 / machine.rate, None)

    def step_by(self, machine, state, is_held, step):
        n, h = len(state.x), machine.waves.num_harmonics
        free = jnp.where(is_held, 0.0, machine.inverse_mass)
        angle = jnp.diag(speeds(state.phase, machine.frequency))
        zero, zeros = jnp.zeros((n, n)), jnp.zeros((n, h))
        loads = [machine.inverse_mass[:, None] * a.T for a in (machine.waves.cosine, machine.waves.sine)]
        pull = machine.inverse_mass[:, None]
        # The state, the speed that sticking masses would gain, the phase of the load, and 1.
        rows = [
            [zero, jnp.diag(free / machine.inverse_mass), zeros, zeros, jnp.zeros((n, 1))],
            [
                -pull * machine.stiffness,
                -pull * machine.damping * (free > 0)[None],
                *loads,
                pull * machine.mean[:, None],
            ],
            [zeros.T, zeros.T, jnp.zeros((h, h)), -angle, jnp.zeros((h, 1))],
            [zeros.T, zeros.T, angle, jnp.zeros((h, h)), jnp.zeros((h, 1))],
            [jnp.zeros((1, 2 * n + 2 * h + 1))],
        ]
        start = jnp.concatenate([state.x, state.v, *state.phase, jnp.ones(1)])
        matrix = jnp.block(rows)
        # z(step) - z(0) = step phi(step A) A z(0), which loses no digits: an additional column carries A z(0).
        size = len(start)
        wide = (
            jnp.zeros((size + 1, size + 1)).at[:size, :size].set(matrix).at[:size, size].set(matrix @ start)
        )
        gained = jax.scipy.linalg.expm(wide * step)[:size, size]
        return gained[:n], gained[n : 2 * n]


@pytest.mark.slow
def test_a_motion_of_ones_own_needs_three_methods_and_drives_the_same_loop():
    scene = load_scene("n1_lowfreq_r07")
    sol = vx.simulate(scene.system, scene.t0, scene.t1, scene.x0, scene.v0, flow=ExponentialFlow())
    pairs = paired(scene.events, log_of(sol))
    assert {found.kind for _, found in pairs} == {"impact", "stick", "release"}
    worst = max(abs(a.t - b.t) for a, b in pairs if a.kind != "impact" or abs(a.velocity) > LIGHT)
    assert worst < 1e-10
    np.testing.assert_allclose(sol.x1, scene.x1, rtol=0, atol=1e-11)
