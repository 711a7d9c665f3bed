"""Lyapunov exponents against multipliers, the exact loss of volume, a published value, and each other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._execution.points import LaneInput, points_of_lanes
from vijax._execution.runner import Counts
from vijax._execution.settings import DEFAULT_SETTINGS
from vijax._execution.threads import Threads
from vijax._flow.choose import choose_flow
from vijax._sweep.grid import base_of
from vijax._trajectory import lyapunov_loop
from vijax._trajectory.tangent_frame import completed

FREQUENCY = "forcing.frequency"
# Frequencies of case (b): a chattering orbit, one with four real multipliers, and chaos.
CHATTERING, ORDERED, CHAOTIC = 0.25, 5 / 6, 2.0


def loss_of_volume(system: vx.ImpactSystem, num_impacts: np.ndarray, time: float) -> float:
    """Exact sum of the exponents of a motion without sticking."""
    damping = np.trace(np.asarray(system.damping) / np.asarray(system.mass)[:, None])
    restitution = np.array([float(stop.restitution) for stop in system.stops])
    return -damping + 2 * float(num_impacts @ np.log(restitution)) / time


@pytest.fixture(scope="module")
def swept():
    values = [CHATTERING, 0.8, 1.1, 1.7, CHAOTIC]
    return vx.sweep(
        vx.models.wagg_bishop_b(1.0),
        {FREQUENCY: values},
        v0=[0.0, 0.05],
        record=100,
        max_impacts=0,
        lyapunov=True,
        progress=False,
    )


@pytest.mark.slow
def test_their_sum_is_the_loss_of_volume_whatever_the_motion(swept):
    free = swept.isel({FREQUENCY: slice(1, None)})
    assert (free.num_sticks == 0).all()
    for k, frequency in enumerate(free[FREQUENCY].values):
        point = free.isel({FREQUENCY: k})
        time = 100 * float(point.forcing_period)
        exact = loss_of_volume(vx.models.wagg_bishop_b(frequency), point.num_impacts.values, time)
        # Impacts at the edge of a period are counted on the same side of it in both.
        assert float(point.lyapunov_exponents.sum()) == pytest.approx(exact, rel=1e-11)


@pytest.mark.slow
def test_what_sticks_forgets_two_directions_for_good(swept):
    point = swept.sel({FREQUENCY: CHATTERING})
    exponents, error = point.lyapunov_exponents.values, point.lyapunov_error.values
    assert point.num_sticks[0] == 100
    assert np.isneginf(exponents).tolist() == [False, False, True, True]
    assert (error[2:] == 0).all()
    assert (error[:2] > 0).all()
    orbit = vx.periodic_orbit(vx.models.wagg_bishop_b(CHATTERING), point.x.values, point.v.values)
    rates = np.log(abs(np.asarray(orbit.multipliers[:2]))) / float(orbit.period)
    assert (abs(exponents[:2] - rates) < 4 * error[:2]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "stop", [vx.Stop(0, 0.0, "upper", 0.8), vx.Contact({0: 1.0}, 0.0, 0.8)], ids=["stop", "contact"]
)
def test_a_stick_while_the_motion_settles_leaves_no_trace(stop):
    # At rest on the stop, and close to it with a chatter: the mass is pressed until its release, and never sticks again.
    load = vx.Harmonic([1.0], 0.7)
    system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, [stop])
    free = vx.lyapunov_exponents(system, [-0.5], transient=300, num_periods=100, progress=False)
    counts = {"transient": 300, "record": 100, "progress": False}
    for start in ([0.0], [-1e-4]):
        found = vx.lyapunov_exponents(system, start, transient=300, num_periods=100, progress=False)
        np.testing.assert_allclose(found, free, atol=1e-6)
        swept = vx.sweep(system, {FREQUENCY: [0.7]}, x0=start, lyapunov=True, **counts)
        np.testing.assert_allclose(swept.lyapunov_exponents[0], free, atol=1e-6)


def test_erased_vectors_are_replaced_by_perpendicular_ones():
    rng = np.random.default_rng(0)
    whole = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    for erased in ([], [0], [1, 4], [0, 2, 5], list(range(6))):
        frame = whole.copy()
        frame[erased] = 0
        found = np.asarray(completed(jnp.asarray(frame)))
        np.testing.assert_allclose(found @ found.T, np.eye(6), atol=1e-14)
        kept = [k for k in range(6) if k not in erased]
        assert (found[kept] == whole[kept]).all()


@pytest.mark.thorough
def test_chaos_grows_and_a_cycle_does_not(swept):
    largest = swept.lyapunov_exponents[:, 0].values
    assert (np.diff(swept.lyapunov_exponents.values[1:], axis=1) <= 0).all()
    assert largest[-1] > 0.15
    assert (largest[:1] < 0).all()


@pytest.mark.slow
def test_a_trajectory_has_the_exponents_of_its_point_in_a_sweep(swept):
    """The loop of one trajectory and that over lanes are compiled separately."""
    system = vx.models.wagg_bishop_b(0.8)
    found, error = vx.lyapunov_exponents(system, v0=[0.0, 0.05], num_periods=100, with_error=True)
    point = swept.sel({FREQUENCY: 0.8})
    np.testing.assert_allclose(found, point.lyapunov_exponents, rtol=0, atol=1e-10)
    np.testing.assert_allclose(error, point.lyapunov_error, rtol=1e-6, atol=1e-10)


@pytest.mark.thorough
def test_a_settled_cycle_has_the_exponents_of_its_multipliers():
    """Multipliers come from the equations of the closed cycle, not from steps."""
    system = vx.models.wagg_bishop_b(ORDERED)
    end = vx.simulate(system, 0.0, 200 * float(system.forcing.period), v0=[0.0, 0.05], max_events=2048)
    orbit = vx.periodic_orbit(system, end.x1, end.v1, 2)
    assert (abs(np.asarray(orbit.multipliers).imag) == 0).all()
    rates = np.log(abs(np.asarray(orbit.multipliers))) / float(orbit.period)
    exponents = vx.lyapunov_exponents(system, orbit.x0, orbit.v0, transient=120, num_periods=120)
    np.testing.assert_allclose(exponents, rates, rtol=1e-10)


@pytest.mark.thorough
def test_an_undamped_oscillator_has_the_exponent_found_by_others():
    """r = 0.8, W = 2.8, stop at rest: an independent code has 0.1415 +- 0.0002."""
    system = vx.models.impact_oscillator(2.8)
    found, error = vx.lyapunov_exponents(system, num_periods=100_000, with_error=True, progress=False)
    assert abs(float(found[0]) - 0.1415) < 3 * float(error[0]) < 6e-3


@pytest.mark.slow
def test_where_forces_switch_their_sum_is_that_of_the_multipliers():
    """A mass that slides both ways, and pushes on a preloaded cushion: at both events its acceleration jumps."""
    system = vx.ImpactSystem(
        [0.184],
        [[0.132]],
        [[0.7]],
        vx.Harmonic([0.624], 2.14, [5.34]),
        [vx.CompliantStop(0, -0.474, "lower", stiffness=24.8, preload=0.05)],
        friction=[vx.Friction({0: 1.0}, 0.123)],
    )
    orbit = vx.periodic_orbit(system, [0.27], [0.95])
    log = vx.simulate(system, 0.0, system.forcing.period, orbit.x0, orbit.v0).events.kind
    assert {vx.TURN, vx.CLOSE} <= set(log.tolist())
    exact = np.log(np.abs(orbit.multipliers)).sum() / float(system.forcing.period)
    exponents = vx.lyapunov_exponents(system, orbit.x0, orbit.v0, transient=0, num_periods=8, progress=False)
    assert float(np.sum(exponents)) == pytest.approx(exact, rel=1e-10)


@pytest.mark.slow
def test_the_error_is_the_scatter_of_starts():
    starts = np.linspace(-1.0, -0.5, 200)
    ds = vx.sweep(
        vx.models.impact_oscillator(2.8),
        {"x0[0]": starts},
        record=1000,
        max_impacts=0,
        lyapunov=True,
        progress=False,
    )
    exponents = ds.lyapunov_exponents[:, 0]
    assert float(exponents.std()) == pytest.approx(float(ds.lyapunov_error[:, 0].mean()), rel=0.25)


@pytest.mark.slow
def test_a_long_period_is_told_from_chaos_before_it_repeats():
    """At 2.73325 the motion repeats after 42 periods, too few of which are in a record of 60; at 2.8 it never does."""
    ds = vx.sweep(
        vx.models.impact_oscillator(2.8),
        {FREQUENCY: [2.73325, 2.8]},
        transient=4000,
        record=1200,
        lyapunov=True,
        progress=False,
    )
    short, long = vx.classify(ds, last=60), vx.classify(ds)
    names = short.motion.flag_meanings.split()
    assert [names[k] for k in short.motion.values] == ["not_settled", "non_periodic"]
    assert [names[k] for k in long.motion.values] == ["periodic", "non_periodic"]
    assert long.num_periods.values.tolist() == [42, 0]


@pytest.mark.thorough
@pytest.mark.parametrize("restitution", [1.0, 0.0])
def test_what_loses_nothing_keeps_volume_and_what_loses_all_forgets(restitution):
    system = vx.models.impact_oscillator(2.8, restitution=restitution)
    found = np.asarray(vx.lyapunov_exponents(system, x0=[-0.7], num_periods=500, progress=False))
    if restitution == 1:
        assert found.sum() == pytest.approx(0, abs=1e-12)
    else:
        assert np.isneginf(found[1])


@pytest.mark.slow
@pytest.mark.parametrize("stop", [vx.Stop(0, 0.0, "upper", 0.7), vx.Contact({0: 1.0}, 0.0, 0.7)])
@pytest.mark.parametrize("friction", [(), [vx.Friction(0, 0.05)]])
def test_what_is_pressed_to_a_stop_from_the_start_has_no_directions_of_its_own(stop, friction):
    """The first mass stays on its stop; the exponents of the second are those of its own oscillation."""
    load = vx.Harmonic([0.0, 0.1], 1.0, mean=[3.0, 0.0])
    damping, stiffness = [[0.1, 0.0], [0.0, 0.2]], [[2.0, -1.0], [-1.0, 2.0]]
    system = vx.ImpactSystem([1.0, 2.0], damping, stiffness, load, [stop], friction=friction)
    for transient in (0, 5):
        found = vx.lyapunov_exponents(system, transient=transient, num_periods=20, progress=False)
        assert np.isneginf(found[2:]).all()
        assert float(found[0] + found[1]) == pytest.approx(-0.2 / 2, rel=1e-10)
    ds = vx.sweep(system, {FREQUENCY: [0.9, 1.0]}, transient=0, record=20, lyapunov=True, progress=False)
    assert np.isneginf(ds.lyapunov_exponents.values[:, 2:]).all()
    np.testing.assert_allclose(ds.lyapunov_exponents[:, :2].sum("exponent"), -0.1, rtol=1e-10)


@pytest.mark.slow
def test_friction_that_sticks_from_the_start_holds_any_position_but_no_velocity():
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.1], 1.0), friction=[vx.Friction(0, 5.0)])
    for transient in (0, 5):
        found = vx.lyapunov_exponents(system, transient=transient, num_periods=20, progress=False)
        np.testing.assert_array_equal(found, [0, -np.inf])


@pytest.mark.slow
def test_it_is_compiled_and_batched_like_any_function(swept):
    def of(frequency):
        system = vx.models.wagg_bishop_b(frequency)
        return vx.lyapunov_exponents(system, [0.0, 0.0], [0.0, 0.05], num_periods=100)

    values = jnp.array([CHATTERING, 0.8])
    expected = swept.sel({FREQUENCY: values}).lyapunov_exponents
    np.testing.assert_allclose(jax.jit(of)(0.8), expected[1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(jax.vmap(of)(values), expected, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_spring_that_hardens_obeys_liouville_as_far_as_its_solver_does():
    system = vx.models.duffing_oscillator(1.2)
    found = vx.lyapunov_exponents(system, transient=20, num_periods=50, progress=False)
    sol = vx.simulate(system, 0.0, 70 * float(system.forcing.period), max_events=4096)
    time = 50 * float(system.forcing.period)
    counted = (sol.events.kind == vx.IMPACT) & (sol.events.t > 20 * float(system.forcing.period))
    assert float(np.sum(found)) == pytest.approx(
        loss_of_volume(system, np.array([counted.sum()]), time), rel=1e-5
    )


@pytest.mark.slow
def test_contacts_between_masses_obey_liouville_too():
    system = vx.models.impact_damper(0.7)
    ds = vx.sweep(system, {FREQUENCY: [0.7, 1.2]}, record=50, max_impacts=0, lyapunov=True, progress=False)
    inverse_mass = np.linalg.inv(np.diag(np.asarray(system.mass)))
    damping = np.trace(inverse_mass @ np.asarray(system.damping))
    restitution = np.array([float(stop.restitution) for stop in system.stops])
    for k in range(2):
        point = ds.isel({FREQUENCY: k})
        assert (point.num_sticks == 0).all()
        time = 50 * float(point.forcing_period)
        exact = -damping + 2 * float(point.num_impacts.values @ np.log(restitution)) / time
        assert float(point.lyapunov_exponents.sum()) == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
def test_two_thousand_random_machines_lose_the_volume_that_they_should():
    rng, count = np.random.default_rng(1), 2000

    def random_matrices(least: float) -> np.ndarray:
        a = rng.normal(size=(count, 2, 2))
        return a @ a.transpose(0, 2, 1) + least * np.eye(2)

    damping = 0.05 * random_matrices(0.0) * rng.choice([0.1, 1, 10], (count, 1, 1))
    mass, restitution = rng.uniform(0.3, 3, (count, 2)), rng.uniform(0.3, 1, (count, 2))
    values = {
        "mass[0]": mass[:, 0],
        "mass[1]": mass[:, 1],
        "damping": damping,
        "stiffness": random_matrices(0.1),
        FREQUENCY: rng.uniform(0.5, 4, count),
        "stops[0].restitution": restitution[:, 0],
        "stops[1].restitution": restitution[:, 1],
    }
    base = base_of(vx.models.wagg_bishop_b(1.0), None, None)
    points = points_of_lanes(base, values)
    full = [np.zeros((2, count))] * 2
    points = LaneInput(jax.tree.map(np.asarray, points.system), *full)
    flow = choose_flow(points.system, can_stick=True)
    counts = Counts(50, 100, 0, None, can_stick=True, lyapunov=True)
    found = Threads(flow, counts, DEFAULT_SETTINGS).run(points, np.arange(count), lambda _: None)
    period = 2 * np.pi / values[FREQUENCY]
    exponents, _ = lyapunov_loop.exponents(lyapunov_loop.in_blocks(found.ends["section_growth"]), 100, period)
    erased = np.isneginf(exponents).sum(axis=0)
    stuck = found.ends["num_sticks"].sum(axis=0) > 0
    assert set(np.unique(erased)) == {0, 2}
    assert ((erased == 2) == stuck).all()
    free = erased == 0
    by_impacts = 2 * (np.log(restitution.T) * found.ends["num_impacts"]).sum(axis=0) / (100 * period)
    exact = by_impacts - (damping[:, [0, 1], [0, 1]] / mass).sum(axis=1)
    np.testing.assert_allclose(exponents.sum(axis=0)[free], exact[free], rtol=1e-12, atol=1e-13)


def test_bad_input_is_refused_in_a_sentence():
    system = vx.models.wagg_bishop_b(0.8)
    with pytest.raises(ValueError, match="num_periods` must be a whole number, 1 or more"):
        vx.lyapunov_exponents(system, num_periods=0)
    with pytest.raises(ValueError, match="`x0` must have shape"):
        vx.lyapunov_exponents(system, x0=[0.0], v0=[0.0, 0.0])
    with pytest.raises(ValueError, match="past `stops"):
        vx.lyapunov_exponents(system, x0=[-9.0, 0.0])
    with pytest.raises(ValueError, match="`record` be 1 or more"):
        vx.sweep(system, {FREQUENCY: [0.8]}, record=0, lyapunov=True, progress=False)


@pytest.mark.thorough
def test_a_motion_that_does_not_get_there_raises_or_is_nan():
    system = vx.models.wagg_bishop_b(0.8)
    with pytest.raises(vx.SimulationError, match="max_steps_reached"):
        vx.lyapunov_exponents(system, num_periods=100, max_steps=50)
    found, error = vx.lyapunov_exponents(system, num_periods=100, max_steps=50, throw=False, with_error=True)
    assert np.isnan(found).all()
    assert np.isnan(error).all()
