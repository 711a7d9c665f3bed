"""Growth of small perturbations of the state along a motion, through all its events: the basis of Lyapunov exponents.

A frame of vectors is carried from step to step by the derivative of the step, the one of `simulate`, and
orthonormalised after each step (Benettin et al. 1980): the logarithms of the lengths are the growth. A step lasts at
most a few times the shortest time scale of the machine, so no vector is lost in the rounding of another, however fast
it decays. Where a mass comes to rest on a stop, position and velocity no longer depend on their past: two directions
are erased; an impact without restitution erases one. A motion that begins at rest on a stop has no such directions from
the start. Vectors in an erased direction become and stay zero while growth is counted. What a transient erases says
nothing of the motion behind it, so there other vectors take their places.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow, Flight
from .._hybrid.transition import Instant
from .._jax.arrays import Scalar, add_up
from .._jax.xla import compute_once, is_any
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.state import State
from .step import flight_to, outcome


class Tangents(eqx.Module):
    """Perturbations of the state.

    Attributes:
        frame: orthonormal vectors, those of erased directions zero; each has first the perturbations of positions times
            the frequency of the load, then those of velocities, (2 n, 2 n).
        growth: sums of the logarithms of their growth, minus infinity for erased ones, (2 n,).
    """

    frame: Float[Array, "vectors state ..."]
    growth: Float[Array, "vectors ..."]

    def start_period(
        self, machine: Machine, state: State, is_over: Bool[Array, "..."], settles: Bool[Array, "..."]
    ) -> "Tangents":
        """Reset the growth where a forcing period is over; where the motion `settles`, replace erased vectors then."""
        is_asked = is_over & settles & jnp.any(_are_erased(self.frame), axis=0)
        anew = lambda: compute_once(allowed_at, machine, state, compute_once(completed, self.frame))  # noqa: E731
        frame = jax.lax.cond(
            is_any(is_asked), lambda: jnp.where(is_asked, anew(), self.frame), lambda: self.frame
        )
        return Tangents(frame, jnp.where(is_over, 0, self.growth))


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

    def fly_along(vector: Float[Array, "state ..."]) -> tuple[tuple[Array, ...], Flight]:
        def end(x: Array, v: Array, gap: Array) -> tuple[tuple[Array, ...], Flight]:
            here = eqx.tree_at(lambda s: (s.x, s.v, s.gap), state, (x, v, gap))
            flight = flight_to(flow, machine, here, target, resolution)
            return (flight.end.x, flight.end.v, flight.end.gap, flight.end.phase, flight.end.time), flight

        change = vector[:n] / machine.frequency, vector[n:]
        change = *change, -machine.contacts.along(change[0])
        _, moved, flight = jax.jvp(end, (state.x, state.v, state.gap), change, has_aux=True)
        return moved, flight

    moved, flight = jax.vmap(fly_along, out_axes=(0, None))(tangents.frame)
    after, instant, (x, v, delay) = compute_once(_resolved, machine, flight, moved)
    # A step to an event ends later, or earlier, by `delay`: refer the perturbation to one time.
    there = machine.in_mode(after)
    now = compute_once(rates, there, after, there.hold(after.held))
    x, v = x - after.v[None] * delay[:, None], v - now.acceleration[None] * delay[:, None]
    frame = jnp.concatenate([x * machine.frequency, v], axis=1)
    is_plastic = instant.hit & machine.contacts.is_plastic
    if machine.has_tied_friction:  # which an impact may bring to rest
        is_plastic = instant.hit
    erases = jnp.any(instant.stuck | is_plastic, axis=0)
    frame, growth = compute_once(orthonormal, frame, erases)
    return after, instant, Tangents(frame, tangents.growth + growth)


def _resolved(
    machine: Machine, flight: Flight, moved: tuple[Array, ...]
) -> tuple[State, Instant, tuple[Array, ...]]:
    """`outcome` of a flight, and perturbations of positions, velocities and time after it, from those before.

    Nothing else is differentiated, and what the differentiation of the outcome needs of it is computed once.
    """
    names = lambda s: (s.x, s.v, s.gap, s.phase, s.time)  # noqa: E731

    def along(moved: tuple[Array, ...]) -> tuple[tuple[Array, ...], tuple[State, Instant]]:
        def result(*end: Array) -> tuple[tuple[Array, ...], tuple[State, Instant]]:
            moved = eqx.tree_at(lambda f: names(f.end), flight, end)
            after, instant = outcome(machine, moved, call=lambda law, *args: law(*args))
            return (after.x, after.v, after.time), (after, instant)

        _, found, both = jax.jvp(result, names(flight.end), moved, has_aux=True)
        return found, both

    found, both = jax.vmap(along, out_axes=(0, None))(moved)
    return *both, found


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
        unit, grown, rest = compute_once(_next_unit, rest, least)
        vectors.append(unit)
        growth.append(grown)
    return jnp.stack(vectors), jnp.stack(growth)


def completed(frame: Float[Array, "vectors state ..."]) -> Float[Array, "vectors state ..."]:
    """Orthonormal vectors, of which unit vectors perpendicular to all others take the places of those erased."""
    number = jnp.arange(len(frame)).reshape(-1, *[1] * (frame.ndim - 2))

    def with_next(frame: Array, place: Array) -> tuple[Array, None]:
        # The coordinate of which the others have least.
        is_first = number == jnp.argmin(add_up(frame * frame), axis=0)
        along = add_up(jnp.swapaxes(frame, 0, 1) * is_first[:, None])
        unit = is_first - add_up(frame * along[:, None])
        unit = unit * jax.lax.rsqrt(add_up(unit * unit))
        is_new = (number == place) & _are_erased(frame)
        return jnp.where(is_new[:, None], unit[None], frame), None

    return jax.lax.scan(with_next, frame, jnp.arange(len(frame)))[0]


def _are_erased(frame: Float[Array, "vectors state ..."]) -> Bool[Array, "vectors ..."]:
    return jnp.all(frame == 0, axis=1)


def _next_unit(
    vectors: Float[Array, "vectors state ..."], least: Scalar
) -> tuple[Float[Array, "state ..."], Scalar, Float[Array, "rest state ..."]]:
    """Unit vector along the first of some vectors, the logarithm of its length, and the others perpendicular to it."""
    first, rest = vectors[0], vectors[1:]
    unit, grown = compute_once(_normalized, first, least)
    if not len(rest):
        return unit, grown, rest
    along = compute_once(lambda unit, rest: jnp.stack([add_up(unit * a) for a in rest]), unit, rest)
    return unit, grown, rest - unit[None] * along[:, None]


def _normalized(vector: Float[Array, "state ..."], least: Scalar) -> tuple[Float[Array, "state ..."], Scalar]:
    square = add_up(vector * vector)
    is_left = square > least
    square = jnp.where(is_left, square, 1)
    unit = jnp.where(is_left, vector * jax.lax.rsqrt(square), 0)
    return unit, jnp.where(is_left, jnp.log(square) / 2, -jnp.inf)


def first_tangents(machine: Machine, state: State) -> Tangents:
    """Initial frame along the coordinates that a motion from a state may vary, without growth."""
    size, like = 2 * len(state.x), state.x
    unit = jnp.eye(size, dtype=like.dtype).reshape((size, size) + (1,) * (like.ndim - 1))
    frame = jnp.broadcast_to(unit, (size, size, *like.shape[1:]))
    return Tangents(allowed_at(machine, state, frame), jnp.zeros(frame.shape[1:], like.dtype))


def allowed_at(
    machine: Machine, state: State, frame: Float[Array, "vectors state ..."]
) -> Float[Array, "vectors state ..."]:
    """Orthonormal vectors along which the elements at rest of a state stay at rest; zero where none is left."""
    n, contacts = len(state.x), machine.in_mode(state).contacts
    held, phase_rate = state.held | state.is_kept_closed, machine.phase_rate(state.phase)

    def at_rest(x: Array, v: Array) -> tuple[Array, Array]:
        x = contacts.with_closed_gaps(x, held & contacts.has_gap, state.phase)
        return x, contacts.without_speeds(v, held, phase_rate)

    def along(vector: Float[Array, "state ..."]) -> Float[Array, "state ..."]:
        change = vector[:n] / machine.frequency, vector[n:]
        _, (x, v) = jax.jvp(at_rest, (state.x, state.v), change)
        return jnp.concatenate([x * machine.frequency, v])

    frame, _ = orthonormal(jax.vmap(along)(frame), jnp.ones_like(machine.frequency, bool))
    return frame
