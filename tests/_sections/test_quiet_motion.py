"""Motions without impacts: the proof that none will come, for sweeps and trajectories."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from responses import LOAD, UNEVEN, matrices, response_at

import vijax as vx
from vijax._sections import non_impacting_proof
from vijax._sweep.provenance import machines_of

pytestmark = pytest.mark.thorough

FREQUENCY, POSITION = "forcing.frequency", "stops[*].position"
# Some hundred roundings of numbers of about 1.
ROUNDED = 1e-12
# A margin above all rounding, and too small for sampling without a proof.
MARGIN = 1e-9


def kinds(source, **options) -> np.ndarray:
    """Kind of every motion in words."""
    motion = vx.classify(source, **options).motion
    return np.array(motion.attrs["flag_meanings"].split())[motion.values]


# Sweeps

LIGHT = vx.chain(
    [1.0] * 3,
    [0.02] * 3,
    [1.0] * 3,
    vx.Harmonic([0.3, 0.0, 0.0], 1.0),
    [vx.Stop(i, 0.6, "upper", 0.7) for i in range(3)],
)
GRID = {FREQUENCY: np.linspace(0.25, 2.35, 15), POSITION: np.array([0.5, 1.0, 2.0])}


def sweep(system, values, **options) -> xr.Dataset:
    return vx.sweep(system, values, progress=False, **({"transient": 100, "record": 20} | options))


@pytest.fixture(scope="module")
def light() -> xr.Dataset:
    return sweep(LIGHT, GRID)


def without_machine(ds: xr.Dataset) -> xr.Dataset:
    """Dataset whose motions can be classified by the section alone."""
    return ds.drop_attrs()


@pytest.mark.slow
def test_beats_of_a_lightly_damped_chain_are_no_longer_taken_for_something_else(light):
    before, after = kinds(without_machine(light)), kinds(light)
    has_hit = (light.num_impacts.sum("stop") > 0).values
    changed = before != after
    assert {"not_settled", "non_periodic"} <= set(before[changed])
    assert set(after[changed]) == {"non_impacting"}
    assert not changed[has_hit].any()
    assert has_hit.sum() > 10
    found = vx.classify(light)
    is_quiet = after == "non_impacting"
    assert is_quiet.sum() > 10
    assert (found.num_periods.values[is_quiet] == 1).all()
    for name in ("num_impacts", "held_time"):
        assert (found[name].values[is_quiet] == 0).all()
    assert (found.num_double_impacts.values[is_quiet] == 0).all()
    # The recorded state is reported unchanged: it did change in the last period.
    assert (found.recurrence_error.values[is_quiet] > 1e-6).any()


@pytest.mark.filterwarnings("ignore:.*max_impacts_reached")  # only counts are needed, not the log
@pytest.mark.slow
def test_no_impact_comes_in_a_much_longer_run(light):
    later = sweep(LIGHT, GRID, carry_from=light, transient=0, record=1000)
    num_impacts = later.num_impacts.sum("stop").values
    assert (num_impacts[kinds(light) == "non_impacting"] == 0).all()
    assert (num_impacts > 0).any()


@pytest.mark.slow
def test_the_contraction_is_that_of_the_slowest_mode(light):
    m, c, k = matrices(LIGHT)
    first_order = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]])
    slowest = np.linalg.eigvals(first_order).real.max()
    expected = np.exp(slowest * 2 * np.pi / light[FREQUENCY]).broadcast_like(light.result).values
    found, is_quiet = vx.classify(light).contraction.values, kinds(light) == "non_impacting"
    np.testing.assert_allclose(found[is_quiet], expected[is_quiet], rtol=ROUNDED)


@pytest.mark.slow
def test_what_will_hit_after_the_record_is_not_quiet():
    # The energy is in the last mass and reaches the first one later; only the beginning is recorded.
    walls = [vx.Stop(i, position, "upper", 0.7) for i, position in enumerate((0.5, 50.0, 50.0))]
    system = vx.chain([1.0] * 3, [1e-3] * 3, [1.0] * 3, vx.Harmonic([0.001, 0.0, 0.0], 8.0), walls)
    values = {"x0[2]": [0.2, 1.2]}
    early = sweep(system, values, transient=0, record=2)
    later = sweep(system, values, carry_from=early, transient=0, record=400)
    assert (early.num_impacts == 0).all()
    np.testing.assert_array_equal(later.num_impacts.values[:, 0] > 0, [False, True])
    assert kinds(early)[0] == "non_impacting"
    assert kinds(early)[1] != "non_impacting"


@pytest.mark.slow
def test_an_undamped_sweep_is_judged_as_before(light):
    undamped = eqx.tree_at(lambda s: s.damping, LIGHT, jnp.zeros((3, 3)))
    ds = sweep(undamped, {POSITION: [40.0, 50.0]})
    assert (ds.num_impacts == 0).all()
    np.testing.assert_array_equal(kinds(ds), kinds(without_machine(ds)))
    assert "non_impacting" not in kinds(ds)


# Datasets of all forms

DAMPINGS = np.stack(
    [0.01 * np.asarray(LIGHT.stiffness), np.zeros((3, 3)), 0.05 * np.asarray(LIGHT.stiffness)]
)


DIMS = ("direction", "forcing.amplitude", "damping", POSITION, "x0[0]", FREQUENCY)


@pytest.fixture(scope="module")
def many() -> xr.Dataset:
    """Swept matrices, loads, stops and starts, up and down; the second machine is undamped."""
    values = {
        "forcing.amplitude": [[0.3, 0.0, 0.0], [0.0, 0.1, 0.4]],
        "damping": DAMPINGS,
        POSITION: [0.4, 3.0],
        "x0[0]": [0.0, 0.1],
        FREQUENCY: [0.7, 1.6],
    }
    return sweep(LIGHT, values, carry="both", transient=10)


def assert_same(found: xr.Dataset, expected: xr.Dataset):
    """Compare verdicts and counts exactly, the rest to rounding, since BLAS adds in another order."""
    xr.testing.assert_equal(found[["motion", "num_periods"]], expected[["motion", "num_periods"]])
    xr.testing.assert_allclose(found, expected, rtol=ROUNDED, atol=ROUNDED)


@pytest.mark.slow
def test_each_point_is_judged_by_its_own_machine(many):
    after, before = kinds(many), kinds(without_machine(many))
    assert (after != before).any()
    motion = vx.classify(many).motion
    is_quiet = motion.copy(data=after == "non_impacting")
    assert not is_quiet.isel(damping=1).any()
    for k in (0, 2):
        assert 0 < is_quiet.isel(damping=k).mean() < 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "select",
    [
        lambda ds: ds.isel({"damping": [2, 0], POSITION: 1}),
        lambda ds: ds.isel({"damping": 2, "forcing.amplitude": 1}).sel(direction="down"),
        lambda ds: ds.isel(dict.fromkeys(DIMS, 0)),
        lambda ds: ds.isel(dict.fromkeys(DIMS, slice(None, None, -1))),
        lambda ds: ds.isel(
            {POSITION: xr.DataArray([1, 0, 1], dims="some"), "damping": xr.DataArray([2, 0, 0], dims="some")}
        ),
    ],
)
def test_a_part_is_judged_as_in_the_whole(many, select):
    assert_same(vx.classify(select(many)), select(vx.classify(many)))


@pytest.mark.slow
def test_the_order_of_dimensions_does_not_matter(many):
    turned = many.transpose(*reversed(list(many.dims)))
    assert turned["damping.values"].dims != many["damping.values"].dims
    assert turned.result.dims != many.result.dims
    found, expected = (vx.classify(ds).transpose(*DIMS, "stop") for ds in (turned, many))
    assert_same(found, expected)


@pytest.mark.slow
def test_the_machine_of_a_point_does_not_depend_on_the_order_of_dimensions():
    loads = np.array([LOAD.amplitude, 2 * np.asarray(LOAD.amplitude)])
    ds = sweep(UNEVEN, {"forcing.amplitude": loads}, transient=0, record=1)
    found = vx.system_of(ds.transpose("mass", "harmonic", ...).isel({"forcing.amplitude": 1}))
    np.testing.assert_array_equal(found.forcing.amplitude, loads[1])


def test_a_file_is_judged_as_the_sweep(many, tmp_path):
    pytest.importorskip("h5netcdf")
    many.to_netcdf(tmp_path / "file.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "file.nc") as found:
        assert_same(vx.classify(found), vx.classify(many))


def test_blocks_of_points_do_not_matter(many, monkeypatch):
    whole = vx.classify(many)
    monkeypatch.setattr(non_impacting_proof, "_BLOCK", 5)
    assert_same(vx.classify(many), whole)


def test_the_machines_of_all_points_are_those_of_each(many):
    grid = many.isel({"x0[0]": [0], FREQUENCY: [1, 0]})
    dims = grid.result.dims
    sizes = [grid.sizes[dim] for dim in dims]
    which = np.array([17, 3, 40])
    found = machines_of(grid, dims, which)
    for lane, number in enumerate(which):
        place = dict(zip(dims, np.unravel_index(number, sizes), strict=True))
        own = jax.tree.map(lambda a: jnp.asarray(a[..., min(lane, a.shape[-1] - 1)]), found)  # noqa: B023
        assert eqx.tree_equal(own, vx.system_of(grid.isel(place)), typematch=True)


def test_where_the_machine_is_not_known_the_section_decides(light):
    by_section = kinds(without_machine(light))
    assert (kinds(light) != by_section).any()
    told = json.loads(light.attrs["system"]) | {"force": "spring"}
    strange = [
        light.assign_attrs(system=json.dumps(told)),
        light.rename({POSITION: "gap"}),
        light.drop_vars(FREQUENCY),
        light.isel({FREQUENCY: [3]}).squeeze(FREQUENCY, drop=True),
    ]
    for ds in strange:
        np.testing.assert_array_equal(kinds(ds), kinds(without_machine(ds)))
    assert (kinds(light)[3] != by_section[3]).any()
    with pytest.raises(ValueError, match="must have swept quantities as coordinates along `gap`"):
        machines_of(light.rename({POSITION: "gap"}), ("gap",))


# Moving stops, and single trajectories


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*max_impacts_reached")  # only counts are needed, not the log
def test_moving_stops_are_swept_as_well():
    motion = vx.Harmonic([[0.2], [0.05]], 1.9)
    stops = [vx.Stop(0, 0.6, "upper", 0.7, motion), vx.Stop(1, -2.0, "lower", 0.7)]
    system = vx.chain([1.0] * 2, [0.01] * 2, [1.0] * 2, vx.Harmonic([0.2, 0.0], 1.9), stops)
    values = {"stops[0].motion.amplitude[0][0]": [0.0, 0.9, 1.5], "stops[0].position": [0.9, 2.4]}
    ds = sweep(system, values)
    after = kinds(ds)
    assert set(kinds(without_machine(ds)).ravel()) & {"not_settled", "non_periodic"}
    later = sweep(system, values, carry_from=ds, transient=0, record=1000)
    is_quiet = after == "non_impacting"
    assert is_quiet.sum() >= 2
    assert (~is_quiet).sum() >= 2
    assert (later.num_impacts.sum("stop").values[is_quiet] == 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("t0", [0.0, 1.3])
def test_a_trajectory_is_judged_likewise(t0):
    system = eqx.tree_at(lambda s: s.forcing.frequency, LIGHT, jnp.asarray(2.2))
    system = eqx.tree_at(lambda s: [stop.position for stop in s.stops], system, [jnp.asarray(0.3)] * 3)
    x, v = response_at(system, 2.2 * t0)
    t1 = t0 + 6 * float(system.forcing.period)
    second_mode = np.array([-0.74, -0.33, 0.59])
    sol = vx.simulate(system, t0, t1, x + 0.05 * second_mode, v)
    assert kinds(sol) == "non_impacting"
    found = vx.classify(sol)
    assert found.num_periods == 1
    assert found.recurrence_error > 1e-4
    # With more free vibration it does not hit, since all stays in that mode, but the energy bound cannot prove it.
    wide = vx.simulate(system, t0, t1, x + 0.2 * second_mode, v)
    assert int(wide.num_events) == 0
    assert kinds(wide) != "non_impacting"


@pytest.mark.slow
def test_a_trajectory_with_a_force_is_judged_by_its_section():
    spring = lambda t, x, v, args: -0.001 * x  # noqa: E731
    load = vx.Harmonic([0.1, 0.0], 1.9)
    links = [1.0] * 2, [0.01] * 2, [1.0] * 2
    ends = [vx.simulate(vx.chain(*links, load, [], force), 0.0, 60.0, [0.1, 0.3]) for force in (None, spring)]
    assert kinds(ends[0]) == "non_impacting"
    assert kinds(ends[1]) != "non_impacting"
