"""Sweeps over the values of a family."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import scipy.stats
from families import rotor, tower
from helpers import counted

import vijax as vx
from vijax._execution.points import LaneInput, points_of_lanes

SPEEDS = np.linspace(0.3, 2.0, 9)
SHORT = {"transient": 20, "record": 5, "progress": False}
# The load is computed once by XLA and once by NumPy.
ROUNDING = 1e-12


def sweep(system, values, **options):
    return vx.sweep(system, values, **(SHORT | options))


def test_a_sweep_is_the_diagonal_of_a_sweep_over_both_paths():
    family = vx.Family(rotor, frequency=0.8, eccentricity=0.01, clearance=0.02)
    own = sweep(family, {"frequency": SPEEDS, "clearance": [0.01, 0.02]})
    values = {
        "forcing.frequency": SPEEDS,
        "forcing.amplitude[0]": 0.01 * SPEEDS**2,
        "stops[0].position": [0.01, 0.02],
    }
    plane = sweep(rotor(0.8), values)
    for k in range(len(SPEEDS)):
        there = plane.isel({"forcing.frequency": k, "forcing.amplitude[0]": k})
        np.testing.assert_allclose(own.x[k], there.x, rtol=ROUNDING, atol=ROUNDING)
        np.testing.assert_array_equal(own.num_impacts[k], there.num_impacts)


@pytest.mark.parametrize("carry", [None, "up"])
def test_a_machine_and_its_family_agree_to_the_bit_in_one_of_its_entries(carry):
    clearances = np.linspace(0.3, 0.9, 7)
    own = sweep(vx.Family(rotor, frequency=0.8), {"clearance": clearances}, carry=carry)
    other = sweep(rotor(0.8), {"stops[0].position": clearances}, carry=carry)
    for name in other.data_vars:
        np.testing.assert_array_equal(own[name].values, other[name].values, err_msg=str(name))


def test_points_share_what_no_swept_value_reaches():
    family = vx.Family(tower, stiffnesses=[1.0, 2.0])
    base = LaneInput(family, np.zeros(2), np.zeros(2))
    points = points_of_lanes(base, {"ratio": np.array([0.05, 0.05, 0.05])})
    assert points.system.damping.shape == (2, 2, 3)  # by what it depends on, not by equal numbers
    assert points.system.stiffness.shape == (2, 2, 1)
    assert points.system.forcing.frequency.shape == (1,)
    points = points_of_lanes(base, {"stiffnesses[1]": np.array([1.0, 2.0])})
    assert points.system.stiffness.shape == (2, 2, 2)
    np.testing.assert_allclose(points.system.stiffness[..., 0], tower([1.0, 1.0]).stiffness)


@pytest.mark.thorough
def test_an_array_and_the_start_are_swept_too():
    family = vx.Family(tower, stiffnesses=[1.0, 2.0])
    pairs = np.array([[1.0, 2.0], [2.0, 1.0], [1.5, 1.5]])
    own = sweep(family, {"stiffnesses": pairs, "x0[0]": [0.0, 0.1]})
    assert own.sizes["stiffnesses"] == 3
    np.testing.assert_array_equal(own["stiffnesses.values"], pairs)
    for k, pair in enumerate(pairs):
        alone = sweep(tower(pair), {"x0[0]": [0.0, 0.1]})
        np.testing.assert_allclose(own.x[k], alone.x, atol=ROUNDING)
    found = vx.system_of(own.isel(stiffnesses=1))
    assert isinstance(found, vx.Family)
    np.testing.assert_array_equal(found.values["stiffnesses"], pairs[1])


def test_a_family_compiles_no_kernel_of_its_own():
    sweep(rotor(0.8), {"forcing.frequency": SPEEDS})
    family = vx.Family(rotor, frequency=0.8)
    with counted() as compilations:
        sweep(family, {"frequency": SPEEDS})
    assert all("leaves_of_lanes" in name for name in map(str, compilations)), compilations


CELL = """
def cell(w, e=0.5):
    load = vx.Harmonic([e * w**2], w)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.6, "upper", 0.7)])
"""


def made_by_cell():
    names = {"vx": vx}
    exec(CELL, names)
    return vx.Family(names["cell"], w=0.8)  # pyright: ignore[reportArgumentType]


def test_the_cell_of_a_notebook_run_again_compiles_nothing():
    sweep(made_by_cell(), {"w": SPEEDS})
    with counted() as compilations:
        sweep(made_by_cell(), {"w": SPEEDS[1:]})
    assert compilations == []


def test_the_dataset_gives_the_family_back():
    family = vx.Family(rotor, frequency=0.8)
    ds = sweep(family, {"frequency": SPEEDS})
    point = ds.isel(frequency=3)
    found = vx.system_of(point)
    assert isinstance(found, vx.Family)
    assert float(found.values["frequency"]) == SPEEDS[3]
    sol = vx.simulate(found, 0.0, 25 * found.forcing.period, max_events=1, throw=False)
    np.testing.assert_allclose(sol.x1, point.x, rtol=1e-8)


def test_the_function_is_given_back_to_the_dataset_of_a_family_alone():
    family = vx.Family(rotor, frequency=0.8)
    ds = sweep(family, {"frequency": SPEEDS})
    for given in (rotor, family):
        assert isinstance(vx.system_of(ds, family=given), vx.Family)
    with pytest.raises(ValueError, match="`family` is the function of a family, but"):
        vx.system_of(sweep(rotor(0.8), {"x0[0]": [0.0]}), family=rotor)
    with pytest.raises(ValueError, match="`force` is for machines"):
        vx.system_of(ds, force=lambda t, x, v, args: x)


@pytest.mark.thorough
def test_functions_of_notebooks_are_known_in_their_process():
    ds = sweep(made_by_cell(), {"w": np.linspace(0.6, 0.7, 3)}, transient=200)
    assert isinstance(vx.system_of(ds), vx.Family)
    orbits = vx.periodic_orbits(ds, progress=False)
    assert orbits.converged.all()


@pytest.mark.thorough
def test_another_process_needs_the_function_or_permission(tmp_path):
    ds = sweep(vx.Family(rotor, frequency=0.8), {"frequency": SPEEDS})
    ds.to_netcdf(tmp_path / "sweep.nc", engine="h5netcdf")
    program = """
import jax, sys
jax.config.update("jax_enable_x64", True)
import xarray as xr, vijax as vx
ds = xr.load_dataset(sys.argv[1], engine="h5netcdf")
try:
    vx.system_of(ds)
except ValueError as error:
    assert "allow_forces=['families']" in str(error), error
else:
    raise SystemExit("it was imported")
assert "families" not in sys.modules
assert vx.classify(ds).motion.size == 9
found = vx.system_of(ds.isel(frequency=2), allow_forces=["families"])
import families
again = vx.system_of(ds.isel(frequency=2), family=families.rotor)
assert float(found.values["frequency"]) == float(again.values["frequency"]) == float(ds.frequency[2])
try:
    vx.system_of(ds, family=families.tower)
except ValueError as error:
    assert "no value" in str(error), error
"""
    here = Path(__file__).parents[1]
    path = os.pathsep.join([str(here), str(here.parent), os.environ.get("PYTHONPATH", "")])
    subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "sweep.nc")],
        check=True,
        env=os.environ | {"PYTHONPATH": path},
    )


def test_a_store_knows_the_family(tmp_path):
    family, values = vx.Family(rotor, frequency=0.8), {"frequency": SPEEDS}
    plain = sweep(family, values)
    first = sweep(family, values, store=tmp_path / "kept")
    again = sweep(family, values, store=tmp_path / "kept")
    for ds in (first, again):
        np.testing.assert_array_equal(ds.x, plain.x)
    with pytest.raises(ValueError, match=r"another sweep.*family"):
        sweep(family.at(clearance=0.7), values, store=tmp_path / "kept")


def test_a_sweep_is_written_with_the_bits_of_one_in_memory(tmp_path):
    family, values = vx.Family(rotor, frequency=0.8), {"frequency": SPEEDS, "clearance": [0.5, 0.6]}
    plain = sweep(family, values)
    written = sweep(family, values, out=tmp_path / "out")
    np.testing.assert_array_equal(written.x, plain.x)
    assert written.attrs["family"] == plain.attrs["family"]


def test_labels_stand_at_the_coordinates():
    family = vx.Family(rotor, frequency=0.8, labels={"frequency": "Speed (rad/s)"})
    ds = sweep(family, {"W": ("frequency", SPEEDS)})
    assert ds.W.attrs == {"path": "frequency", "label": "Speed (rad/s)", "long_name": "Speed (rad/s)"}
    ax = vx.plot.bifurcation(ds, stop=0)
    assert ax.get_xlabel() == "Speed (rad/s)"
    plain = sweep(vx.Family(rotor, frequency=0.8), {"frequency": SPEEDS})
    assert vx.plot.bifurcation(plain, stop=0).get_xlabel() == "frequency"
    named = vx.plot.bifurcation(plain, stop=0, labels={"frequency": "Speed"})
    assert named.get_xlabel() == "Speed"


def test_parts_of_a_sweep_of_a_family_are_joined():
    family = vx.Family(rotor, frequency=0.8)
    parts = [sweep(family, {"frequency": part}) for part in np.array_split(SPEEDS, 2)]
    whole = sweep(family, {"frequency": SPEEDS})
    np.testing.assert_array_equal(vx.combine(parts).x, whole.x)


@pytest.mark.thorough
def test_ensembles_and_sensitivity_vary_the_values():
    family = vx.Family(rotor, frequency=0.8)
    known = {"e": ("eccentricity", scipy.stats.uniform(0.4, 0.1)), "x0[0]": scipy.stats.norm(0.0, 0.01)}
    ds = vx.ensemble(family, known, samples=8, **SHORT)
    for k in range(8):
        alone = sweep(rotor(0.8, float(ds.e[k])), {"x0[0]": [float(ds["x0[0]"][k])]})
        np.testing.assert_allclose(ds.x[k], alone.x[0], atol=ROUNDING)
    end = lambda machine: vx.simulate(machine, 0.0, 10.0).x1[0]  # noqa: E731
    found = vx.sensitivity(end, family, {"eccentricity": scipy.stats.norm(0.5, 0.01)})
    slope = jax.grad(lambda e: end(rotor(0.8, e)))(0.5)
    np.testing.assert_allclose(found.derivative[0], slope, rtol=1e-10)


def test_a_chart_is_over_values():
    family = vx.Family(rotor, frequency=0.8)
    plane = {"frequency": np.linspace(0.6, 1.0, 9), "clearance": np.linspace(0.4, 0.8, 5)}
    chart = vx.chart(family, plane, stride=4, transient=100, progress=False)
    assert chart.motion.dims == ("frequency", "clearance")
    whole = vx.classify(sweep(family, plane, transient=100, record=20))
    assert ((chart.motion == whole.motion) | ~chart.is_computed).all()


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"period": [1.0, 2.0]}, "names a variable or a dimension"),
        ({"mass": [1.0, 2.0]}, "names a dimension already"),
        ({"mass[0]": [1.0]}, "names nothing"),
    ],
)
def test_names_that_datasets_use_are_refused(values, sentence):
    def machine(period, mass=1.0):
        return vx.ImpactSystem([mass], [[0.1]], [[1.0]], vx.Harmonic([0.3], 2 * np.pi / period))

    with pytest.raises(ValueError, match=sentence):
        sweep(vx.Family(machine, period=5.0), values)


def test_args_are_refused():
    with pytest.raises(ValueError, match="let the function of the family"):
        sweep(vx.Family(rotor, frequency=0.8), {"frequency": SPEEDS}, args=(1.0,))


def test_values_that_make_no_machine_are_refused_before_anything_runs():
    def machine(r):
        return vx.ImpactSystem(
            [1.0], [[0.1]], [[1.0]], vx.Harmonic([0.3], 0.8), [vx.Stop(0, 0.3, "upper", r)]
        )

    family = vx.Family(machine, r=0.5)
    with pytest.raises(ValueError, match="restitution"):
        sweep(family, {"r": [0.5, 1.5]})
