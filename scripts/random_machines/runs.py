"""Runs of random machines, in batches."""

from typing import NamedTuple

import numpy as np

import vijax as vx

from .machines import machine, own_numbers
from .shapes import Shape

# Number of saved states, room for events.
SAVED, ROOM = 33, 256
EVENLY = np.linspace(0.0, 1.0, SAVED)
# Bound on steps: on an elastic stop bounces never end.
MOST_STEPS = 20_000


class Failure(NamedTuple):
    """One machine that fails one check, by how much beyond the tolerance."""

    check: str
    lane: int
    excess: float


class Run(NamedTuple):
    """Results of a batch, (lanes, ...).

    Attributes:
        known: time until which the states and the log are known.
        clearance: smallest gap at which a mass turned back just before its stop.
        others: as in `vx.Solution` and its log.
    """

    ts: np.ndarray
    xs: np.ndarray
    vs: np.ndarray
    t: np.ndarray
    stop: np.ndarray
    kind: np.ndarray
    before: np.ndarray
    after: np.ndarray
    num_events: np.ndarray
    result: np.ndarray
    stretches: np.ndarray
    impulse: np.ndarray
    known: np.ndarray
    clearance: np.ndarray

    def start_at(self, place: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities from which runs go on from a saved state, (lanes, masses and Jenkins elements)."""
        stretches = self.stretches[:, place]
        x, v = self.xs[:, place], self.vs[:, place]
        return np.append(x, 0 * stretches, axis=1), np.append(v, stretches, axis=1)


def stretches_of(sol: vx.Solution, ts: np.ndarray, system: vx.ImpactSystem) -> np.ndarray:
    """Stretches of the Jenkins elements at times, (times, hysteresis)."""
    if not system.hysteresis:
        return np.zeros((len(ts), 0))
    is_known = np.asarray(sol.known_until) >= ts  # before a motion that stopped early
    forces = np.asarray(sol.hysteresis_force(np.where(is_known, ts, ts[0])))
    return forces / [float(one.stiffness) for one in system.hysteresis]


def run(
    shape: Shape,
    a: dict,
    begin,
    end,
    x0=None,
    v0=None,
    most_steps: int | None = MOST_STEPS,
    fractions: np.ndarray = EVENLY,
) -> Run:
    """Simulate the machines one by one: one program serves all of a size, and compiles in a fraction of a batch's time.

    `fractions` of the time are saved, (times,), or for each machine its own, (lanes, times).
    """
    x0, v0 = a["x0"] if x0 is None else x0, a["v0"] if v0 is None else v0
    fractions = np.broadcast_to(fractions, (len(begin), fractions.shape[-1]))
    rows = []
    for k in range(len(begin)):
        own = own_numbers(a, k)
        ts = np.minimum(begin[k] + (end[k] - begin[k]) * fractions[k], end[k])
        system = machine(shape, own)
        sol = vx.simulate(
            system,
            begin[k],
            end[k],
            x0[k],
            v0[k],
            ts=ts,
            max_events=ROOM,
            max_steps=most_steps,
            throw=False,
        )
        log = sol.events
        own_log = log.t, log.stop, log.kind, log.velocity_minus, log.velocity_plus
        of_run = sol.num_events, sol.result._value, stretches_of(sol, ts, system), log.impulse
        found = ts, sol.xs, sol.vs, *own_log, *of_run, sol.known_until, sol.grazing.clearance
        rows.append([np.asarray(a) for a in found])
    return (
        Run(*(np.stack(column) for column in zip(*rows, strict=True)))
        if rows
        else Run(*[np.empty(0)] * len(Run._fields))
    )


def start_of_rest(shape: Shape, a: dict, begin, since, is_sound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities from which motions go on at a time; those of runs that end before it are their starts."""
    none = np.zeros((len(since), len(shape.sliders)))
    now = run(shape, a, begin, since).start_at(-1)
    before = (np.append(a[name], none, axis=1) for name in ("x0", "v0"))
    x, v = (np.where(is_sound[:, None], *pair) for pair in zip(now, before, strict=True))
    return x, v


def code_of(name: str) -> int:
    """Number of a result."""
    return int(getattr(vx.RESULTS, name)._value)
