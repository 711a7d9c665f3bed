"""Datasets that describe how they were made, and lossless files of them."""

import dataclasses
import json
import platform

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from outputs import FILES, assert_comes_back, names_of

import vijax as vx
from vijax._execution.points import LaneInput
from vijax._execution.runner import Counts
from vijax._sweep.provenance import origin
from vijax._system.description import build, describe

FREQUENCY, RESTITUTION = "forcing.frequency", "stops[*].restitution"
SYSTEM = vx.models.wagg_bishop_b(0.8)
THIRD = 1 / 3
# Every kind of number that a machine has, most of them without a finite decimal form.
LOAD = vx.Harmonic([[THIRD, 0.0, 0.1], [0.7, 1e-300, -0.2]], np.pi, [[0.1, 0.2, 0.3]] * 2, [THIRD, 0.0, -0.1])
STOPS = [vx.Stop(0, -THIRD, "lower", 0.7), vx.Stop(2, np.sqrt(2), "upper", THIRD)]
MACHINE = vx.chain([1.0, THIRD, np.e], [0.1, 0.2, 0.3], [1.0, np.pi, 7.0], LOAD, STOPS)
DAMPINGS = np.array([[[0.3, -0.1], [-0.1, 0.1]], [[0.2, -0.1], [-0.1, 0.1]]])


def sweep(values: dict, system: vx.ImpactSystem = SYSTEM, **options) -> xr.Dataset:
    return vx.sweep(system, values, transient=4, record=2, progress=False, **options)


@pytest.fixture(scope="module")
def grid() -> xr.Dataset:
    """Three dimensions with names of every kind, and a fourth with strings."""
    return sweep({FREQUENCY: [0.5, 0.8], RESTITUTION: [0.5, THIRD], "x0[1]": [0.05]}, carry="both")


@pytest.fixture(scope="module")
def matrices() -> xr.Dataset:
    """A swept matrix."""
    return sweep({"damping": DAMPINGS, "stops[0].position": [-0.3, -THIRD]})


@pytest.fixture(scope="module")
def solution() -> vx.Solution:
    return vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 40.0, ts=np.linspace(0.0, 40.0, 5), max_events=128)


def assert_same_machine(found: vx.ImpactSystem, expected: vx.ImpactSystem):
    """Compare every bit, every type, every string."""
    assert eqx.tree_equal(found, expected, typematch=True)


def test_a_machine_comes_back_from_text_bit_for_bit():
    text = json.dumps(describe(MACHINE))
    assert_same_machine(build(json.loads(text), "float64"), MACHINE)


def test_a_machine_of_float32_comes_back_as_it_was():
    narrow = jax.tree.map(lambda a: a.astype("float32"), MACHINE)
    assert_same_machine(build(json.loads(json.dumps(describe(narrow))), "float32"), narrow)


def test_no_field_of_a_machine_is_left_out():
    """If this fails, the machine has a new field that `describe` and `build` must include."""
    # Friction, Jenkins elements, first-order states and a base are told of where there are any.
    load = vx.Harmonic(LOAD.amplitude, LOAD.frequency, LOAD.phase, LOAD.mean, from_base=True)
    parts = MACHINE.mass, MACHINE.damping, MACHINE.stiffness, load, STOPS
    machine = vx.ImpactSystem(*parts, friction=[vx.Friction(0, 0.1)], hysteresis=[vx.Jenkins(0, 1.0, 0.1)])
    machine = vx.with_states(machine, [[-1.0]], np.zeros((3, 1)))
    description = describe(machine)
    parts = [(machine, description), (load, description["forcing"]), (STOPS[0], description["stops"][0])]
    for part, told in parts:
        assert {field.name for field in dataclasses.fields(part)} == set(told)


def test_a_sweep_gives_its_machine_back(grid):
    assert_same_machine(vx.system_of(grid), SYSTEM)


def test_a_selected_point_gives_the_machine_that_was_run_there(grid):
    point = grid.isel({FREQUENCY: 1, RESTITUTION: 1, "x0[1]": 0}).sel(direction="down")
    found = vx.system_of(point)
    where = lambda s: [stop.restitution for stop in s.stops]  # noqa: E731
    assert_same_machine(found, eqx.tree_at(where, SYSTEM, [jnp.asarray(THIRD)] * 2))
    # Parameters that are not selected stay as they were.
    assert float(vx.system_of(grid.isel({FREQUENCY: 0})).stops[1].restitution) == 0.7


def test_a_swept_matrix_is_kept_and_given_back(matrices):
    np.testing.assert_array_equal(matrices["damping.values"], DAMPINGS)
    assert matrices["damping.values"].dims == ("damping", "row", "mass")
    assert_same_machine(vx.system_of(matrices), SYSTEM)
    found = vx.system_of(matrices.isel({"damping": 0, "stops[0].position": 1}))
    where = lambda s: (s.damping, s.stops[0].position)  # noqa: E731
    assert_same_machine(found, eqx.tree_at(where, SYSTEM, (jnp.asarray(DAMPINGS[0]), jnp.asarray(-THIRD))))


def test_the_dimension_of_masses_is_not_swept_by_that_name():
    with pytest.raises(ValueError, match="`mass` names a dimension already"):
        sweep({"mass": np.ones((3, 2))})


def test_a_dataset_without_a_machine_is_refused():
    with pytest.raises(ValueError, match="has no `system`"):
        vx.system_of(xr.Dataset())


def test_the_attributes_tell_how_a_sweep_was_made(grid):
    told = grid.attrs
    assert {name: told[name] for name in ("transient", "record", "max_impacts", "max_steps")} == {
        "transient": 4, "record": 2, "max_impacts": 2048, "max_steps": "default",
    }  # fmt: skip
    assert (told["carry"], told["carry_from"]) == ("both", "none")
    assert (told["flow"], told["dtype"], told["device"]) == ("ModalFlow", "float64", "cpu")
    assert json.loads(told["x0"]) == json.loads(told["v0"]) == [0.0, 0.0]
    assert told["jax_version"] == jax.__version__
    assert told["numpy_version"] == np.__version__
    assert told["python_version"] == platform.python_version()
    assert told["vijax_version"]


def test_variables_tell_what_they_are(grid, matrices, solution):
    for ds in (grid, matrices, solution.to_xarray()):
        for name, variable in ds.variables.items():
            assert "long_name" in variable.attrs, name
    assert grid.impact_phase.attrs["units"] == "rad"
    assert grid[RESTITUTION].attrs["units"] == "1"
    assert grid[FREQUENCY].attrs["long_name"] == "angular frequency of the load"


@pytest.mark.parametrize("what", ["grid", "matrices", "solution"])
@pytest.mark.parametrize("way", FILES)
def test_a_dataset_comes_back_from_a_file_as_it_was(request, tmp_path, way, what):
    ds = request.getfixturevalue(what)
    ds = ds.to_xarray() if isinstance(ds, vx.Solution) else ds
    found = assert_comes_back(ds, way, tmp_path / "file")
    if what == "grid":
        assert (ds.impact_stop == -1).any()
        assert np.isnan(ds.impact_time).any()
        assert found.sel(direction="up").sizes["impact"] == ds.sizes["impact"]
        assert_same_machine(vx.system_of(found), SYSTEM)
    if what == "matrices":
        where = lambda s: s.damping  # noqa: E731
        expected = eqx.tree_at(where, SYSTEM, jnp.asarray(DAMPINGS[1]))
        assert_same_machine(vx.system_of(found.isel(damping=1)), expected)


@pytest.mark.parametrize("num_masses", [1, 90])
def test_attributes_of_one_mass_and_of_many_survive(tmp_path, num_masses):
    """NetCDF turns one entry into a scalar, and many entries are more than HDF5 keeps in a short attribute."""
    pytest.importorskip("h5netcdf")
    load = vx.Harmonic(np.full(num_masses, THIRD), 0.8)
    links = np.full(num_masses, THIRD)
    system = vx.chain(links, links, links, load)
    start = np.zeros(num_masses)
    counts = Counts(transient=1, record=1, max_impacts=1, max_steps=1, can_stick=False)
    attributes = origin(LaneInput(system, start, start), counts, flow="", carry=None, goes_on=False)
    assert (len(attributes["system"]) > 1 << 16) == (num_masses == 90)
    xr.Dataset(attrs=attributes).to_netcdf(tmp_path / "file.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "file.nc") as found:
        assert found.attrs == attributes
        assert_same_machine(vx.system_of(found), system)


def test_a_solution_is_labelled(solution):
    ds, count = solution.to_xarray(), int(solution.num_events)
    assert 0 < count < solution.events.t.size
    assert dict(ds.sizes) == {"time": 5, "mass": 2, "event": count, "stop": 2}
    np.testing.assert_array_equal(ds.time, solution.ts)
    np.testing.assert_array_equal(ds.x, solution.xs)
    np.testing.assert_array_equal(ds.v, solution.vs)
    np.testing.assert_array_equal(ds.event_time, solution.events.t[:count])
    for name in ("stop", "kind", "velocity_minus", "velocity_plus", "impulse"):
        np.testing.assert_array_equal(ds[f"event_{name}"], getattr(solution.events, name)[:count])
    for name in ("x1", "v1", "stuck1", "t0", "t1", "num_events", "num_steps"):
        np.testing.assert_array_equal(ds[name], getattr(solution, name))
    for name in ("impact_speed", "clearance", "is_near"):
        np.testing.assert_array_equal(ds[f"grazing_{name}"], getattr(solution.grazing, name))


def test_the_flags_of_a_solution_name_its_codes(solution):
    ds = solution.to_xarray()
    kinds = {vx.IMPACT: "impact", vx.STICK: "stick", vx.RELEASE: "release"}
    logged = np.asarray(solution.events.kind)[: int(solution.num_events)]
    assert names_of(ds.event_kind) == [kinds[kind] for kind in logged.tolist()]
    assert set(names_of(ds.event_kind)) == set(kinds.values())
    assert names_of(ds.result) == ["successful"]
    for name in ("event_kind", "result"):
        assert ds[name].dtype == ds[name].attrs["flag_values"].dtype == np.int8


def test_a_solution_that_is_traced_is_refused(solution):
    with pytest.raises(ValueError, match="call it outside"):
        jax.jit(lambda t1: eqx.tree_at(lambda s: s.t1, solution, t1).to_xarray().x1.values)(1.0)
