"""Motions that coexist are told apart, each start is led where a long run of it goes, and boundaries have their dimension."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
import xarray as xr
from outputs import assert_comes_back

import vijax as vx
from vijax._attractors.distances import mixes, same_cycle, set_distance
from vijax._attractors.links import linked
from vijax._attractors.motions import Motion

FREQUENCY = "forcing.frequency"
# Cycles are polished by a program that takes long to compile.
polishes = pytest.mark.thorough
# Polished cycles close to 1e-13; what follows from their states is known to this.
EXACT = 1e-9
# A motion that has been run for hundreds of periods is on its cycle to this.
SETTLED = 1e-6


@dataclass(frozen=True)
class Of:
    """A machine by its text, for a cache to know it again."""

    system: vx.ImpactSystem = field(compare=False)
    text: str = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "text", repr(self.system))


def machine(frequency: float, amplitude: float = 1.0, restitution: float = 0.8) -> vx.ImpactSystem:
    """A mass on a spring between two stops, alike on both sides."""
    stops = [vx.Stop(0, -0.5, "lower", restitution), vx.Stop(0, 0.5, "upper", restitution)]
    return vx.ImpactSystem([1.0], [[0.05]], [[1.0]], vx.Harmonic([amplitude], frequency), stops)


# Two motions, each the mirror image of the other; a cycle of three periods beside one of one; a motion
# without impacts beside one with; two chaotic ones.
MIRRORED, THREE, QUIET, CHAOTIC = machine(1.5), machine(4.0, 4.0, 0.9), machine(3.0), machine(1.25)


@cache
def _found(of: Of, starts: int, seed: int) -> xr.Dataset:
    return vx.attractors(of.system, starts, seed=seed, progress=False)


def found(system: vx.ImpactSystem, starts: int = 60, seed: int = 0) -> xr.Dataset:
    """From random starts; computed once for each machine."""
    return _found(Of(system), starts, seed)


def states(ds: xr.Dataset) -> np.ndarray:
    return np.concatenate([ds.x0, ds.v0], axis=-1)


def section(ds: xr.Dataset, number: int) -> np.ndarray:
    """The section points of an attractor, (points, 2 n)."""
    rows = np.concatenate([ds.section_x[number], ds.section_v[number]], axis=1)
    return rows[~np.isnan(rows[:, 0])]


def box(count: int) -> np.ndarray:
    """Starts spread over all that is between the stops."""
    return np.random.default_rng(1).uniform([-0.5, -3.0], [0.5, 3.0], (count, 2))


# What is one, and what is two


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
def test_chaotic_motions_of_one_cloud_are_one_and_mirror_images_are_two():
    pair = found(CHAOTIC)
    assert pair.motion.attrs["flag_meanings"].split()[int(pair.motion[0])] == "non_periodic"
    assert pair.sizes["attractor"] == 2
    np.testing.assert_array_equal(pair.num_periods, 0)
    largest = pair.exponents.values[:, 0]
    assert (largest > 0).all()
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


# Where starts lead


@polishes
@pytest.mark.parametrize("system", [MIRRORED, THREE, QUIET], ids=["mirrored", "three", "quiet"])
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


# Along a parameter


@polishes
def test_attractors_go_on_along_a_parameter_begin_and_end():
    values = [1.5, 1.75, 2.0, 2.25]  # far apart, so that attractors move far
    starts = box(24)
    ds = vx.follow_attractors(machine(1.0), FREQUENCY, values, starts, threshold=1.0, progress=False)
    # The two mirror images meet in one motion, which is its own.
    on = int(ds.is_found.values[1].argmax())
    np.testing.assert_array_equal(ds.is_found[:, on], True)
    np.testing.assert_array_equal(ds.is_found[:, 1 - on], [1, 0, 0, 0])
    np.testing.assert_array_equal(ds.is_found[:, 2], [0, 0, 1, 1])
    np.testing.assert_array_equal(ds.birth, [np.nan, np.nan, 2.0])
    np.testing.assert_array_equal(ds.death[[on, 1 - on, 2]], [np.nan, 1.75, np.nan])
    assert ds.successor.values[[on, 1 - on, 2]].tolist() == [-1, on, -1]
    np.testing.assert_array_equal(ds.num_impacts.sum("stop", skipna=False)[2:, [on, 2]], [[2, 0]] * 2)
    for k, value in enumerate(values):
        single = vx.attractors(machine(value), starts, progress=False)
        shares = np.sort(ds.share[k].values[ds.share[k] > 0])
        np.testing.assert_allclose(shares, np.sort(single.share), atol=1e-12)


@polishes
def test_an_attractor_is_not_lost_where_no_start_leads_to_it_any_more():
    values, starts = [3.0, 2.5, 2.1], box(60)
    first, last = (vx.attractors(machine(w), starts, progress=False) for w in (3.0, 2.1))
    is_quiet = [(ds.num_impacts.sum("stop") == 0).values[ds.label.values] for ds in (first, last)]
    chosen = starts[~is_quiet[1]][:12]
    share = is_quiet[0][~is_quiet[1]][:12].mean()
    ds = vx.follow_attractors(machine(1.0), FREQUENCY, values, chosen, threshold=1.0, progress=False)
    assert ds.is_found.all()
    quiet = ds.num_impacts.sum("stop").values[0].tolist().index(0)
    np.testing.assert_array_equal(ds.num_impacts[:, quiet], 0)
    assert float(ds.share[0, quiet]) == pytest.approx(share)
    assert 0 == ds.share[-1, quiet] < share


@polishes
def test_an_attractor_dies_where_a_stop_comes_to_graze_it_and_leads_to_the_one_that_is_left():
    """At phase 0 the motion without impacts is at its highest, so there the stop that has moved is past it."""
    response = 1 / (1 - 3.0**2 + 0.05j * 3.0)
    grazing = abs(response)
    load = vx.Harmonic([1.0], 3.0, [-np.angle(response)])
    stops = [vx.Stop(0, -0.5, "lower", 0.8), vx.Stop(0, 0.5, "upper", 0.8)]
    system = vx.ImpactSystem([1.0], [[0.05]], [[1.0]], load, stops)
    near = np.tile([0.98 * grazing, 0.0], (4, 1))
    values = [1.1 * grazing, 1.01 * grazing, 0.99 * grazing]
    starts = np.concatenate([near, box(8) * [0.2, 1.0]])
    ds = vx.follow_attractors(system, "stops[1].position", values, starts, progress=False)
    quiet = ds.num_impacts.sum("stop", skipna=False).values[0].tolist().index(0)
    assert ds.is_found.values[:, [quiet, 1 - quiet]].tolist() == [[True, True], [True, True], [False, True]]
    assert float(ds.death[quiet]) == values[2]
    assert int(ds.successor[quiet]) == 1 - quiet


def motion(value: int, points: list, impacts: float = 1.0) -> Motion:
    """A made up cycle at a value of the parameter."""
    rows, nothing = np.array(points, float), np.zeros(2)
    return Motion(value, rows, 1.0, len(rows), 1, np.array([impacts]), nothing, nothing + 0j, 0.0)


def test_the_nearest_goes_on_those_with_the_same_impacts_first():
    before = [motion(0, [[0.0, 0.0]]), motion(0, [[0.5, 0.0]], 2.0)]
    after = [motion(1, [[0.1, 0.0]], 2.0), motion(1, [[0.15, 0.0]]), motion(1, [[0.9, 0.0]])]
    assert linked([*before, *after], 2, 0.2).tolist() == [0, 1, 2, 0, 3]
    assert linked([*before, *after], 2, 0.5).tolist() == [0, 1, 1, 0, 2]


def test_sets_are_as_far_apart_as_their_points_are_in_the_mean():
    assert set_distance(np.zeros((1, 2)), np.array([[1.0, 0.0], [3.0, 0.0]])) == pytest.approx(2.0)


# Boundaries


def grid_of(label: np.ndarray) -> xr.Dataset:
    return xr.Dataset({"label": (("x0[0]", "v0[0]"), label.astype(int))})


def test_a_smooth_boundary_has_the_exponent_one():
    x, v = np.meshgrid(np.linspace(-1, 1, 600), np.linspace(-1, 1, 600))
    found = vx.uncertainty_exponent(grid_of(x + 0.4 * v**2 > 0.1))
    # Near e = 1 step the grid shows: that is within the error.
    assert float(found.exponent) == pytest.approx(1.0, abs=0.03)
    assert float(found.dimension) == pytest.approx(1.0, abs=0.03)
    assert 0 < float(found.exponent_error) < 0.02


def test_a_boundary_of_cantor_sets_has_its_dimension():
    # Gaps of the middle-thirds set belong in turn to one attractor and the other, by their level.
    level, x = np.zeros(3**6, int), np.arange(3**6)
    for k in range(6):
        digit = x // 3 ** (5 - k) % 3
        level[(level == 0) & (digit == 1)] = k + 1
    row = np.pad(level % 2, 150)
    found = vx.uncertainty_exponent(grid_of(np.tile(row[:, None], (1, len(row)))))
    exact = 1 - np.log(2) / np.log(3)
    # A set of six levels between steps of sqrt(2): its fractions go up in stairs.
    assert float(found.exponent) == pytest.approx(exact, abs=0.05)


def test_starts_that_are_not_known_do_not_count():
    x = np.tile(np.linspace(-1, 1, 200), (200, 1))
    label = np.where(x > 0, 1, 0)
    label[:, 150:] = -1
    whole, part = (vx.uncertainty_exponent(grid_of(a)).fraction for a in (x > 0, label))
    np.testing.assert_allclose(part[0] / whole[0], 150 / 124, rtol=1e-12)


# What is refused


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


def test_basins_and_exponents_of_anything_else_are_refused():
    with pytest.raises(ValueError, match="must name two start quantities or more"):
        vx.basins(MIRRORED, {"x0[0]": [0.0]})
    with pytest.raises(ValueError, match="has no `label` over a grid"):
        vx.uncertainty_exponent(xr.Dataset())
    with pytest.raises(ValueError, match="The grid has 9 x 9 starts: 32 along each axis"):
        vx.uncertainty_exponent(grid_of(np.eye(9)))
    with pytest.raises(ValueError, match="No boundary of basins passes"):
        vx.uncertainty_exponent(grid_of(np.zeros((64, 64))))


def test_following_anything_else_is_refused():
    with pytest.raises(ValueError, match=r"Argument `values` must have shape \(values,\)"):
        vx.follow_attractors(MIRRORED, FREQUENCY, 1.0, 3)
    with pytest.raises(ValueError, match="names nothing"):
        vx.follow_attractors(MIRRORED, "x0[0]", [0.1], 3)
    with pytest.raises(ValueError, match="Argument `threshold` must be positive"):
        vx.follow_attractors(MIRRORED, FREQUENCY, [1.0], 3, threshold=0.0)


# The paper's machines, and others: long to compile


@pytest.mark.slow
@pytest.mark.thorough
def test_case_a_has_two_attractors_at_1_8():
    ds = found(vx.models.wagg_bishop_a(1.8), 90)
    assert ds.num_periods.values.tolist() == [3, 2]
    assert ds.num_impacts.values.tolist() == [[1, 1], [1, 0]]


@pytest.mark.slow
def test_chaos_of_case_a_at_1_4_is_a_transient_beside_the_motion_without_impacts():
    system = vx.models.wagg_bishop_a(1.4)
    ds = found(system, 90)
    assert ds.motion.values.tolist() == [0]
    assert ds.share.values.tolist() == [1.0]
    # After 100 periods many still impact; after 3000 none does.
    values = {"x0[0]": np.linspace(-0.3, 0.3, 9), "v0[0]": np.linspace(-1, 1, 10)}
    kinds = [vx.sweep(system, values, transient=t, max_impacts=0, progress=False) for t in (100, 3000)]
    impacting = [float((one.num_impacts.sum("stop") > 0).mean()) for one in kinds]
    assert impacting[0] > 0.2
    assert impacting[1] == 0


@pytest.mark.slow
@pytest.mark.thorough
def test_chaos_of_case_b_at_2_05_lasts_beside_a_cycle():
    system = vx.models.wagg_bishop_b(2.05)
    values = {"x0[0]": np.linspace(-0.3, 0.3, 8), "v0[0]": np.linspace(-1, 1, 10)}
    ds = vx.basins(system, values, progress=False)
    assert sorted(ds.num_periods.values.tolist()) == [0, 1]
    largest = ds.exponents.values[:, 0]
    assert ((largest > 0.1) == (ds.num_periods.values == 0)).all()
    long = vx.classify(vx.sweep(system, values, transient=3000, progress=False))
    np.testing.assert_array_equal(ds.num_periods.values[ds.label.values], long.num_periods)


@pytest.mark.slow
def test_machines_with_contacts_and_with_forces_have_attractors():
    damper = found(vx.models.impact_damper(1.1), 60)
    # Mirror images.
    assert damper.num_impacts.values.tolist() == [[4, 4], [4, 4]]
    assert damper.num_periods.values.tolist() == [2, 2]
    duffing = found(vx.models.duffing_oscillator(1.2), 60)
    assert duffing.num_impacts.values.tolist() == [[2], [1]]
    assert duffing.is_stable.all()
