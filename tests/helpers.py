"""Event logs as tuples, golden scenes and their comparison, and checks of all ready-made machines.

A golden scene was solved by ball arithmetic to at least 36 proved digits. Rounding errors made at an event are
magnified by all that follows. The amplification was measured with each scene, and sets the tolerances.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

GOLDEN = Path(__file__).parent / "data" / "golden"
KINDS = {vx.IMPACT: "impact", vx.STICK: "stick", vx.RELEASE: "release"}

# Some hundred steps of rounding 1e-16 each, before amplification.
ROUNDING = 1e-12
# The last bounces before a stick depend on when a solver ends a chatter.
CHATTER_END = 1e-5
# Events closer than this may come in any order.
ONE_INSTANT = 1e-8
# A rounding of the position by 1e-15 moves a light impact by 1e-15 / v.
POSITION_ROUNDING = 1e-15
# Event that JAX reports for a compilation.
FINISHED = "/jax/core/compile/backend_compile_duration"


class Event(NamedTuple):
    """One line of a log; the velocity is that just before the event."""

    t: float
    kind: str
    stop: int
    velocity: float


class Scene(NamedTuple):
    """A machine, a start, and the exact results."""

    name: str
    system: vx.ImpactSystem
    t0: float
    t1: float
    x0: np.ndarray
    v0: np.ndarray
    events: list[Event]
    x1: np.ndarray
    v1: np.ndarray
    held_at_start: list[int]
    held_at_end: list[int]
    state_amplification: float
    time_amplification: float

    def simulate(self) -> vx.Solution:
        """Trajectory by vijax, without an error for its result."""
        return vx.simulate(self.system, self.t0, self.t1, self.x0, self.v0, throw=False)

    def time_tolerance(self, event: Event) -> float:
        """Tolerance of the time of an event."""
        tolerance = ROUNDING * max(1.0, event.t) * self.time_amplification
        loss = 1 - float(self.system.stops[event.stop].restitution)
        if event.kind == "impact" and loss > 0:
            tolerance += POSITION_ROUNDING / (abs(event.velocity) * loss)
        return tolerance

    @property
    def state_tolerance(self) -> float:
        """Tolerance of the end state."""
        return ROUNDING * self.state_amplification


def slow_except(kept: Iterable[Any], names: Iterable[Any]) -> list:
    """Cases of a test, all slow but a few that stand for the others."""
    return [name if name in kept else pytest.param(name, marks=pytest.mark.slow) for name in names]


def golden_names() -> list[str]:
    """Names of all golden scenes."""
    return sorted(path.stem for path in GOLDEN.glob("*.json"))


def load_scene(name: str) -> Scene:
    """A golden scene from its file."""
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    stops = [vx.Stop(s["mass"], s["position"], s["side"], s["restitution"]) for s in data["stops"]]
    load = vx.Harmonic(data["A"], data["Omega"], data["phase"])
    return scene_of(name, data, vx.ImpactSystem(data["M"], data["C"], data["K"], load, stops), "stop")


def scene_of(name: str, data: dict, system: vx.ImpactSystem, stop: str) -> Scene:
    """Scene from data whose events name the stop or contact by the key `stop`."""
    return Scene(
        name=name,
        system=system,
        t0=data["t0"],
        t1=data["t1"],
        x0=np.array(data["x0"]),
        v0=np.array(data["v0"]),
        events=[Event(e["t"], e["kind"], e[stop], e["v_before"]) for e in data["events"]],
        x1=np.array(data["x1"]),
        v1=np.array(data["v1"]),
        held_at_start=data["stuck_at_start"],
        held_at_end=data["stuck_at_end"],
        state_amplification=max(1.0, data["amplification_worst_restart"]),
        time_amplification=max(1.0, data["amplification_worst_restart_events"]),
    )


def machine_shape(name: str) -> tuple:
    """Properties for which a program is compiled: the number of masses, and the stops in their order."""
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    return data["n"], tuple((s["mass"], s["side"]) for s in data["stops"])


def log_of(solution: vx.Solution) -> list[Event]:
    """Event log of a solution, without padding."""
    log, n = solution.events, int(solution.num_events)
    columns = (np.asarray(a)[:n].tolist() for a in (log.t, log.kind, log.stop, log.velocity_minus))
    return [Event(t, KINDS[kind], stop, v) for t, kind, stop, v in zip(*columns, strict=True)]


def without_chatter_ends(events: Sequence[Event]) -> list[Event]:
    """Drop, for every stop, the light impacts that end in its stick."""
    is_kept = [True] * len(events)
    for i, stick in enumerate(events):
        if stick.kind == "stick":
            for j in range(i - 1, -1, -1):
                if events[j].stop == stick.stop:
                    if events[j].kind != "impact" or abs(events[j].velocity) >= CHATTER_END:
                        break
                    is_kept[j] = False
    return [event for event, kept in zip(events, is_kept, strict=True) if kept]


def kinds_at_stops(events: Sequence[Event]) -> dict[int, list[str]]:
    """Kinds of events at each stop, in order, without the ends of chatters."""
    kinds = {}
    for event in without_chatter_ends(events):
        kinds.setdefault(event.stop, []).append(event.kind)
    return kinds


def swapped(expected: Sequence[Event], found: Sequence[Event]) -> list[tuple[Event, Event]]:
    """Pairs of expected events, one clearly after the other, that come in the other order in `found`.

    The logs must have the same events at every stop.
    """
    expected, places = without_chatter_ends(expected), _places(expected, found)
    times = np.array([event.t for event in expected])
    is_before = times[:, None] + ONE_INSTANT < times[None]
    wrong = is_before & (places[:, None] > places[None])
    return [(expected[i], expected[j]) for i, j in np.argwhere(wrong)]


def paired(expected: Sequence[Event], found: Sequence[Event]) -> list[tuple[Event, Event]]:
    """Pair the events of two logs, which must have the same kinds at every stop, and the same order.

    The pairs have the order of `expected`, without the ends of chatters.
    """
    assert kinds_at_stops(found) == kinds_at_stops(expected)
    assert swapped(expected, found) == [], "events in another order"
    places, found = _places(expected, found), without_chatter_ends(found)
    return [(event, found[i]) for event, i in zip(without_chatter_ends(expected), places, strict=True)]


def _places(expected: Sequence[Event], found: Sequence[Event]) -> np.ndarray:
    """Index in `found` of every expected event; ends of chatters are dropped from both."""
    expected, found = without_chatter_ends(expected), without_chatter_ends(found)
    places = np.zeros(len(expected), int)
    for stop in {event.stop for event in (*expected, *found)}:
        ours, theirs = ([i for i, e in enumerate(log) if e.stop == stop] for log in (found, expected))
        places[theirs] = ours
    return places


def relative_errors(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Largest error of every column, relative to its largest entry or to 1."""
    return np.abs(found - expected).max(axis=0) / np.maximum(1.0, np.abs(expected).max(axis=0))


def assert_depends_on_every_parameter(
    build: Callable[..., vx.ImpactSystem], parameters: dict, tolerance: float
) -> None:
    """Check that a machine can be built of traced numbers, with finite, nonzero derivatives by all of them."""

    def numbers(parameters: dict) -> jax.Array:
        return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(build(**parameters))])

    traced, slopes = jax.jit(lambda p: (numbers(p), jax.jacfwd(numbers)(p)))(parameters)
    np.testing.assert_allclose(traced, numbers(parameters), rtol=tolerance)
    for parameter, slope in slopes.items():
        assert np.isfinite(slope).all(), parameter
        assert np.abs(slope).max() > 0.1, parameter


@contextmanager
def counted() -> Iterator[list[str]]:
    """Names of the compilations in the context, in order."""
    found: list[str] = []

    def note(event: str, seconds: float, **details) -> None:
        del seconds
        if event == FINISHED:
            found.append(str(details.get("fun_name", event)))

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        yield found
    finally:
        # Older releases of JAX have only a private name for it.
        remove = getattr(jax.monitoring, "unregister_event_duration_listener", None)
        (remove or jax._src.monitoring._unregister_event_duration_listener_by_callback)(note)


def end_of(machine: vx.ImpactSystem, span: float):
    """End (x, v) of a run from t = 0, as a function of its start."""

    def end(start: jax.Array) -> jax.Array:
        half = len(start) // 2
        run = vx.simulate(machine, 0.0, span, start[:half], start[half:])
        return jnp.concatenate([run.x1, run.v1])

    return end
