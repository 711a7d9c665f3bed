"""A sweep is a loop of single runs, with names."""

import equinox as eqx
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._execution import lane_queue, threads
from vijax._execution.settings import ExecutionSettings

FREQUENCIES = [0.5, 0.8, 1.4]
TRANSIENT, RECORD = 4, 3
# Some hundred roundings, with the amplification of these motions (measured: below 100).
ROUNDING = 1e-11
# A machine whose modes its damping does not diagonalise.
NONPROPORTIONAL = [[0.3, -0.1], [-0.1, 0.1]]
CASES = {"a": vx.models.wagg_bishop_a, "b": vx.models.wagg_bishop_b}
SYSTEM = vx.models.wagg_bishop_b(0.8)


def sweep(system: vx.ImpactSystem, values: dict, **options) -> xr.Dataset:
    """A short sweep."""
    options = {"transient": TRANSIENT, "record": RECORD, "progress": False} | options
    return vx.sweep(system, values, **options)


def alone(system: vx.ImpactSystem, x0=None, v0=None) -> tuple[vx.Solution, dict[str, np.ndarray]]:
    """One run over the same periods, and its impacts after the transient."""
    period = 2 * np.pi / float(system.forcing.frequency)
    sol = vx.simulate(system, 0.0, (TRANSIENT + RECORD) * period, x0, v0)
    log = sol.events
    kept = np.asarray((log.kind == vx.IMPACT) & (log.t > TRANSIENT * period))
    t, velocity, stop = (np.asarray(a)[kept] for a in (log.t, log.velocity_minus, log.stop))
    return sol, {"time": t - TRANSIENT * period, "velocity": velocity, "stop": stop}


def assert_same(point: xr.Dataset, system: vx.ImpactSystem, x0=None, v0=None):
    """Check that a point of a sweep equals a single run."""
    sol, impacts = alone(system, x0, v0)
    count = len(impacts["time"])
    assert point.num_impacts.values.tolist() == [
        int((impacts["stop"] == j).sum()) for j in range(system.num_stops)
    ]
    np.testing.assert_array_equal(point.impact_stop[:count], impacts["stop"])
    for name in ("time", "velocity"):
        np.testing.assert_allclose(point[f"impact_{name}"][:count], impacts[name], rtol=0, atol=ROUNDING)
        assert np.isnan(point[f"impact_{name}"][count:]).all()
    assert (point.impact_stop[count:] == -1).all()
    phase = np.asarray(system.forcing.frequency * point.impact_time[:count].values)
    np.testing.assert_allclose(point.impact_phase[:count], phase % (2 * np.pi), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(point.x, sol.x1, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(point.v, sol.v1, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(point.stuck, sol.stuck1)
    assert result_name(point) == "successful"


def result_name(point: xr.Dataset) -> str:
    """Result code in words, from the attributes."""
    attributes = point.result.attrs
    names = dict(zip(attributes["flag_values"], attributes["flag_meanings"].split(), strict=True))
    return names[int(point.result)]


@pytest.mark.parametrize("case", CASES)
def test_a_sweep_equals_a_loop(case):
    ds = sweep(CASES[case](1.0), {"forcing.frequency": FREQUENCIES})
    assert int(ds.num_impacts.sum()) > 10
    for k, frequency in enumerate(FREQUENCIES):
        assert_same(ds.isel({"forcing.frequency": k}), CASES[case](frequency))


def test_a_grid_of_two_quantities_has_a_dimension_for_each():
    amplitudes = [0.4, 0.5]
    ds = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES, "forcing.amplitude[0]": amplitudes})
    grid = ("forcing.frequency", "forcing.amplitude[0]")
    assert ds.result.dims == ds.steps.dims == grid
    assert ds.num_impacts.dims == ds.num_sticks.dims == ds.stuck.dims == (*grid, "stop")
    assert ds.x.dims == ds.v.dims == (*grid, "mass")
    for name in ("time", "velocity", "phase", "stop"):
        assert ds[f"impact_{name}"].dims == (*grid, "impact")
    np.testing.assert_array_equal(ds["forcing.frequency"], FREQUENCIES)
    np.testing.assert_array_equal(ds["forcing.amplitude[0]"], amplitudes)
    assert (ds.sizes["mass"], ds.sizes["stop"]) == (2, 2)
    assert ds.sizes["impact"] == int(ds.num_impacts.sum("stop").max())
    for frequency in FREQUENCIES:
        for amplitude in amplitudes:
            point = ds.sel({"forcing.frequency": frequency, "forcing.amplitude[0]": amplitude})
            assert_same(point, vx.models.wagg_bishop_b(frequency, amplitude))


def changed(where, value) -> vx.ImpactSystem:
    return eqx.tree_at(where, SYSTEM, value)


PATHS = {
    "forcing.amplitude[0]": (0.4, lambda a: changed(lambda s: s.forcing.amplitude, jnp.array([a, 0.0]))),
    "forcing.phase[0]": (1.0, lambda a: changed(lambda s: s.forcing.phase, jnp.array([a, 0.0]))),
    "forcing.mean[1]": (0.05, lambda a: changed(lambda s: s.forcing.mean, jnp.array([0.0, a]))),
    "stops[*].restitution": (
        0.5,
        lambda a: changed(lambda s: [stop.restitution for stop in s.stops], [jnp.array(a)] * 2),
    ),
    "stops[0].restitution": (0.5, lambda a: changed(lambda s: s.stops[0].restitution, jnp.array(a))),
    "stops[1].position": (0.2, lambda a: changed(lambda s: s.stops[1].position, jnp.array(a))),
    "mass[0]": (1.25, lambda a: changed(lambda s: s.mass, jnp.array([a, 1.0]))),
    "damping": (
        np.array(NONPROPORTIONAL),
        lambda a: changed(lambda s: s.damping, jnp.asarray(a)),
    ),
    "stiffness[1][1]": (1.5, lambda a: changed(lambda s: s.stiffness, jnp.array([[2.0, -1.0], [-1.0, a]]))),
}


@pytest.mark.parametrize("path", PATHS)
def test_a_path_sets_what_it_names(path):
    value, build = PATHS[path]
    ds = sweep(SYSTEM, {path: np.array([value])})
    assert_same(ds.isel({path: 0}), build(value))


def test_a_start_is_swept_by_its_path():
    ds = sweep(SYSTEM, {"x0[1]": [-0.4, 0.05, 0.1]}, x0=[0.1, 0.0])
    for x in (-0.4, 0.05, 0.1):
        assert_same(ds.sel({"x0[1]": x}), SYSTEM, [0.1, x])


@pytest.mark.slow
def test_a_swept_matrix_is_labelled_by_number():
    dampings = np.array([NONPROPORTIONAL, SYSTEM.damping, 2 * np.array(NONPROPORTIONAL)])
    ds = sweep(SYSTEM, {"damping": dampings})
    assert ds.result.dims == ("damping",)
    np.testing.assert_array_equal(ds.damping, [0, 1, 2])
    for k, damping in enumerate(dampings):
        assert_same(ds.isel(damping=k), changed(lambda s: s.damping, jnp.asarray(damping)))


def test_too_little_room_cuts_the_log_and_nothing_else():
    whole = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES})
    total = whole.num_impacts.sum("stop").values
    room = int(total.min())
    assert room < total.max()
    too_many = int((total > room).sum())
    with pytest.warns(UserWarning, match=f"{too_many} of 3 points ended .* Increase `max_impacts`") as told:
        cut = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, max_impacts=room)
    assert len(told) == 1
    for name in ("num_impacts", "num_sticks", "x", "v", "stuck", "steps"):
        np.testing.assert_array_equal(cut[name], whole[name])
    assert cut.sizes["impact"] == room
    for name in ("impact_time", "impact_velocity", "impact_stop", "impact_phase"):
        np.testing.assert_array_equal(cut[name], whole[name][:, :room])
    for k, count in enumerate(total):
        expected = "max_impacts_reached" if count > room else "successful"
        assert result_name(cut.isel({"forcing.frequency": k})) == expected


def test_too_few_steps_are_told_and_only_of_their_point():
    whole = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES})
    bound = int(whole.steps.min())
    too_long = int((whole.steps > bound).sum())
    with pytest.warns(UserWarning, match=f"{too_long} of 3 points ended .* Increase `max_steps`") as told:
        cut = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, max_steps=bound)
    assert len(told) == 1
    for k, steps in enumerate(whole.steps.values):
        expected = "max_steps_reached" if steps > bound else "successful"
        assert result_name(cut.isel({"forcing.frequency": k})) == expected
        if steps <= bound:
            np.testing.assert_array_equal(cut.x[k], whole.x[k])
    assert np.isfinite(cut.x).all()


@pytest.mark.slow
@pytest.mark.thorough
def test_a_stiff_machine_under_a_slow_load_has_the_steps_it_needs():
    """A period of the slow load has 20 000 vibrations of the machine, one of the fast load 200."""
    load = vx.Harmonic([1.0], 0.05)
    system = vx.ImpactSystem([1.0], [[2.0]], [[1e6]], load, [vx.Stop(0, 5e-7, "upper", 0.7)])
    values = {"forcing.frequency": [0.05, 5.0]}
    ds = sweep(system, values)
    assert [result_name(ds.isel({"forcing.frequency": k})) for k in (0, 1)] == ["successful"] * 2
    assert ds.steps[0] > 100_000 + 10_000 * (TRANSIENT + RECORD)
    assert ds.attrs["max_steps"] == "default"


@pytest.mark.slow
@pytest.mark.parametrize("run", ["simulate", "sweep"])
def test_a_force_that_is_not_finite_at_the_start_is_told_as_that(run):
    force = lambda t, x, v, args: 0.1 / x  # noqa: E731
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.5], 0.8), force=force)
    if run == "simulate":
        assert vx.simulate(system, 0.0, 1.0, throw=False).result == vx.RESULTS.non_finite
        return
    with pytest.warns(UserWarning, match="1 of 2 points ended with non_finite"):
        ds = sweep(system, {"x0[0]": [0.0, 1.0]})
    assert result_name(ds.isel({"x0[0]": 0})) == "non_finite"


def test_what_is_drawn_or_told_of_a_log_that_was_cut_says_so():
    with pytest.warns(UserWarning, match="max_impacts_reached"):
        cut = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, max_impacts=2)
    one = cut.isel({"forcing.frequency": [0]})
    count = int(cut.result.astype(bool).sum())
    assert count > 0
    assert result_name(one.isel({"forcing.frequency": 0})) == "max_impacts_reached"
    uses = {
        "classify": lambda: vx.classify(cut),
        "impact map": lambda: vx.impact_map(cut),
        "bifurcation": lambda: vx.plot.bifurcation(cut, stop=None),
    }
    for use in uses.values():
        with pytest.warns(UserWarning, match=f"{count} of 3 points ended with max_impacts_reached") as told:
            use()
        assert len(told) == 1
    with pytest.warns(UserWarning, match="1 of 1 points ended with max_impacts_reached"):
        vx.plot.impact_map(one, stop=None)
    plt.close("all")


def test_the_result_names_its_codes():
    attributes = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}).result.attrs
    names = attributes["flag_meanings"].split()
    assert {"successful", "max_impacts_reached", "max_steps_reached", "non_finite"} <= set(names)
    assert attributes["flag_values"].dtype == np.int8
    assert len(attributes["flag_values"]) == len(names) == len(set(names))


def test_the_recorded_periods_follow_the_transient():
    early = sweep(SYSTEM, {"forcing.frequency": [0.8]}, transient=0, record=TRANSIENT + RECORD)
    late = sweep(SYSTEM, {"forcing.frequency": [0.8]})
    shift = TRANSIENT * 2 * np.pi / 0.8
    count = late.sizes["impact"]
    assert 0 < count < early.sizes["impact"]
    np.testing.assert_allclose(
        late.impact_time[0], early.impact_time[0, -count:] - shift, rtol=0, atol=ROUNDING
    )
    np.testing.assert_array_equal(late.impact_velocity[0], early.impact_velocity[0, -count:])
    assert (late.impact_time >= 0).all()
    assert (late.impact_time <= RECORD * 2 * np.pi / 0.8).all()


@pytest.mark.thorough
def test_points_that_follow_others_in_their_lane_are_what_they_are_alone():
    frequencies = np.linspace(0.7, 1.7, 131)
    chosen = [0, 60, 127, 128, 130]
    whole = sweep(SYSTEM, {"forcing.frequency": frequencies})
    np.testing.assert_array_equal(whole["forcing.frequency"], frequencies)
    few = sweep(SYSTEM, {"forcing.frequency": frequencies[chosen]})
    part = whole.isel({"forcing.frequency": chosen})
    np.testing.assert_array_equal(part.num_impacts, few.num_impacts)
    assert int(few.num_impacts.sum()) > 10
    room = few.sizes["impact"]
    assert np.isnan(part.impact_time[:, room:]).all()
    np.testing.assert_array_equal(part.impact_stop[:, :room], few.impact_stop)
    for name in ("impact_time", "impact_velocity"):
        np.testing.assert_allclose(part[name][:, :room], few[name], rtol=0, atol=ROUNDING)
    for name in ("x", "v"):
        np.testing.assert_allclose(part[name], few[name], rtol=0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("room", ["impact_rows", "mark_rows"])
def test_nothing_is_lost_where_rows_are_taken_away_on_the_way(room):
    whole = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES})
    settings = ExecutionSettings(**{room: 17})
    wide = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES, "x0[0]": np.zeros(3)}, settings=settings)
    assert int(whole.num_impacts.sum()) > 17
    for k in range(3):
        xr.testing.assert_allclose(wide.isel({"x0[0]": k}, drop=True), whole, rtol=0, atol=ROUNDING)


def test_the_steps_of_a_call_bound_no_motion():
    whole = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES})
    settings = ExecutionSettings(turns=50)
    wide = sweep(SYSTEM, {"forcing.frequency": FREQUENCIES, "x0[0]": np.zeros(6)}, settings=settings)
    for k in range(6):
        xr.testing.assert_allclose(wide.isel({"x0[0]": k}, drop=True), whole, rtol=0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [160, 256, 5000])
@pytest.mark.parametrize("system", [SYSTEM, vx.models.friction_oscillator(0.8, 1.0, force=0.3)])
def test_results_do_not_depend_on_the_number_of_lanes(system, lanes):
    """XLA divides operations on many lanes among threads, which is an error in a kernel."""
    whole = sweep(system, {"forcing.frequency": FREQUENCIES})
    many = sweep(system, {"forcing.frequency": FREQUENCIES}, settings=ExecutionSettings(lanes=lanes))
    xr.testing.assert_allclose(many, whole, rtol=0, atol=ROUNDING)


def test_one_program_serves_every_sweep_of_a_size():
    """Another number of points, other quantities, starts, masses and sides of stops, and what is carried compile nothing."""
    sweep(SYSTEM, {"forcing.frequency": FREQUENCIES})
    size = lane_queue.lane_programs.count()
    sweep(SYSTEM, {"forcing.frequency": np.linspace(0.8, 1.2, 130)})
    place = float(SYSTEM.stops[0].position)
    sweep(
        SYSTEM,
        {"forcing.amplitude[0]": [0.1, 0.2], "stops[0].position": [place, 2 * place], "v0[0]": [0.0, 0.1]},
    )
    sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, carry="both")
    sides = {"upper": "lower", "lower": "upper"}
    others = tuple(vx.Stop(1 - s.mass, -s.position, sides[s.side], s.restitution) for s in SYSTEM.stops)
    sweep(eqx.tree_at(lambda s: s.stops, SYSTEM, others), {"stops[0].position": [-place, -2 * place]})
    assert lane_queue.lane_programs.count() == size


def test_an_interrupt_is_heard_in_a_long_sweep(monkeypatch):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(threads, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        vx.sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, transient=10**6, record=0, progress=False)


def test_both_flows_give_the_same_sweep():
    modal, taylor = (
        sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, flow=flow) for flow in (None, vx.TaylorFlow())
    )
    np.testing.assert_array_equal(modal.num_impacts, taylor.num_impacts)
    np.testing.assert_array_equal(modal.impact_stop, taylor.impact_stop)
    for name in ("impact_time", "impact_velocity", "x", "v"):
        np.testing.assert_allclose(modal[name], taylor[name], rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_sweep_of_nonproportional_damping_equals_a_loop():
    build = lambda w: eqx.tree_at(  # noqa: E731
        lambda s: s.damping, vx.models.wagg_bishop_b(w), jnp.array(NONPROPORTIONAL)
    )
    ds = sweep(build(1.0), {"forcing.frequency": FREQUENCIES})
    assert int(ds.num_impacts.sum()) > 3
    for k, frequency in enumerate(FREQUENCIES):
        assert_same(ds.isel({"forcing.frequency": k}), build(frequency))


def test_the_progress_bar_is_shown_only_where_wanted(capsys):
    sweep(SYSTEM, {"forcing.frequency": FREQUENCIES})
    assert capsys.readouterr().err == ""
    sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, progress=True)
    assert "3/3" in capsys.readouterr().err
