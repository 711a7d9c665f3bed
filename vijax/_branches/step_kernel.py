"""The compiled program of branches: plain steps, several in a call, and requests for one of their two parts.

A step corrects a cycle and, if it is plain, simulates the machine from its start. Corrections and simulations alone are
requested as well, to locate events for instance. They run in the same program, so that a process compiles one.

Of machines whose forces switch the loop of a run would be half of that program. The one of few branches has none: it takes
plain steps as if the machine followed every cycle. The runs are made behind it, by the program of `simulate`, see
`motions.py`, and steps behind the first cycle that is not followed are dropped, see `followed_steps.py`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._jax.arrays import Flag, Scalar
from .._jax.packing import Packed, pack
from .._orbits.sequence import NOTHING, Sequence
from .admissibility import Margins
from .corrector import Corrected
from .kernels import (
    PAST,
    CorrectedCycle,
    SimulatedMotion,
    corrected_cycle,
    corrected_cycles,
    run_of,
    simulate_motion,
)
from .margin_scan import LeastMargins
from .parameter_family import ExtendedCycle, ParameterFamily
from .steps import (
    StepLimits,
    StepState,
    is_accepted,
    is_followed_or_unstable,
    is_plain,
    is_resolved,
    next_length,
)
from .tolerances import SHORTEST_STEP


class StepRequest(NamedTuple):
    """A request for plain steps, or for one part of a step, but for the point where it begins.

    Attributes:
        sequence: events of the cycles, padded.
        target: of a correction; NaN for steps.
        start: of a simulation, in space, (2 n,); NaN for that of the cycle.
        simulates: True for a simulation.
        limits: of plain steps.
    """

    sequence: Sequence
    target: Any
    start: Any
    simulates: Any
    limits: StepLimits


class Stepped(NamedTuple):
    """Result of a call, lanes first.

    Attributes:
        point: corrected cycle from which to step on, packed.
        next_ds: length of the step from it.
        tries: corrected cycles of the tries, (tries, ...), packed.
        ds: their lengths, (tries,).
        is_taken: flags of the steps that were taken, (tries,).
        last: number of the last try.
        is_sound: True if that is accepted and short enough.
        has_motion: True if the machine was simulated from its end, or is yet to be.
        next_length: length of the step after it.
        motion: of the machine from its end, packed; None if it is yet to be simulated.
        runs: what to simulate, see `motions.py`, (tries, ...), packed; None if that is done.
    """

    point: Packed
    next_ds: Array
    tries: Packed
    ds: Array
    is_taken: Array
    last: Array
    is_sound: Array
    has_motion: Array
    next_length: Array
    motion: Packed | None
    runs: Packed | None


class _JudgedStep(NamedTuple):
    """A corrected step with its verdicts, and the motion from its end or the run to be made, packed, see `Stepped`."""

    cycle: CorrectedCycle
    is_sound: Flag
    is_taken: Flag
    has_motion: Flag
    next_length: Scalar
    motion: Packed | None
    run: Packed | None


class _State(NamedTuple):
    """State of the loop: number of the try, lanes that go on, steps that each may still take, result so far."""

    number: Array
    is_live: Array
    left: Array
    found: Stepped


def take_steps(
    families: ParameterFamily,
    requests: StepRequest,
    points: Packed,
    ds: Array,
    most: Array,
    *,
    tries: int,
    room: int | None,
    cycle: Packed | None = None,
) -> Stepped:
    """Answer a batch of requests, along the first axis.

    Args:
        families: of the branches.
        requests: of the branches.
        points: corrected cycles from which to step; of a correction its guess and, as tangent, its weights, and of a
            simulation its cycle, see `blank_cycles`; packed.
        ds: length of the first step; 0 for a correction, NaN for a simulation.
        most: most steps that each may take; 0 to try one.
        tries: most steps that are tried for each branch.
        room: least padded number of events of a simulation; None to make none.
        cycle: result of `first_corrections`, if that was computed before; for one try.
    """
    known = cycle

    def trial_of(state: _State) -> _JudgedStep:
        point, ds = state.found.point.unpacked(), state.found.next_ds
        target = jnp.where(state.number == 0, requests.target, jnp.nan)
        if known is None:
            guess = each_row(_prediction)(point, ds, target, state.is_live)
            cycle = each_row(corrected_cycle)(families, requests.sequence, *guess)
        else:
            cycle = known.unpacked()
        cycle = each_row(_with_past)(cycle, point, ds)
        sound, plain, length = each_row(_judged)(requests, point, cycle, ds)
        has_motion = (plain | requests.simulates) & state.is_live
        is_taken = plain & (state.left > 0) & state.is_live
        if room is None:
            run = pack(each_row(run_of)(families, cycle), has_rows=True)
            return _JudgedStep(cycle, sound, is_taken, has_motion, length, None, run)
        simulated = partial(_simulated, room=room)
        motion = each_row(simulated)(families, requests, point, cycle, has_motion)
        is_followed = each_row(is_followed_or_unstable)(requests.sequence, cycle, motion)
        motion = pack(motion, has_rows=True)
        return _JudgedStep(cycle, sound, is_taken & is_followed, has_motion, length, motion, None)

    def one(state: _State) -> _State:
        trial, before, number, is_live = trial_of(state), state.found, state.number, state.is_live
        row = pack(trial.cycle, before.point.layout, has_rows=True)
        shorter = jnp.where(trial.is_sound, before.next_ds, before.next_ds / 2)
        following = jnp.where(trial.is_taken, trial.next_length, shorter)
        left = state.left - trial.is_taken
        goes_on = is_live & (trial.is_taken | ~trial.is_sound) & (left > 0) & (following >= SHORTEST_STEP)
        tried = lambda all_, one: jax.tree.map(lambda a, b: a.at[:, number].set(b), all_, one)  # noqa: E731
        found = Stepped(
            point=_chosen(trial.is_taken, row, before.point),
            next_ds=jnp.where(is_live, following, before.next_ds),
            tries=tried(before.tries, row),
            ds=before.ds.at[:, number].set(before.next_ds),
            is_taken=before.is_taken.at[:, number].set(trial.is_taken),
            last=jnp.where(is_live, number, before.last),
            is_sound=jnp.where(is_live, trial.is_sound, before.is_sound),
            has_motion=jnp.where(is_live, trial.has_motion, before.has_motion),
            next_length=jnp.where(is_live, trial.next_length, before.next_length),
            motion=_chosen(is_live, trial.motion, before.motion),
            runs=tried(before.runs, trial.run),
        )
        return _State(number + 1, goes_on, left, found)

    def is_going_on(state: _State) -> Array:
        return (state.number < tries) & jnp.any(state.is_live)

    nothing = _before_the_first(families, requests, points, ds, tries, room)
    first = _State(jnp.array(0), jnp.ones(len(ds), bool), jnp.asarray(most), nothing)
    return jax.lax.while_loop(is_going_on, one, first).found


def first_corrections(
    families: ParameterFamily, requests: StepRequest, points: Packed, ds: Array
) -> CorrectedCycle:
    """Corrected cycles of the first try of `take_steps`, in the form for many branches."""
    all_ = jnp.ones(len(ds), bool)
    guess = each_row(_prediction)(points.unpacked(), ds, requests.target, all_)
    return corrected_cycles(families, requests.sequence, *guess)


def _before_the_first(
    families: ParameterFamily, requests: StepRequest, points: Packed, ds: Array, tries: int, room: int | None
) -> Stepped:
    """A result that the first try overwrites."""
    num, ds, motion, runs = len(ds), jnp.asarray(ds), None, None
    many = lambda a: jnp.zeros((num, tries, *a.shape[1:]), a.dtype)  # noqa: E731
    none, flags = jnp.zeros(num, int), jnp.zeros(num, bool)
    if room is None:
        run = jax.eval_shape(lambda: pack(each_row(run_of)(families, points.unpacked()), has_rows=True))
        runs = jax.tree.map(many, run)
    else:
        sequence = _widened(requests.sequence, room)
        flights = jnp.zeros(sequence.kind.shape, ds.dtype)
        motion = pack(SimulatedMotion(flags, sequence, flights, jnp.asarray(requests.start)), has_rows=True)
    return Stepped(
        point=jax.tree.map(jnp.asarray, points),
        next_ds=ds,
        tries=jax.tree.map(many, points),
        ds=many(ds),
        is_taken=many(flags),
        last=none,
        is_sound=flags,
        has_motion=flags,
        next_length=ds,
        motion=motion,
        runs=runs,
    )


def _chosen(flags: Array, one: Packed | None, other: Packed | None) -> Any:
    """Rows of one batch where flags are set, else of another; None if there are none."""
    return jax.tree.map(lambda a, b: jnp.where(flags[:, None], a, b), one, other)


def _prediction(
    point: CorrectedCycle, ds: Scalar, target: Scalar, is_live: Flag
) -> tuple[ExtendedCycle, ExtendedCycle, Scalar]:
    """Guess, weights and target of the corrector; NaN for a lane that is done, which ends it at once."""
    place, weights = point.found.place, point.found.tangent
    guess = place.moved(weights, jnp.where(is_live, ds, jnp.nan))
    return guess, weights, jnp.where(jnp.isnan(target), place.along(weights) + ds, target)


def _with_past(cycle: CorrectedCycle, point: CorrectedCycle, ds: Scalar) -> CorrectedCycle:
    """The corrected cycle of a step, with what the next one needs of the point where it began."""
    return cycle._replace(past=jnp.append(point.neighbours, ds))


def _judged(
    request: StepRequest, point: CorrectedCycle, cycle: CorrectedCycle, ds: Scalar
) -> tuple[Flag, Flag, Scalar]:
    """True for a step that is accepted and short enough, True for one that is plain too, length of the next one."""
    known, new = (StepState.of(request.sequence, at) for at in (point, cycle))
    sound = is_accepted(known, new, cycle, ds) & is_resolved(known, new, ds)
    plain = sound & is_plain(request.sequence, known, new, request.limits, ds)
    return sound, plain, next_length(known, new, cycle, ds, request.limits.longest)


def _simulated(
    family: ParameterFamily,
    request: StepRequest,
    point: CorrectedCycle,
    cycle: CorrectedCycle,
    is_wanted: Flag,
    *,
    room: int,
) -> SimulatedMotion:
    """Motion of the machine from the end of a step, or as requested; of none that is not wanted."""
    place = jax.tree.map(
        lambda a, b: jnp.where(request.simulates, a, b), point.found.place, cycle.found.place
    )
    sequence = jax.tree.map(lambda a: a[0], _widened(jax.tree.map(lambda a: a[None], request.sequence), room))
    flights = jnp.pad(place.flights, (0, len(sequence.kind) - len(place.flights)))
    z = jnp.where(is_wanted, place.z, jnp.nan)
    return simulate_motion(family, sequence, ExtendedCycle(z, flights, place.p), request.start)


def _widened(sequences: Sequence, room: int) -> Sequence:
    """A batch of sequences with more padding."""
    more = (0, 0), (0, max(room - sequences.kind.shape[1], 0))
    return Sequence(
        kind=jnp.pad(sequences.kind, more, constant_values=NOTHING),
        stop=jnp.pad(sequences.stop, more),
        mode=jnp.pad(sequences.mode, (*more, (0, 0)), mode="edge"),
    )


def blank_cycles(
    sequences: Sequence, places: ExtendedCycle, weights: ExtendedCycle, *, has_grip: bool
) -> CorrectedCycle:
    """Cycles of which nothing is known but the weights of their correction; `has_grip` with friction of contacts."""
    dtype, (lanes, size), (*_, num) = np.asarray(places.z).dtype, np.shape(places.z), sequences.mode.shape

    def zeros(*shape: int, like: Any = dtype) -> Any:
        return np.zeros((lanes, *shape), like)

    num_guards = num * sequences.num_groups
    none, whole, events = zeros(num_guards), zeros(num_guards, like=int), np.zeros_like(places.flights)
    multipliers = zeros(size, like=np.result_type(dtype, np.complex64))
    found = Corrected(
        places, weights, multipliers, events, zeros(), zeros(), zeros(like=int), zeros(like=bool)
    )
    is_plastic = zeros(num, like=bool)
    grip = zeros(events.shape[1], num) if has_grip else None
    watched = LeastMargins(none, none, whole, none, none, whole, none, whole, is_plastic, zeros(), grip)
    margins, past = Margins(events, none, none, none), zeros(PAST) + np.nan
    return CorrectedCycle(found, watched, margins, zeros(size), zeros(PAST - 1), past)


def each_row(function: Callable) -> Callable:
    """`jax.vmap` of a function along the first axis; of a batch of one the function itself.

    Under `vmap` every choice computes both sides, and every loop selects what it carries: a program of one branch without
    it has a third fewer operations.
    """

    def of_rows(*rows: Any) -> Any:
        if len(jax.tree.leaves(rows)[0]) > 1:
            return jax.vmap(function)(*rows)
        found = function(*jax.tree.map(lambda a: a[0], rows))
        return jax.tree.map(lambda a: a[None], found)

    return of_rows
