"""Short names of swept quantities: the same results as by path, under other names."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._sweep.short_names import with_paths

FREQUENCY, AMPLITUDE = "forcing.frequency", "forcing.amplitude[0]"
SYSTEM = vx.models.wagg_bishop_a(0.8)
FREQUENCIES, AMPLITUDES = [0.75, 0.8, 0.85], [0.25, 0.3]
NAMED = {"W": (FREQUENCY, FREQUENCIES), "A": (AMPLITUDE, AMPLITUDES)}
BY_PATH = {FREQUENCY: FREQUENCIES, AMPLITUDE: AMPLITUDES}
MATRICES = np.array([[[0.3, -0.1], [-0.1, 0.1]], [[0.2, -0.1], [-0.1, 0.1]]])


def sweep(values: dict, **options) -> xr.Dataset:
    options = {"transient": 60, "record": 4, "progress": False} | options
    return vx.sweep(SYSTEM, values, **options)


@pytest.fixture(scope="module")
def named() -> xr.Dataset:
    return sweep(NAMED)


@pytest.fixture(scope="module")
def by_path() -> xr.Dataset:
    return sweep(BY_PATH)


def assert_same(named: xr.Dataset, by_path: xr.Dataset):
    """Compare every number and every attribute, once the names are taken off."""
    xr.testing.assert_identical(with_paths(named), by_path)


def test_a_short_name_is_a_dimension_and_a_coordinate(named, by_path):
    assert named.result.dims == ("W", "A")
    np.testing.assert_array_equal(named.A, AMPLITUDES)
    assert named.A.attrs == {"long_name": "amplitude of the load", "path": AMPLITUDE}
    assert named.W.attrs["path"] == FREQUENCY
    assert float(named.sel(A=0.3, W=0.8).A) == 0.3
    assert_same(named, by_path)


def test_one_quantity_may_have_a_name_and_another_none(by_path):
    ds = sweep({FREQUENCY: FREQUENCIES, "A": (AMPLITUDE, AMPLITUDES)})
    assert ds.result.dims == (FREQUENCY, "A")
    assert_same(ds, by_path)


def test_carried_sweeps_go_on_from_sweeps_with_short_names(named, by_path):
    for carry in (None, "up"):
        found = sweep(NAMED, carry=carry, carry_from=named)
        assert_same(found, sweep(BY_PATH, carry=carry, carry_from=by_path))
        assert not found.x.equals(named.x)
    both = sweep(NAMED, carry="both")
    assert both.result.dims == ("direction", "W", "A")


def test_the_machine_of_a_point_has_the_values_of_the_point(named):
    system = vx.system_of(named.sel(W=0.85, A=0.25))
    assert float(system.forcing.frequency) == 0.85
    assert float(system.forcing.amplitude[0]) == 0.25
    assert float(vx.system_of(named).forcing.frequency) == 0.8


def test_swept_matrices_may_have_a_short_name():
    ds = sweep({"C": ("damping", MATRICES)}, transient=3)
    assert ds["C.values"].dims == ("C", "row", "mass")
    assert_same(ds, sweep({"damping": MATRICES}, transient=3))
    for k, damping in enumerate(MATRICES):
        np.testing.assert_array_equal(vx.system_of(ds.isel(C=k)).damping, damping)


@pytest.mark.slow
def test_motions_orbits_and_branches_are_those_by_path(named, by_path):
    assert_same(vx.classify(named), vx.classify(by_path))
    orbits = vx.periodic_orbits(named, progress=False)
    assert orbits.converged.dims == ("W", "A")
    assert int(orbits.converged.sum()) > 2
    assert_same(orbits, vx.periodic_orbits(by_path, progress=False))


@pytest.mark.slow
def test_branches_follow_the_path(named):
    found = vx.branches(named.isel(A=[1]).squeeze("A"), progress=False)
    assert {branch.path for branch in found} == {FREQUENCY}
    assert min(float(branch.points[FREQUENCY].min()) for branch in found) == pytest.approx(0.75)


def test_impacts_have_columns_of_these_names(named):
    table = vx.impacts(named)
    assert list(table.columns[:2]) == ["W", "A"]
    expected = np.repeat(np.tile(AMPLITUDES, 3), named.num_impacts.sum("stop").values.ravel())
    np.testing.assert_array_equal(table.A, expected)


def test_names_survive_files_and_joining(named, tmp_path):
    named.to_netcdf(tmp_path / "named.nc")
    with xr.open_dataset(tmp_path / "named.nc") as back:
        assert back.A.attrs["path"] == AMPLITUDE
        assert float(vx.system_of(back.isel(W=0, A=0)).forcing.frequency) == 0.75
    parts = [sweep(NAMED | {"W": (FREQUENCY, part)}) for part in ([0.75], [0.8, 0.85])]
    joined = vx.combine(parts)
    xr.testing.assert_equal(joined, named)
    assert joined.W.attrs["path"] == FREQUENCY


def test_parts_that_mean_different_quantities_by_one_name_are_not_joined():
    first, second = (sweep({"A": (path, [a])}) for path, a in ((AMPLITUDE, 0.3), (FREQUENCY, 0.8)))
    with pytest.raises(ValueError, match="parts of one sweep"):
        vx.combine([first, second])


def test_a_store_serves_both_forms(named, by_path, tmp_path):
    assert_same(sweep(NAMED, store=tmp_path), by_path)
    xr.testing.assert_identical(sweep(BY_PATH, store=tmp_path), by_path)


def test_what_is_written_to_a_folder_has_the_short_names(named, tmp_path):
    ds = sweep(NAMED, out=tmp_path / "out")
    assert ds.result.dims == ("W", "A")
    assert ds.A.attrs["path"] == AMPLITUDE
    with xr.open_zarr(tmp_path / "out", consolidated=False) as back:
        np.testing.assert_array_equal(back.x, named.x)
        assert float(vx.system_of(back.isel(W=2, A=0)).forcing.frequency) == 0.85
    with pytest.raises(ValueError, match="short names"):
        sweep(BY_PATH, out=tmp_path / "out")


@pytest.mark.slow
def test_basins_and_charts_take_short_names():
    by_path = {"x0[0]": np.linspace(-0.2, 0.2, 3), "v0[0]": np.linspace(-0.5, 0.5, 2)}
    options = {"transient": 30, "record": 4, "progress": False}
    named = dict(zip("xv", by_path.items(), strict=True))
    found = vx.basins(SYSTEM, named, **options)
    assert found.label.dims == ("x", "v")
    assert_same(found, vx.basins(SYSTEM, by_path, **options))
    plane = vx.chart(SYSTEM, NAMED, **options)
    assert plane.motion.dims == ("W", "A")
    assert_same(plane, vx.chart(SYSTEM, BY_PATH, **options))


@pytest.mark.parametrize(
    ("name", "trouble"),
    [
        ("a b", "no identifier"),
        ("lambda", "no identifier"),
        ("forcing.frequency", "no identifier"),
        ("mass", "path of the machine"),
        ("x0", "path of the machine"),
        ("stops", "path of the machine"),
        ("impact_time", "variable or a dimension"),
        ("result", "variable or a dimension"),
        ("x", "variable or a dimension"),
        ("stop", "variable or a dimension"),
        ("direction", "variable or a dimension"),
        ("exponent", "variable or a dimension"),
    ],
)
def test_a_short_name_that_means_something_else_is_refused(name, trouble):
    with pytest.raises(ValueError, match=f"short name `{name}`.*{trouble}"):
        sweep({name: (AMPLITUDE, AMPLITUDES)})


def test_every_variable_of_a_sweep_is_refused_as_a_short_name(named):
    ds = sweep(NAMED, lyapunov=True, transient=2)
    own = [str(name) for name in (*ds.variables, *ds.dims) if name not in ("W", "A")]
    assert {"lyapunov_exponents", "period", "impact"} <= set(own)
    for name in own:
        with pytest.raises(ValueError, match=r"variable or a dimension|path of the machine"):
            sweep({name: (AMPLITUDE, AMPLITUDES)})


def test_wrong_pairs_are_refused():
    with pytest.raises(ValueError, match="swept twice"):
        sweep({"A": (AMPLITUDE, AMPLITUDES), AMPLITUDE: AMPLITUDES})
    with pytest.raises(ValueError, match="a path and its values"):
        sweep({"A": (AMPLITUDE, AMPLITUDES, "up")})
    with pytest.raises(ValueError, match="amplitude"):
        sweep({"A": ("forcing.amplitud", AMPLITUDES)})
