"""Admissibility of a cycle between its events: least gaps of free masses, least contact forces of held ones."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._flow.interface import AbstractFlow
from .._hybrid.guards import guards_of as groups_of, is_idle, select_active
from .._hybrid.limits import FORCE, GAP
from .._machine.derivatives import derivatives
from .._machine.machine import Machine
from .._orbits.cycle import Moment, Problem, Unknowns, flow_map, state_in_mode, traverse
from .._orbits.sequence import elements_of_events
from .._orbits.side_by_side import follower_flags, may_have_pairs
from .margin_scan import (
    OF_FORCE,
    Course,
    GapsAndForces,
    LeastMargins,
    density_of,
    least_margins,
    of_flight,
)
from .tolerances import END_OF_FLIGHT
from .torn_friction import Guards, excess_of_torn, has_friction, rises_with_torn, with_torn


class Margins(NamedTuple):
    """Quantities that stay positive on an admissible cycle: approach speeds, and gap, force, rise of `LeastMargins`."""

    speeds: Float[Array, " events"]
    gap: Float[Array, " stops"]
    force: Float[Array, " stops"]
    rise: Float[Array, " stops"]


def course_of(problem: Problem, unknowns: Unknowns, begins: Moment | None = None) -> Course:
    """The flights of a cycle, from the moments at which they begin, see `traverse`, if these are known."""
    machine, sequence = problem.machine, problem.sequence
    count, room = jnp.sum(sequence.is_event), len(sequence.kind)
    begins = traverse(problem, unknowns, count)[0] if begins is None else begins
    whole = problem.length(unknowns)
    last = whole - jnp.sum(unknowns.flights)
    # The event of a negative first flight lies before the start, hence ends the last flight before the cycle ends.
    early = jnp.minimum(unknowns.flights[0], 0) if room else 0.0
    flights = jnp.append(unknowns.flights, 0).at[count].set(last + early)
    have_event = elements_of_events(sequence, machine.contacts).astype(int)
    have_length = jnp.where(flights > END_OF_FLIGHT * whole, jnp.arange(room + 1), 0)
    return Course(
        sequence=sequence,
        begins=begins,
        flights=flights,
        count=count,
        skipped=jnp.clip(-last, 0),
        whole=whole,
        passed=jnp.where((last < 0) | problem.is_autonomous, count, 0),
        last=last,
        density=machine.rate * machine.period * density_of(sequence),
        phase=problem.phase,
        is_plastic=machine.contacts.is_plastic,
        had=jnp.cumsum(jnp.concatenate([jnp.zeros_like(have_event[:1]), have_event]), axis=0),
        before=jnp.concatenate([jnp.zeros_like(count)[None], jax.lax.cummax(have_length)[:-1]]),
        follows=_followers(problem),
    )


def margins_of_cycle(problem: Problem, unknowns: Unknowns, begins: Moment | None = None) -> LeastMargins:
    """Scan a cycle between its events for the least gap and contact force of each stop.

    Args:
        problem: the equations of the cycle.
        unknowns: the cycle.
        begins: moments at which its flights begin, see `traverse`, if they are known.
    """
    course = course_of(problem, unknowns, begins)
    found = least_margins(course, partial(read, problem.machine, problem.flow))
    return with_margins_at_events(problem, course.begins, found)


def with_margins_at_events(problem: Problem, begins: Moment, found: LeastMargins) -> LeastMargins:
    """The margins between the events of a cycle with those of friction at the events, which begin its flights."""
    found = found._replace(grip=None if begins.grip is None else begins.grip[1:])
    if has_friction(problem.machine):
        excess = excess_of_torn(problem.sequence, begins, guards_of(problem))
        rise, flight = with_torn(excess, found.rise, found.rise_flight)
        found = found._replace(rise=rise, rise_flight=flight)
    return _of_leaders(problem, found)


def _followers(problem: Problem) -> Bool[Array, " guards"] | None:
    """Flags of the guards of elements that follow others, see `side_by_side.py`; None where there are none."""
    contacts = problem.machine.contacts
    return problem.sequence.for_guards(follower_flags(contacts)) if may_have_pairs(contacts) else None


def _of_leaders(problem: Problem, found: LeastMargins) -> LeastMargins:
    """The margins without those of elements that follow others."""
    follows = _followers(problem)
    if follows is None:
        return found
    names = "gap", "force", "rise"
    return found._replace(**{name: jnp.where(follows, jnp.inf, getattr(found, name)) for name in names})


def margins_at(problem: Problem, begins: Moment, speeds: Array, watched: LeastMargins) -> Margins:
    """Margins at the times of `watched`, to be differentiated: to first order the time of a minimum has no effect.

    Values at the end of a flight move with it.
    """
    machine, flow, sequence = problem.machine, problem.flow, problem.sequence
    stops = jnp.arange(len(watched.gap))
    if not len(stops):  # a loop over no rows has no length
        return Margins(speeds=speeds, gap=watched.gap, force=watched.force, rise=watched.rise)

    def at_row(flight: Array, time: Array) -> GapsAndForces:
        begin = of_flight(begins, flight)
        since = jnp.maximum(time + problem.phase - jax.lax.stop_gradient(begin.time), 0)
        if sequence.num_groups > 1:
            whole = of_flight(begins.time, jnp.minimum(flight + 1, len(sequence.kind))) - begin.time
            since = jnp.where(jnp.abs(since - whole) < END_OF_FLIGHT, whole, since)
        return read(machine, flow, begin, jnp.asarray(sequence.mode)[flight], since)

    flights = jnp.concatenate([watched.gap_flight, watched.force_flight, watched.rise_flight])
    # Rises at the beginning of their flights: earlier times are clipped to it.
    times = jnp.concatenate([watched.gap_time, watched.force_time, jnp.full_like(watched.gap_time, -jnp.inf)])
    gap, force, rise = (
        jax.tree.map(lambda a: a[stops, stops], part)
        for part in _split_in_three(jax.vmap(at_row)(flights, times))
    )
    rises = rise.gap[2]
    if has_friction(machine):
        excess = excess_of_torn(sequence, begins, guards_of(problem))
        rises = rises_with_torn(excess, rises, watched.rise_flight)
    return Margins(speeds=speeds, gap=gap.gap[0], force=force.force[0], rise=rises)


def _split_in_three(readings: GapsAndForces) -> list[GapsAndForces]:
    return [jax.tree.map(lambda a, k=k: jnp.split(a, 3)[k], readings) for k in range(3)]


def guards_of(problem: Problem) -> Guards:
    """Function of the beginning of a flight, its mode and a time on it, that gives the values of all guards."""
    return lambda begin, mode, since: read(problem.machine, problem.flow, begin, mode, since).gap[0]


def read(machine: Machine, flow: AbstractFlow, begin: Moment, mode: Array, since: Array) -> GapsAndForces:
    """Gaps and contact forces, or all guards, `since` forcing periods after the beginning of a flight."""
    x, v, phase, _ = flow_map(machine, flow, begin, mode, since)
    x, time = jnp.split(begin.z, 2)[0] + x, (begin.time + since) * machine.period
    state = state_in_mode(machine, phase, x, v, mode, time)
    machine = machine.in_mode(state)
    hold = machine.hold(state.held)
    now = derivatives(machine, state, hold)
    if len(groups_of(machine)) > 1:
        of = lambda limit: limit.derivatives(machine, state, hold, now)[:OF_FORCE]  # noqa: E731
        guards = [a * machine.period**order for order, a in enumerate(select_active(machine, state, of))]
        if machine.has_tied_friction:  # which has no guard while its contact is open
            guards = [jnp.where(is_idle(state), order == 0, a) for order, a in enumerate(guards)]
        return GapsAndForces(guards, guards)
    in_periods = lambda limit: [  # noqa: E731
        a * machine.period**order for order, a in enumerate(limit.derivatives(machine, state, hold, now))
    ]
    return GapsAndForces(in_periods(GAP), in_periods(FORCE))
