"""Orbits of a branch, from the columns of its dataset."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._flow.choose import choose_flow
from .._flow.taylor import TaylorFlow
from .._hybrid.limits import IMPACT
from .._jax.xla import compile_quickly
from .._machine.numbers import numbers_of
from .._orbits.autonomous import log_and_progression
from .._orbits.cycle import Problem, Unknowns, log_of_cycle, prepared, progression_of
from .._orbits.orbit import ORBIT_RESULTS, PeriodicOrbit
from .._orbits.rigid_modes import free_drifts, free_shifts
from .._orbits.sequence import NOTHING, SECOND, Sequence
from .._system.parameters import set_parameter
from .._system.system import AnySystem, machine_of

# `_STEP_OF_ROOM`: logs have room for a multiple of this number, one program for most orbits of a branch.
# `_SPARE`: spare room of a log.
# `_OF_CHATTER`: the same where stops hold, as a chatter may complete later.
_STEP_OF_ROOM, _SPARE, _OF_CHATTER = 8, 4, 32


def orbit_at(system: AnySystem, point: xr.Dataset) -> PeriodicOrbit:
    """Orbit of one point of a branch."""
    system = set_parameter(system, point.attrs["path"], point[point.attrs["path"]].values)
    columns = {name: point[name].values for name in OF_SEQUENCE if name in point}
    sequence = sequence_at(columns, point.sizes["event"])
    n, phase = int(point.attrs["num_periods"]), 2 * np.pi * point.attrs["phase"]
    machine = machine_of(system)
    flow = choose_flow(machine, can_stick=True) if n else TaylorFlow()
    unknowns = Unknowns(jnp.asarray(point["start"].values), jnp.asarray(point["flight"].values))
    cycle = jax.tree.map(jnp.asarray, sequence), unknowns, np.asarray(float(n or 1)), np.asarray(phase)
    events, progression = _log(
        numbers_of(machine), flow, *cycle, room=_room_of_log(sequence), is_autonomous=n == 0
    )
    period = n * system.forcing.period
    if n == 0:
        period, still = point["period"].values, system.forcing
        system = eqx.tree_at(lambda s: s.forcing.frequency, system, 0 * still.frequency)
    multipliers = jnp.asarray(point["multipliers"].values)
    return PeriodicOrbit(
        system=system,
        num_periods=n,
        period=jnp.asarray(period),
        phase=jnp.asarray(phase),
        x0=jnp.asarray(point["x0"].values),
        v0=jnp.asarray(point["v0"].values),
        events=events,
        progression=progression,
        num_impacts=jnp.asarray(point["num_impacts"].values),
        multipliers=multipliers,
        is_stable=jnp.asarray(point["is_stable"].values),
        is_admissible=jnp.asarray(point["is_admissible"].values),
        residual=jnp.asarray(point["residual"].values),
        num_runs=jnp.array(0),
        result=ORBIT_RESULTS.successful,
        args=None,
        flow=None,
    )


def _room_of_log(sequence: Sequence) -> int:
    """Room for the entries of a log: impacts, and the sticks and releases of their instants.

    Some is spare: a run may have other bounces of a chatter, or an impact where the orbit grazes.
    """
    num_changes = np.count_nonzero(np.diff(sequence.mode.astype(int), axis=0))
    spare = _OF_CHATTER if num_changes else _SPARE
    count = int(np.count_nonzero(sequence.kind == IMPACT) + num_changes) + spare
    return _STEP_OF_ROOM * -(-count // _STEP_OF_ROOM)


@compile_quickly
def _log(numbers, flow, sequence, unknowns, num_periods, phase, *, room, is_autonomous):
    machine = prepared(numbers, flow, num_periods)
    shifts = free_shifts(numbers), free_drifts(numbers)
    problem = Problem(*machine, sequence, num_periods, phase / (2 * jnp.pi), *shifts, is_autonomous)
    if is_autonomous:
        return log_and_progression(problem, unknowns, room)
    return log_of_cycle(problem, unknowns, room), progression_of(problem, unknowns)


# Columns of a sequence of events; machines that only impact have no guards and modes.
OF_SEQUENCE = ("event_kind", "event_stop", "event_guard", "held", "mode")


def sequence_at(point: Mapping[str, np.ndarray], num_events: int) -> Sequence:
    """Sequence of one point of a branch, from its columns."""
    kind, stop = (point[name][:num_events] for name in ("event_kind", "event_stop"))
    if "mode" not in point:
        return Sequence(kind, np.maximum(stop, 0), point["held"][: num_events + 1])
    mode = point["mode"][: num_events + 1].astype(np.int8)
    last = np.count_nonzero(kind != NOTHING)
    mode[last:] = mode[last]
    return Sequence(kind + SECOND * point["event_guard"][:num_events], np.maximum(stop, 0), mode)
