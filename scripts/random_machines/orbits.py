"""Checks on periodic orbits of random machines: their closing, multipliers and exponents, and the same from another phase."""

from typing import Any

import numpy as np

import vijax as vx

from .machines import machine, own_numbers
from .runs import MOST_STEPS, ROOM, Failure, stretches_of
from .shapes import Shape

# Forcing periods after which a motion is taken to be settled, and the relative distance at which it repeats.
SETTLED, NEARLY = 300, 1e-4
# Size of a motion that has died out, in machines of size 1.
STILL = 1e-12
# Orbits that are found again from another phase, in periods, and the relative difference of their multipliers.
FEW, PHASE, ANY_PHASE = 8, 0.3, 1e-6
# Largest multiplier of an orbit that a run repeats.
UNSTABLE = 100.0


def check_orbits(shape: Shape, a: dict, orbits: dict[int, vx.PeriodicOrbit]) -> list[Failure]:
    """Orbits of some lanes: their closing and their multipliers; of a few the same from another phase, and exponents."""
    found = [
        (k, fault) for k, orbit in orbits.items() for fault in orbit_faults(shape, own_numbers(a, k), orbit)
    ]
    found += [(k, fault) for k, orbit in list(orbits.items())[:FEW] for fault in _other_ways(orbit)]
    return [Failure(name, k, excess) for k, (name, excess) in found]


def _other_ways(orbit: vx.PeriodicOrbit) -> list[tuple[str, float]]:
    """The orbit from another phase of the load, and the sum of its Lyapunov exponents."""
    system, n, found = orbit.system, int(orbit.num_periods), []
    multipliers = np.sort(np.abs(np.asarray(orbit.multipliers)))
    period = float(system.forcing.period)
    if multipliers[-1] > UNSTABLE:
        return []
    sol = vx.simulate(system, 0.0, PHASE * period, orbit.x0, orbit.v0, max_events=ROOM, throw=False)
    x, v = np.split(_state(system, sol, PHASE * period), 2)
    other = vx.periodic_orbit(system, x, v, n, phase=2 * np.pi * PHASE, throw=False)
    away = np.abs(np.sort(np.abs(np.asarray(other.multipliers))) - multipliers).max() / max(
        1.0, multipliers[-1]
    )
    if not (bool(other.is_admissible) and away <= ANY_PHASE):
        found.append(("orbit from another phase", float(away / ANY_PHASE)))
    if 1e-6 < multipliers[0] and multipliers[-1] < 1:
        exponents = vx.lyapunov_exponents(
            system, orbit.x0, orbit.v0, transient=0, num_periods=4 * n, throw=False, progress=False
        )
        expected = np.log(multipliers).sum() / (n * period)
        away = abs(float(np.sum(np.asarray(exponents))) - expected) / (ANY_PHASE * (1 + abs(expected)))
        if not away <= 1:
            found.append(("sum of the exponents", away))
    return found


def settled_orbits(shape: Shape, a: dict, lanes: list[int]) -> dict[int, vx.PeriodicOrbit]:
    """Orbits of those among a few driven machines that settle to a period."""
    found = {}
    for k in lanes if shape.is_periodic else []:
        system = machine(shape, own_numbers(a, k))
        period = 2 * np.pi / float(a["frequency"][k])
        ts = period * (SETTLED + np.arange(5))
        start = a["x0"][k], a["v0"][k]
        sol = vx.simulate(
            system, 0.0, ts[-1], *start, ts=ts, max_events=ROOM, max_steps=10 * MOST_STEPS, throw=False
        )
        stretches = stretches_of(sol, ts, system)
        states = np.concatenate([sol.xs, 0 * stretches, sol.vs, stretches], axis=1)
        away = np.abs(states[1:] - states[0]).max(axis=1) / (np.abs(states[0]).max() + 1e-12)
        # Without a load motions die out: bodies that rest in touch have no multipliers.
        if not (away < NEARLY).any() or np.abs(states[0]).max() < STILL:
            continue
        n = 1 + int(np.argmax(away < NEARLY))
        x, v = np.split(states[0], 2)
        orbit = vx.periodic_orbit(system, x, v, n, throw=False)
        if bool(orbit.is_admissible) and float(orbit.residual) < 1e-9:
            found[k] = orbit
    return found


def orbit_faults(shape: Shape, own: dict, orbit: vx.PeriodicOrbit) -> list[tuple[str, float]]:
    """Names of the checks that an orbit fails, and by how much."""
    end = float(orbit.num_periods) * float(orbit.system.forcing.period)
    sol = vx.simulate(orbit.system, 0.0, end, orbit.x0, orbit.v0, max_events=ROOM, throw=False)
    start, last = np.concatenate([orbit.x0, orbit.v0]), _state(orbit.system, sol, end)
    multipliers = np.asarray(orbit.multipliers)
    largest = max(1.0, float(np.abs(multipliers).max()))
    moved = np.append(orbit.progression, np.zeros(len(start) - len(orbit.progression)))
    lack, size = np.abs(last - start - moved).max(), 1e-9 * largest * (np.abs(start).max() + 1e-3)
    found = [] if lack <= size else [("closing of an orbit", float(lack / size))]
    kinds = np.asarray(sol.events.kind[: int(sol.num_events)])
    is_held = bool(np.asarray(sol.stuck1).any())
    if is_held or shape.is_switching or shape.is_moving or (kinds != vx.IMPACT).any():
        return found
    # Liouville: a flight loses volume by the damper, an impact by the square of its restitution.
    mass = own["mass"] if shape.is_full else np.diag(own["mass"])
    loss = -np.trace(np.linalg.solve(mass, np.asarray(orbit.system.damping))) * end
    r = np.concatenate([own["restitution"], own["contact_restitution"]])
    volume = np.exp(loss) * np.prod(r[np.asarray(sol.events.stop[: len(kinds)])] ** 2)
    error = abs(np.prod(multipliers) - volume) / (1e-8 * largest ** len(multipliers))
    return found if error <= 1 else [*found, ("product of the multipliers", float(error))]


def _state(system: Any, sol: vx.Solution, t: float) -> np.ndarray:
    """Positions and velocities at the end of a run, each with the coordinates of Jenkins elements."""
    (stretches,) = stretches_of(sol, np.array([t]), system)
    return np.concatenate([sol.x1, 0 * stretches, sol.v1, stretches])
