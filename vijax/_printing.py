"""Output of `print` and of notebooks for machines, trajectories and logs: numbers, in about ten lines.

One table is written in two forms: text, and HTML without colours, which takes on those of the notebook. A batch shows
only ranges, traced values only shapes. Nothing here may raise: prints are often made because something went wrong.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from ._descriptions import Description
from ._jax.concrete import concrete
from ._written_numbers import (
    MOST_NUMBERS,
    as_number,
    counted,
    is_zero,
    written_batch,
    written_beside,
    written_numbers,
    written_shape,
    written_short,
)

# _STOPS: most stops of a machine that are shown.
# _EVENTS: most events of a log.
_STOPS, _EVENTS = 3, 7
_COLUMNS = ("t", "kind", "stop", "velocity_minus", "velocity_plus", "impulse")


def describe_harmonic(harmonic: Any) -> Description:
    """Describe a load, or the motion of a stop, which has no frequency."""
    batch = written_batch((harmonic.frequency, 0), (harmonic.mean, 1))
    own = harmonic.amplitude.ndim - len(batch)
    rows = [("amplitude", written_numbers(harmonic.amplitude, own))]
    if harmonic.frequency is not None:
        rows.append(("frequency", written_numbers(harmonic.frequency, 0)))
    parts = (("phase", harmonic.phase, own), ("mean", harmonic.mean, 1))
    rows += [(name, written_numbers(value, own)) for name, value, own in parts if not is_zero(value)]
    kind = harmonic.num_harmonics(len(batch))
    return Description(
        f"Harmonic with {counted(kind, 'harmonic')}{written_beside(harmonic.amplitude, batch)}", rows
    )


def describe_tabulated(load: Any) -> Description:
    """Describe a load by a table in time."""
    knots = concrete(load.times)
    span = written_shape(load.times) if knots is None else f"{knots.min():.6g} to {knots.max():.6g}"
    return Description(f"Tabulated load, {_table(load.times, load)}", [("times", span), _largest(load)])


def describe_waveform(load: Any) -> Description:
    """Describe a wave form; one in a sum may have no frequency of its own."""
    rows = [_largest(load)]
    if load.frequency is not None:
        rows.append(("frequency", written_numbers(load.frequency, 0)))
    return Description(f"Waveform, {_table(load.phases, load)}", rows)


def describe_loads(loads: Any) -> Description:
    """Describe a sum of loads, one on each line."""
    rows = [(f"load {k}", _load(load)) for k, load in enumerate(loads.loads)]
    if loads.common is not None:
        rows.append(("frequency", written_numbers(loads.common, 0)))
    return Description(f"Sum of {counted(len(loads.loads), 'load')}", rows)


def _load(load: Any) -> str:
    """A load on one line."""
    tell = describe_harmonic
    if hasattr(load, "times"):
        tell = describe_tabulated
    elif hasattr(load, "phases"):
        tell = describe_waveform
    title, rows = tell(load)
    return f"{title}: {_line(rows)}"


def _table(knots: Any, load: Any) -> str:
    return f"{load.kind}, {counted(len(knots), 'knot')}{written_beside(load.values, knots.shape[1:])}"


def _largest(load: Any) -> tuple[str, str]:
    values = concrete(load.values)
    return (
        "largest",
        written_shape(load.values) if values is None else written_numbers(abs(values).max(axis=0), 1),
    )


def _load_rows(forcing: Any) -> list[tuple[str, ...]]:
    """Rows of a machine about its load."""
    if hasattr(forcing, "amplitude"):
        load = describe_harmonic(forcing).rows
        return [("load", _line(load[:2])), *([("", _line(load[2:]))] if load[2:] else [])]
    lines = [_load(load) for load in forcing.loads]
    if len(lines) > 1 and forcing.common is not None:
        lines.append(f"frequency {written_numbers(forcing.common, 0)}")
    return [("" if k else "load", line) for k, line in enumerate(lines)]


def describe_limit(stop: Any) -> Description:
    """Describe a stop or contact on one line."""
    who = f"stop of mass {stop.mass}" if stop.slot else "contact"
    return _in_one_line(
        f"Compliant {who}" if stop.is_compliant else who.capitalize(),
        _wall(stop),
        stop.position,
        _law_of(stop),
    )


def describe_friction(element: Any) -> Description:
    """Describe a friction element on one line."""
    return _in_one_line("Friction", _rubbing(element), element.slip, element.velocity)


def describe_hysteresis(element: Any) -> Description:
    """Describe a Jenkins element on one line."""
    return _in_one_line("Jenkins", _slider(element), element.stiffness, element.limit)


def _in_one_line(who: str, words: str, *numbers: Any) -> Description:
    """Description of an element that has no rows; the numbers tell its batch, the first one its precision."""
    batch = written_batch(*((a, 0) for a in numbers))
    return Description(f"{who}: {words}{written_beside(numbers[0], batch)}", [])


def describe_system(system: Any, name_of_force: Callable[[Any], str]) -> Description:
    """Describe a machine: its matrices, load, stops and force."""
    forcing, stops = system.forcing, system.stops
    walls = [(value, 0) for stop in stops for value in (stop.position, _law_of(stop))]
    walls += [(element.slip, 0) for element in system.friction]
    walls += [(element.limit, 0) for element in system.hysteresis]
    batch = written_batch((system.damping, 2), (forcing.frequency, 0), *walls)
    masses = counted(system.stiffness.shape[-1] - system.num_states, "mass", "masses")
    if system.num_states:
        masses = f"{masses}, {counted(system.num_states, 'first-order state')}"
    rows = [
        ("mass", written_numbers(system.mass, 2 if system.has_full_mass else 1)),
        ("damping", written_numbers(system.damping, 2)),
        ("stiffness", written_numbers(system.stiffness, 2)),
        *_load_rows(forcing),
    ]
    for j, stop in enumerate(stops[:_STOPS]):
        name, whose = ("stop", f"mass {stop.mass}, ") if stop.slot else ("contact", "")
        rows.append((f"{name} {j}", f"{whose}{_wall(stop)}"))
    if len(stops) > _STOPS:
        rows.append(("...", counted(len(stops) - _STOPS, "more stop")))
    rows += _rows_of("friction", system.friction, _rubbing)
    rows += _rows_of("hysteresis", system.hysteresis, _slider)
    if system.force is not None:
        rows.append(("force", written_short(name_of_force(jax.tree.map(as_number, system.force)))))
    count = counted(len(stops), "stop")
    count += "".join(f", with {name}" for name in ("friction", "hysteresis") if getattr(system, name))
    return Description(f"ImpactSystem of {masses} and {count}{written_beside(system.mass, batch)}", rows)


def words_of_kind(system: Any) -> str:
    """The kind of a machine, which programs are compiled for, in words: "2 masses, 1 friction element and 1 stop"."""
    rigid, compliant = (
        [stop for stop in system.stops if stop.is_compliant == is_compliant] for is_compliant in (False, True)
    )
    num_alone = sum(bool(stop.slot) for stop in rigid)
    counts = (
        (system.num_masses - system.num_states, "mass", "masses"),
        (system.num_states, "first-order state", None),
        (len(system.friction), "friction element", None),
        (len(compliant), "compliant stop", None),
        (len(rigid) - num_alone, "contact", None),
        (num_alone, "stop", None),
    )
    words = [counted(*own) for own in counts if own[0]]
    words += ["a force"] * (system.force is not None)
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + words[-1:])


def describe_events(log: Any, kinds: Sequence[str]) -> Description:
    """Describe the first and the last events of a log."""
    kind = concrete(log.kind)
    room, batch = log.t.shape[-1], log.t.shape[:-1]
    title = f"EventLog with room for {counted(room, 'event')}{written_beside(log.t, batch)}"
    if kind is None:
        return Description(
            title, [(name, written_shape(getattr(log, name))) for name in ("t", "stop", "kind")]
        )
    title += f": {_kinds(kind, kinds)}"
    count = int(np.count_nonzero(kind >= 0))
    if batch or not count:
        return Description(title, [])
    rows = [("...",) if i is None else _event(log, i, kinds) for i in _first_and_last(count)]
    return Description(title, [("", *_COLUMNS), *rows])


def _first_and_last(count: int) -> list[int | None]:
    """Indices of the events to show, None for those left out."""
    if count <= _EVENTS:
        return [*range(count)]
    ends = _EVENTS // 2
    return [*range(ends), None, *range(count - ends, count)]


def _event(log: Any, i: int, kinds: Sequence[str]) -> tuple[str, ...]:
    cells = {name: np.asarray(getattr(log, name))[i] for name in _COLUMNS}
    numbers = {name: f"{value:.6g}" for name, value in cells.items()} | {"kind": kinds[int(cells["kind"])]}
    return (str(i), *numbers.values())


def describe_solution(solution: Any, results: Sequence[str], kinds: Sequence[str]) -> Description:
    """Describe a trajectory, or a batch of them: its result, events and end."""
    batch, log = solution.t1.shape, solution.events
    kind, held = concrete(log.kind), concrete(solution.stuck1)
    code = concrete(solution.result._value)
    span = f"t = {written_numbers(solution.t0, 0)} to {written_numbers(solution.t1, 0)}"
    rows = [
        ("result", written_shape(solution.result._value) if code is None else _results(code, results)),
        ("events", written_shape(log.kind) if kind is None else _kinds(kind, kinds)),
        ("x1", written_numbers(solution.x1, 1)),
        ("v1", written_numbers(solution.v1, 1)),
        ("stuck1", written_shape(solution.stuck1) if held is None else _held(held)),
        ("grazing", _grazing(solution.grazing)),
        ("ts", f"{counted(solution.ts.shape[-1], 'saved state')}, xs {list(solution.xs.shape)}"),
        (
            "steps",
            f"{written_numbers(solution.num_steps, 0)}, rejected {written_numbers(solution.num_rejected, 0)}",
        ),
    ]
    return Description(f"Solution from {span}{written_beside(solution.t1, batch)}", rows)


def describe_orbit(orbit: Any, results: Sequence[str], kinds: Sequence[str]) -> Description:
    """Describe a periodic orbit, or a batch of them, in five lines."""
    kind, code = concrete(orbit.events.kind), concrete(orbit.result._value)
    multipliers = concrete(orbit.multipliers)
    rows = [
        ("result", written_shape(orbit.result._value) if code is None else _results(code, results)),
        ("x0, v0", f"{written_numbers(orbit.x0, 1)}, {written_numbers(orbit.v0, 1)}"),
        ("events", written_shape(orbit.events.kind) if kind is None else _kinds(kind, kinds)),
        (
            "multipliers",
            written_shape(orbit.multipliers) if multipliers is None else _judged(orbit, multipliers),
        ),
    ]
    n = counted(orbit.num_periods, "forcing period")
    return Description(
        f"PeriodicOrbit of {n}, {written_numbers(orbit.period, 0)}{written_beside(orbit.x0, orbit.period.shape)}",
        rows,
    )


def _judged(orbit: Any, multipliers: np.ndarray) -> str:
    if multipliers.ndim > 1:
        return f"{np.count_nonzero(orbit.is_stable)} of {orbit.is_stable.size} stable"
    described = " ".join(
        f"{a.real:.6g}" if a.imag == 0 else f"{a:.6g}" for a in multipliers[:MOST_NUMBERS].tolist()
    )
    return (
        described
        if np.isnan(multipliers).any()
        else f"{described}: {'stable' if orbit.is_stable else 'unstable'}"
    )


def _line(rows: list[tuple[str, ...]]) -> str:
    return ", ".join(map(" ".join, rows))


def _wall(stop: Any) -> str:
    motion, side = stop.motion, "<=" if stop.sign > 0 else ">="
    row = "x" if stop.slot else _sum(stop)
    moving = "" if motion is None else f" + motion of amplitude {written_numbers(motion.amplitude, 1)}"
    law = _compliance(stop) if stop.is_compliant else f"restitution {_restitution(stop.restitution)}"
    return f"{row} {side} {written_numbers(stop.position, 0)}{moving}, {law}"


def _law_of(stop: Any) -> Any:
    """The first number of the law of a stop."""
    return stop.stiffness if stop.is_compliant else stop.light_restitution


def _compliance(stop: Any) -> str:
    others = (
        f"{name} {written_numbers(getattr(stop, name), 0)}"
        for name in ("damping", "preload")
        if not is_zero(getattr(stop, name))
    )
    return ", ".join([f"stiffness {written_numbers(stop.stiffness, 0)}", *others])


def _rows_of(name: str, elements: Sequence[Any], tell: Callable[[Any], str]) -> list[tuple[str, ...]]:
    """Rows of a machine about its elements of one kind."""
    rows = [(f"{name} {k}", tell(element)) for k, element in enumerate(elements[:_STOPS])]
    more = len(elements) - _STOPS
    return [*rows, ("...", f"{more} more of {name}")] if more > 0 else rows


def _rubbing(element: Any) -> str:
    given = element.static_coefficient if element.is_tied else element.static
    static = "" if given is None else f", static {written_numbers(given, 0)}"
    name = f"contact {element.contact}, coefficient" if element.is_tied else "force"
    belt = (
        "" if is_zero(element.velocity) else f", surface of velocity {written_numbers(element.velocity, 0)}"
    )
    return f"of {_sum(element)}, {name} {written_numbers(element.slip, 0)}{static}{belt}"


def _slider(element: Any) -> str:
    start = "" if element.slider is None else f", slider at {written_numbers(element.slider, 0)}"
    stiffness, limit = written_numbers(element.stiffness, 0), written_numbers(element.limit, 0)
    return f"of {_sum(element)}, stiffness {stiffness}, limit {limit}{start}"


def _restitution(value: Any) -> str:
    """A number, or a law, which describes itself."""
    return written_numbers(value, 0) if hasattr(value, "ndim") else repr(value)


def _sum(contact: Any) -> str:
    """Row of a contact times the positions, as text: x0 - x1."""
    row = concrete(contact.row)
    if row is None or row.ndim > 1:
        return f"row {written_shape(contact.row)} on masses {list(contact.masses)}"
    terms = zip(row.tolist(), contact.masses, strict=True)
    described = " ".join(
        f"{'-' if a < 0 else '+'} {'' if abs(a) == 1 else f'{abs(a):.6g} '}x{i}" for a, i in terms
    )
    return described.removeprefix("+ ").replace("- ", "-", described.startswith("- "))


def _results(code: np.ndarray, results: Sequence[str]) -> str:
    found = [(name, int(np.count_nonzero(code == k))) for k, name in enumerate(results)]
    return ", ".join(f"{count} {name}" if code.ndim else name for name, count in found if count)


# Kinds of events of rigid contacts, the first of all.
_RIGID = 3


def _kinds(kind: np.ndarray, kinds: Sequence[str]) -> str:
    """Numbers of events: of impacts, sticks and releases always, of other kinds where there are any."""
    counts = [int(np.count_nonzero(kind == k)) for k in range(len(kinds))]
    named = zip(counts, kinds, strict=True)
    return ", ".join(counted(count, name) for k, (count, name) in enumerate(named) if count or k < _RIGID)


def _held(held: np.ndarray) -> str:
    if held.ndim > 1:
        lanes = held.reshape(-1, held.shape[-1]).any(axis=-1)
        return f"some stop holds its mass in {np.count_nonzero(lanes)} of {lanes.size}"
    stops = np.flatnonzero(held)
    return f"mass held by stop {written_numbers(stops, 1)}" if stops.size else "no mass is held"


def _grazing(grazing: Any) -> str:
    speed, clearance, near = map(concrete, (grazing.impact_speed, grazing.clearance, grazing.is_near))
    if speed is None or clearance is None or near is None:
        return written_shape(grazing.impact_speed)
    least = [f"{a.min():.6g}" if np.isfinite(a.min()) else "none" for a in (speed, clearance)]
    doubt = ", near: derivatives are unreliable or one-sided" if near.any() else ""
    return f"slowest impact {least[0]}, narrowest miss {least[1]}{doubt}"
