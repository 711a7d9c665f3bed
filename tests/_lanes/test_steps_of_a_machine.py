"""Steps of machines over lanes: those of the engine's own form with lanes last."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._flow.choose import choose_flow
from vijax._lanes.transform import lanes_last
from vijax._machine.numbers import numbers_of
from vijax._machine.preparation import prepare
from vijax._machine.state import start_period
from vijax._trajectory.step import advance, initial_state

# Sums in another order, grown over 60 steps.
ROUNDING = 1e-11
LANES, STEPS = 4, 60
MACHINES = {"a": (vx.models.wagg_bishop_a(frequency=0.8), False), "b": (vx.models.wagg_bishop_b(0.5), True)}


def turn(flow, machine, state, phase0):
    resolution = 4 * jnp.finfo(state.x.dtype).eps * machine.period
    after, instant = advance(flow, machine, state, machine.period, resolution)
    return start_period(after, phase0, instant.arrived), instant.hit


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.thorough
def test_steps_and_impacts_are_those_of_the_engine(name):
    machine, can_stick = MACHINES[name]
    frequencies = jnp.linspace(0.6, 1.2, LANES)
    system = jax.tree.map(lambda a: jnp.asarray(a)[..., None], machine)
    system = eqx.tree_at(lambda s: s.forcing.frequency, system, frequencies)
    with jax.numpy_rank_promotion("allow"):
        flow, still = choose_flow(system, can_stick=can_stick), jnp.zeros((2, LANES))

    @eqx.filter_jit
    def run(system):
        start = (jnp.zeros(1), still, still)
        numbers = prepare(numbers_of(system), 2 * jnp.pi / frequencies, start, can_stick=can_stick)
        motion = flow.prepare(numbers)
        phase0 = jnp.stack([jnp.ones((1, LANES)), jnp.zeros((1, LANES))])
        first = initial_state(motion, numbers, phase0, still, still)

        def many(step):
            one = lambda state, _: step(motion, numbers, state, phase0[..., :1])  # noqa: E731
            return jax.lax.scan(one, first, None, length=STEPS)

        return many(turn), many(lanes_last(turn))

    with jax.numpy_rank_promotion("allow"):  # lanes that share numbers are broadcast
        (state, hits), (found, found_hits) = run(system)
    assert int(jnp.sum(hits)) > LANES
    np.testing.assert_array_equal(found_hits, hits)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(state), strict=True):
        np.testing.assert_allclose(a, b, atol=ROUNDING)
