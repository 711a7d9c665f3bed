"""What is watched at every stop during an approximate step, and what its polynomial tells of it.

As in `bounds.py` it is one function of time that is positive while nothing happens: the gap of a free
mass, divided by the power of time that it begins with, or the contact force of a held one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._machine import Machine, State
from .._types import Scalar
from .bernstein import from_nodes, nodes, slopes_from_nodes


class Inside(eqx.Module):
    """A step between its ends, at the nodes of `bernstein.py`.

    Attributes:
        displacement: x - x(0), (nodes, n).
        gain: v - v(0), (nodes, n); for a held mass what it would be if the mass were let go: its
            derivative is contact force by mass.
    """

    displacement: Float[Array, "nodes n"]
    gain: Float[Array, "nodes n"]


class Rates(eqx.Module):
    """What is watched, and its derivatives, at one instant.

    Attributes:
        value: the gap, or where a mass is held the contact force by its mass, (stops,).
        slope: its first derivative.
        a: accelerations, (n,).
        jerk: their rates, (n,).
        pull: what the accelerations were, if no mass were held, (n,).
    """

    value: Float[Array, " stops"]
    slope: Float[Array, " stops"]
    a: Float[Array, " n"]
    jerk: Float[Array, " n"]
    pull: Float[Array, " n"]


def rates(machine: Machine, state: State, is_held: Bool[Array, " n"]) -> Rates:
    """The present."""
    pull = machine.inverse_mass * machine.total_force(state)
    a = jnp.where(is_held, 0, pull)
    change = machine.inverse_mass * machine.total_force_rate(state, a)
    value = jnp.where(state.held, machine.at_stops(pull), state.gap)
    slope = jnp.where(state.held, machine.at_stops(change), -machine.at_stops(state.v))
    return Rates(value, slope, a, jnp.where(is_held, 0, change), pull)


def is_due(now: Rates, state: State) -> Bool[Array, " stops"]:
    """Whether an event happens at once: a mass already at its stop moves in, a force already gone falls."""
    return (state.contact == 0) & (now.value <= 0) & (now.slope < 0)


def delays(
    machine: Machine, end: Rates, held: Bool[Array, " stops"], scale: Scalar
) -> Float[Array, " stops"]:
    """How far from the end of a step every stop has its event, if so near that no more terms count; else infinite.

    Args:
        machine: the numbers of the machine.
        end: what is watched at the end of the step.
        held: stops that hold their mass.
        scale: the time in which the motion changes.
    """
    curve = jnp.where(held, 0, -machine.at_stops(end.a) / 2)
    bend = jnp.where(held, 0, -machine.at_stops(end.jerk) / 6)
    square = end.slope * end.slope - 4 * curve * end.value
    is_simple = (end.slope < 0) & (4 * square > end.slope * end.slope)
    root = jnp.sqrt(jnp.where(is_simple, square, 1))
    delay = 2 * end.value / (root - jnp.where(is_simple, end.slope, 0))
    for _ in range(2):
        value = end.value + delay * (end.slope + delay * (curve + delay * bend))
        rate = end.slope + delay * (2 * curve + 3 * delay * bend)
        delay = delay - value / jnp.where(is_simple & (rate < 0), rate, -1)
    return jnp.where(is_simple & (jnp.abs(delay) <= scale * nearness(held, delay.dtype)), delay, jnp.inf)


def nearness(held: Bool[Array, " stops"], dtype: jnp.dtype) -> Float[Array, " stops"]:
    """Parts of the scale of time, of which the first power that is left out is below rounding."""
    eps = float(jnp.finfo(dtype).eps)
    return jnp.where(held, eps**0.5, eps ** (1 / 3))


class Watched(eqx.Module):
    """What is watched at every stop during a step.

    Attributes:
        likely: Bernstein coefficients of what the polynomial inside the step says, (degree + 1, stops).
        sure: of what is left of it if the polynomial is as wrong as it may be.
        is_crossed: whether an event happens even so, (stops,).
        error: how wrong it may be, (stops,).
    """

    likely: Float[Array, "coefficients stops"]
    sure: Float[Array, "coefficients stops"]
    is_crossed: Bool[Array, " stops"]
    error: Float[Array, " stops"]


def watch(machine: Machine, state: State, now: Rates, end: Rates, inside: Inside, step: Scalar) -> Watched:
    """Watch every stop during a step.

    Its ends are exact, as far as the step is. The position between them may be as wrong as its derivative differs from
    the velocity, times the time since the start.
    """
    degree = len(inside.gain) - 1
    to_bernstein, to_slope = (jnp.asarray(f(degree), step.dtype) for f in (from_nodes, slopes_from_nodes))
    at_stops = jax.vmap(machine.at_stops)
    displacement = at_stops(inside.displacement)
    gap = to_bernstein @ _deflated(machine, state, now, displacement, step)
    pressed = to_slope @ at_stops(inside.gain)
    first, last = (step * machine.at_stops(r.pull)[None] for r in (now, end))
    likely = jnp.where(state.held[None], jnp.concatenate([first, pressed[1:-1], last]), gap)

    defect = to_slope @ inside.displacement - step * (state.v[None] + to_bernstein @ inside.gain)
    error = jnp.where(state.held, 0, machine.of_stops(jnp.max(jnp.abs(defect), axis=0)))
    time = jnp.arange(degree + 1, dtype=step.dtype)[:, None] / degree
    share = jnp.where((state.contact[None] == 0) | (time == 0), time, 1)
    sure = likely - share * error[None]
    lowest = jnp.where(
        state.held, jnp.min(likely, axis=0), state.gap - jnp.max(displacement[1:], axis=0) + error
    )
    return Watched(likely, sure, (lowest < 0) | (end.value < 0), error)


def _deflated(
    machine: Machine, state: State, now: Rates, displacement: Float[Array, "nodes stops"], step: Scalar
) -> Float[Array, "nodes stops"]:
    """The gap at the nodes, divided by as many powers of time as derivatives of it vanish at the start."""
    time = jnp.asarray(nodes(len(displacement) - 1), step.dtype)[1:, None]
    v, a, jerk = (-machine.at_stops(w) for w in (state.v, now.a, now.jerk))
    leading = (state.gap, step * v, step**2 * a / 2, step**3 * jerk / 6)
    start, later = leading[0], state.gap[None] - displacement[1:]
    for order in (1, 2, 3):
        start = jnp.where(state.contact == order, leading[order], start)
        later = jnp.where(state.contact[None] == order, -displacement[1:] / time**order, later)
    return jnp.concatenate([start[None], later])
