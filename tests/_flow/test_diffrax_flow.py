"""Nonlinear machines and their flow: events, derivatives, batches.

Linear machines are the first check: by diffrax they must have their exact motion. The rest is checked against
quadratures and differences that are independent of the engine.
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from helpers import load_scene, log_of, paired
from problems import one_mass

import vijax as vx
from vijax._flow.modes import modal_flow
from vijax._hybrid.sticking_region import StickingRegion

pytestmark = pytest.mark.thorough

# Some hundred steps of 1e-10 each.
SOLVER = 1e-8
# An error of 1e-11 in position moves a light impact, or the zero of a slowly falling force, by more.
LIGHT = 1e-3


PID = diffrax.PIDController(rtol=1e-9, atol=1e-9)


class Cubic(eqx.Module):
    """A hardening spring."""

    k3: jax.Array

    def __call__(self, t, x, v, args):
        return -self.k3 * x**3


def duffing(k3: float, *, r: float = 1.0, c: float = 0.0, amplitude: float = 0.0) -> vx.ImpactSystem:
    load = vx.Harmonic([amplitude], 0.9 if amplitude else 0.0)
    return vx.ImpactSystem([1.0], [[c]], [[1.0]], load, [vx.Stop(0, 0.5, "upper", r)], Cubic(jnp.array(k3)))


# Linear machines


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_b_om020", "paper_b_om030", "paper_b_om140"])
def test_chatter_and_sticking_end_in_the_events_of_the_exact_motion(name):
    scene = load_scene(name)
    sol = vx.simulate(scene.system, scene.t0, scene.t1, scene.x0, scene.v0, flow=vx.DiffraxFlow())
    for expected, found in paired(scene.events, log_of(sol)):
        if expected.kind != "impact" or abs(expected.velocity) > LIGHT:
            assert abs(found.t - expected.t) < SOLVER
    np.testing.assert_allclose(sol.x1, scene.x1, rtol=0, atol=SOLVER)
    np.testing.assert_allclose(sol.v1, scene.v1, rtol=0, atol=SOLVER)
    times = jnp.linspace(scene.t0, scene.t1, 50)
    exact = vx.simulate(scene.system, scene.t0, scene.t1, scene.x0, scene.v0)
    np.testing.assert_allclose(sol.evaluate(times)[0], exact.evaluate(times)[0], rtol=0, atol=SOLVER)


def driven(position: float = 0.8) -> vx.ImpactSystem:
    return one_mass(c=0.1, amplitude=0.5, frequency=0.7, stops=(vx.Stop(0, position, "upper", 0.8),))


@pytest.fixture(scope="module")
def near_grazing() -> tuple[np.ndarray, vx.Solution, vx.Solution]:
    """Stops near the highest point of a motion: the excess over them, the exact motions and those by diffrax."""
    free = vx.simulate(driven(100.0), 0.0, 20.0)
    times = np.linspace(0.0, 20.0, 20001)
    x, v = (np.asarray(a)[:, 0] for a in free.evaluate(times))
    top = int(np.argmax(x))
    # Maximum of the parabola at the highest sample.
    highest = float(x[top] + v[top] ** 2 / 2 / (x[top] + 0.1 * v[top] - 0.5 * np.cos(0.7 * times[top])))
    excess = np.concatenate([s * 10.0 ** -np.arange(2, 9) for s in (1.0, -1.0)])

    def run(flow, excess):
        system = eqx.tree_at(lambda s: s.stops[0].position, driven(), highest - excess)
        return vx.simulate(system, 0.0, times[top] + 0.5, flow=flow, throw=False)

    flow = vx.DiffraxFlow(diffrax.Dopri8(), PID)
    exact, found = (jax.vmap(lambda e, f=f: run(f, e))(jnp.asarray(excess)) for f in (vx.TaylorFlow(), flow))
    return excess, exact, found


@pytest.mark.slow
def test_near_grazing_impacts_are_found_and_near_misses_are_none(near_grazing):
    _, exact, found = near_grazing
    assert exact.num_events.tolist() == [1] * 7 + [0] * 7
    assert found.num_events.tolist() == exact.num_events.tolist()


@pytest.mark.slow
def test_a_near_miss_costs_a_bounded_number_of_steps(near_grazing):
    _, exact, found = near_grazing
    assert int(jnp.max(found.num_steps)) < 2 * int(jnp.max(exact.num_steps)) + 100


@pytest.mark.slow
def test_the_error_falls_with_the_order_of_the_solver():
    flow = lambda dt: vx.DiffraxFlow(diffrax.Tsit5(), diffrax.ConstantStepSize(), dt0=dt)  # noqa: E731
    exact = vx.simulate(driven(), 0.0, 20.0)
    steps, errors, ends = [0.2, 0.1, 0.05], [], []
    for dt in steps:
        sol = vx.simulate(driven(), 0.0, 20.0, flow=flow(dt))
        ends.append(sol.x1.tolist())
        assert int(sol.num_events) == int(exact.num_events) >= 2
        gaps = jnp.abs(sol.events.t - exact.events.t)[: int(exact.num_events)]
        errors.append(max(float(jnp.max(gaps)), float(jnp.abs(sol.x1 - exact.x1)[0])))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 4.5).all(), (errors, orders)
    assert errors[-1] < 1e-6
    together = jax.vmap(lambda dt: vx.simulate(driven(), 0.0, 20.0, flow=flow(dt)).x1)(jnp.array(steps))
    np.testing.assert_allclose(together, ends, rtol=1e-12)


# Forces


@pytest.mark.slow
def test_an_undamped_cubic_spring_bounces_with_the_period_of_a_quadrature():
    k3, position, top = 2.5, 0.5, -1.2
    potential = lambda x: x * x / 2 + k3 * x**4 / 4  # noqa: E731
    energy = potential(top)
    # x = top + u^2 removes the singularity at the turning point.
    rest = lambda u: 2 * u / np.sqrt(2 * (energy - potential(top + u * u)))  # noqa: E731
    half, _ = scipy.integrate.quad(rest, 0, np.sqrt(position - top), epsabs=0, epsrel=1e-13)
    sol = vx.simulate(duffing(k3), 0.0, 20.0, [top], [0.0])
    n = int(sol.num_events)
    assert n >= 8
    np.testing.assert_allclose(sol.events.t[:n], half * (1 + 2 * np.arange(n)), rtol=SOLVER)
    speed = np.sqrt(2 * (energy - potential(position)))
    np.testing.assert_allclose(sol.events.velocity_minus[:n], speed, rtol=SOLVER)
    assert 0 <= int(sol.num_rejected) < int(sol.num_steps)


def shaken(t, x, v, args):
    amplitude, frequency = args
    return jnp.stack([amplitude * jnp.cos(frequency * t), 0.0 * t])


@pytest.mark.slow
def test_a_load_written_as_a_force_chatters_sticks_and_is_let_go_as_the_load():
    linear = vx.models.wagg_bishop_b(0.2)
    quiet = eqx.tree_at(lambda s: s.forcing.amplitude, linear, jnp.zeros(2))
    system = vx.ImpactSystem(
        *(getattr(quiet, f) for f in ("mass", "damping", "stiffness", "forcing", "stops")), shaken
    )
    sol = vx.simulate(system, 0.0, 80.0, args=(0.5, 0.2))
    exact = vx.simulate(linear, 0.0, 80.0)
    assert (sol.events.kind == exact.events.kind).all()
    assert {vx.IMPACT, vx.STICK, vx.RELEASE} < set(sol.events.kind.tolist())
    heavy = jnp.abs(exact.events.velocity_minus) > LIGHT
    np.testing.assert_allclose(sol.events.t[heavy], exact.events.t[heavy], rtol=0, atol=SOLVER)
    np.testing.assert_allclose(sol.x1, exact.x1, rtol=0, atol=SOLVER)
    times = jnp.linspace(0.0, 80.0, 60)
    np.testing.assert_allclose(sol.contact_force(times), exact.contact_force(times), rtol=0, atol=1e-6)


def test_a_short_push_is_not_stepped_over_where_steps_are_bounded():
    push = lambda t, x, v, args: jnp.exp(-(((t - 5.0) / 0.01) ** 2)) + 0.0 * x  # noqa: E731
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 0.0), (), push)
    flow = vx.DiffraxFlow(stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-12, dtmax=0.05))
    sol = vx.simulate(system, 0.0, 10.0, flow=flow)
    np.testing.assert_allclose(sol.v1, 0.01 * np.sqrt(np.pi), rtol=SOLVER)


@pytest.mark.slow
def test_a_force_that_is_not_finite_ends_its_own_lane_alone():
    def run(k3):
        sol = vx.simulate(duffing(k3), 0.0, 20.0, [-1.2], [0.0], throw=False)
        return sol.num_events, sol.result

    num_events, result = jax.jit(jax.vmap(run))(jnp.array([2.5, jnp.nan]))
    assert int(num_events[0]) >= 8
    assert (result == vx.RESULTS.successful).tolist() == [True, False]
    assert (result == vx.RESULTS.non_finite).tolist() == [False, True]


# Derivatives


def end_and_impacts(k3, position, speed):
    system = duffing(k3, r=0.7, c=0.1, amplitude=0.6)
    system = eqx.tree_at(lambda s: s.stops[0].position, system, position)
    sol = vx.simulate(system, 0.0, 15.0, [-1.0], speed[None], max_events=8)
    return jnp.concatenate([sol.x1, sol.v1, sol.events.t[:2]])


@pytest.mark.slow
def test_derivatives_are_those_of_differences_and_the_same_both_ways():
    point = (jnp.array(1.5), jnp.array(0.5), jnp.array(0.2))
    forward = jax.jit(jax.jacfwd(end_and_impacts, (0, 1, 2)))(*point)
    value = jax.jit(jax.vmap(end_and_impacts))
    weights = jnp.arange(1.0, 5.0)
    reverse = jax.jit(jax.grad(lambda *p: jnp.sum(weights * end_and_impacts(*p)), (0, 1, 2)))(*point)
    h = 1e-3 * np.array([-2, -1, 1, 2])
    for i in range(3):
        lanes = [jnp.full(4, p) + (h if j == i else 0.0) for j, p in enumerate(point)]
        difference = np.array([1, -8, 8, -1]) @ np.asarray(value(*lanes)) / 12e-3
        # Errors of the differences: spacing to the fourth, and the solver's error over the spacing.
        np.testing.assert_allclose(forward[i], difference, rtol=2e-6, atol=2e-6)
        np.testing.assert_allclose(reverse[i], jnp.sum(weights * forward[i]), rtol=1e-10, atol=1e-10)


@pytest.mark.slow
def test_the_monodromy_matrix_of_a_cubic_spring_is_a_saltation_between_two_flights():
    system = duffing(1.5, r=0.7, c=0.1, amplitude=0.6)
    start = jnp.array([-1.0, 0.2])
    sol = vx.simulate(system, 0.0, system.forcing.period, start[:1], start[1:])
    assert int(sol.num_events) == 1
    t, before, after = sol.events.t[0], sol.events.velocity_minus[0], sol.events.velocity_plus[0]

    def field(s, y):
        return np.array([y[1], 0.6 * np.cos(0.9 * s) - 0.1 * y[1] - y[0] - 1.5 * y[0] ** 3])

    def variation(s, z):
        jacobian = np.array([[0, 1], [-1 - 4.5 * z[0] ** 2, -0.1]])
        return np.concatenate([field(s, z[:2]), (jacobian @ z[2:].reshape(2, 2)).ravel()])

    def flight(t0, t1, y):
        z = np.concatenate([y, np.eye(2).ravel()])
        return scipy.integrate.solve_ivp(variation, (t0, t1), z, "DOP853", rtol=1e-12, atol=1e-13).y[2:, -1]

    saltation = vx.saltation_matrix(system, t, [0.5], [before], 0)
    first = flight(0.0, float(t), np.asarray(start)).reshape(2, 2)
    second = flight(float(t), float(system.forcing.period), np.array([0.5, float(after)])).reshape(2, 2)
    matrix = vx.monodromy_matrix(system, start[:1], start[1:])
    np.testing.assert_allclose(matrix, second @ saltation @ first, rtol=0, atol=10 * SOLVER)


# Sweeps


@pytest.mark.slow
def test_a_sweep_of_a_machine_with_a_force_is_its_trajectories():
    system = duffing(1.5, r=0.7, c=0.1, amplitude=0.6)
    frequencies = np.array([0.8, 0.9, 1.3])
    ds = vx.sweep(system, {"forcing.frequency": frequencies}, transient=2, record=3, progress=False)
    assert (ds.result == 0).all()
    for i, frequency in enumerate(frequencies):
        one = eqx.tree_at(lambda s: s.forcing.frequency, system, jnp.asarray(frequency))
        period = float(one.forcing.period)
        sol = vx.simulate(one, 0.0, 5 * period)
        late = (sol.events.kind == vx.IMPACT) & (sol.events.t > 2 * period)
        np.testing.assert_allclose(ds.x[i], sol.x1, rtol=0, atol=SOLVER)
        assert int(ds.num_impacts[i].sum()) == int(late.sum())
        times = ds.impact_time[i].dropna("impact")
        np.testing.assert_allclose(times, np.asarray(sol.events.t)[late] - 2 * period, rtol=0, atol=1e-7)


def solved(t, x, v, args):
    """A cubic spring by functions that a kernel without libraries cannot contain."""
    return -jnp.linalg.solve(args["compliance"] * jnp.eye(1), jnp.sort(x**3))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The force uses `sort`")
def test_a_sweep_with_a_force_that_calls_libraries_is_carried_along_and_kept(tmp_path):
    plain = duffing(1.5, r=0.7, c=0.1, amplitude=0.6)
    frequencies = np.array([0.8, 0.9, 1.3])

    def run(force, compliance):
        system, args = vx.ImpactSystem(**(vars(plain) | {"force": force})), {"compliance": compliance}
        return vx.sweep(
            system, {"forcing.frequency": frequencies}, transient=2, record=3, carry="up", args=args,
            store=tmp_path / "kept", progress=False,
        )  # fmt: skip

    ds = run(solved, 1 / 1.5)
    assert (ds.result == 0).all()
    np.testing.assert_array_equal(ds.section_x.isel(period=-1), ds.x)
    last = eqx.tree_at(
        lambda s: s.forcing.frequency, duffing(1.5, r=0.7, c=0.1, amplitude=0.6), jnp.asarray(1.3)
    )
    end = vx.simulate(last, 0.0, 5 * float(last.forcing.period), ds.x[1].values, ds.v[1].values).x1
    np.testing.assert_allclose(ds.x[2], end, rtol=0, atol=SOLVER)
    np.testing.assert_array_equal(run(solved, 1 / 1.5).x, ds.x)
    with pytest.raises(ValueError, match=r"`force_parameters\.args\.compliance` is 0\.66"):
        run(solved, 1 / 1.6)
    with pytest.raises(ValueError, match=r"`system\.force\.path` is test_diffrax_flow:solved there"):
        run(lambda t, x, v, args: -x, 1 / 1.5)
    assert float(vx.system_of(ds).force.args["compliance"]) == 1 / 1.5


# Bad input


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: vx.simulate(duffing(1.0), 0.0, 1.0, flow=modal_flow(driven(), can_stick=False)),
            "exact for linear machines alone",
        ),
        (lambda: vx.simulate(driven(), 0.0, 1.0, args=1.0), "the machine has no `force`"),
        (lambda: vx.sticking_region(duffing(1.0), 0), "known for linear machines alone"),
        (lambda: StickingRegion(vx.simulate(duffing(1.0), 0.0, 0.0).machine, (0,)), "known for linear"),
        (lambda: vx.simulate(duffing(1.0), 0.0, 1.0, args="stiff"), "made of real numbers"),
        (lambda: one_with(3.0), "must be a function force"),
        (lambda: vx.simulate(one_with(lambda t, x, v, args: x[0]), 0.0, 1.0), "one force per mass"),
        (lambda: vx.DiffraxFlow(diffrax.SemiImplicitEuler()), "Runge-Kutta"),
        (lambda: vx.DiffraxFlow(diffrax.KenCarp4()), "for one term"),
        (lambda: vx.DiffraxFlow(diffrax.Kvaerno5()), "needs tolerances of its own"),
        (lambda: vx.DiffraxFlow(stepsize_controller=diffrax.ConstantStepSize()), "`dt0` must be given"),
        (
            lambda: vx.DiffraxFlow(stepsize_controller=diffrax.ClipStepSizeController(PID)),
            "must choose steps",
        ),
    ],
)
def test_wrong_use_says_what_to_do(call, sentence):
    with pytest.raises(ValueError, match=sentence):
        call()


def one_with(force) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([0.0], 0.0), (), force)


@pytest.mark.slow
def test_the_monodromy_matrix_of_a_linear_machine_by_diffrax_is_the_exact_one():
    machine = vx.models.wagg_bishop_a(0.8), [0.1, 0.2], [0.3, 0.0]
    by_steps = vx.monodromy_matrix(*machine, flow=vx.DiffraxFlow(), max_steps=1000)
    np.testing.assert_allclose(by_steps, vx.monodromy_matrix(*machine), rtol=0, atol=SOLVER)
