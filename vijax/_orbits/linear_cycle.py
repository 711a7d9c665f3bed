"""Equations of a cycle linearised: its residual and the derivatives of every flight, event by event."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._flow.interface import AbstractFlow
from .._machine.machine import Machine
from .condensation import Flights, over_flights
from .cycle import (
    CycleFlight,
    Moment,
    Problem,
    Residual,
    Unknowns,
    closing_of,
    duration_of,
    flights_of,
    fly_to_event,
    initial_moment,
    moved_by,
)
from .rigid_modes import closing_pin, of_positions
from .sequence import sticks_all_along

# Share of a row along a shift that a cycle may progress by, above which that is pinned in place of its slider.
_PINNED = 1e-9


def slider_pin(problem: Problem, scale: Float[Array, " state"]) -> Float[Array, "state state"]:
    """The matrix that adds row . dx - de of each slider that sticks all along to the closing of its stretch e.

    Such a cycle belongs to a family, one for each place of the slider, row . x - e, which comes back by itself: one closing
    follows from the others. The step of Newton's method then keeps the slider where it is, as `rigid_modes.py` says of shifts.
    """
    contacts = problem.machine.contacts
    num = contacts.num_sliders
    rows, is_stuck = contacts.rows[-num:], sticks_all_along(problem.sequence, num)
    if problem.drift is not None:  # a shift that sliders alone resist is pinned already
        is_stuck = is_stuck & ~jnp.any(jnp.abs(rows @ problem.drift) > _PINNED * jnp.abs(rows), axis=1)
    size = rows.shape[1]
    stretches = jnp.eye(size, dtype=scale.dtype)[-num:]
    places = jnp.concatenate([rows, -stretches], axis=1) * scale[None] / scale[-1]
    zeros = jnp.zeros_like(stretches)
    return jnp.concatenate([zeros, stretches], axis=1).T @ (is_stuck[:, None] * places)


class LinearCourse(NamedTuple):
    """Moments at which the flights of a cycle begin, and what tells their rates along any direction.

    States and derivatives are those of `Flights`.

    Attributes:
        begins: the moments, (events + 1, ...) each.
        begin: see `Flights`.
        forward: likewise.
        speed: derivative of the approach speed at each event, (events, next + 1).
        grip: likewise of `Moment.grip` behind it, (events, stops, next + 1); None without friction of contacts.
    """

    begins: Moment
    begin: Float[Array, "next free"]
    forward: Float[Array, "events next given"]
    speed: Float[Array, "events given"]
    grip: Any = None

    def rates(
        self, start: Float[Array, " free"], flights: Float[Array, " events"], scale: Float[Array, " state"]
    ) -> tuple[Moment, Float[Array, " events"]]:
        """Rates of the moments, and of the approach speeds, by those of the scaled start and parameter and the durations."""

        def one(state: Array, flight: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
            forward, duration = flight
            given = jnp.append(state, duration)
            return forward @ given, (state, given)

        last, (states, given) = jax.lax.scan(one, self.begin @ start, (self.forward, flights))
        states, size = jnp.concatenate([states, last[None]]), len(scale)
        grip = self.begins.grip
        if grip is not None:
            grip = jnp.zeros_like(grip).at[1:].set(jnp.einsum("esg,eg->es", self.grip, given))
        gap = jnp.zeros_like(self.begins.gap)  # each flight has the derivatives of its own positions
        moments = Moment(states[:, :size] * scale[None], states[:, size], gap, grip)
        return moments, jnp.sum(self.speed * given, axis=1)


def linearise(
    problem: Problem,
    unknowns: Unknowns,
    scale: Float[Array, " state"],
    count: Int[Array, ""] | None = None,
    change: tuple | None = None,
) -> tuple[Residual, Flights]:
    """The residual and its derivatives by the scaled unknowns, flight by flight.

    Args:
        problem: the equations of the cycle.
        unknowns: where to linearise.
        scale: sizes of positions and velocities, by which `z` is divided, (2 n,).
        count: number of flights that end with an event, see `over_flights`.
        change: derivatives of the machine and its flow by a parameter, which is then one of the unknowns.
    """
    return _linearise(problem, unknowns, scale, count, change, has_course=False)[:2]


def linearise_course(
    problem: Problem,
    unknowns: Unknowns,
    scale: Float[Array, " state"],
    count: Int[Array, ""] | None = None,
    change: tuple | None = None,
) -> tuple[Residual, Flights, LinearCourse]:
    """`linearise`, and the course of the cycle, in one traversal."""
    return _linearise(problem, unknowns, scale, count, change, has_course=True)


def _linearise(
    problem: Problem,
    unknowns: Unknowns,
    scale: Float[Array, " state"],
    count: Int[Array, ""] | None,
    change: tuple | None,
    *,
    has_course: bool,
) -> tuple[Residual, Flights, Any]:
    size, p = len(scale), jnp.zeros(0 if change is None else 1, scale.dtype)

    def at(p: Array) -> tuple[Machine, AbstractFlow]:
        here = problem.machine, problem.flow
        return here if change is None else moved_by(here, change, p[0])

    def one(place: Moment, flight: CycleFlight):
        def moved(y: Array):
            here, p = place._replace(z=y[:size] * scale, time=y[size]), y[size + 1 : -1]
            there, (value, speed), _ = fly_to_event(*at(p), here, flight.event, y[-1])
            passed = (speed, there.grip) if has_course else None
            end = jnp.concatenate([there.z / scale, there.time[None], p])
            return (end, value, passed), (there, value, speed)

        duration = duration_of(problem, place, flight)
        y = jnp.concatenate([place.z / scale, place.time[None], p, duration[None]])
        (forward, normal, passed), (there, value, speed) = jax.jacfwd(moved, has_aux=True)(y)
        return there, (forward, normal, value, speed, (place, passed) if has_course else None)

    def begun(y: Array):
        place = initial_moment(problem, at(y[size:])[0], y[:size] * scale)
        return jnp.concatenate([place.z / scale, place.time[None], y[size:]]), place

    begin, place = jax.jacfwd(begun, has_aux=True)(jnp.concatenate([unknowns.z / scale, p]))
    flights = flights_of(problem, unknowns, count)
    num = None if count is None else count + 1
    place, (forward, normal, values, speeds, course) = over_flights(one, place, flights, num)
    # The flight that closes the cycle lasts as long as the others leave.
    last = forward[-1 if count is None else count]
    shortened = 0 if problem.is_autonomous else last[:size, -1]
    close = last[:size, :-1].at[:, size].add(-shortened)
    # Its place among the others is padding, which lanes with fewer events than another traverse.
    padding = jnp.eye(*forward.shape[1:]), jnp.eye(forward.shape[-1])[-1], jnp.zeros(())
    forward, normal, values = (
        jnp.where(flights.closes.reshape(-1, *[1] * pad.ndim), pad, a)[:-1]
        for pad, a in zip(padding, (forward, normal, values), strict=True)
    )
    found = Residual(values, closing_of(problem, place.z - unknowns.z), speeds[:-1])
    drift = None if problem.drift is None else of_positions(problem.drift)
    pin = closing_pin(problem.shifts)
    if problem.machine.contacts.num_sliders:
        pin = pin + slider_pin(problem, scale)
    if has_course:
        begins, passed = course
        course = LinearCourse(begins, begin, forward, *jax.tree.map(lambda a: a[:-1], passed))
    return found, Flights(begin, forward, normal, close, pin, drift), course
