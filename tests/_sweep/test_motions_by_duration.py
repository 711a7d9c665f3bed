"""Motions followed for a duration: against single runs and closed forms; stored, written, combined, sent away, refused."""

import re
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
import xarray as xr

import vijax as vx

GAP, INDEX = "stops[0].position", "index"
DURATION = 24.0
# The start, a knot of the record, the last of its knots, the end.
TS = np.array([0.0, 3.3, 4.0, 12.5, 20.0, 24.0])
# Some hundred roundings, with the amplification of these motions.
ROUNDING = 1e-12

_TIMES = np.linspace(0.0, 20.0, 101)
RECORDS = np.cumsum(np.random.default_rng(1).normal(size=(5, 101)), axis=1) * 0.3
RECORD = vx.Tabulated(_TIMES, RECORDS[0])
WAVES = {
    "two frequencies": vx.Harmonic([0.8], 0.8) + vx.Waveform([0.0, 2.0], [1.0, -1.0], 0.37, kind="previous"),
    "a wave form and a record": vx.Waveform([0.0, 2.0], [0.5, -0.5], 1.37) + RECORD,
}


def machine(load: Any = RECORD, **others) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.5, "upper", 0.7)], **others)


def shaken(index=0.0, gap=0.5):
    """Two towers of one mass each that pound, shaken by a record of some."""
    record = vx.Tabulated(_TIMES, jnp.asarray(RECORDS)[jnp.asarray(index, int)])
    load = vx.base_excitation([1.0, 1.0], acceleration=record)
    contact = vx.Contact({0: 1.0, 1: -1.0}, gap, 0.6)
    return vx.ImpactSystem([1.0, 1.0], 0.1 * np.eye(2), [[1.0, 0.0], [0.0, 2.0]], load, [contact])


def sweep(system=None, values=None, **options) -> xr.Dataset:
    values = {GAP: np.linspace(0.3, 1.3, 9)} if values is None else values
    options = {"duration": DURATION, "ts": TS, "progress": False} | options
    return vx.sweep(machine() if system is None else system, values, **options)


@pytest.fixture(scope="module")
def plain() -> xr.Dataset:
    return sweep(quantities=["max_position", "impulse"])


def assert_runs(ds: xr.Dataset, rebuild=vx.system_of, **start) -> int:
    """Compare every point of a sweep with a run of its own; return the number of impacts."""
    (path,) = ds.result.dims
    for point in (ds.isel({path: k}) for k in range(ds.sizes[path])):
        sol = vx.simulate(rebuild(point), 0.0, ds.duration, ts=ds.time.values, **start)
        n = int(sol.num_events)
        is_impact = np.asarray(sol.events.kind)[:n] == vx.IMPACT
        number = int(point.num_impacts.sum())
        assert number == is_impact.sum()
        for found, known in ((point.xs, sol.xs), (point.vs, sol.vs), (point.x, sol.x1), (point.v, sol.v1)):
            np.testing.assert_allclose(found, known, rtol=ROUNDING, atol=ROUNDING)
        times, speeds = (np.asarray(a)[:n][is_impact] for a in (sol.events.t, sol.events.velocity_minus))
        np.testing.assert_allclose(point.impact_time[:number], times, rtol=ROUNDING)
        np.testing.assert_allclose(point.impact_velocity[:number], speeds, rtol=1e-9, atol=ROUNDING)
    return int(ds.num_impacts.sum())


@pytest.mark.thorough
def test_every_point_is_a_run_from_the_start(plain):
    assert plain.xs.dims == (GAP, "time", "mass")
    np.testing.assert_array_equal(plain.time, TS)
    np.testing.assert_array_equal(plain.xs[:, -1], plain.x)
    assert plain.duration == DURATION
    assert not {"transient", "record"} & set(plain.attrs)
    assert not {"impact_phase", "section_x", "section_v", "forcing_period"} & set(plain.variables)
    assert assert_runs(plain) > 15


@pytest.mark.thorough
@pytest.mark.parametrize("name", WAVES)
def test_loads_without_a_common_period(name):
    ds = sweep(machine(WAVES[name]), {"forcing[0].frequency": [0.3, 0.8, 1.3]})
    assert assert_runs(ds) > 8


def test_a_step_of_the_load_is_followed_by_a_free_oscillation():
    """m = k = 1, unit step at 0: x = 1 - cos t up to the stop, hit at arccos(1 - position)."""
    step = vx.Tabulated([0.0, 100.0], [1.0, 1.0], kind="previous")
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], step, [vx.Stop(0, 1.0, "upper", 1.0)])
    position = np.array([0.5, 1.0, 1.5, 2.5])
    ts = [0.5, 1.0]
    ds = vx.sweep(system, {GAP: position}, duration=3.0, ts=ts, quantities=["max_position"], progress=False)
    np.testing.assert_allclose(ds.xs[1:, :, 0], 1 - np.cos([ts] * 3), rtol=1e-13)
    hit = np.arccos(1 - position[:3])
    np.testing.assert_allclose(ds.impact_time[:3, 0], hit, rtol=1e-13)
    np.testing.assert_allclose(ds.impact_velocity[:3, 0], np.sin(hit), rtol=1e-13)
    np.testing.assert_array_equal(ds.num_impacts[3], [0])
    np.testing.assert_allclose(ds.max_position[3], 1 - np.cos(3.0), rtol=1e-13)


def test_a_machine_without_a_load_decays():
    """Free decay of x'' + 2 a x' + x = 0 from x0, without a forcing period."""
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.0], 0.0), [])
    ds = vx.sweep(
        system, {"x0[0]": [1.0, -2.0]}, duration=9.0, ts=[2.0], quantities=["mean_velocity"], progress=False
    )
    w = np.sqrt(1 - 0.05**2)
    for t, found in ((2.0, ds.xs[:, 0, 0]), (9.0, ds.x[:, 0])):
        decay = np.exp(-0.05 * t) * (np.cos(w * t) + 0.05 / w * np.sin(w * t))
        np.testing.assert_allclose(found, decay * ds["x0[0]"], rtol=1e-13)
    np.testing.assert_allclose(ds.mean_velocity[:, 0], (ds.x[:, 0] - ds["x0[0]"]) / 9.0, rtol=1e-13)


@pytest.mark.thorough
def test_frequencies_down_to_zero_and_times_at_the_ends_of_periods():
    """A load of frequency 0 is constant; the state at the end of a period is that of a sweep that counts them."""
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 2.0), [vx.Stop(0, 0.3, "upper", 0.7)]
    )
    values = {"forcing.frequency": [0.0, 2.0]}
    period = np.pi
    ds = vx.sweep(system, values, duration=6 * period, ts=period * np.arange(7), progress=False)
    assert_runs(ds)
    counted = vx.sweep(system, {"forcing.frequency": [2.0]}, transient=0, record=6, progress=False)
    np.testing.assert_allclose(ds.xs[1, 1:], counted.section_x[0], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_array_equal(ds.num_impacts[1], counted.num_impacts[0])


@pytest.mark.slow
def test_records_of_a_family_are_swept_by_their_index():
    ds = sweep(vx.Family(shaken, index=0), {INDEX: np.arange(5)}, quantities=["max_position"])
    assert assert_runs(ds, lambda point: vx.system_of(point, family=shaken)) > 40
    both = sweep(vx.Family(shaken, index=0), {INDEX: np.arange(5), "gap": [0.5, 1.0]})
    np.testing.assert_array_equal(both.xs.sel(gap=0.5), ds.xs)


@pytest.mark.slow
def test_friction_compliant_stops_and_a_force_of_another_period():
    table = vx.Tabulated(_TIMES, RECORDS[:2].T)
    stops = [vx.Stop(0, 0.5, "upper", 0.7), vx.CompliantStop(1, 0.3, "lower", 50.0, 1.0)]
    system = vx.ImpactSystem(
        [1.0, 1.0], 0.1 * np.eye(2), [[2.0, -1.0], [-1.0, 1.0]], table, stops, friction=[vx.Friction(0, 0.1)]
    )
    ds = sweep(system, {"friction[0].force": [0.05, 0.1]})
    assert assert_runs(ds) > 5
    assert ds.held_time.dims == ("friction[0].force", "stop")
    assert ds.sticking_time.dims == ("friction[0].force", "friction")
    assert (ds.sticking_time > 0).all()

    def force(t, x, v, args):
        return -(x**3) + 0.3 * jnp.cos(np.sqrt(2) * t)

    driven = machine(vx.Harmonic([1.0], 0.8), force=force)
    ds = sweep(driven, {"forcing.frequency": [0.3, 0.8]})
    assert assert_runs(ds, lambda point: vx.system_of(point, force=force)) > 8


@pytest.mark.slow
def test_sums_and_rates_are_those_of_the_whole_motion(plain):
    ds = sweep(quantities=["impulse", "dissipated_energy", "impact_rate", "mean_velocity", "rms_velocity"])
    assert ds.impulse.dims == ds.dissipated_energy.dims == (GAP, "stop")
    np.testing.assert_array_equal(ds.impulse, plain.impulse)
    speed = ds.impact_velocity.where(~ds.impact_sticks).sum("impact")
    lost = (1 - 0.7**2) / 2 * (ds.impact_velocity.where(~ds.impact_sticks) ** 2).sum("impact")
    is_plain = ~ds.impact_sticks.any("impact")
    assert is_plain.sum() > 4
    np.testing.assert_allclose(ds.impulse[:, 0].where(is_plain), 1.7 * speed.where(is_plain), rtol=1e-13)
    np.testing.assert_allclose(ds.dissipated_energy[:, 0].where(is_plain), lost.where(is_plain), rtol=1e-13)
    np.testing.assert_allclose(ds.impact_rate, ds.num_impacts / DURATION, rtol=1e-15)
    np.testing.assert_allclose(ds.mean_velocity, ds.x / DURATION, rtol=1e-13)
    sol = vx.simulate(vx.system_of(ds.isel({GAP: 4})), 0.0, DURATION)
    t = np.linspace(0.0, DURATION, 200_001)
    v = np.asarray(sol.evaluate(t)[1])
    np.testing.assert_allclose(
        ds.rms_velocity[4], np.sqrt(np.trapezoid(v**2, t, axis=0) / DURATION), rtol=1e-4
    )


def test_a_point_that_stops_early_has_no_states_beyond():
    with pytest.warns(UserWarning, match="max_steps_reached"):
        ds = sweep(max_steps=40, quantities=["max_position"])
    assert np.isnan(ds.xs[:, -1]).all()
    assert np.isfinite(ds.xs[:, 0]).all()
    assert np.isnan(ds.max_position).all()
    assert np.isnan(ds.held_time).all()


def test_stored_and_written_sweeps_have_the_same_bits(plain, tmp_path):
    quantities = ["max_position", "impulse"]
    for _ in range(2):
        stored = sweep(store=tmp_path / "store", quantities=quantities)
        assert stored.identical(plain)
    with pytest.raises(ValueError, match=re.escape("holds another sweep: `values.time` is 6 values")):
        sweep(store=tmp_path / "store", ts=[1.0], quantities=quantities)
    with pytest.raises(ValueError, match=re.escape("holds another sweep: `duration` is 24.0 there")):
        sweep(store=tmp_path / "store", duration=25.0, quantities=quantities)
    written = sweep(out=tmp_path / "out", quantities=quantities)
    assert written.load().equals(plain)
    plain.to_netcdf(tmp_path / "plain.nc")
    assert xr.open_dataset(tmp_path / "plain.nc").equals(plain)


def test_parts_combine(plain):
    parts = [
        sweep(values={GAP: part}, quantities=["max_position", "impulse"])
        for part in np.array_split(plain[GAP].values, 3)
    ]
    assert vx.combine(parts).equals(plain)
    other = sweep(values={GAP: [2.0]}, quantities=["max_position", "impulse"], duration=25.0)
    with pytest.raises(ValueError, match=r"`duration` is 24\.0 there, but 25\.0 here"):
        vx.combine([*parts, other])


@pytest.mark.slow
def test_processes_change_nothing(plain):
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert sweep(executor=pool, quantities=["max_position", "impulse"]).equals(plain)


def test_an_ensemble_of_motions():
    known = {GAP: scipy.stats.uniform(0.3, 0.5)}
    options = {"duration": DURATION, "ts": TS, "samples": 8, "progress": False}
    ds = vx.ensemble(machine(), known, quantities=["max_position"], **options)
    assert ds.xs.dims == ("sample", "time", "mass")
    again = sweep(values={GAP: ds[GAP].values}, quantities=["max_position"])
    np.testing.assert_array_equal(ds.xs, again.xs)
    np.testing.assert_array_equal(ds.max_position, again.max_position)


def test_impacts_in_a_table_and_pictures_need_no_phases(plain):
    table = vx.impacts(plain)
    assert list(table.columns) == [GAP, "stop", "time", "velocity"]
    assert len(table) == plain.num_impacts.sum()
    vx.plot.bifurcation(plain)
    vx.plot.bifurcation(plain, ordinate="max_position", mass=0)


REFUSED = {
    "no period": ({"duration": None, "ts": None}, "`vx.sweep(..., duration=...)`"),
    "times without a duration": ({"duration": None}, "give their `duration` too"),
    "not positive": ({"duration": 0.0}, "must be a positive, finite time, but is 0.0"),
    "infinite": ({"duration": np.inf}, "must be a positive, finite time"),
    "no number": ({"duration": "x"}, "must be made of real numbers"),
    "several durations": ({"duration": [1.0, 2.0]}, "must be a positive, finite time"),
    "periods": ({"transient": 3}, "leave out `transient` and `record`"),
    "exponents": ({"lyapunov": True}, "leave out `lyapunov` or `duration`"),
    "carried": ({"carry": "up"}, "leave out `carry` and `carry_from`"),
    "times beyond the end": ({"ts": [25.0]}, "in increasing order, within [0, 24]"),
    "times out of order": ({"ts": [2.0, 1.0]}, "in increasing order"),
    "times that are none": ({"ts": [np.nan]}, "must be finite times"),
    "sections": ({"quantities": ["section_position"]}, "motions of a `duration` have none: give `ts`"),
    "knots out of order": ({"values": {"forcing.times[3]": [9.0]}}, "Every swept `times` must rise"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_needs_periods_is_refused(case):
    options, sentence = REFUSED[case]
    with pytest.raises(ValueError, match=re.escape(sentence)):
        sweep(**options)


@pytest.mark.parametrize("function", [vx.classify, vx.periodic_orbits, vx.branches, vx.stroboscopic_section])
def test_what_needs_phases_says_why_there_are_none(plain, function):
    with pytest.raises(ValueError, match="followed for a `duration`, without forcing periods"):
        function(plain)
