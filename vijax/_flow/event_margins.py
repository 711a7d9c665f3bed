"""Event margin of every stop during an approximate step, and its bounds by the polynomial inside the step.

As in `safe_step.py`, the margin is a function of time that is positive while nothing happens: the gap of a free mass,
divided by the power of time with which it begins, or the contact force of a held one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.guards import leading_zeros
from .._jax.arrays import Flag, Scalar, smallest
from .._jax.xla import compute_once, in_one_kernel
from .._machine.contacts import Held
from .._machine.derivatives import Rates, approaches, rates
from .._machine.machine import Machine
from .._machine.state import KEPT_CLOSED, State
from .._system.waves import speeds, turned
from .bernstein import bernstein, derivative_coefficients, divided, first_crossing, nodes
from .mode_series import LONGEST_STEP_AND_TERMS, cosine_and_sine


class StepInterior(eqx.Module):
    """Motion inside a step, at the nodes of `bernstein.py`.

    Attributes:
        displacement: x - x(0), (nodes, n).
        gain: v - v(0), (nodes, n), see `Contacts.free_accelerations`.
        pushes: likewise, (nodes, stops).
    """

    displacement: Float[Array, "nodes n"]
    gain: Float[Array, "nodes n"]
    pushes: Float[Array, "nodes stops"] | None = None


class EventMargins(eqx.Module):
    """Event margins at one instant, and the motion there.

    Attributes:
        value: gap of a free contact, pull of one that holds, (guards,).
        slope: its time derivative.
        curve: its second Taylor coefficient, as far as it is known, else 0.
        bend: its third, likewise.
        radius: time at which the first omitted power is below rounding, as a fraction of the time scale.
        motion: forces, accelerations and their rates.
    """

    value: Float[Array, " guards"]
    slope: Float[Array, " guards"]
    curve: Float[Array, " guards"]
    bend: Float[Array, " guards"]
    radius: Float[Array, " guards"]
    motion: Rates


def event_margins_at(machine: Machine, state: State, hold: Held) -> EventMargins:
    """Event margins at a state."""
    motion, phase = rates(machine, state, hold), state.phase
    pull = machine.contacts.pull(motion.force, hold, phase)
    pull_rate = machine.contacts.pull(motion.force_rate, hold, machine.phase_rate(phase))
    approach = approaches(machine, state, motion)
    value = jnp.where(state.held, pull, state.gap)
    slope = jnp.where(state.held, pull_rate, -approach[0])
    # A contact that others keep closed has no event.
    value, slope = jnp.where(state.is_kept_closed, 1, value), jnp.where(state.is_kept_closed, 0, slope)
    return EventMargins(
        value=value,
        slope=slope,
        curve=jnp.where(state.held, 0, -approach[1] / 2),
        bend=jnp.where(state.held, 0, -approach[2] / 6),
        radius=jnp.where(state.held, series_radius(2, value.dtype), series_radius(3, value.dtype)),
        motion=motion,
    )


def series_radius(num_terms: int, dtype: jnp.dtype) -> float:
    """Time at which so many powers leave out no more than rounding, as a fraction of the time scale."""
    return float(jnp.finfo(dtype).eps) ** (1 / num_terms)


def is_due(now: EventMargins, state: State) -> Bool[Array, " guards"]:
    """True where an event is due at the start of a step: the gap, or the contact force, is zero and falls."""
    return (leading_zeros(state) == 0) & (now.value <= 0) & (now.slope < 0)


def times_to_events(end: EventMargins, scale: Scalar) -> Float[Array, " guards"]:
    """Time from the end of a step to the event of every guard, if near enough for the known terms; else infinite.

    Args:
        end: event margins at the end of the step.
        scale: time scale of the motion.
    """
    square = end.slope * end.slope - 4 * end.curve * end.value
    is_simple = (end.slope < 0) & (4 * square > end.slope * end.slope)
    root = jnp.sqrt(jnp.where(is_simple, square, 1))
    delay = 2 * end.value / (root - jnp.where(is_simple, end.slope, 0))
    for _ in range(2):
        value = end.value + delay * (end.slope + delay * (end.curve + delay * end.bend))
        rate = end.slope + delay * (2 * end.curve + 3 * delay * end.bend)
        delay = delay - value / jnp.where(is_simple & (rate < 0), rate, -1)
    return jnp.where(is_simple & (jnp.abs(delay) <= scale * end.radius), delay, jnp.inf)


class StopView(eqx.Module):
    """Step relative to one stop: quantities at its start, positive towards the stop.

    Attributes:
        held: whether the stop holds its mass.
        contact: how the stop was last left, see `State`.
        gap: gap of the stop.
        v: velocity.
        a: acceleration.
        jerk: rate of the acceleration.
        pull: acceleration as if the mass were not held.
        last_pull: pull at the end of the step.
        last: event margin at the end of the step.
        displacement: displacement since the start, at the nodes of `bernstein.py`, (nodes,).
        gain: gain of velocity, likewise.
    """

    held: Flag
    contact: Int[Array, "..."]
    gap: Scalar
    v: Scalar
    a: Scalar
    jerk: Scalar
    pull: Scalar
    last_pull: Scalar
    last: Scalar
    displacement: Float[Array, "*stops nodes"]
    gain: Float[Array, "*stops nodes"]


class EventFreeProof(eqx.Module):
    """Part of a step that its polynomial proves free of events of one guard.

    Attributes:
        free: part of the step without an event: up to the event, if there is one, else as far as is proved.
        is_crossed: whether an event happens even with the largest error of the polynomial.
        error: bound of the error of the position on the polynomial.
    """

    free: Scalar
    is_crossed: Flag
    error: Scalar


def crossings_in_step(
    machine: Machine,
    state: State,
    hold: Held,
    now: EventMargins,
    end: EventMargins,
    inside: StepInterior,
    step: Scalar,
    is_expected: Bool[Array, " stops"],
) -> EventFreeProof:
    """Test every stop during a step; an event that `is_expected` at its end does not count as crossed."""
    contacts, changes = machine.contacts, phase_changes(machine, state, inside, step)
    approach = approaches(machine, state, now.motion)
    view = StopView(
        held=state.held,
        contact=state.contact,
        gap=state.gap,
        v=approach[0],
        a=approach[1],
        jerk=approach[2],
        pull=contacts.pull(now.motion.force, hold, state.phase),
        last_pull=contacts.pull(end.motion.force, hold, state.phase + changes[-1]),
        last=end.value,
        displacement=jax.vmap(contacts.towards, out_axes=1)(inside.displacement, changes),
        gain=jax.vmap(contacts.integrated_pull, out_axes=1)(inside.gain, inside.pushes),
    )
    return in_one_kernel(jax.vmap(_prove, (0, None, 0)), view, step, is_expected)


def _prove(view: StopView, step: Scalar, is_expected: Flag) -> EventFreeProof:
    """Prove as much of a step as possible free of events of one stop.

    The ends of the polynomial are as accurate as the step. Between them the error of the position is at most the
    difference between its derivative and the velocity, times the time since the start.
    """
    displacement = compute_once(bernstein, view.displacement)
    gain = compute_once(bernstein, view.gain)
    error = compute_once(_error, view, displacement, gain, step)
    likely = compute_once(_likely, view, displacement, gain, step)
    nearest = view.gap + smallest([-view.displacement[j] for j in range(1, len(displacement))]) + error
    is_below = (jnp.where(view.held, smallest(likely), nearest) < 0) | (view.last < 0)
    return proof_of(likely, is_below & ~is_expected, view.contact, view.contact == KEPT_CLOSED, error)


def proof_of(
    likely: list[Scalar], is_crossed: Flag, leading_zeros: Int[Array, "..."], is_idle: Flag, error: Scalar
) -> EventFreeProof:
    """Prove as much of a step as possible free of events of one guard.

    Args:
        likely: Bernstein coefficients of the guard, divided by the power of time with which it begins.
        is_crossed: whether an event happens even with the largest error.
        leading_zeros: that power.
        is_idle: whether the guard has no event at all.
        error: bound of the error of the guard inside the step.
    """
    degree, is_crossed = len(likely) - 1, is_crossed & ~is_idle
    share = [jnp.where(leading_zeros == 0, k / degree, min(k, 1)) for k in range(degree + 1)]
    doubt = jnp.where(is_crossed, 0, error)
    reduced = [c - part * doubt for c, part in zip(likely, share, strict=True)]
    return EventFreeProof(jnp.where(is_idle, 1, compute_once(first_crossing, reduced)), is_crossed, error)


def _error(view: StopView, displacement: list[Scalar], gain: list[Scalar], step: Scalar) -> Scalar:
    speeds = [step * (view.v + g) for g in gain]
    defects = [-jnp.abs(s - v) for s, v in zip(derivative_coefficients(displacement), speeds, strict=True)]
    return jnp.where(view.held, 0, -smallest(defects))


def _likely(view: StopView, displacement: list[Scalar], gain: list[Scalar], step: Scalar) -> list[Scalar]:
    """Bernstein coefficients of the contact force, or of the gap divided by the power of time with which it begins."""
    gap = [view.gap, *(view.gap - d for d in displacement[1:])]
    starts = -step * view.v, -(step**2) * view.a / 2, -(step**3) * view.jerk / 6
    gap = without_leading_zeros(gap, starts, view.contact)
    force = [step * view.pull, *derivative_coefficients(gain)[1:-1], step * view.last_pull]
    return [jnp.where(view.held, f, g) for f, g in zip(force, gap, strict=True)]


def without_leading_zeros(
    coefficients: list[Scalar], starts: tuple[Scalar, ...], leading_zeros: Int[Array, "..."]
) -> list[Scalar]:
    """Bernstein coefficients divided by the power of time with which the polynomial begins; `starts` are its derivatives."""
    for order, start in enumerate(starts, 1):
        shorter = divided(coefficients, start)
        coefficients = [
            jnp.where(leading_zeros >= order, a, b) for a, b in zip(shorter, coefficients, strict=True)
        ]
    return coefficients


def phase_changes(
    machine: Machine, state: State, inside: StepInterior, step: Scalar
) -> Float[Array, "nodes 2 harmonics"]:
    """Changes of the forcing phase at the nodes inside a step."""
    times = step * nodes(len(inside.gain) - 1)
    return jax.vmap(lambda time: phase_change(machine, state.phase, time))(times)


def phase_change(machine: Machine, phase: Float[Array, "2 harmonics ..."], time: Scalar) -> Array:
    """Change of the forcing phase over a time no longer than a step.

    By power series: library sines and cosines in every stage of a solver cost a third of the step.
    """

    def of_harmonics(phase: Array) -> Array:
        angle = speeds(phase, machine.pace) * time
        wave, arc = cosine_and_sine(angle * angle, LONGEST_STEP_AND_TERMS[str(angle.dtype)][1])
        return turned(phase, (wave, angle * arc))

    return machine.with_harmonics(phase, time, of_harmonics)
