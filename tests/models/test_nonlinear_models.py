"""Nonlinear ready-made machines, against elliptic functions and an independent solver."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.special
from helpers import log_of
from mpmath import mp, mpf

import vijax as vx

# Some hundred steps of 1e-10 each (measured: 4e-10).
SOLVER = 2e-9
# Error of derivatives, with steps chosen for the errors of the states (measured: 1e-9).
SLOPES = 1e-8
DIGITS = 30


# Free motions: -a cn(w t) of the cubic spring, 2 asin(kappa sn(w t)) of the pendulum


class Free(NamedTuple):
    """An undamped, undriven oscillator that turns back at -top: its energy and its motion."""

    energy: Callable[[mpf], mpf]
    top: Callable[[mpf], mpf]
    rise: Callable[[mpf, mpf], mpf]
    state: Callable[[mpf, mpf], tuple[mpf, mpf]]


def cubic(k3: mpf, k: float = 1.0) -> Free:
    """x'' + k x + k3 x^3 = 0: `duffing_oscillator` without its load."""

    def rate(a: mpf) -> tuple[mpf, mpf]:
        w = mp.sqrt(k + k3 * a**2)
        return w, k3 * a**2 / (2 * w**2)

    def rise(a: mpf, x: mpf) -> mpf:
        w, m = rate(a)
        return mp.ellipf(mp.acos(-x / a), m) / w

    def state(a: mpf, t: mpf) -> tuple[mpf, mpf]:
        w, m = rate(a)
        cn, sn, dn = (mp.ellipfun(name, w * t, m=m) for name in ("cn", "sn", "dn"))
        # A negative m gives complex numbers without imaginary parts.
        return mp.re(-a * cn), mp.re(a * w * sn * dn)

    return Free(
        energy=lambda x: k * x**2 / 2 + k3 * x**4 / 4,
        top=lambda e: mp.sqrt(4 * e / (k + mp.sqrt(k**2 + 4 * k3 * e))),
        rise=rise,
        state=state,
    )


def swinging(w: mpf) -> Free:
    """x'' + w^2 sin x = 0: `impacting_pendulum` without its load."""

    def rise(b: mpf, x: mpf) -> mpf:
        kappa = mp.sin(b / 2)
        return (mp.ellipk(kappa**2) + mp.ellipf(mp.asin(mp.sin(x / 2) / kappa), kappa**2)) / w

    def state(b: mpf, t: mpf) -> tuple[mpf, mpf]:
        kappa = mp.sin(b / 2)
        u, m = w * t - mp.ellipk(kappa**2), kappa**2
        return 2 * mp.asin(kappa * mp.ellipfun("sn", u, m=m)), 2 * w * kappa * mp.ellipfun("cn", u, m=m)

    return Free(
        energy=lambda x: 2 * (w * mp.sin(x / 2)) ** 2,
        top=lambda e: 2 * mp.asin(mp.sqrt(e / 2) / w),
        rise=rise,
        state=state,
    )


def bounces(free: Free, top: mpf, position: mpf, r: mpf) -> Iterator[tuple[mpf, mpf, mpf]]:
    """Time, speed and next turning point for every impact, from rest at -top."""
    t = free.rise(top, position)
    while True:
        speed = mp.sqrt(2 * (free.energy(top) - free.energy(position)))
        top = free.top(free.energy(position) + (r * speed) ** 2 / 2)
        yield t, speed, top
        t += 2 * free.rise(top, position)


def free_end(free: Free, top: mpf, position: mpf, r: mpf, t1: float) -> list[mpf]:
    """State at t1 and times of the first two impacts, from rest at -top."""
    times = []
    for t, _, turn in bounces(free, top, position, r):
        if t > t1:
            break
        times.append(t)
        last = turn
    since = t1 - times[-1] - free.rise(last, position)
    return [*free.state(last, since), *times[:2]]


class Model(NamedTuple):
    """A machine of `vijax.models`, the parameter of its force, and its motion without load and damping."""

    build: Callable[..., vx.ImpactSystem]
    parameter: str
    free: Callable[[mpf], Free]


DUFFING = Model(vx.models.duffing_oscillator, "cubic_stiffness", cubic)
PENDULUM = Model(vx.models.impacting_pendulum, "natural_frequency", swinging)


class Case(NamedTuple):
    """A start at rest at -top, without load."""

    model: Model
    value: float
    position: float
    restitution: float
    top: float

    @property
    def system(self) -> vx.ImpactSystem:
        """The machine."""
        values = {self.model.parameter: self.value}
        return self.model.build(0.9, 0.0, position=self.position, restitution=self.restitution, **values)

    def exact(self) -> tuple[Free, mpf, mpf, mpf]:
        """Oscillator in the current working precision, for `bounces` and `free_end`."""
        value, position, restitution, top = (mpf(a) for a in self[1:])
        return self.model.free(value), top, position, restitution


FREE = {
    "hardening": Case(DUFFING, 2.5, 0.0, 0.8, 1.2),
    "softening": Case(DUFFING, -0.5, 0.2, 0.9, 1.1),
    "pendulum": Case(PENDULUM, 1.3, 0.1, 0.9, 3.0),
    # Elastic stops never stick, which is another program.
    "elastic": Case(DUFFING, 2.5, 0.5, 1.0, 1.2),
    "elastic pendulum": Case(PENDULUM, 1.3, 0.4, 1.0, 2.0),
}
SLOW = {name: pytest.mark.slow if "elastic" in name else () for name in FREE}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW[name]) for name in FREE])
def test_a_free_machine_hits_its_stop_at_the_times_and_speeds_of_elliptic_integrals(name):
    case = FREE[name]
    sol = vx.simulate(case.system, 0.0, 20.0, [-case.top])
    found = log_of(sol)
    assert len(found) >= 5
    with mp.workdps(DIGITS):
        exact = bounces(*case.exact())
        times, speeds, _ = np.array([[float(a) for a in next(exact)] for _ in found]).T
        end = [float(a) for a in free_end(*case.exact(), 20.0)]
    assert [event.kind for event in found] == ["impact"] * len(found)
    np.testing.assert_allclose([event.t for event in found], times, rtol=SOLVER)
    np.testing.assert_allclose([event.velocity for event in found], speeds, rtol=SOLVER)
    np.testing.assert_allclose([*sol.x1, *sol.v1], end[:2], rtol=0, atol=SOLVER)


@pytest.mark.thorough
def test_every_impact_on_a_wall_at_the_bottom_multiplies_the_sine_of_half_the_angle_by_r():
    w, _, r, b = (case := Case(PENDULUM, 1.3, 0.0, 0.8, 2.5))[1:]
    sol = vx.simulate(case.system, 0.0, 20.0, [-b])
    kappa = np.sin(b / 2) * r ** np.arange(int(sol.num_events))
    quarters = scipy.special.ellipk(kappa**2) / w
    times = quarters[0] + np.append(0, np.cumsum(2 * quarters[1:]))
    n = len(kappa)
    assert n >= 6
    np.testing.assert_allclose(sol.events.t[:n], times, rtol=SOLVER)
    np.testing.assert_allclose(sol.events.velocity_minus[:n], 2 * w * kappa, rtol=SOLVER)


@pytest.mark.slow
def test_a_pendulum_pressed_on_its_wall_by_its_weight_chatters_for_the_sum_of_its_bounces_and_stays():
    case = Case(PENDULUM, 1.3, -0.5, 0.6, 1.2)
    sol = vx.simulate(case.system, 0.0, 20.0, [-case.top])
    *impacts, stick = log_of(sol)
    # The hundredth bounce is 0.6^100 = 7e-23 of the first, and its height the square of that.
    with mp.workdps(2 * DIGITS):
        exact = bounces(*case.exact())
        first = [next(exact) for _ in range(100)]
    heavy = [float(speed) for _, speed, _ in first if speed > 1e-3]
    assert len(heavy) > 10
    np.testing.assert_allclose([event.velocity for event in impacts[: len(heavy)]], heavy, rtol=SOLVER)
    assert stick.kind == "stick"
    assert stick.t == pytest.approx(float(first[-1][0]), abs=SOLVER)
    assert float(sol.contact_force(20.0)[0]) == pytest.approx(1.3**2 * np.sin(0.5), rel=1e-14)


# Loads and damping: a solver of SciPy, with explicit impacts


class Flown(NamedTuple):
    """Results of the other solver."""

    times: np.ndarray
    speeds: np.ndarray
    end: np.ndarray


def restoring(values: dict) -> Callable[[float], float]:
    if "natural_frequency" in values:
        return lambda x: values["natural_frequency"] ** 2 * np.sin(x)
    return lambda x: values["stiffness"] * x + values["cubic_stiffness"] * x**3


def flown(values: dict, x0: float, t1: float) -> Flown:
    """Fly x'' = A cos(W t) - c x' - restoring force from rest at x0, reflected by the stop at r times the speed."""
    a, w, c = (values[name] for name in ("amplitude", "frequency", "damping"))
    r, position, pull = values["restitution"], values["position"], restoring(values)

    def field(t, y):
        return [y[1], a * np.cos(w * t) - c * y[1] - pull(y[0])]

    def contact(t, y):
        return position - y[0]

    contact.terminal, contact.direction = True, -1
    t, y, impacts = 0.0, np.array([x0, 0.0]), []
    while True:
        # Steps are so short that the polynomial inside them, of degree 7, is as exact as their ends.
        part = scipy.integrate.solve_ivp(
            field, (t, t1), y, "DOP853", rtol=1e-13, atol=1e-14, max_step=0.05, events=contact
        )
        t, y = part.t[-1], part.y[:, -1]
        if part.status == 0:
            return Flown(*np.array(impacts).reshape(-1, 2).T, y)
        impacts.append((t, y[1]))
        y = np.array([position, -r * y[1]])


DRIVEN_DUFFING = {
    "amplitude": 0.6, "damping": 0.1, "stiffness": 0.8, "cubic_stiffness": 1.5, "position": 0.5, "restitution": 0.7
}  # fmt: skip
DRIVEN_PENDULUM = {
    "amplitude": 0.7, "damping": 0.2, "natural_frequency": 1.3, "position": 0.3, "restitution": 0.7
}  # fmt: skip
DRIVEN = {"duffing_oscillator": DRIVEN_DUFFING, "impacting_pendulum": DRIVEN_PENDULUM}
FREQUENCIES = [0.7, 0.9, 1.3]


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.parametrize("name", DRIVEN)
@pytest.mark.thorough
def test_a_driven_machine_moves_as_another_solver_says(name, frequency):
    values = DRIVEN[name] | {"frequency": frequency}
    sol = vx.simulate(getattr(vx.models, name)(**values), 0.0, 20.0, [-1.0])
    other, found = flown(values, -1.0, 20.0), log_of(sol)
    assert [event.kind for event in found] == ["impact"] * len(other.times)
    assert len(found) >= 2
    np.testing.assert_allclose([event.t for event in found], other.times, rtol=0, atol=SOLVER)
    np.testing.assert_allclose([event.velocity for event in found], other.speeds, rtol=0, atol=SOLVER)
    np.testing.assert_allclose([*sol.x1, *sol.v1], other.end, rtol=0, atol=SOLVER)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["duffing_oscillator", "impacting_pendulum"])
def test_a_sweep_of_the_frequency_of_the_load_is_what_another_solver_says(name):
    system = getattr(vx.models, name)(frequency=1.0, **DRIVEN[name])
    frequencies = {"forcing.frequency": FREQUENCIES}
    ds = vx.sweep(system, frequencies, transient=2, record=2, x0=[-1.0], progress=False)
    assert (ds.result == 0).all()
    for i, frequency in enumerate(FREQUENCIES):
        period = 2 * np.pi / frequency
        other = flown(DRIVEN[name] | {"frequency": frequency}, -1.0, 4 * period)
        late = other.times > 2 * period
        assert int(ds.num_impacts[i].sum()) == late.sum() > 0
        speeds = ds.impact_velocity[i].dropna("impact")
        np.testing.assert_allclose(speeds, other.speeds[late], rtol=0, atol=SOLVER)
        np.testing.assert_allclose([*ds.x[i], *ds.v[i]], other.end, rtol=0, atol=SOLVER)


# Derivatives


TOP, SPAN = 1.2, 10.0


@jax.jit
@jax.jacfwd
def slopes(system: vx.ImpactSystem) -> jax.Array:
    """Derivatives of the last state and the first two impact times by all numbers of the machine."""
    sol = vx.simulate(system, 0.0, SPAN, [-TOP], max_events=16)
    return jnp.concatenate([sol.x1, sol.v1, sol.events.t[:2]])


@pytest.mark.slow
@pytest.mark.parametrize("model", [DUFFING, PENDULUM], ids=lambda m: m.parameter)
def test_derivatives_of_a_free_machine_are_those_of_elliptic_functions(model):
    case = Case(model, 1.3, 0.2, 0.8, TOP)
    found = slopes(case.system)
    # The strength of the weight is the square of the frequency.
    force = found.force.stiffness if model is DUFFING else found.force.strength * 2 * case.value
    [stop] = found.stops

    def by(field: str) -> list[float]:
        def end(shift: mpf) -> mpmath.matrix:
            there = case._replace(**{field: getattr(case, field) + shift})
            return mpmath.matrix(free_end(*there.exact(), SPAN))

        h = mpf(10) ** -8
        return [float(slope) for slope in (end(h) - end(-h)) / (2 * h)]

    with mp.workdps(DIGITS):
        exact = [by(field) for field in ("value", "position", "restitution")]
    np.testing.assert_allclose([force, stop.position, stop.restitution], exact, rtol=SLOPES, atol=SLOPES)


@pytest.mark.slow
def test_the_derivative_of_a_driven_machine_by_its_cubic_stiffness_is_that_of_another_solver():
    values = DRIVEN_DUFFING | {"frequency": 0.9}
    found = slopes(vx.models.duffing_oscillator(**values)).force.stiffness
    # Both errors, the solver's 1e-13 over h and h^4 of curvature, are below 1e-9.
    h = 3e-4

    def shifted(steps: int) -> np.ndarray:
        other = flown(values | {"cubic_stiffness": values["cubic_stiffness"] + steps * h}, -TOP, SPAN)
        return np.append(other.end, other.times[:2])

    differences = (8 * (shifted(1) - shifted(-1)) - (shifted(2) - shifted(-2))) / (12 * h)
    np.testing.assert_allclose(found, differences, rtol=SLOPES, atol=SLOPES)


# Forces


def test_the_forces_act_on_each_of_several_masses():
    x = jnp.array([0.5, -2.0])
    each = vx.models.CubicSpring([2.0, 0.25])(jnp.array(0.0), x, x, None)
    np.testing.assert_array_equal(each, [-0.25, 2.0])
    all_alike = vx.models.PendulumWeight(3.0)(jnp.array(0.0), x, x, None)
    np.testing.assert_allclose(all_alike, -3.0 * np.sin([0.5, -2.0]), rtol=1e-15)
