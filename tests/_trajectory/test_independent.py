"""The engine against independent codes: 40-digit Taylor flights here, and heyoka."""

import sys
from collections.abc import Sequence
from pathlib import Path

import mpmath
import numpy as np
import pytest
from helpers import Event, log_of, paired
from mpmath import mpf
from problems import first_order_matrix, load_phase, one_mass

import vijax as vx

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

from random_machines.machines import draw_numbers, machine as made
from random_machines.shapes import draw_shape

# Terms and length of a step: no machine here has a rate above 2.5, and (2.5 / 8)^40 / 40! < 1e-67.
TERMS, STEP = 40, mpf(1) / 8
# Samples of a step, enough that none of these motions passes a stop unseen.
LOOKS = 8
# Below this speed the rest of a chatter is summed as a geometric series: exact to its square.
LIGHT = mpf(10) ** -15

# Some hundred roundings, magnified by the impacts of these short and tame motions.
ROUNDING = 2e-13
# A rounding of the position over the velocity is the uncertainty of the time of a light impact.
POSITION_ROUNDING = 1e-15
# The bounces under 1e-6 that end a chatter are summed for a constant acceleration: error of second order in 1e-6.
CHATTER_END = 1e-11
# Difference of two codes in double precision after a dozen impacts.
TWO_CODES = 1e-11


# Taylor flights to 40 digits


class Flight:
    """Trajectory of a linear machine with stops, as z = (x, v, cos W t, sin W t, 1)."""

    def __init__(self, system: vx.ImpactSystem, x0: Sequence[float], v0: Sequence[float]):
        self.system = system
        self.n = system.num_masses
        self.free = first_order_matrix(system).tolist()
        self.t = mpf(0)
        self.z = [mpf(a) for a in (*x0, *v0)] + [*load_phase(system, self.t), mpf(1)]
        self.held: set[int] = set()
        self.events: list[Event] = []
        # Number of leading derivatives of each gap that vanish, just after leaving the stop.
        self.leaving: dict[int, int] = {}

    def fly(self, t1: float) -> None:
        """Advance to t1, from event to event."""
        while self.t < t1:
            series = self._series()
            watched = [self._watched(j, series) for j in range(len(self.system.stops))]
            step = min([mpf(t1) - self.t, STEP, *(_bounce_and_more(c) for c in watched)])
            roots = [_first_root(c, step) for c in watched]
            step = min([step, *(root for root in roots if root is not None)])
            self.t += step
            self.z = [_value([c[i] for c in series], step) for i in range(len(self.z))]
            self.leaving = {}
            reached = [j for j, root in enumerate(roots) if root == step]
            for j in reached:
                self._let_go(j, 3) if j in self.held else self._hit(j)

    def pressing(self, j: int) -> mpf:
        """Acceleration towards stop j of a mass at rest on it."""
        stop = self.system.stops[j]
        z = list(self.z)
        z[self.n + stop.mass] = mpf(0)
        return stop.sign * _dot(self.free[self.n + stop.mass], z)

    def _series(self) -> list[list[mpf]]:
        still = {self.system.stops[j].mass for j in self.held}
        series = [self.z]
        for k in range(TERMS):
            last = series[-1]
            series.append(
                [
                    mpf(0) if i - self.n in still else _dot(row, last) / (k + 1)
                    for i, row in enumerate(self.free)
                ]
            )
        return series

    def _watched(self, j: int, series: list[list[mpf]]) -> list[mpf]:
        """Taylor coefficients of the function that is positive between events at stop j: its gap, or its force."""
        stop = self.system.stops[j]
        if j in self.held:
            return [stop.sign * _dot(self.free[self.n + stop.mass], c) for c in series]
        gap = [-stop.sign * c[stop.mass] for c in series]
        gap[0] += stop.sign * mpf(float(stop.position))
        return gap[self.leaving.get(j, 0) :]

    def _hit(self, j: int) -> None:
        stop = self.system.stops[j]
        i, r = self.n + stop.mass, mpf(float(stop.restitution))
        self._log("impact", j, self.z[i])
        self.z[stop.mass], self.z[i] = mpf(float(stop.position)), -r * self.z[i]
        self.leaving[j] = 1
        press = self.pressing(j)
        if press > 0 and abs(self.z[i]) < LIGHT:
            self._log("stick", j, mpf(0), self.t + 2 * abs(self.z[i]) / press / (1 - r))
            self.z[i] = mpf(0)
            self.held.add(j)
        for other in sorted(self.held):
            if self.pressing(other) < 0:
                self._let_go(other, 2)

    def _let_go(self, j: int, leaving: int) -> None:
        self._log("release", j, mpf(0))
        self.held.remove(j)
        self.leaving[j] = leaving

    def _log(self, kind: str, stop: int, velocity: mpf, t: mpf | None = None) -> None:
        self.events.append(Event(float(self.t if t is None else t), kind, stop, float(velocity)))


def _dot(row: Sequence[mpf], z: Sequence[mpf]) -> mpf:
    return mpmath.fsum(a * b for a, b in zip(row, z, strict=True) if a)


def _value(c: Sequence[mpf], u: mpf) -> mpf:
    total = mpf(0)
    for a in reversed(c):
        total = total * u + a
    return total


def _bounce_and_more(c: Sequence[mpf]) -> mpf:
    """Twice the time after which c0 + c1 u falls to zero: short bounces need short steps."""
    return 2 * c[0] / -c[1] if c[0] > 0 > c[1] else STEP


def _first_root(c: Sequence[mpf], step: mpf) -> mpf | None:
    """First root in (0, step], between two samples of different sign."""
    low = mpf(0)
    for look in range(1, LOOKS + 1):
        high = step * look / LOOKS
        if _value(c, high) <= 0:
            return mpmath.findroot(lambda u: _value(c, u), (low, high), solver="anderson", verify=False)
        low = high
    return None


SCENES = {
    "one_mass_that_sticks": (
        one_mass(c=0.125, amplitude=1.0, frequency=0.5, stops=(vx.Stop(0, 0.25, "upper", 0.5),)),
        25.0,
        {"impact", "stick", "release"},
    ),
    "stops_on_one_side": (vx.models.wagg_bishop_a(0.8), 20.0, {"impact"}),
    "stops_on_opposite_sides": (vx.models.wagg_bishop_b(0.2), 34.0, {"impact", "stick", "release"}),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.thorough
def test_the_motion_agrees_with_taylor_flights_of_40_digits(name):
    system, t1, kinds = SCENES[name]
    rest = np.zeros(system.num_masses)
    flight = Flight(system, rest.tolist(), rest.tolist())
    flight.fly(t1)
    assert {event.kind for event in flight.events} == kinds

    solution = vx.simulate(system, 0.0, t1, rest, rest)
    for expected, found in paired(flight.events, log_of(solution)):
        tolerance = ROUNDING * max(1.0, expected.t)
        if expected.kind == "impact":
            loss = 1 - float(system.stops[expected.stop].restitution)
            tolerance += POSITION_ROUNDING / (abs(expected.velocity) * loss)
        if expected.kind == "stick":
            tolerance += CHATTER_END
        assert abs(found.t - expected.t) <= tolerance, (expected, found)
        assert abs(found.velocity - expected.velocity) <= tolerance, (expected, found)
    n = system.num_masses
    np.testing.assert_allclose(solution.x1, [float(x) for x in flight.z[:n]], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(solution.v1, [float(v) for v in flight.z[n : 2 * n]], rtol=0, atol=ROUNDING)
    assert set(np.flatnonzero(solution.stuck1).tolist()) == flight.held


def random_machines(count: int) -> list:
    """The first machines of the campaign that flights can follow: plain stops, one harmonic, no rate above 20."""
    found = []
    for number in range(1000):
        rng = np.random.default_rng([20261124, number])
        shape = draw_shape(rng, 3)
        is_plain = shape.is_rigid and shape.is_driven and not (shape.is_full or shape.is_moving)
        if not is_plain or shape.harmonics > 1:
            continue
        numbers = draw_numbers(rng, shape, 40)
        for k in range(40):
            own = {name: value[k] for name, value in numbers.items()}
            rates = np.sqrt(np.abs(own["stiffness"]).sum(axis=1) / own["mass"])
            is_tame = rates.max() < 20 and 0.1 < own["restitution"].min() and own["restitution"].max() < 0.95
            if is_tame:
                found.append(pytest.param(shape, own, id=f"{number}-{k}"))
                break
        if len(found) == count:
            break
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "own"), random_machines(24))
def test_random_machines_agree_with_taylor_flights_of_40_digits(shape, own):
    system, t1 = made(shape, own), min(12.0, 3 * np.pi / own["frequency"])
    flight = Flight(system, own["x0"].tolist(), own["v0"].tolist())
    flight.fly(t1)
    n = system.num_masses

    def run(v0: np.ndarray) -> np.ndarray:
        sol = vx.simulate(system, 0.0, t1, own["x0"], v0, max_events=512)
        return np.append(sol.x1, sol.v1)

    found = run(own["v0"])
    growth = max(1.0, np.abs(run(own["v0"] * (1 + 1e-8)) - found).max() / 1e-8)
    assert growth < 1e6
    expected = [float(a) for a in flight.z[: 2 * n]]
    np.testing.assert_allclose(found, expected, rtol=0, atol=CHATTER_END + ROUNDING * growth)


# heyoka


def _impacts_by_heyoka(system: vx.ImpactSystem, t1: float) -> tuple[list[Event], list[float]]:
    """Impacts and end state from rest, by heyoka's Taylor integrator with terminal events."""
    hy = pytest.importorskip("heyoka")
    n, load = system.num_masses, system.forcing
    x, v = (hy.make_vars(*(f"{name}{i}" for i in range(n))) for name in "xv")
    x, v = ([a] if n == 1 else list(a) for a in (x, v))
    mass, c, k = (a.tolist() for a in (system.mass, system.damping, system.stiffness))
    amplitude, phase, w = load.amplitude.tolist(), load.phase.tolist(), float(load.frequency)
    force = [
        amplitude[i] * hy.cos(w * hy.time + phase[i]) - sum(c[i][j] * v[j] + k[i][j] * x[j] for j in range(n))
        for i in range(n)
    ]
    equations = [(x[i], v[i]) for i in range(n)] + [(v[i], force[i] / mass[i]) for i in range(n)]
    events: list[Event] = []

    def stop_event(j: int, stop: vx.Stop):
        def strike(integrator, _direction) -> bool:
            i = n + stop.mass
            events.append(Event(integrator.time, "impact", j, float(integrator.state[i])))
            integrator.state[i] *= -float(stop.restitution)
            return True

        closing = hy.event_direction.positive if stop.side == "upper" else hy.event_direction.negative
        return hy.t_event(x[stop.mass] - float(stop.position), callback=strike, direction=closing)

    integrator = hy.taylor_adaptive(
        equations,
        [0.0] * (2 * n),
        t_events=[stop_event(j, stop) for j, stop in enumerate(system.stops)],
    )
    integrator.propagate_until(t1)
    return events, integrator.state.tolist()


@pytest.mark.parametrize(
    ("system", "t1", "impacts"),
    [
        pytest.param(
            one_mass(c=0.1, amplitude=1.0, frequency=0.8, stops=(vx.Stop(0, 0.3, "upper", 0.7),)),
            20.0,
            5,
            id="one_mass",
        ),
        pytest.param(vx.models.wagg_bishop_a(1.5), 40.0, 5, id="two_masses"),
    ],
)
def test_a_motion_of_few_impacts_agrees_with_heyoka(system, t1, impacts):
    events, state = _impacts_by_heyoka(system, t1)
    rest = np.zeros(system.num_masses)
    solution = vx.simulate(system, 0.0, t1, rest, rest)
    found = log_of(solution)
    assert len(events) == len(found) == impacts
    for theirs, ours in zip(events, found, strict=True):
        assert (theirs.kind, theirs.stop) == (ours.kind, ours.stop)
        assert abs(theirs.t - ours.t) < TWO_CODES
        assert abs(theirs.velocity - ours.velocity) < TWO_CODES
    np.testing.assert_allclose(np.append(solution.x1, solution.v1), state, rtol=0, atol=TWO_CODES)
