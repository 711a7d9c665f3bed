"""Arguments of a run that all points share, checked: how long it is followed, and what is recorded."""

from typing import Any

import numpy as np

from .._execution.runner import Counts
from .._jax.arrays import Count, Numbers, as_numpy_float, whole_number
from .._system.system import AnySystem, machine_of
from .._system.tabulated import Tabulated, Waveform

# Periods of a run where nothing else is said: before recording, and recorded.
TRANSIENT, RECORD = 100, 20
# Knots of a load that take about as long as an oscillation.
_KNOTS = 8


def counts_of(
    system: AnySystem,
    transient: Count,
    record: Count,
    duration: Any,
    ts: Numbers | None,
    *,
    max_impacts: Count,
    max_steps: Count | None,
    lyapunov: bool,
) -> Counts:
    """`Counts` from arguments of the user; `can_stick` and what is observed are determined later.

    Raises:
        ValueError: for numbers that are none, too few periods, or a duration beside periods.
    """
    transient, record = whole_number("transient", transient), whole_number("record", record)
    max_impacts = whole_number("max_impacts", max_impacts)
    max_steps = None if max_steps is None else whole_number("max_steps", max_steps)
    if duration is None:
        if ts is not None:
            raise ValueError(
                "Argument `ts` saves the states of motions from their start: give their `duration` too. Where periods are counted, "
                "`section_x` and `section_v` are the states at the ends of those recorded."
            )
        if lyapunov and record < 1:
            raise ValueError("Exponents are averaged over the recorded periods: let `record` be 1 or more.")
        return Counts(transient, record, max_impacts, max_steps, can_stick=True, lyapunov=bool(lyapunov))
    if (transient, record) != (TRANSIENT, RECORD):
        raise ValueError(
            "Argument `duration` follows motions from their start without counting periods: leave out `transient` and `record`."
        )
    if lyapunov:
        raise ValueError(
            "Exponents are averaged over forcing periods: leave out `lyapunov` or `duration`. Of one motion, `vx.lyapunov_exponents`."
        )
    times = _times(duration, ts)
    work = _work(machine_of(system), times[-1])
    return Counts(0, len(times), max_impacts, max_steps, can_stick=True, times=times, own_work=work)


def _times(duration: Any, ts: Numbers | None) -> tuple[float, ...]:
    """Times at which states are saved, and the end."""
    end = as_numpy_float(duration, "duration")
    if end.shape != () or not (np.isfinite(end) and end > 0):
        raise ValueError(f"Argument `duration` must be a positive, finite time, but is {duration!r}.")
    given = as_numpy_float([] if ts is None else ts, "ts")
    if given.ndim != 1 or not np.isfinite(given).all():
        raise ValueError(f"Argument `ts` must be finite times, (times,), but has shape {given.shape}.")
    if given.size and not ((np.diff(given) >= 0).all() and given[0] >= 0 and given[-1] <= end):
        raise ValueError(
            f"Argument `ts` must be in increasing order, within [0, {float(end):g}], the `duration`."
        )
    return (*given.tolist(), float(end))


def _work(system: Any, duration: float) -> int:
    """Rough number of oscillations in a time."""
    stiffness, mass = np.asarray(system.stiffness), np.asarray(system.mass)
    diagonal = np.diag(mass) if system.has_full_mass else mass
    natural = np.sqrt(max(np.abs(stiffness).max(initial=0), 0) / diagonal.min()) if mass.size else 0.0
    clock, loads = system.forcing.clock, system.forcing.loads
    rates = [float(np.max(clock if load.frequency is None else load.frequency)) for load in loads]
    rate = max(float(natural), *rates)
    knots = sum(_knots_passed(load, duration, clock) for load in loads)
    return int(min(duration * rate / (2 * np.pi) + knots / _KNOTS, 1e9)) + 1


def _knots_passed(load: Any, duration: float, clock: Any) -> float:
    """Number of knots of a load in a time; `clock` is the frequency of loads of a sum without their own."""
    if isinstance(load, Tabulated):
        return float(len(load.times))
    if isinstance(load, Waveform):
        return (
            len(load.phases)
            * duration
            * float(clock if load.frequency is None else load.frequency)
            / (2 * np.pi)
        )
    return 0.0
