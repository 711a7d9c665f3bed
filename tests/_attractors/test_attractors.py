"""Impact maps, stroboscopic sections and kinds of motion of machines: the paper's, and some solved exactly."""

import jax
import numpy as np
import pytest
import xarray as xr
from periodic_orbits import ORBITS, periodic_orbit
from problems import sticking_orbit

import vijax as vx

FREQUENCY = "forcing.frequency"
# Frequencies for which the masses hit almost together; the paper names 0.27 and 0.435 among them.
DOUBLE = [0.27, 0.435]
CASE_A = [0.2, 0.4, 0.8, 1.0, 1.2, 1.4, 1.5, 1.8, *DOUBLE]
# The first two chatter, at more than a hundred steps a period, and settle within a few.
CHATTERING = [0.2, 0.3]
CASE_B = [0.5, 0.715, 0.75, 0.8, 1.1, 1.4, 1.7, 2.0, 2.05, 2.1]
# For each, some starts of the second mass end in one impact a period, and some in chaos.
COEXISTING = (1.7, 2.0, 2.05, 2.1)
# The basins are intertwined: of these, some lead to chaos at each frequency.
TO_PERIODIC, TO_CHAOS = -0.4, (-0.2, -0.05, 0.02, 0.04, 0.05, 0.06, 0.08, 0.09)
# Error of settled motions, after some hundred roundings that are not magnified.
SETTLED = 1e-11
# Error of the end of a chatter, about the duration of the last bounces, which are cut off.
CHATTER_END = 1e-9


def sweep(system: vx.ImpactSystem, values: dict, **options) -> xr.Dataset:
    return vx.sweep(system, values, progress=False, **({"transient": 1000, "record": 20} | options))


def kind(point: xr.Dataset) -> str:
    """Kind of motion in words, from the attributes."""
    names = dict(zip(point.motion.flag_values, point.motion.flag_meanings.split(), strict=True))
    return names[int(point.motion)]


@pytest.fixture(scope="module")
def case_a() -> xr.Dataset:
    return sweep(vx.models.wagg_bishop_a(1.0), {FREQUENCY: CASE_A})


@pytest.fixture(scope="module")
def case_b() -> xr.Dataset:
    return sweep(vx.models.wagg_bishop_b(1.0), {FREQUENCY: CASE_B})


@pytest.fixture(scope="module")
def chattering_b() -> xr.Dataset:
    return sweep(vx.models.wagg_bishop_b(1.0), {FREQUENCY: CHATTERING}, transient=100)


@pytest.fixture(scope="module")
def held_both() -> vx.Solution:
    """Twelve periods of case (b) at 0.2, from rest: both masses chatter and stick in each."""
    system = vx.models.wagg_bishop_b(0.2)
    return vx.simulate(system, 0.0, 12 * system.forcing.period, max_events=2048)


# The paper

TABLE_2 = {
    0.2: ("periodic", 1, (1, 1)),
    0.4: ("periodic", 1, (1, 2)),
    0.8: ("periodic", 1, (1, 1)),
    1.0: ("periodic", 1, (0, 1)),
    1.2: ("non_impacting", 1, (0, 0)),
    1.4: ("non_impacting", 1, (0, 0)),
    1.5: ("periodic", 5, (2, 1)),
    1.8: ("periodic", 2, (1, 0)),
}
TABLE_3 = {
    0.2: ("chattering", 1, (np.inf, np.inf)),
    0.3: ("chattering", 1, (12, np.inf)),
    0.5: ("periodic", 1, (4, 4)),
    0.8: ("periodic", 2, (4, 4)),
    1.1: ("periodic", 2, (2, 3)),
    1.4: ("periodic", 1, (1, 1)),
    1.7: ("periodic", 1, (1, 1)),
}


@pytest.mark.parametrize("frequency", TABLE_2)
def test_case_a_moves_as_table_2_says(case_a, frequency):
    # Corrected: at 1.0 the columns are exchanged; at 1.4 chaos dies out; at 1.5 five periods make a cycle.
    assert_motion(vx.classify(case_a).sel({FREQUENCY: frequency}), TABLE_2[frequency])


@pytest.mark.thorough
@pytest.mark.parametrize("frequency", TABLE_3)
def test_case_b_moves_as_table_3_says(case_b, chattering_b, frequency):
    # Corrected: at 0.3 mass 1 just fails to stick; at 0.8 the two impacts alternate; 1.1 takes two periods.
    ds = chattering_b if frequency in CHATTERING else case_b
    assert_motion(vx.classify(ds).sel({FREQUENCY: frequency}), TABLE_3[frequency])


def assert_motion(point: xr.Dataset, expected: tuple):
    assert (kind(point), int(point.num_periods), tuple(point.num_impacts.values)) == expected


def test_the_speed_of_the_only_impact_of_table_2_at_1_is_that_of_the_second_mass(case_a):
    pairs = vx.impact_map(case_a.sel({FREQUENCY: 1.0}))
    assert (pairs.stop == 1).all()
    np.testing.assert_allclose(pairs.velocity, 0.91691, rtol=0, atol=5e-6)


def test_what_the_paper_calls_chaotic_in_case_a_does_not_repeat_while_it_lasts():
    ds = sweep(vx.models.wagg_bishop_a(1.0), {FREQUENCY: CASE_A}, transient=100)
    point = vx.classify(ds).sel({FREQUENCY: 1.4})
    assert kind(point) == "non_periodic"
    assert int(point.num_periods) == 0
    assert point.recurrence_error > 0.01


@pytest.mark.thorough
def test_chaos_and_a_motion_of_one_impact_a_period_coexist_in_case_b():
    ds = sweep(vx.models.wagg_bishop_b(1.0), {FREQUENCY: COEXISTING, "x0[1]": [TO_PERIODIC, *TO_CHAOS]})
    motions = vx.classify(ds)
    assert motions.motion.dims == (FREQUENCY, "x0[1]")
    for frequency in COEXISTING:
        points = motions.sel({FREQUENCY: frequency})
        assert_motion(points.sel({"x0[1]": TO_PERIODIC}), ("periodic", 1, (1, 1)))
        kinds = [kind(points.sel({"x0[1]": start})) for start in TO_CHAOS]
        # At 2.0 chaos is a transient with a half-life of some 1500 periods: one may already be over.
        assert kinds.count("non_periodic") >= 3, frequency


@pytest.mark.thorough
def test_both_masses_stick_within_one_period(case_b, chattering_b):
    point = vx.classify(chattering_b).sel({FREQUENCY: 0.2})
    period = 2 * np.pi / 0.2
    assert ((point.held_time > 0.1 * period) & (point.held_time < period)).all()
    assert (vx.classify(case_b).sel({FREQUENCY: 0.5}).held_time == 0).all()


@pytest.mark.parametrize("frequency", DOUBLE)
def test_the_double_impacts_of_the_paper_are_found(case_a, frequency):
    motions = vx.classify(case_a)
    assert float(motions.sel({FREQUENCY: frequency}).num_double_impacts) == 1
    # The two impacts are 0.005 apart, and no other impacts at these frequencies are half as close.
    narrow, wide = (vx.classify(case_a, double_impact_within=gap) for gap in (0.0045, 0.006))
    assert float(narrow.sel({FREQUENCY: frequency}).num_double_impacts) == 0
    assert float(wide.sel({FREQUENCY: frequency}).num_double_impacts) == 1
    assert float(wide.num_double_impacts.sel({FREQUENCY: list(TABLE_2)}).sum()) == 0


@pytest.mark.thorough
def test_the_attractor_at_0715_has_three_pieces_that_end_in_three_impacts_a_period(case_b):
    assert kind(vx.classify(case_b).sel({FREQUENCY: 0.715})) == "non_periodic"
    # Few impacts leave gaps inside the pieces that are nearly as large as those between them.
    many = {"transient": 1000, "record": 400, "max_impacts": 4000, "progress": False}
    ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {FREQUENCY: [0.715]}, **many)
    pairs = vx.impact_map(ds.isel({FREQUENCY: 0}), stop=1)
    phases = np.sort(pairs.phase.values[np.isfinite(pairs.phase.values)])
    gaps = np.diff(np.append(phases, phases[0] + 2 * np.pi))
    assert (gaps > 0.2).sum() == 3
    assert_motion(vx.classify(case_b).sel({FREQUENCY: 0.75}), ("periodic", 1, (2, 3)))


# Motions known exactly

STABLE = [name for name, orbit in ORBITS.items() if name.startswith("subharmonic") or "damped" in name]


@pytest.mark.parametrize("name", [*STABLE, "two_periods_focus", "two_periods_node"])
def test_an_orbit_with_its_impact_at_the_end_of_a_period_is_told(name):
    orbit, periods = periodic_orbit(name), ORBITS[name].periods
    x, v = (float(a[0]) for a in (orbit.problem.start.x, orbit.problem.start.v))
    sol = vx.simulate(orbit.problem.system, 0.0, 60 * float(orbit.period) / periods, [x], [v])
    motion = vx.classify(sol)
    assert_motion(motion, ("periodic", periods, (1,)))
    assert float(motion.recurrence_error) < SETTLED
    pairs = vx.impact_map(sol, stop=0)
    np.testing.assert_allclose(pairs.velocity, float(orbit.speed), rtol=SETTLED)
    np.testing.assert_allclose(np.sin(pairs.phase), 0, atol=SETTLED)


def test_the_contraction_is_the_largest_floquet_multiplier():
    # Both multipliers of x'' + x = cos(6 t) with one impact in three periods are 0.4, that is r, for r = 0.4.
    orbit = periodic_orbit("subharmonic_6")
    x, v = (float(a[0]) for a in (orbit.problem.start.x, orbit.problem.start.v))
    sol = vx.simulate(orbit.problem.system, 0.0, 20 * float(orbit.period), [x], [v * (1 + 1e-4)])
    motion = vx.classify(sol)
    assert_motion(motion, ("periodic", 3, (1,)))
    assert float(motion.contraction) == pytest.approx(0.4 ** (1 / 3), rel=1e-3)


@pytest.fixture(scope="module")
def exact_chatter() -> vx.Solution:
    return vx.simulate(sticking_orbit().problem.system, 0.0, 12 * float(sticking_orbit().period))


def test_an_orbit_that_chatters_across_the_end_of_a_period_is_held_as_long_as_it_must(exact_chatter):
    orbit, motion = sticking_orbit(), vx.classify(exact_chatter)
    assert_motion(motion, ("chattering", 1, (np.inf,)))
    expected = float(orbit.release + orbit.period - orbit.end)
    np.testing.assert_allclose(motion.held_time, expected, rtol=0, atol=CHATTER_END)
    held = vx.stroboscopic_section(exact_chatter).held_time
    # The mass sticks from the start to the first release.
    np.testing.assert_allclose(held[0], float(orbit.release), rtol=0, atol=CHATTER_END)
    np.testing.assert_allclose(held[1:], expected, rtol=0, atol=CHATTER_END)


def test_the_impact_map_ends_where_a_chatter_does(exact_chatter):
    orbit, pairs = sticking_orbit(), vx.impact_map(exact_chatter, stop=0)
    num_impacts = np.flatnonzero(np.isnan(pairs.next_velocity))[0] + 1
    assert 15 < num_impacts < 30
    exact = orbit.problem.impacts[:num_impacts]
    np.testing.assert_allclose(pairs.velocity[:num_impacts], [float(i.velocity) for i in exact], atol=SETTLED)
    phases = [float(i.t) / 2 % (2 * np.pi) for i in exact]
    np.testing.assert_allclose(pairs.phase[:num_impacts], phases, atol=SETTLED)
    for name in ("phase", "velocity"):
        ours, following = pairs[name].values[:num_impacts], pairs[f"next_{name}"].values[:num_impacts]
        np.testing.assert_array_equal(following[:-1], ours[1:])
    # The last bounce is not paired with the first impact of the next period.
    assert float(pairs.velocity[num_impacts]) == pytest.approx(float(exact[0].velocity), abs=SETTLED)


# Agreement of sweeps and trajectories


@pytest.mark.thorough
def test_a_sweep_records_the_section_and_the_times_held_of_a_trajectory(held_both):
    whole = sweep(vx.models.wagg_bishop_b(1.0), {FREQUENCY: CHATTERING + CASE_B}, transient=5, record=7)
    ds = whole.sel({FREQUENCY: 0.2})
    ours, single = vx.stroboscopic_section(ds), vx.stroboscopic_section(held_both).isel(period=slice(5, None))
    assert ours.x.dims == ours.v.dims == ("period", "mass")
    assert ours.held_time.dims == ("period", "stop")
    assert float(ours.held_time.min()) > 1
    for name in ("x", "v", "held_time"):
        np.testing.assert_allclose(ours[name], single[name], rtol=0, atol=SETTLED)
    x, v = held_both.evaluate(np.arange(6, 13) * held_both.machine.period)
    np.testing.assert_allclose(ours.x, x, rtol=0, atol=SETTLED)
    np.testing.assert_allclose(ours.v, v, rtol=0, atol=SETTLED)
    np.testing.assert_array_equal(ours.x[-1], ds.x)
    np.testing.assert_array_equal(ours.v[-1], ds.v)


@pytest.mark.thorough
def test_a_sweep_and_a_trajectory_have_the_same_impact_maps_and_motions(held_both):
    whole = sweep(vx.models.wagg_bishop_b(1.0), {FREQUENCY: CHATTERING + CASE_B}, transient=0, record=12)
    ds = whole.sel({FREQUENCY: 0.2})
    for stop in (None, 0, 1):
        ours, single = vx.impact_map(ds, stop), vx.impact_map(held_both, stop)
        np.testing.assert_array_equal(ours.stop[: single.sizes["impact"]], single.stop)
        for name in ("phase", "velocity", "next_phase", "next_velocity"):
            np.testing.assert_allclose(
                ours[name][: single.sizes["impact"]], single[name], rtol=0, atol=SETTLED
            )
    ours, single = vx.classify(ds, last=6), vx.classify(held_both)
    for name in ("motion", "num_periods", "num_impacts", "num_double_impacts"):
        np.testing.assert_array_equal(ours[name], single[name])
    np.testing.assert_allclose(ours.held_time, single.held_time, rtol=0, atol=SETTLED)


@pytest.mark.thorough
@pytest.mark.parametrize("which", ["case_b", "chattering_b"])
def test_the_global_map_is_made_of_the_impacts_of_the_individual_ones(request, which):
    ds = request.getfixturevalue(which)
    everything = vx.impact_map(ds)
    assert everything.velocity.dims == (FREQUENCY, "impact")
    single = [vx.impact_map(ds, stop) for stop in (0, 1)]
    counts = [int(np.isfinite(pairs.velocity).sum()) for pairs in (everything, *single)]
    assert counts[0] == counts[1] + counts[2] == int(ds.num_impacts.sum())
    for stop, pairs in enumerate(single):
        assert set(np.unique(pairs.stop)) <= {stop, -1}
        assert (np.isfinite(pairs.velocity) == (pairs.stop == stop)).all()


# Wrong use


def test_a_motion_without_a_forcing_period_is_refused():
    system = vx.ImpactSystem(
        [1.0], [[0.0]], [[1.0]], vx.Harmonic([0.0], 0.0), [vx.Stop(0, 0.5, "upper", 0.5)]
    )
    sol = vx.simulate(system, 0.0, 10.0, [-1.0], [0.0])
    for look in (vx.classify, vx.impact_map, vx.stroboscopic_section):
        with pytest.raises(ValueError, match="The load has no frequency"):
            look(sol)


def test_several_trajectories_at_once_are_refused(held_both):
    batch = jax.tree.map(lambda a: a[None], held_both)
    for look in (vx.classify, vx.impact_map, vx.stroboscopic_section):
        with pytest.raises(ValueError, match="holds several trajectories"):
            look(batch)


def test_bounds_that_are_not_positive_are_refused(case_a):
    with pytest.raises(ValueError, match="Argument `tolerance` must be positive"):
        vx.classify(case_a, tolerance=0.0)
    with pytest.raises(ValueError, match="Argument `double_impact_within` must be positive"):
        vx.classify(case_a, double_impact_within=-1.0)


def test_a_stop_that_is_not_there_is_refused(case_a):
    for stop in (-1, 2):
        with pytest.raises(ValueError, match="Argument `stop` must lie in 0 to 1"):
            vx.impact_map(case_a, stop)


def test_too_few_periods_are_refused(case_a):
    for last in (1, 21):
        with pytest.raises(ValueError, match="2 at least and 20 at most"):
            vx.classify(case_a, last=last)
