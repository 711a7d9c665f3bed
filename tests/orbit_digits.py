"""Periodic orbits of two masses to 40 digits, by a solver that shares only the machines with the engine.

`python tests/orbit_digits.py` recomputes them and writes `tests/data/golden_orbits.json`. From the engine it takes
only a guess: the events of an orbit in their order, their times, and a start. Then it solves, in numbers of 80
digits,

    z(n T; z(0)) = z(0),  with a gap of zero at each impact, and a force of zero at each release,

by Newton's method. Every flight is an exponential of a matrix; its duration, a root of the gap or the force, depends
on the start by the implicit function theorem. An orbit is accepted if no stop is passed between its events, and every
contact force while sticking is positive. Multipliers are eigenvalues of the derivative of z(n T), which differences
confirm.
"""

import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import jax
import mpmath
from mpmath import mp, mpf
from problems import first_order_matrix, load_phase

import vijax as vx

DATA = Path(__file__).parent / "data" / "golden_orbits.json"
STORED, WORKING = 40, 80
# Least speed of a followed chatter, whose error is its square. Bounces below `LIGHT` are not stored.
LIGHTEST, LIGHT = mpf(10) ** -25, mpf(10) ** -5
# Samples of a flight, enough that no stop is passed unseen.
LOOKS = 24
# Spacing of differences, whose error is its square.
SPACING = mpf(10) ** -20


class Case(NamedTuple):
    """A machine, and a guess of its orbit."""

    system: vx.ImpactSystem
    num_periods: int
    x: Sequence[float]
    v: Sequence[float]


def _shaken() -> vx.ImpactSystem:
    """One fixed stop and one that moves with two harmonics; the modes do not diagonalise the damping."""
    motion = vx.Harmonic([[0.1], [0.04]], 1.3, phase=[[0.2], [1.0]], mean=[0.02])
    load = vx.Harmonic([[2.0, 0.0], [0.0, 0.1]], 1.3, phase=[[0.0, 0.0], [0.0, 0.5]])
    stops = [vx.Stop(0, 0.4, "upper", 0.7), vx.Stop(1, 0.25, "upper", 0.6, motion)]
    return vx.chain([1.0, 0.8], [0.1, 0.05], [1.0, 1.5], load, stops)


def _a(frequency: float, x: Sequence[float], v: Sequence[float]) -> Callable[[], Case]:
    return lambda: Case(vx.models.wagg_bishop_a(frequency), 1, x, v)


def _b(frequency: float, num_periods: int, x: Sequence[float], v: Sequence[float]) -> Callable[[], Case]:
    return lambda: Case(vx.models.wagg_bishop_b(frequency), num_periods, x, v)


CASES: dict[str, Callable[[], Case]] = {
    "a_080_one_impact_of_each": _a(0.8, (0.1846, 0.0851), (0.3286, 0.5155)),
    "b_110_two_and_three_in_two_periods": _b(1.1, 2, (-0.0049, -0.1508), (0.2236, 0.1913)),
    "b_080_unstable": _b(0.8, 1, (0.2655, 0.0752), (0.331, -0.2362)),
    "b_080_doubled": _b(0.8, 2, (0.2507, 0.0865), (0.336, -0.2586)),
    "b_060_four_and_three": _b(0.6, 1, (0.5019, 0.0379), (0.083, 0.0975)),
    "b_040_chatter_that_ends_before_it_is_complete": _b(0.4, 1, (0.2745, 0.0727), (-0.0062, 0.0459)),
    "b_025_two_masses_stick": _b(0.25, 1, (0.3398, 0.0977), (0.1065, 0.0975)),
    "a_stop_is_shaken": lambda: Case(_shaken(), 1, (-1.8205, -4.8966), (2.9711, 3.0992)),
}


class Machine:
    """A linear machine as rows and matrices for z = (x, v, cosines and sines of the load, 1)."""

    def __init__(self, system: vx.ImpactSystem):
        self.n, self.stops = system.num_masses, system.stops
        self.free = first_order_matrix(system)
        self.period = 2 * mp.pi / mpf(float(system.forcing.frequency))
        self.phase0 = [*load_phase(system, mpf(0)), mpf(1)]
        self.size = self.free.rows

    def place(self, j: int) -> mpmath.matrix:
        """Position of stop j, as a row."""
        stop, row = self.stops[j], mpmath.zeros(1, self.size)
        row[self.size - 1] = mpf(float(stop.position))
        if stop.motion is not None:
            row[self.size - 1] += mpf(float(stop.motion.mean[0]))
            waves = zip(
                stop.motion.amplitude.ravel().tolist(), stop.motion.phase.ravel().tolist(), strict=True
            )
            for h, (a, phase) in enumerate(waves):
                row[2 * self.n + 2 * h] = mpf(a) * mpmath.cos(phase)
                row[2 * self.n + 2 * h + 1] = -mpf(a) * mpmath.sin(phase)
        return row

    def gap(self, j: int) -> mpmath.matrix:
        """Gap of stop j, as a row."""
        row = self.place(j)
        row[self.stops[j].mass] -= 1
        return self.stops[j].sign * row

    def force(self, j: int, held: Sequence[int]) -> mpmath.matrix:
        """Contact force on stop j, as the acceleration that its mass would have without it."""
        rate = self.flow(tuple(i for i in held if i != j))
        return -self.gap(j) * rate * rate

    def flow(self, held: Sequence[int]) -> mpmath.matrix:
        """Matrix of z' while the stops `held` hold their masses."""
        a = self.free.copy()
        for j in held:
            a[self.n + self.stops[j].mass, :] = self.place(j) * self.free * self.free
        return a

    def impact(self, j: int, *, sticks: bool) -> mpmath.matrix:
        """Matrix by which an impact at stop j changes z."""
        i, r = self.stops[j].mass, 0 if sticks else mpf(float(self.stops[j].restitution))
        after = mpmath.eye(self.size)
        after[i, :] = self.place(j)
        after[self.n + i, :] = (1 + r) * self.place(j) * self.free
        after[self.n + i, self.n + i] -= r
        return after


class Step(NamedTuple):
    """An impact or a release, and the approximate duration of the flight before it; `sticks` ends a chatter."""

    kind: int
    stop: int
    span: mpf
    sticks: bool = False


class Lap(NamedTuple):
    """One cycle: end, its derivative by the start, steps as flown, event times and speeds, least gap or force."""

    end: mpmath.matrix
    slope: mpmath.matrix
    steps: list[Step]
    times: list[mpf]
    speeds: list[mpf]
    lowest: mpf


def lap(
    machine: Machine, start: Sequence[mpf], steps: Sequence[Step], span: mpf, held: Sequence[int] = ()
) -> Lap:
    """Follow the steps from a start for a span of time, whether the motion is admissible or not."""
    m, held = machine, tuple(held)
    z = mpmath.matrix([*start, *m.phase0])
    slope, moved = (
        mpmath.eye(m.size)[:, : 2 * m.n],
        mpmath.zeros(1, 2 * m.n),
    )  # of z, and of the time, by the start
    taken, times, speeds, t, lowest = [], [], [], mpf(0), mpf("inf")
    for step in steps:
        a = m.flow(held)
        row = m.gap(step.stop) if step.kind == vx.IMPACT else m.force(step.stop, held)
        tau = _root(a, row, z, step.span)
        lowest = min(lowest, _lowest(m, a, z, tau, held))
        z, slope = mpmath.expm(a * tau) * z, mpmath.expm(a * tau) * slope
        shift = -(row * slope) / (row * a * z)[0]
        slope, moved = slope + a * z * shift, moved + shift
        t += tau
        times.append(t)
        speeds.append(z[m.n + m.stops[step.stop].mass])
        taken.append(step._replace(span=tau))
        if step.kind == vx.IMPACT:
            after = m.impact(step.stop, sticks=step.sticks)
            z, slope = after * z, after * slope
            held = (*held, step.stop) if step.sticks else held
        else:
            held = tuple(j for j in held if j != step.stop)
    a = m.flow(held)
    lowest = min(lowest, _lowest(m, a, z, span - t, held))
    z, slope = mpmath.expm(a * (span - t)) * z, mpmath.expm(a * (span - t)) * slope
    slope -= a * z * moved
    return Lap(z[: 2 * m.n, :], slope[: 2 * m.n, :], taken, times, speeds, lowest)


def _root(a: mpmath.matrix, row: mpmath.matrix, z: mpmath.matrix, guess: mpf) -> mpf:
    """Next time at which row . z is zero, by Newton's method down to rounding."""
    tau, last = guess, mpf("inf")
    for _ in range(20):
        there = mpmath.expm(a * tau) * z
        step = -(row * there)[0] / (row * a * there)[0]
        if abs(step) >= last / 2 and abs(step) < mpf(10) ** -30:
            return tau
        tau, last = tau + step, abs(step)
    raise ArithmeticError(f"No event near {mpmath.nstr(guess, 5)} after the last one.")


def _lowest(m: Machine, a: mpmath.matrix, z: mpmath.matrix, span: mpf, held: Sequence[int]) -> mpf:
    """Least gap of the free stops and least force on the others, inside a flight."""
    rows = [m.force(j, held) if j in held else m.gap(j) for j in range(len(m.stops))]
    advance, lowest = mpmath.expm(a * (span / LOOKS)), mpf("inf")
    for _ in range(LOOKS - 1):
        z = advance * z
        lowest = min([lowest, *((row * z)[0] for row in rows)])
    return lowest


class Solved(NamedTuple):
    """An orbit: its cycle, its start, and the eigenvalues of its derivative."""

    lap: Lap
    start: mpmath.matrix
    multipliers: list[mpmath.mpc]


def solve(case: Case) -> Solved:
    """Newton's method from the engine's orbit, until the digits no longer change."""
    guess = vx.periodic_orbit(case.system, case.x, case.v, case.num_periods)
    machine = Machine(case.system)
    span, n = case.num_periods * machine.period, machine.n
    start = mpmath.matrix([mpf(float(a)) for a in (*guess.x0, *guess.v0)])
    steps, held = _steps(machine, guess), ()
    for _ in range(8):
        found = lap(machine, start, steps, span, held)
        step = mpmath.lu_solve(found.slope - mpmath.eye(2 * n), start - found.end)
        start, steps = start + step, found.steps
        if mpmath.norm(step) < mpf(10) ** -(STORED + 5):
            break
    else:
        raise ArithmeticError("The orbit was not reached.")
    found = lap(machine, start, steps, span, held)
    assert found.lowest > 0, "a stop is passed, or pulls"
    differences = mpmath.zeros(2 * n)
    for k in range(2 * n):
        e = mpmath.eye(2 * n)[:, k] * SPACING
        ahead, behind = (lap(machine, start + sign * e, steps, span, held).end for sign in (1, -1))
        differences[:, k] = (ahead - behind) / (2 * SPACING)
    assert mpmath.norm(differences - found.slope) < mpf(10) ** -25 * mpmath.norm(found.slope)
    values = [mpmath.chop(mu, mpf(10) ** -25) for mu in mpmath.eig(found.slope, left=False, right=False)]
    return Solved(found, start, sorted(values, key=lambda mu: (-round(abs(mu), STORED), -mpmath.im(mu))))


def _steps(machine: Machine, orbit: vx.PeriodicOrbit) -> list[Step]:
    """Steps of the engine's orbit; a chatter is continued with its ratio down to `LIGHTEST`."""
    log, steps, last = orbit.events, [], 0.0
    events = [e for e in zip(log.t.tolist(), log.kind.tolist(), log.stop.tolist(), strict=True) if e[1] >= 0]
    for k, (t, kind, stop) in enumerate(events):
        if kind == vx.STICK:
            continue
        steps.append(Step(kind, stop, mpf(t - last)))
        last = t
        if kind == vx.IMPACT and next((e[1] for e in events[k + 1 :] if e[2] == stop), None) == vx.STICK:
            assert events[k + 1][1:] == (vx.STICK, stop), "something else happens within the chatter"
            r, speed = mpf(float(machine.stops[stop].restitution)), abs(mpf(float(log.velocity_minus[k])))
            bounces = int(mpmath.ceil(mpmath.log(LIGHTEST / speed) / mpmath.log(r)))
            tail = [Step(kind, stop, steps[-1].span * r**i) for i in range(1, bounces + 1)]
            steps += [*tail[:-1], tail[-1]._replace(sticks=True)]
            last += float(sum(step.span for step in tail))
    return steps


def digits_of(name: str) -> dict:
    """Stored quantities of an orbit, as strings."""
    case, told = CASES[name](), lambda a: mpmath.nstr(a, STORED)
    with mp.workdps(WORKING):
        orbit = solve(case)
        n = case.system.num_masses
        events = [
            {
                "t": told(t),
                "kind": ("impact", "stick", "release")[step.kind],
                "stop": step.stop,
                "v_before": told(v),
            }
            for step, t, v in zip(orbit.lap.steps, orbit.lap.times, orbit.lap.speeds, strict=True)
            if step.kind == vx.RELEASE or abs(v) > LIGHT
        ]
        return {
            "num_periods": case.num_periods,
            "x0": [told(a) for a in orbit.start[:n]],
            "v0": [told(a) for a in orbit.start[n:]],
            "events": events,
            "multipliers": [[told(mpmath.re(mu)), told(mpmath.im(mu))] for mu in orbit.multipliers],
        }


@cache
def stored() -> dict[str, dict]:
    """All stored digits, by name."""
    return json.loads(DATA.read_text())


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    DATA.write_text(json.dumps({name: digits_of(name) for name in CASES}, indent=1) + "\n")
