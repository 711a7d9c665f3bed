"""Coexisting motions are distinguished, and each start is assigned to the attractor of a long run."""

import numpy as np
import pytest
import xarray as xr
from coexisting_motions import CHAOTIC, EXACT, MIRRORED, QUIET, THREE, box, found, section, states
from outputs import assert_comes_back

import vijax as vx
from vijax._attractors.distances import mixes, same_cycle

# Cycles are polished by a program that takes long to compile.
polishes = pytest.mark.thorough
# Distance of a motion from its cycle after hundreds of periods.
SETTLED = 1e-6


# Equal and different attractors


@pytest.mark.slow
@polishes
def test_two_motions_that_are_mirror_images_are_two_though_their_impacts_are_equal():
    pair = found(MIRRORED)
    assert pair.sizes["attractor"] == 2
    assert pair.num_periods.values.tolist() == [1, 1]
    np.testing.assert_array_equal(pair.num_impacts, 1)
    half = float(MIRRORED.forcing.period) / 2
    later = vx.simulate(MIRRORED, 0.0, half, pair.x0.values[0], pair.v0.values[0])
    np.testing.assert_allclose(np.concatenate([later.x1, later.v1]), -states(pair)[1], atol=EXACT)


@polishes
@pytest.mark.slow
def test_a_cycle_of_three_periods_met_at_any_of_its_phases_is_one():
    three = found(THREE)
    which = three.num_periods.values.tolist().index(3)
    phases = section(three, which)
    assert phases.shape == (3, 2)
    again = vx.attractors(THREE, np.repeat(phases, 4, axis=0), progress=False)
    assert again.sizes["attractor"] == 1
    np.testing.assert_array_equal(again.label, 0)
    np.testing.assert_allclose(states(again)[0], states(three)[which], atol=EXACT)
    assert phases[:, 0].argmin() == 0


@polishes
@pytest.mark.slow
def test_chaotic_motions_of_one_cloud_are_one_and_mirror_images_are_two():
    pair = found(CHAOTIC)
    assert pair.motion.attrs["flag_meanings"].split()[int(pair.motion[0])] == "non_periodic"
    assert pair.sizes["attractor"] == 2
    np.testing.assert_array_equal(pair.num_periods, 0)
    largest = pair.exponents.values[:, 0]
    assert (largest > 3 * pair.exponents_error[:, 0]).all()
    assert (pair.exponents_error[:, 0] > 0).all()
    assert largest[0] == pytest.approx(largest[1], rel=0.2)
    assert not pair.is_stable.any()
    np.testing.assert_array_equal(pair.label >= 0, True)
    # The mirror image of one, half a period later, is the other.
    x, v = np.split(section(pair, 0)[:40], 2, axis=1)
    half = float(CHAOTIC.forcing.period) / 2
    later = [vx.simulate(CHAOTIC, 0.0, half, a, b) for a, b in zip(x, v, strict=True)]
    mirrored = -np.array([[s.x1[0], s.v1[0]] for s in later])
    near, far = (set_to(mirrored, section(pair, k)) for k in (1, 0))
    assert np.median(near) < 0.2 * np.median(far)


def set_to(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.abs(points[:, None] - others[None]).max(axis=2).min(axis=1)


def test_samples_of_one_set_mix_and_of_two_do_not():
    def rotation(ratio, first, radius):
        angle = 2 * np.pi * (first + ratio * np.arange(1024))
        return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def henon(x, skip):
        rows = []
        y = 0.1
        for _ in range(skip + 1024):
            x, y = 1 - 1.4 * x * x + y, 0.3 * x
            rows.append((x, y))
        return np.array(rows[skip:])

    golden = (np.sqrt(5) - 1) / 2
    for ratio in (golden, 16 / 101 + 1e-6):
        assert mixes(rotation(ratio, 0.0, 1.0), rotation(ratio, 0.3, 1.0), 0.25)
    assert not mixes(rotation(golden, 0.0, 1.0), rotation(golden, 0.3, 1.1), 0.25)
    assert mixes(henon(0.1, 100), henon(0.2, 1000), 0.25)
    assert not mixes(henon(0.1, 100), henon(0.2, 1000) + np.array([0.0, 0.3]), 0.25)


def test_cycles_are_compared_up_to_a_shift_alone():
    cycle = np.random.default_rng(0).normal(size=(5, 4))
    for shift in range(5):
        assert same_cycle(cycle, np.roll(cycle, shift, axis=0) + 1e-10, EXACT)
    assert not same_cycle(cycle, cycle[::-1], EXACT)
    assert not same_cycle(cycle, np.concatenate([cycle, cycle]), EXACT)


# Attractors of starts


@pytest.mark.slow
@polishes
@pytest.mark.parametrize(
    "system",
    [pytest.param(MIRRORED, marks=pytest.mark.slow), pytest.param(THREE, marks=pytest.mark.slow), QUIET],
    ids=["mirrored", "three", "quiet"],
)
def test_each_start_is_led_where_a_long_run_of_it_goes(system):
    starts = box(40)
    ds = vx.attractors(system, starts, progress=False)
    assert {*ds.label.values} == {*range(ds.sizes["attractor"])} >= {0, 1}
    values = {"x0": starts[:, :1]}
    begin = xr.Dataset({"x": (("start", "mass"), starts[:, :1]), "v": (("start", "mass"), starts[:, 1:])})
    long = vx.sweep(system, values, carry_from=begin, transient=1500, record=1, max_impacts=0, progress=False)
    ends = np.concatenate([long.x, long.v], axis=1)
    away = np.stack([set_to(ends, section(ds, k)) for k in range(ds.sizes["attractor"])])
    np.testing.assert_array_equal(away.argmin(axis=0), ds.label)
    assert away.min(axis=0).max() < SETTLED


@polishes
def test_the_shares_are_the_fractions_of_starts_with_their_binomial_error():
    ds = found(MIRRORED)
    counts = np.bincount(ds.label)
    np.testing.assert_array_equal(ds.num_starts, counts)
    assert counts[0] >= counts[1]
    np.testing.assert_allclose(ds.share, counts / 60)
    np.testing.assert_allclose(ds.share_error, np.sqrt(ds.share * (1 - ds.share) / 60))


@polishes
def test_the_multipliers_of_a_cycle_have_their_exact_product_and_tell_its_exponents():
    ds = found(THREE)
    for k in range(2):
        one, n = ds.isel(attractor=k), int(ds.num_periods[k])
        time = n * float(THREE.forcing.period)
        exact = 0.9 ** (2 * float(one.num_impacts.sum())) * np.exp(-0.05 * time)
        np.testing.assert_allclose(np.prod(one.multipliers.values).real, exact, rtol=EXACT)
        np.testing.assert_allclose(one.exponents.sum(), np.log(exact) / time, rtol=EXACT)
        np.testing.assert_array_equal(one.exponents_error, 0)
        assert bool(one.is_stable)
        assert float(one.residual) < EXACT


@polishes
def test_a_quiet_motion_is_the_response_of_the_linear_machine():
    ds = found(QUIET)
    which = ds.num_impacts.sum("stop").values.tolist().index(0)
    response = 1.0 / (1 - 9.0 + 0.05j * 3.0)
    np.testing.assert_allclose(states(ds)[which], [response.real, -3.0 * response.imag], atol=EXACT)
    np.testing.assert_allclose(ds.exponents[which], -0.025, atol=EXACT)


@polishes
def test_the_same_call_finds_the_same_and_another_seed_draws_other_starts():
    xr.testing.assert_identical(vx.attractors(MIRRORED, 60, progress=False), found(MIRRORED))
    other = found(MIRRORED, seed=1)
    assert (other.label != found(MIRRORED).label).any()
    np.testing.assert_allclose(np.sort(other.x0, axis=0), np.sort(found(MIRRORED).x0, axis=0), atol=EXACT)


@polishes
def test_random_starts_lie_within_their_bounds():
    x, v = states(found(MIRRORED))[1]
    near = [[x - 1e-3, x + 1e-3], [v - 1e-3, v + 1e-3]]
    ds = vx.attractors(MIRRORED, 10, bounds=near, progress=False)
    assert ds.share.values.tolist() == [1.0]
    np.testing.assert_allclose(states(ds)[0], [x, v], atol=EXACT)


@polishes
def test_a_start_that_fails_is_told_and_leaves_the_others_alone():
    starts = box(12)
    sound = vx.attractors(MIRRORED, starts, progress=False)
    broken = np.insert(starts, 5, [0.0, 1e300], axis=0)
    with pytest.warns(UserWarning, match="1 of 13 points ended with"):
        ds = vx.attractors(MIRRORED, broken, progress=False)
    assert np.flatnonzero(ds.is_failed).tolist() == [5]
    assert int(ds.label[5]) == -1
    assert (int(ds.num_failed), int(ds.num_not_settled)) == (1, 0)
    np.testing.assert_array_equal(np.delete(ds.label.values, 5), sound.label)
    np.testing.assert_array_equal(ds.x0, sound.x0)


@polishes
def test_a_grid_is_the_list_of_its_starts():
    axes = {"v0[0]": np.linspace(-1, 1, 6), "x0[0]": np.linspace(-0.5, 0.5, 5)}
    ds = vx.basins(MIRRORED, axes, progress=False)
    assert ds.label.dims == ("v0[0]", "x0[0]")
    v, x = (a.reshape(-1, 1) for a in np.meshgrid(*axes.values(), indexing="ij"))
    listed = vx.attractors(MIRRORED, (x, v), progress=False)
    np.testing.assert_array_equal(ds.label.values.ravel(), listed.label)
    np.testing.assert_array_equal(ds["x0[0]"], axes["x0[0]"])
    one = vx.attractors(MIRRORED, {"v0[0]": axes["v0[0]"]}, x0=[-0.5], progress=False)
    np.testing.assert_array_equal(one.label, ds.label[:, 0])


@polishes
def test_attractors_are_kept_in_files(tmp_path):
    again = assert_comes_back(found(THREE), "NetCDF by h5netcdf", tmp_path / "found.nc")
    assert float(vx.system_of(again).forcing.frequency) == 4.0


# Refused arguments


@pytest.mark.parametrize(
    ("starts", "options", "sentence"),
    [
        (0, {}, "Argument `starts` must be a whole number, 1 or more"),
        (2.5, {}, "Argument `starts` must be a whole number"),
        (np.zeros((3, 3)), {}, r"must be positions and velocities, \(starts, 1\) each"),
        ((np.zeros((3, 1)), np.zeros((2, 1))), {}, "as many velocities as positions"),
        (np.array([[0.6, 0.0]]), {}, "Some points start beyond a stop"),
        (np.array([[np.nan, 0.0]]), {}, "All swept values must be finite"),
        ({}, {}, "The starts are empty"),
        ({"forcing.amplitude[0]": [1.0]}, {}, "is no entry of the start"),
        ({"x0[3]": [1.0]}, {}, "names nothing"),
        ({"x0[0]": 0.1}, {}, r"must have shape \(points,\)"),
        (3, {"bounds": [[0, 1]]}, "Argument `bounds` must hold"),
        (3, {"bounds": [[1, 0], [0, 1]]}, "is not in order"),
        (3, {"bounds": [[2, 3], [0, 1]]}, "hardly any start lies between the stops"),
        (3, {"seed": -1}, "Argument `seed` must be a whole number, 0 or more"),
        (3, {"record": 1}, "Argument `record` must be a whole number, 2 or more"),
        (3, {"tolerance": 0.0}, "Argument `tolerance` must be positive"),
    ],
)
def test_starts_that_are_none_are_refused(starts, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.attractors(MIRRORED, starts, progress=False, **options)


def test_basins_of_anything_else_are_refused():
    with pytest.raises(ValueError, match="must name two start quantities or more"):
        vx.basins(MIRRORED, {"x0[0]": [0.0]})


@pytest.mark.thorough
def test_starts_of_a_grid_beyond_a_stop_have_no_label():
    machine = vx.models.impact_oscillator(1.3, position=0.2, damping_ratio=0.1, restitution=0.6)
    grid = {"x0[0]": np.linspace(-0.4, 0.4, 5), "v0[0]": np.linspace(-1, 1, 3)}
    with pytest.warns(UserWarning, match="3 of 15 starts of the grid lie beyond a stop: .* label is -1"):
        found = vx.basins(machine, grid, progress=False)
    np.testing.assert_array_equal((found.label == -1).all("v0[0]"), [False, False, False, False, True])
    inside = vx.basins(machine, grid | {"x0[0]": grid["x0[0]"][:4]}, progress=False)
    np.testing.assert_array_equal(found.label[:4], inside.label)
    np.testing.assert_array_equal(found.share, inside.share)
    with pytest.raises(ValueError, match="Every start of the grid lies beyond a stop"):
        vx.basins(machine, grid | {"x0[0]": np.array([0.3, 0.4])}, progress=False)


@pytest.mark.slow
def test_starts_of_bodies_that_overlap_have_no_label():
    """Two bodies with friction whose gap is 0.2."""
    contact, load = vx.Contact({0: 1, 1: -1}, 0.2, 0.6), vx.Harmonic([0.3, 0.0], 1.3)
    machine = vx.ImpactSystem(
        [1.0, 1.0], 0.1 * np.eye(2), np.eye(2), load, [contact], friction=[vx.Friction(1, 0.05)]
    )
    grid = {"x0[0]": np.linspace(-0.4, 0.8, 4), "x0[1]": np.array([0.0, 0.3])}
    with pytest.warns(UserWarning, match="3 of 8 starts of the grid lie beyond a stop"):
        found = vx.basins(machine, grid, progress=False)
    overlap = grid["x0[0]"][:, None] - grid["x0[1]"] > 0.2
    np.testing.assert_array_equal(found.label == -1, overlap)
    np.testing.assert_allclose(found.share, [1.0])
