"""The hybrid state of a motion: all that decides how it goes on."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .._jax.arrays import Scalar

# A contact that is kept closed by others, see `State.contact`.
SHUT = 4


class State(eqx.Module):
    """Where one trajectory is: all that decides how it goes on.

    Time is local to the forcing period, in two parts whose sum carries twice the digits, so that no
    step is ever lost in a rounding. `gap` is carried beside x, counted from the last contact
    instead of as the difference position - x: light bounces keep all their digits.

    `contact` tells how a stop was last left: the number of leading derivatives of the gap that
    vanish exactly (0 none, 1 just hit, 2 let go by a jump of the force, 3 let go as the force
    crossed zero). It holds for the next step only. All of them vanish, `SHUT`, where the row of a contact depends
    on those of others that hold: it stays closed without a force, until one of them lets go.

    `memory` is what the flow that drives the motion keeps from step to step; exact ones keep nothing.
    """

    periods: Int[Array, "..."]
    time: Scalar
    time_low: Scalar
    phase: Float[Array, "2 harmonics ..."]
    x: Float[Array, "n ..."]
    v: Float[Array, "n ..."]
    gap: Float[Array, "stops ..."]
    held: Bool[Array, "stops ..."]
    contact: Int[Array, "stops ..."]
    memory: PyTree = None

    @property
    def is_shut(self) -> Bool[Array, "stops ..."]:
        """Contacts that others keep closed."""
        return self.contact == SHUT


def remembering(state: State, memory: PyTree) -> State:
    """The state with another memory."""
    return eqx.tree_at(lambda s: s.memory, state, memory, is_leaf=lambda leaf: leaf is None)


def start_period(state: State, phase0: Float[Array, "2 harmonics ..."], is_over: Bool[Array, "..."]) -> State:
    """Where a forcing period is over, count it and set time and phase back, so that neither drifts."""
    return eqx.tree_at(
        lambda s: (s.periods, s.time, s.time_low, s.phase),
        state,
        (
            state.periods + is_over,
            jnp.where(is_over, 0, state.time),
            jnp.where(is_over, 0, state.time_low),
            jnp.where(is_over, phase0, state.phase),
        ),
    )
