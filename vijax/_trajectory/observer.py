"""Extremes of a motion and integrals of its squares, gathered step by step while it is followed.

A step is smooth: `AbstractFlow.propagate` gives the motion at any instant inside. Each step is evaluated at Gauss-Lobatto
nodes, which integrate squares to rounding. Between two nodes the cubic through values and slopes shows where a signal may
be largest, even where its slope vanishes twice. The best place of the step is then refined by Newton's method on the
slope of the motion itself. What is kept are values of the motion, never those of a polynomial. (A guard at every
zero of the slope would shorten the steps: the motion would have other bits where its extremes are requested.)

Limit: of two local maxima within one step, half a period of the fastest mode at most, the lower one may be taken if they
differ by less than 1e-4 of the amplitude.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool

from .._flow.exact_step import state_after_step
from .._flow.interface import AbstractFlow
from .._jax.arrays import Scalar, append_axes, clip_to_zero, stack
from .._jax.xla import compute_once, is_any
from .._machine.contacts import Held
from .._machine.derivatives import rates
from .._machine.machine import Machine
from .._machine.state import State

# What may be observed, each with its meaning in `signals`: extremes by signal and sign, squares by signal.
EXTREMES = {
    "max_position": ("position", 1),
    "min_position": ("position", -1),
    "max_velocity": ("velocity", 1),
    "min_velocity": ("velocity", -1),
    "max_force": ("force", 1),
    "max_acceleration": ("acceleration", 1),
    "min_acceleration": ("acceleration", -1),
    "highest_absolute_acceleration": ("absolute acceleration", 1),
    "lowest_absolute_acceleration": ("absolute acceleration", -1),
}
SQUARES = {
    "square_position": "position",
    "square_velocity": "velocity",
    "square_acceleration": "acceleration",
    "hysteresis_energy": "root_slip_power",
}
# Those that need the part of the load that a moving base makes.
OF_BASE = ("highest_absolute_acceleration", "lowest_absolute_acceleration")
# Nodes of a step: squares, of at most 6 rad, are integrated to rounding.
_NODES = 12
# Newton steps: the cubic places an extreme to 1e-3 of a step, and its value has no error of first order.
_REFINEMENTS = 2

Observed = dict[str, Array]


def nothing_observed(names: Sequence[str], like: State, num_stops: int, num_sliders: int) -> Observed:
    """Observations before the first step, for a state whose arrays are as those of `like`."""
    n, lanes = len(like.x), like.x.shape[1:]

    def of(name: str) -> Array:
        size = {"max_force": num_stops, "hysteresis_energy": num_sliders}.get(name, n)
        # A stop without a load has the force 0; all else has no extreme yet.
        least = 0.0 if name in SQUARES or name == "max_force" else -EXTREMES[name][1] * np.inf
        return jnp.full((size, *lanes), least, like.x.dtype)

    return {name: of(name) for name in names}


def observe(
    observed: Observed,
    flow: AbstractFlow,
    machine: Machine,
    state: State,
    end: Scalar,
    is_counted: Bool[Array, "..."],
) -> Observed:
    """Observations after a smooth step.

    Args:
        observed: what was known before it.
        flow: the motion between events.
        machine: the machine as arrays.
        state: state at the beginning of the step.
        end: local time at its end.
        is_counted: whether the step counts.
    """
    step = clip_to_zero((end - state.time) - state.time_low)

    def seen() -> Observed:
        found = compute_once(partial(_of_step, tuple(observed)), flow, machine, state, step)
        return {name: _joined(name, a, found[name], is_counted) for name, a in observed.items()}

    return jax.lax.cond(is_any(is_counted), seen, lambda: observed)


def _joined(name: str, so_far: Array, found: Array, is_counted: Array) -> Array:
    if name in SQUARES:
        return so_far + jnp.where(is_counted, found, 0)
    larger = jnp.maximum if EXTREMES[name][1] > 0 else jnp.minimum
    # NaN is passed on: the motion is lost.
    return jnp.where(is_counted, larger(so_far, found), so_far)


def _of_step(
    names: tuple[str, ...], flow: AbstractFlow, machine: Machine, state: State, length: Scalar
) -> Observed:
    """Contributions of one step to some observations."""
    machine = machine.in_mode(state)
    hold = machine.hold(state.held)
    move = flow.inside(machine, state, hold)
    extremes, squares = ([name for name in names if name in of] for of in (EXTREMES, SQUARES))
    seen = partial(_seen, extremes, squares, machine, hold)
    shapes = jax.eval_shape(seen, state, length)
    unseen = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
    zero = unseen.values
    place = _Place(zero, zero, zero - jnp.inf, zero - jnp.inf)
    numbers = append_axes(jnp.arange(len(zero)), zero)

    # Nodes and refinements are turns of one loop: two would compile twice as long.
    def look(carry: tuple[_Sight, _Place, Array], turn: tuple[Array, Array, Array]):
        before, place, sums = carry
        node, weight, number = turn
        is_own = numbers == number
        own = jnp.sum(jnp.where(is_own, place.time, 0), axis=0)
        time = jnp.where(number < 0, length * node, own)
        there = compute_once(state_after_step, machine, state, *compute_once(move, time), time)
        here = compute_once(seen, there, time)
        place = compute_once(_better_place, place, before, here, number < 0)
        place = compute_once(_newton, place, here, is_own, length)
        return (here, place, sums + weight * here.squares), None

    start = unseen, place, unseen.squares
    (_, place, sums), _ = jax.lax.scan(look, start, _turns(len(zero), length.dtype))
    rows, sums = list(place.largest), list(length * sums)
    found, num_stops = {}, machine.contacts.num_stops
    for name in extremes:
        size = num_stops if name == "max_force" else machine.num_masses
        own, rows = rows[:size], rows[size:]
        found[name] = EXTREMES[name][1] * stack(own) if own else jnp.zeros((0, *length.shape), length.dtype)
    for name in squares:
        size = machine.contacts.num_sliders if name == "hysteresis_energy" else machine.num_masses
        own, sums = sums[:size], sums[size:]
        found[name] = stack(own)
    return found


class _Sight(NamedTuple):
    """Motion at an instant.

    Attributes:
        time: since the beginning of the step.
        values: signals with the signs of their extremes, (signals, ...).
        slopes: their derivatives along the motion.
        squares: squares of signals, (squares, ...).
    """

    time: Scalar
    values: Array
    slopes: Array
    squares: Array


class _Place(NamedTuple):
    """Estimated maxima of signals within a step, (signals, ...) each.

    Attributes:
        time: since the beginning of the step; 0 where no maximum lies inside.
        curvature: second derivative there; 0 where no maximum lies inside.
        height: value of the cubic there.
        largest: largest value of the motion seen.
    """

    time: Array
    curvature: Array
    height: Array
    largest: Array


def _seen(
    extremes: list[str], squares: list[str], machine: Machine, hold: Held, state: State, time: Scalar
) -> _Sight:
    names = lambda s: (s.time, s.x, s.v, s.phase)  # noqa: E731

    def signals(*moving: Array) -> Array:
        found = _signals(
            machine, eqx.tree_at(names, state, moving), hold, {EXTREMES[name][0] for name in extremes}
        )
        rows = [EXTREMES[name][1] * found[EXTREMES[name][0]] for name in extremes]
        return jnp.concatenate([jnp.zeros_like(state.x[:0]), *rows])

    acceleration = rates(machine, state, hold).acceleration
    along = jnp.ones_like(state.time), state.v, acceleration, machine.phase_rate(state.phase)
    values, slopes = jax.jvp(signals, names(state), along)
    found = _signals(machine, state, hold, {SQUARES[name] for name in squares})
    rows = [found[SQUARES[name]] for name in squares]
    squared = jnp.concatenate([jnp.zeros_like(state.x[:0]), *rows]) ** 2
    return _Sight(time, values, slopes, squared)


def _better_place(place: _Place, left: _Sight, right: _Sight, is_node: Array) -> _Place:
    """Look for a maximum of the cubics between two nodes."""
    width = (right.time - left.time)[None]
    rise, begin, end = right.values - left.values, left.slopes * width, right.slopes * width
    b, c = 3 * rise - 2 * begin - end, begin + end - 2 * rise
    square = b * b - 3 * c * begin
    root = jnp.sqrt(jnp.where(square > 0, square, 1))
    under = root - b
    t = begin / jnp.where(under > 0, under, 1)
    height = left.values + t * (begin + t * (b + t * c))
    is_inside = is_node & (square > 0) & (under > 0) & (t > 0) & (t < 1)
    is_better = is_inside & (height > place.height)
    return _Place(
        time=jnp.where(is_better, left.time + t * width, place.time),
        curvature=jnp.where(is_better, -2 * root / jnp.where(width > 0, width * width, 1), place.curvature),
        height=jnp.where(is_better, height, place.height),
        largest=jnp.maximum(place.largest, right.values),
    )


def _newton(place: _Place, here: _Sight, is_own: Array, length: Scalar) -> _Place:
    """Move the place of a signal by its slope there."""
    bend = jnp.where(place.curvature < 0, place.curvature, -jnp.inf)
    moved = jnp.clip(place.time - here.slopes / bend, 0, length)
    return place._replace(time=jnp.where(is_own, moved, place.time))


def _turns(num_signals: int, dtype: DTypeLike) -> tuple[Array, Array, Array]:
    """Node, weight and number of the signal of each turn: first the nodes, of no signal, then refinements of every signal."""
    nodes, weights = _lobatto(_NODES)
    later = np.tile(np.arange(num_signals), _REFINEMENTS + 1)
    numbers = np.append(np.full(_NODES, -1), later)
    nodes, weights = (np.append(a, np.zeros(len(later))) for a in (nodes, weights))
    return jnp.asarray(nodes, dtype), jnp.asarray(weights, dtype), jnp.asarray(numbers)


def _signals(machine: Machine, state: State, hold: Held, names: set[str]) -> dict[str, Array]:
    """Motion of the masses in space, and the forces of the stops, (masses or stops, ...) each."""
    x, v = machine.in_space(state)
    contacts = machine.contacts
    load = machine.total_force(state)
    pressing = contacts.contact_force(load, hold, state.phase)
    free = jnp.zeros_like(pressing) if state.mode is None else contacts.forces_of(state)
    force = jnp.where(state.held, pressing, free)[: contacts.num_stops]
    found = {"position": x, "velocity": v, "force": force}
    if "acceleration" in names or "absolute acceleration" in names:
        found["acceleration"] = machine.acceleration_in_space(state, load, hold)
    if "absolute acceleration" in names:
        found["absolute acceleration"] = machine.absolute(found["acceleration"], state)
    if contacts.num_sliders and state.mode is not None:
        # The loss while a slider slips; a root, as it is summed as a square.
        slips = state.mode.direction != 0
        power = jnp.where(slips, free * contacts.along(state.v), 0)[-contacts.num_sliders :]
        found["root_slip_power"] = jnp.sqrt(jnp.maximum(power, 0))
    return found


def _lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of Gauss-Lobatto quadrature on [0, 1] and their weights."""
    last = np.polynomial.legendre.Legendre.basis(count - 1)
    inner = np.sort(last.deriv().roots().real)
    points = np.concatenate([[-1.0], inner, [1.0]])
    weights = 1 / (count * (count - 1) * last(points) ** 2)
    return (points + 1) / 2, weights
