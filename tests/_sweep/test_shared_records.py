"""Points of a sweep that have the same record hold it once: against sweeps in which each has its own."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._execution import points as module
from vijax._sweep.grid import base_of, grid_points
from vijax._system.shared_records import SharedRecords

TIMES = np.linspace(0.0, 12.0, 61)
RECORDS = np.cumsum(np.random.default_rng(3).normal(size=(5, 61)), axis=1) * 0.3
GAPS = np.linspace(0.2, 0.8, 6)
# Some hundred roundings, with the amplification of these motions.
ROUNDING = 1e-12
OPTIONS = {"duration": 15.0, "ts": [0.0, 3.3, 12.0], "progress": False}


def shaken(index=0.0, gap=0.5, scale=1.0, kind="linear") -> vx.ImpactSystem:
    record = vx.Tabulated(TIMES, scale * jnp.asarray(RECORDS)[jnp.asarray(index, int)], kind)
    load = vx.base_excitation([1.0, 1.0], acceleration=record)
    contact = vx.Contact({0: 1.0, 1: -1.0}, gap, 0.6)
    return vx.ImpactSystem([1.0, 1.0], 0.1 * np.eye(2), [[1.0, 0.0], [0.0, 2.0]], load, [contact])


def smooth(index=0.0, gap=0.5) -> vx.ImpactSystem:
    return shaken(index, gap, kind="cubic")


def mixed(index=0.0, gap=0.5) -> vx.ImpactSystem:
    """A mass under the sum of a record, a wave form and a harmonic, whose mass depends on the record too."""
    record = vx.Tabulated(TIMES, jnp.asarray(RECORDS)[jnp.asarray(index, int)], "previous")
    load = record + vx.Waveform([0.0, 2.0], [0.5, -0.5], 1.37) + vx.Harmonic([0.3], 0.7)
    mass = jnp.asarray([1.0]) + 0.1 * jnp.asarray(index)
    return vx.ImpactSystem(mass, [[0.1]], [[1.0]], load, [vx.Stop(0, gap, "upper", 0.7)])


def both(monkeypatch, system, values, **options) -> tuple[xr.Dataset, xr.Dataset]:
    """A sweep whose points share records, and one in which each has its own."""
    shared = vx.sweep(system, values, **OPTIONS, **options)
    monkeypatch.setattr(module, "_LANES_TO_A_RECORD", np.inf)
    return shared, vx.sweep(system, values, **OPTIONS, **options)


def assert_same(one: xr.Dataset, other: xr.Dataset) -> None:
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=str(name))
    assert int(one.num_impacts.sum()) > 20


@pytest.mark.slow
@pytest.mark.parametrize("function", [shaken, smooth, mixed])
def test_records_of_a_family_are_those_that_every_point_has_alone(monkeypatch, function):
    values = {"index": np.arange(5.0), "gap": GAPS}
    quantities = ["max_position", "max_absolute_acceleration"]
    assert_same(*both(monkeypatch, vx.Family(function), values, quantities=quantities))


@pytest.mark.slow
def test_records_swept_by_path_are_those_that_every_point_has_alone(monkeypatch):
    values = {"forcing.values": -RECORDS[..., None] * np.ones(2), "stops[0].position": GAPS}
    assert_same(*both(monkeypatch, shaken(), values))
    values = {"forcing.times": np.stack([TIMES, TIMES * 1.1]), "stops[0].position": GAPS}
    monkeypatch.undo()
    assert_same(*both(monkeypatch, shaken(), values))


@pytest.mark.thorough
def test_records_that_are_values_of_a_family_are_shared_beside_another_that_scales_them(monkeypatch):
    def of_record(record, scale, gap=0.5) -> vx.ImpactSystem:
        load = vx.Tabulated(TIMES, scale * record)
        return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, gap, "upper", 0.7)])

    family = vx.Family(of_record, record=RECORDS[0], scale=1.0)
    values = {"record": RECORDS, "scale": np.array([0.5, 1.0]), "gap": GAPS}
    points = grid_points(base_of(family, None, None), values, counts_periods=False)
    assert points.system.forcing.values.shape == (10, 61, 1, 1)
    assert_same(*both(monkeypatch, family, values))


def test_a_record_is_held_once():
    values = {"index": np.arange(5.0), "gap": np.linspace(0.2, 0.8, 400)}
    points = grid_points(base_of(vx.Family(shaken), None, None), values, counts_periods=False)
    load = points.system.forcing
    assert isinstance(load, SharedRecords)
    assert load.values.shape == (5, 61, 2, 1)
    assert load.number.shape == (2000,)
    # Without sharing the records alone are 2000 * 61 * 2.
    assert sum(a.size for a in jax.tree.leaves(points)) < 20_000
    # Where every point has a record of its own, it stays in the lane of the point.
    alone = grid_points(
        base_of(vx.Family(shaken), None, None), {"index": np.arange(5.0)}, counts_periods=False
    )
    assert alone.system.forcing.values.shape == (61, 2, 5)


def test_bad_records_are_refused_before_anything_runs():
    with pytest.raises(ValueError, match="All swept values must be finite"):
        vx.sweep(vx.Family(shaken), {"index": np.array([0.0, np.nan])}, **OPTIONS)
    values = {"forcing.times": np.stack([TIMES, TIMES[::-1]]), "stops[0].position": GAPS}
    with pytest.raises(ValueError, match="`times` must rise from knot to knot"):
        vx.sweep(shaken(), values, **OPTIONS)
    values = {"forcing.values": np.full((2, 61, 2), np.nan), "stops[0].position": GAPS}
    with pytest.raises(ValueError, match="must be finite"):
        vx.sweep(shaken(), values, **OPTIONS)


@pytest.mark.slow
def test_workers_and_folders_get_the_records_of_their_points(tmp_path):
    values = {"index": np.arange(5.0), "gap": GAPS}
    whole = vx.sweep(vx.Family(shaken), values, **OPTIONS)
    small = vx.ExecutionSettings(min_chunk=7, max_chunk=7)
    out = vx.sweep(vx.Family(shaken), values, **OPTIONS, out=tmp_path / "out", settings=small)
    np.testing.assert_allclose(out.x, whole.x, rtol=ROUNDING, atol=ROUNDING)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        sent = vx.sweep(vx.Family(shaken), values, **OPTIONS, executor=executor, settings=small)
    for name in ("x", "v", "impact_time", "xs"):
        np.testing.assert_allclose(sent[name], whole[name], rtol=ROUNDING, atol=ROUNDING, err_msg=name)
    np.testing.assert_array_equal(sent.num_impacts, whole.num_impacts)
