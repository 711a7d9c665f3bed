"""Search for an orbit from a guess, and the orbit as a function of its machine."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from .._hybrid.limits import IMPACT
from .._jax.arrays import Reals, Scalar
from .._jax.concrete import is_traced, stop_gradients
from .._jax.xla import compile_derivatives_lightly, compile_lightly
from .._trajectory.event_log import EventLog
from .._trajectory.one_call import KnownMachine
from .candidate_cycle import multipliers_of
from .condensation import Pencil
from .cycle import Problem, Unknowns, log_of_cycle, prepared, progression_of
from .floquet import floquet_multipliers
from .newton import implicit_orbit, pencil_of
from .orbit import ORBIT_RESULTS
from .rigid_modes import closing_pin, drifts, free_drifts, free_shifts, num_of
from .search import Search, StroboscopicMap, begin_search, frame_offset, search_step
from .search_by_calls import search_by_calls
from .sequence import num_erased, num_stops_of


class OrbitSolution(eqx.Module):
    """Result of a search: the fields of a `PeriodicOrbit` that it finds."""

    x0: Float[Array, " n"]
    v0: Float[Array, " n"]
    events: EventLog
    progression: Float[Array, " n"]
    num_impacts: Int[Array, " stops"]
    multipliers: Complex[Array, " state"]
    is_stable: Bool[Array, ""]
    is_admissible: Bool[Array, ""]
    residual: Scalar
    num_runs: Int[Array, ""]
    result: ORBIT_RESULTS


def find(strobe: StroboscopicMap, guess: Reals, machine: KnownMachine | None = None) -> OrbitSolution:
    """Search from a guess, (2 n,), until an orbit is found, or nothing is left to try; of `machine` if that is known."""
    # The search itself is not differentiated: derivatives come from the implicit function theorem. Outside of `jit` its
    # values are known even under derivatives, so that its programs serve them too.
    known = strobe, guess
    search = search_to_end(*(known if machine else stop_gradients(known)), machine)
    return tell_of_search(replace(strobe, flow=strobe.flow.compact()), search)


def search_to_end(strobe: StroboscopicMap, guess: Reals, machine: KnownMachine | None = None) -> Search:
    """A search to its end, by calls of the program of `simulate` where its numbers are known."""
    found = None
    if strobe.flow.has_flow_map and (machine or not is_traced((strobe, guess))):
        machine = machine or KnownMachine(strobe.numbers, strobe.flow, can_stick=True)
        found = search_by_calls(machine, strobe, np.asarray(guess))
    return found or _search_in_one(replace(strobe, flow=strobe.flow.compact()), guess)


@compile_lightly
def _search_in_one(strobe: StroboscopicMap, guess: Float[Array, " state"]) -> Search:
    """A search to its end in one program, of a strobe whose flow is `compact`."""
    numbers = strobe.numbers
    search = begin_search(guess, numbers.kinds, strobe.room)
    follow = None
    if not strobe.flow.has_flow_map:
        follow = jax.jit(lambda z: strobe.run(z), inline=True)  # traced once
        run = jax.eval_shape(follow, guess)
        nothing = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), (run.events, run.jacobian))
        search = replace(search, last=nothing)
    step = lambda search: search_step(strobe, search, follow)  # noqa: E731
    return jax.lax.while_loop(lambda search: search.is_on, step, search)


def solution_of_search(strobe: StroboscopicMap, search: Search) -> OrbitSolution:
    """Result of a finished search, as a function of the machine."""
    start, multipliers, events, progression = (_by_sequence if strobe.flow.has_flow_map else _by_map)(
        strobe, search
    )
    is_impact = (events.kind == IMPACT)[:, None]
    stops = jnp.arange(num_stops_of(strobe.numbers))[None]
    x0, v0 = jnp.split(jnp.where(search.has_cycle, start, search.base), 2)
    return OrbitSolution(
        x0=x0,
        v0=v0,
        events=events,
        progression=progression,
        num_impacts=jnp.sum(is_impact & (events.stop[:, None] == stops), axis=0),
        multipliers=jnp.where(search.has_cycle, multipliers, jnp.nan),
        is_stable=search.has_cycle & _is_stable(strobe, multipliers),
        is_admissible=search.is_orbit,
        residual=jnp.where(search.has_cycle, search.cycle.residual, search.closing),
        num_runs=search.num_runs,
        result=_result(strobe, search),
    )


def _is_stable(strobe: StroboscopicMap, multipliers: Complex[Array, " state"]) -> Bool[Array, ""]:
    drift = free_drifts(strobe.numbers)
    if drift is None:
        return jnp.abs(multipliers[0]) < 1
    return jnp.sum(~(jnp.abs(multipliers) < 1)) == num_of(drift)


tell_of_search = compile_derivatives_lightly(solution_of_search)


def _by_sequence(strobe: StroboscopicMap, search: Search) -> tuple[Array, Array, EventLog, Array]:
    """Start, multipliers, events and progression of an orbit by the equations of its sequence."""
    sequence = search.cycle.sequence
    machine = prepared(strobe.numbers, strobe.flow, strobe.num_periods)
    shifts = free_shifts(strobe.numbers), free_drifts(strobe.numbers)
    problem = Problem(*machine, sequence, strobe.num_periods, strobe.phase, *shifts)
    unknowns = implicit_orbit(problem, search.cycle.unknowns)
    return (
        unknowns.z - frame_offset(problem),
        _multipliers(problem, unknowns, search.cycle.multipliers),
        log_of_cycle(problem, unknowns, len(unknowns.flights)),
        progression_of(problem, unknowns),
    )


@eqx.filter_custom_jvp
def _multipliers(problem: Problem, unknowns: Unknowns, known: Complex[Array, " state"]) -> Array:
    """Multipliers of an orbit, as the search has them, as a function of its machine and its unknowns."""
    del problem, unknowns
    return known


@_multipliers.def_jvp
def _multipliers_jvp(primals, tangents):
    problem, unknowns, _ = primals

    def of(problem: Problem, unknowns: Unknowns) -> Array:
        return multipliers_of(problem, pencil_of(problem, unknowns))

    # The value is that of the same function, so that second derivatives see all of it.
    values, moved = eqx.filter_jvp(of, (problem, unknowns), tuple(tangents[:2]))
    return values, moved


def _by_map(strobe: StroboscopicMap, search: Search) -> tuple[Array, Array, EventLog, Array]:
    """As `_by_sequence`, by the stroboscopic map, for a flow that advances step by step."""
    start = fixed_point(strobe, search.cycle.start)
    if search.last is None:
        events, jacobian = strobe.follow(start).events, jax.jacfwd(strobe.end)(start)
    else:
        events, jacobian = _last_run(strobe, start, search.last)
    pencil = Pencil(jacobian, jnp.eye(len(start)))
    erased = num_erased(search.cycle.sequence, strobe.numbers.num_sliders)
    multipliers = floquet_multipliers(pencil, erased, free_shifts(strobe.numbers))
    return start, multipliers, events, jnp.zeros_like(strobe.numbers.mean)


@eqx.filter_custom_jvp
def _last_run(strobe: StroboscopicMap, start: Array, known: tuple[EventLog, Array]) -> tuple[EventLog, Array]:
    """Events of a run and the derivative of its end by its start, as the search has them, as a function of both."""
    del strobe, start
    return known


@_last_run.def_jvp
def _last_run_jvp(primals, tangents):
    def of(strobe: StroboscopicMap, start: Array) -> tuple[EventLog, Array]:
        return strobe.follow(start).events, jax.jacfwd(strobe.end)(start)

    # The value is that of the same function, so that second derivatives see all of it.
    return eqx.filter_jvp(of, tuple(primals[:2]), tuple(tangents[:2]))


@eqx.filter_custom_jvp
def fixed_point(strobe: StroboscopicMap, z: Float[Array, " state"]) -> Float[Array, " state"]:
    """Fixed point of the map as a function of the machine: derivatives by the implicit function theorem."""
    del strobe
    return z


@fixed_point.def_jvp
def _fixed_point_jvp(primals, tangents):
    strobe, z = primals
    z = fixed_point(strobe, z)
    _, moved = eqx.filter_jvp(lambda strobe: strobe.end(z), (strobe,), (tangents[0],))
    closed = jnp.eye(len(z)) - closing_pin(free_shifts(strobe.numbers))
    return z, jnp.linalg.solve(closed - jax.jacfwd(strobe.end)(z), moved)


def _result(strobe: StroboscopicMap, search: Search) -> ORBIT_RESULTS:
    result = ORBIT_RESULTS.where(
        search.is_full, ORBIT_RESULTS.max_events_reached, ORBIT_RESULTS.not_converged
    )
    does_drift = drifts(strobe.numbers, free_shifts(strobe.numbers))
    result = ORBIT_RESULTS.where(does_drift, ORBIT_RESULTS.drifts, result)
    result = ORBIT_RESULTS.where(search.has_cycle, ORBIT_RESULTS.left_the_stops, result)
    return ORBIT_RESULTS.where(search.is_orbit, ORBIT_RESULTS.successful, result)
