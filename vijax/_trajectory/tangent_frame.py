"""How small changes of the state grow along a motion, through all its events: what Lyapunov exponents are made of.

A frame of vectors is carried from step to step by the derivative of the step, the one that `simulate` is
differentiated by, and made orthonormal again after each (Benettin et al. 1980): the logarithms of the lengths are the growth.
Steps last at most a few times the shortest time scale of the machine, so no vector is lost in the rounding of
another, however fast it fades. Where a mass comes to rest on a stop its position and velocity forget where they
came from: two directions are erased, and so is one by an impact without restitution. Vectors that lie in what is
erased become zero and stay so.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar, add_up
from .._jax.xla import compute_once
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.state import State
from .step import advance


class Tangents(eqx.Module):
    """Changes of the state that go with it.

    Attributes:
        frame: orthonormal vectors one after another, those of erased directions zero; of each first the changes of
            positions times the frequency of the load, then those of velocities, (2 n, 2 n).
        growth: sums of the logarithms by which they grew, minus infinity for erased ones, (2 n,).
    """

    frame: Float[Array, "vectors state ..."]
    growth: Float[Array, "vectors ..."]

    def start_period(self, is_over: Bool[Array, "..."]) -> "Tangents":
        """Where a forcing period is over, count the growth from zero."""
        return Tangents(self.frame, jnp.where(is_over, 0, self.growth))


def advance_with(
    tangents: Tangents,
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    target: Scalar,
    resolution: Scalar,
) -> tuple[State, Instant, Tangents]:
    """`advance`, and where it takes the tangents."""
    n = machine.num_masses

    def along(vector: Float[Array, "state ..."]):
        def step(x: Array, v: Array, gap: Array):
            here = eqx.tree_at(lambda s: (s.x, s.v, s.gap), state, (x, v, gap))
            after, instant = advance(flow, machine, here, target, resolution)
            return (after.x, after.v, after.time), (after, instant)

        change = vector[:n] / machine.frequency, vector[n:]
        change = *change, -machine.contacts.along(change[0])
        _, (x, v, delay), found = jax.jvp(step, (state.x, state.v, state.gap), change, has_aux=True)
        # A step that ends on an event ends later, or earlier, by `delay`: as of one time.
        after = found[0]
        now = compute_once(rates, machine, after, machine.hold(after.held))
        x, v = x - after.v * delay, v - now.acceleration * delay
        return jnp.concatenate([x * machine.frequency, v]), found

    frame, (after, instant) = jax.vmap(along, out_axes=(0, None))(tangents.frame)
    is_plastic = instant.hit & machine.contacts.restitution.is_plastic
    erases = jnp.any(instant.stuck | is_plastic, axis=0)
    frame, growth = compute_once(orthonormal, frame, erases)
    return after, instant, Tangents(frame, tangents.growth + growth)


def orthonormal(
    frame: Float[Array, "vectors state ..."], erases: Bool[Array, "..."]
) -> tuple[Float[Array, "vectors state ..."], Float[Array, "vectors ..."]]:
    """Vectors made orthonormal one after another, and the logarithms of what was left of their lengths.

    Args:
        frame: the vectors, of lengths about 1 a step before.
        erases: whether directions were erased in it, so that a vector may be in no other.
    """
    least, rest = jnp.where(erases, jnp.finfo(frame.dtype).eps, 0), frame
    vectors, growth = [], []
    for _ in range(len(frame)):
        first, rest = rest[0], rest[1:]
        square = add_up(first * first)
        is_left = square > least
        unit = jnp.where(is_left, first * jax.lax.rsqrt(jnp.where(is_left, square, 1)), 0)
        rest = [a - unit * add_up(unit * a) for a in rest]
        vectors.append(unit)
        growth.append(jnp.where(is_left, jnp.log(jnp.where(is_left, square, 1)) / 2, -jnp.inf))
    return jnp.stack(vectors), jnp.stack(growth)


def first_tangents(x: Float[Array, "n ..."]) -> Tangents:
    """The frame of the coordinates, for a motion of positions `x`, not grown yet."""
    size = 2 * len(x)
    unit = jnp.eye(size, dtype=x.dtype).reshape((size, size) + (1,) * (x.ndim - 1))
    return Tangents(
        jnp.broadcast_to(unit, (size, size, *x.shape[1:])), jnp.zeros((size, *x.shape[1:]), x.dtype)
    )
