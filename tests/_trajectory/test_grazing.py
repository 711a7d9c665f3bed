"""Near-grazing passes: clearances of either sign from 1e-4 down to 1e-12 separate no impact from one."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

CLEARANCES = np.array([sign * 10.0**-k for k in range(4, 13) for sign in (1, -1)])
# Effect on a gap of some ten roundings of a position of order one.
GAP_ROUNDING = 2e-15
RESTITUTION = 0.7
SIDES = ((0, "upper"), (-1, "lower"))


class Machine(NamedTuple):
    """A driven machine that starts at rest at zero position, and the length of its motion."""

    mass: list
    damping: list
    stiffness: list
    amplitude: list
    frequency: float
    phase: float
    span: float


MACHINES = {
    "light_damping": Machine([1.0], [[0.1]], [[1.0]], [0.5], 0.8, 0.3, 30.0),
    "slow_forcing_heavy_damping": Machine([1.0], [[4.0]], [[1.0]], [0.6], 0.05, 2.0, 120.0),
    "fast_forcing_no_damping": Machine([2.0], [[0.0]], [[3.0]], [5.0], 7.0, 1.0, 20.0),
    "two_masses": Machine(
        [1.0, 1.4], [[0.17, -0.12], [-0.12, 0.12]], [[1.9, -0.8], [-0.8, 0.8]], [0.6, 0.0], 0.55, 0.2, 40.0
    ),
    "two_masses_slow": Machine(
        [1.0, 1.4], [[2.7, -1.4], [-1.4, 1.4]], [[1.9, -0.8], [-0.8, 0.8]], [0.6, 0.1], 0.06, 3.1, 100.0
    ),
    "two_masses_in_proportion": Machine(
        [1.0, 1.0], [[0.2, -0.1], [-0.1, 0.1]], [[2.0, -1.0], [-1.0, 1.0]], [0.3, 0.0], 1.1, 0.0, 40.0
    ),
}


class FreeMotion:
    """Motion without stops to 40 digits: y(t) = Re(P exp(i W t)) + sum_k c_k exp(l_k t)."""

    def __init__(self, machine: Machine):
        n = len(machine.mass)
        first_order = mp.zeros(2 * n)
        load = mp.zeros(2 * n, 1)
        for i, m in enumerate(machine.mass):
            first_order[i, n + i] = mp.mpf(1)
            load[n + i] = mp.mpf(machine.amplitude[i]) * mp.expj(mp.mpf(machine.phase)) / mp.mpf(m)
            for j in range(n):
                first_order[n + i, j] = -mp.mpf(machine.stiffness[i][j]) / mp.mpf(m)
                first_order[n + i, n + j] = -mp.mpf(machine.damping[i][j]) / mp.mpf(m)
        self.frequency = mp.mpf(machine.frequency)
        self.steady = mp.lu_solve(mp.mpc(0, 1) * self.frequency * mp.eye(2 * n) - first_order, load)
        self.rates, self.vectors = mp.eig(first_order)
        start = mp.matrix([-mp.re(p) for p in self.steady])
        self.weights = mp.lu_solve(self.vectors, start)
        self.n = n

    def derivative(self, mass: int, t, order: int):
        """Derivative of x of one mass, of any order."""
        mass %= self.n
        driven = self.steady[mass] * (mp.mpc(0, 1) * self.frequency) ** order * mp.expj(self.frequency * t)
        free = sum(
            self.vectors[mass, k] * c * rate**order * mp.exp(rate * t)
            for k, (c, rate) in enumerate(zip(self.weights, self.rates, strict=True))
        )
        return mp.re(driven + free)

    def highest(self, mass: int, sign: int, span: float):
        """Time inside the span at which sign * x is highest, and x there."""
        grid = np.linspace(0.0, span, 1501)[1:-1]
        with mp.workdps(15):
            heights = np.array([float(sign * self.derivative(mass, t, 0)) for t in grid])
        rises = np.diff(heights) > 0
        tops = np.flatnonzero(rises[:-1] & ~rises[1:]) + 1
        best = tops[np.argmax(heights[tops])]
        time = mp.findroot(lambda t: self.derivative(mass, t, 1), grid[best])
        return time, self.derivative(mass, time, 0)


class Case(NamedTuple):
    """Stop positions for every clearance, and the exact results."""

    machine: Machine
    positions: np.ndarray
    end: float
    grazed: int
    velocity: np.ndarray
    curvature: float


@cache
def case(name: str) -> Case:
    """Place both stops at extremes of their masses: the earlier is never touched, the later by negative clearances."""
    machine = MACHINES[name]
    with mp.workdps(40):
        motion = FreeMotion(machine)
        signs = [1, -1]
        extremes = [motion.highest(mass, s, machine.span) for (mass, _), s in zip(SIDES, signs, strict=True)]
        grazed = int(extremes[1][0] > extremes[0][0])
        time, sign, mass = extremes[grazed][0], signs[grazed], SIDES[grazed][0]
        curvature = -sign * motion.derivative(mass, time, 2)
        assert curvature > 1e-4
        positions, velocity = [], []
        for clearance in CLEARANCES:
            gaps = [abs(clearance), abs(clearance)]
            gaps[grazed] = clearance
            places = [float(x + s * mp.mpf(g)) for (_, x), s, g in zip(extremes, signs, gaps, strict=True)]
            positions.append(places)
            if clearance > 0:
                velocity.append(0.0)
                continue
            # The position is the double that was passed, not the number that was rounded to it.
            depth = sign * (extremes[grazed][1] - mp.mpf(places[grazed]))
            before = time - mp.sqrt(2 * depth / curvature)
            hit = mp.findroot(lambda t, s=places[grazed]: motion.derivative(mass, t, 0) - mp.mpf(s), before)
            velocity.append(float(motion.derivative(mass, hit, 1)))
        # Within less than half an oscillation no other stop can be reached.
        end = float(time + mp.mpf("0.3") * min(1, 1 / machine.frequency))
    return Case(machine, np.array(positions), end, grazed, np.array(velocity), float(curvature))


def simulate(machine: Machine, positions, end) -> vx.Solution:
    load = vx.Harmonic(machine.amplitude, machine.frequency, jnp.full(len(machine.mass), machine.phase))
    stops = [
        vx.Stop(mass % len(machine.mass), positions[j], side, RESTITUTION)
        for j, (mass, side) in enumerate(SIDES)
    ]
    system = vx.ImpactSystem(machine.mass, machine.damping, machine.stiffness, load, stops)
    return vx.simulate(system, 0.0, end, max_events=4, throw=False)


def check(case: Case, count, stop, velocity):
    """Check for exactly one impact where the clearance is negative, and none elsewhere."""
    np.testing.assert_array_equal(count, CLEARANCES < 0)
    is_hit = CLEARANCES < 0
    np.testing.assert_array_equal(stop[is_hit, 0], case.grazed)
    # The depth, half the squared velocity over the curvature, has the accuracy of the gap.
    depth, exact = (v**2 / (2 * case.curvature) for v in (velocity[is_hit, 0], case.velocity[is_hit]))
    size = max(1, np.abs(case.positions).max())
    np.testing.assert_allclose(depth, exact, rtol=1e-9, atol=size * GAP_ROUNDING)


simulate_all = jax.jit(jax.vmap(simulate, in_axes=(None, 0, None)))


@pytest.mark.parametrize(
    "name",
    [pytest.param(m, marks=pytest.mark.slow if m.startswith("two") else ()) for m in MACHINES],
)
def test_a_light_pass_has_the_right_number_of_impacts(name):
    c = case(name)
    machine = Machine(*(jnp.asarray(a) for a in c.machine))
    sol = simulate_all(machine, jnp.asarray(c.positions), c.end)
    check(c, *map(np.asarray, (sol.num_events, sol.events.stop, sol.events.velocity_minus)))


def test_the_trajectory_tells_how_close_to_grazing_it_came():
    c = case("light_damping")
    machine = Machine(*(jnp.asarray(a) for a in c.machine))
    met = simulate_all(machine, jnp.asarray(c.positions), c.end).grazing
    narrow = (CLEARANCES > 0) & (CLEARANCES < 1e-5)
    np.testing.assert_allclose(
        np.asarray(met.clearance)[narrow], CLEARANCES[narrow], rtol=1e-2, atol=GAP_ROUNDING
    )
    is_hit = CLEARANCES < 0
    speed = np.abs(c.velocity[is_hit])
    np.testing.assert_allclose(np.asarray(met.impact_speed)[is_hit], speed, rtol=1e-6, atol=1e-8)
    is_near = np.asarray(met.is_near)
    assert is_near[np.abs(CLEARANCES) < 3e-12].all()
    assert not is_near[np.abs(CLEARANCES) > 3e-8].any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["light_damping", "two_masses_in_proportion"])
def test_a_light_pass_of_one_machine_at_a_time_has_the_right_number_of_impacts(name):
    c = case(name)
    runs = [simulate(c.machine, p, c.end) for p in c.positions]
    stop, velocity = (np.array([getattr(s.events, a) for s in runs]) for a in ("stop", "velocity_minus"))
    check(c, np.array([int(s.num_events) for s in runs]), stop, velocity)
