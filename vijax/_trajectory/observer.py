"""Extremes of a motion and integrals of its squares, gathered step by step while it is followed.

A step is smooth: `AbstractFlow.propagate` gives the motion at any instant inside. Each step is evaluated at Gauss-Lobatto
nodes, which integrate squares to rounding. Between two nodes the cubic through values and slopes shows where a signal may
be largest, even where its slope vanishes twice. The best place of the step is then refined by Newton's method on the
slope of the motion itself. What is kept are values of the motion, never those of a polynomial. (A guard at every
zero of the slope would shorten the steps: the motion would have other bits where its extremes are requested.)

Limit: of two local maxima within one step, a third of a period of the fastest mode at most, the lower one may be taken if
they differ by less than 1e-5 of the amplitude.
"""

from collections.abc import Callable, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._flow.exact_step import state_after_step
from .._flow.interface import AbstractFlow
from .._jax.arrays import Scalar, add_up, clip_to_zero
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
}
SQUARES = {"square_position": "position", "square_velocity": "velocity"}
# Nodes of a step: squares, of at most 6 rad, are integrated to rounding.
_NODES = 12
# Newton steps: the cubic places an extreme to 1e-3 of a step, and its value has no error of first order.
_REFINEMENTS = 2

Observed = dict[str, Array]


def nothing_observed(names: Sequence[str], like: State, num_stops: int) -> Observed:
    """What is known before the first step, for a state whose arrays are as those of `like`."""
    n, lanes = len(like.x), like.x.shape[1:]

    def of(name: str) -> Array:
        size = num_stops if name == "max_force" else n
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
    """What is known after a smooth step.

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
    names: tuple[str, ...], flow: AbstractFlow, machine: Machine, state: State, step: Scalar
) -> Observed:
    """What some names stand for in one step."""
    machine = machine.in_mode(state)
    hold = machine.hold(state.held)
    extremes, squares = ([name for name in names if name in of] for of in (EXTREMES, SQUARES))

    def at(time: Scalar) -> State:
        moved = flow.propagate(machine, state, hold, time)
        return state_after_step(machine, state, *moved, time)

    nodes, weights = _lobatto(_NODES)
    shape = (_NODES,) + (1,) * step.ndim
    times = step * jnp.asarray(nodes, step.dtype).reshape(shape)
    states = jax.vmap(at)(times)
    found: Observed = {}
    for name in squares:
        rows = jax.vmap(lambda s, name=name: _signals(machine, s, hold)[SQUARES[name]])(states)
        found[name] = step * add_up([float(w) * row * row for w, row in zip(weights, rows, strict=True)])
    if extremes:
        found |= _extremes(extremes, machine, hold, at, (times, states))
    return found


def _extremes(
    names: list[str], machine: Machine, hold: Held, at: Callable[[Scalar], State], inside: tuple[Array, State]
) -> Observed:
    """Extremes of some signals in a step, from its nodes and refined."""

    def signs_and_slopes(state: State) -> tuple[Array, Array]:
        """All signals with the signs of their extremes, and their slopes along the motion, (signals, ...) each."""
        now = rates(machine, state, hold)
        along = jnp.ones_like(state.time), state.v, now.acceleration, machine.phase_rate(state.phase)

        def signed(moving: tuple[Array, ...]) -> Array:
            signals = _signals(machine, eqx.tree_at(_moving, state, moving), hold)
            return jnp.concatenate([EXTREMES[name][1] * signals[EXTREMES[name][0]] for name in names])

        return jax.jvp(signed, (_moving(state),), (along,))

    times, states = inside
    values, slopes = jax.vmap(signs_and_slopes)(states)
    place, curvature = compute_once(_best_place, values, slopes, times)
    best = jnp.max(values, axis=0)
    numbers = jnp.arange(len(best))

    def own(time: Scalar, number: Array) -> tuple[Array, Array]:
        found = signs_and_slopes(at(time))
        is_own = (numbers == number).reshape(-1, *(1,) * time.ndim)
        return tuple(jnp.sum(jnp.where(is_own, a, 0), axis=0) for a in found)

    for _ in range(_REFINEMENTS + 1):
        value, slope = compute_once(jax.vmap(own), place, numbers)
        best = jnp.maximum(best, value)
        moved = jnp.clip(place - slope / curvature, 0, times[-1])
        place = jnp.where(jnp.isfinite(moved), moved, place)
    sizes = [len(machine.mean) if name != "max_force" else machine.contacts.num_stops for name in names]
    parts = jnp.split(best, np.cumsum(sizes)[:-1])
    return {name: EXTREMES[name][1] * part for name, part in zip(names, parts, strict=True)}


def _moving(state: State) -> tuple[Array, ...]:
    return state.time, state.x, state.v, state.phase


def _signals(machine: Machine, state: State, hold: Held) -> dict[str, Array]:
    """Positions and velocities in space, and the forces of the stops, (masses or stops, ...) each."""
    x, v = machine.in_space(state)
    contacts = machine.contacts
    pressing = contacts.contact_force(machine.total_force(state), hold, state.phase)
    free = jnp.zeros_like(pressing) if state.mode is None else contacts.forces_of(state)
    force = jnp.where(state.held, pressing, free)[: contacts.num_stops]
    return {"position": x, "velocity": v, "force": force}


def _best_place(values: Array, slopes: Array, times: Array) -> tuple[Array, Array]:
    """Time of the largest interior maximum of the cubics between nodes, and the curvature there, (signals, ...) each.

    The first node, and a curvature of -1, where there is none.

    Args:
        values: at the nodes, (nodes, signals, ...).
        slopes: likewise.
        times: of the nodes, (nodes, ...).
    """
    times = times[:, None]
    width = times[1:] - times[:-1]
    rise, begin, end = values[1:] - values[:-1], slopes[:-1] * width, slopes[1:] * width
    b, c = 3 * rise - 2 * begin - end, begin + end - 2 * rise
    square = b * b - 3 * c * begin
    root = jnp.sqrt(jnp.where(square > 0, square, 1))
    under = root - b
    t = begin / jnp.where(under > 0, under, 1)
    is_inside = (square > 0) & (under > 0) & (t > 0) & (t < 1)
    height = jnp.where(is_inside, values[:-1] + t * (begin + t * (b + t * c)), -jnp.inf)
    place, curvature = times[:-1] + t * width, -2 * root / jnp.where(width > 0, width * width, 1)
    highest, found = jnp.full_like(height[0], -jnp.inf), (jnp.zeros_like(t[0]), jnp.full_like(t[0], -1))
    for k in range(len(height)):
        is_better = height[k] > highest
        highest = jnp.where(is_better, height[k], highest)
        found = tuple(jnp.where(is_better, a[k], old) for a, old in zip((place, curvature), found, strict=True))
    return found


def _lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of Gauss-Lobatto quadrature on [0, 1] and their weights."""
    last = np.polynomial.legendre.Legendre.basis(count - 1)
    inner = np.sort(last.deriv().roots().real)
    points = np.concatenate([[-1.0], inner, [1.0]])
    weights = 1 / (count * (count - 1) * last(points) ** 2)
    return (points + 1) / 2, weights
