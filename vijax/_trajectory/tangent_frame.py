"""Growth of small perturbations of the state along a motion, through all its events: the basis of Lyapunov exponents.

A frame of vectors is carried from step to step by the derivative of the step, the one of `simulate`, and
orthonormalised after each step (Benettin et al. 1980): the logarithms of the lengths are the growth. A step lasts at
most a few times the shortest time scale of the machine, so no vector is lost in the rounding of another, however fast
it decays. Where a mass comes to rest on a stop, position and velocity no longer depend on their past: two directions
are erased; an impact without restitution erases one. Vectors in an erased direction become and stay zero.
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
    """Perturbations of the state.

    Attributes:
        frame: orthonormal vectors, those of erased directions zero; each has first the perturbations of positions times
            the frequency of the load, then those of velocities, (2 n, 2 n).
        growth: sums of the logarithms of their growth, minus infinity for erased ones, (2 n,).
    """

    frame: Float[Array, "vectors state ..."]
    growth: Float[Array, "vectors ..."]

    def start_period(self, is_over: Bool[Array, "..."]) -> "Tangents":
        """Reset the growth where a forcing period is over."""
        return Tangents(self.frame, jnp.where(is_over, 0, self.growth))


def advance_with(
    tangents: Tangents,
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    target: Scalar,
    resolution: Scalar,
) -> tuple[State, Instant, Tangents]:
    """`advance`, with the tangents carried along."""
    n = machine.num_masses

    def along(vector: Float[Array, "state ..."]):
        def step(x: Array, v: Array, gap: Array):
            here = eqx.tree_at(lambda s: (s.x, s.v, s.gap), state, (x, v, gap))
            after, instant = advance(flow, machine, here, target, resolution)
            return (after.x, after.v, after.time), (after, instant)

        change = vector[:n] / machine.frequency, vector[n:]
        change = *change, -machine.contacts.along(change[0])
        _, (x, v, delay), found = jax.jvp(step, (state.x, state.v, state.gap), change, has_aux=True)
        # A step to an event ends later, or earlier, by `delay`: refer the perturbation to one time.
        after = found[0]
        now = compute_once(rates, machine, after, machine.hold(after.held))
        x, v = x - after.v * delay, v - now.acceleration * delay
        return jnp.concatenate([x * machine.frequency, v]), found

    frame, (after, instant) = jax.vmap(along, out_axes=(0, None))(tangents.frame)
    is_plastic = instant.hit & machine.contacts.is_plastic
    erases = jnp.any(instant.stuck | is_plastic, axis=0)
    frame, growth = compute_once(orthonormal, frame, erases)
    return after, instant, Tangents(frame, tangents.growth + growth)


def orthonormal(
    frame: Float[Array, "vectors state ..."], erases: Bool[Array, "..."]
) -> tuple[Float[Array, "vectors state ..."], Float[Array, "vectors ..."]]:
    """Orthonormalise vectors one after another; also the logarithms of their remaining lengths.

    Args:
        frame: vectors, of lengths about 1 before the step.
        erases: whether the step erased directions, so that nothing of a vector may remain.
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
    """Initial frame along the coordinates, without growth, for positions like `x`."""
    size = 2 * len(x)
    unit = jnp.eye(size, dtype=x.dtype).reshape((size, size) + (1,) * (x.ndim - 1))
    return Tangents(
        jnp.broadcast_to(unit, (size, size, *x.shape[1:])), jnp.zeros((size, *x.shape[1:]), x.dtype)
    )
