"""Classification of motions as periodic, chattering, unsettled or chaotic, on records written by hand."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._sweep.recurrence import Recurrence, periods_left

PERIOD, RECORD = 2.0, 20
K = np.arange(1, RECORD + 1)
POINT = "forcing.frequency"


def record(section, impacts=(), *, masses=(0, 1), logged=None, room=0, **changes) -> xr.Dataset:
    """Dataset as from a sweep of one point.

    Args:
        section: the one velocity that changes at the ends of periods, (periods,), or all of them.
        impacts: time, velocity, stop and whether it is the last of a chatter.
        masses: the mass of each stop.
        logged: number of impacts in the log, if not all.
        room: the least length of the log.
        changes: variables to set.
    """
    section = np.asarray(section, float)
    v = section if section.ndim == 2 else np.stack([section, np.ones(len(section))], axis=1)
    rows = sorted((*row, False)[:4] for row in impacts)
    stops = np.array([row[2] for row in rows], int)
    rows = rows[:logged]
    time, velocity, stop, sticks = (np.array([row[i] for row in rows]) for i in range(4))
    own = {
        "impact_time": time.astype(float),
        "impact_phase": np.pi * time.astype(float) % (2 * np.pi),
        "impact_velocity": velocity.astype(float),
        "impact_stop": stop.astype(int),
        "impact_sticks": sticks.astype(bool),
    }
    fill = {"impact_stop": -1, "impact_sticks": False}
    free = (0, max(0, room - len(rows)))
    own = {name: np.pad(a, free, constant_values=fill.get(name, np.nan)) for name, a in own.items()}
    variables = {name: ((POINT, "impact"), a[None]) for name, a in own.items()}
    variables |= {
        "section_x": ((POINT, "period", "mass"), np.zeros((1, *v.shape))),
        "section_v": ((POINT, "period", "mass"), v[None]),
        "held_time": ((POINT, "period", "stop"), np.zeros((1, len(v), len(masses)))),
        "num_impacts": ((POINT, "stop"), [[(stops == j).sum() for j in range(len(masses))]]),
        "forcing_period": ((POINT,), [PERIOD]),
        "result": ((POINT,), np.zeros(1, np.int8)),
    }
    ds = xr.Dataset(variables, coords={"stop_mass": ("stop", list(masses))})
    return ds.assign({name: (ds[name].dims, value) for name, value in changes.items()})


def motion_of(ds: xr.Dataset, **options) -> tuple:
    """Kind of motion and its n."""
    point = vx.classify(ds, **options).isel({POINT: 0})
    return point.motion.flag_meanings.split()[int(point.motion)], int(point.num_periods)


def impacts_of(ds: xr.Dataset) -> list:
    return vx.classify(ds).num_impacts.values[0].tolist()


# Harmless differences


def test_an_impact_now_just_before_and_now_just_after_the_end_of_a_period_is_one():
    late = np.random.default_rng(0).uniform(-1e-7, 1e-7, RECORD)
    late[:2] = 0, 1e-16
    # If the impact is before the end or at it, the velocity at the end is that after the impact.
    ds = record(
        np.where(late <= 0, -0.35, 0.5), [(k * PERIOD + d, 0.5, 0) for k, d in zip(K, late, strict=True)]
    )
    assert motion_of(ds) == ("periodic", 1)
    assert impacts_of(ds) == [1, 0]
    assert vx.classify(ds).recurrence_error.item() < 1e-6


def test_impacts_of_two_masses_at_the_end_of_a_period_are_undone_each_for_itself():
    late = np.random.default_rng(1).uniform(-1e-7, 1e-7, (2, RECORD))
    v = np.where(late <= 0, [[-0.35], [0.21]], [[0.5], [-0.3]]).T
    hits = [(k * PERIOD + late[j, k - 1], (0.5, -0.3)[j], j) for k in K for j in range(2)]
    ds = record(v, hits)
    assert motion_of(ds) == ("periodic", 1)
    assert impacts_of(ds) == [1, 1]
    assert vx.classify(ds).num_double_impacts.item() == 1


def test_the_first_of_two_impacts_of_one_mass_before_the_end_is_the_one_to_undo():
    late = np.where(K % 2, 1e-6, -1e-6)
    hits = [
        (k * PERIOD + d + 1e-5 * j, 5 * 0.1 ** (j + 1), 0)
        for k, d in zip(K, late, strict=True)
        for j in (-1, 0)
    ]
    ds = record(np.where(K % 2, -3.5, -0.35), hits)
    assert motion_of(ds) == ("periodic", 1)
    assert impacts_of(ds) == [2, 0]


def test_two_masses_that_hit_together_may_change_their_order():
    first = np.random.default_rng(2).uniform(-1e-7, 1e-7, (2, RECORD))
    hits = [((k - 0.3) * PERIOD + first[j, k - 1], 0.4, j) for k in K for j in range(2)]
    assert len({row[2] for row in sorted(hits)[::2]}) == 2
    ds = record(np.full(RECORD, 0.2), hits)
    assert motion_of(ds) == ("periodic", 1)
    assert impacts_of(ds) == [1, 1]
    assert vx.classify(ds).num_double_impacts.item() == 1
    assert vx.classify(ds, double_impact_within=1e-12).num_double_impacts.item() == 0


def test_impacts_of_one_mass_are_no_double_impact_however_close():
    hits = [((k - 0.3) * PERIOD + 1e-5 * j, 0.4, j) for k in K for j in range(2)]
    assert vx.classify(record(np.ones(RECORD), hits, masses=(0, 0))).num_double_impacts.item() == 0


def test_a_double_impact_across_the_end_of_a_cycle_counts_once():
    edge = 1e-3 * PERIOD
    hits = [(k * PERIOD - edge + (-1e-5, 1e-5)[j], 0.4, j) for k in K for j in range(2)]
    ds = record(np.ones(RECORD), hits)
    assert impacts_of(ds) == [1, 1]
    assert vx.classify(ds).num_double_impacts.item() == 1


@pytest.mark.parametrize("n", [1, 2, 3, 5, 7, 10])
def test_every_cycle_of_up_to_half_the_record_is_told(n):
    ds = record(np.sin(K * 2 * np.pi / n + 0.3), [((k - 0.5) * PERIOD, 0.4, 1) for k in K if k % n == 0])
    assert motion_of(ds) == ("periodic", n)
    assert impacts_of(ds) == [0, 1]


def test_a_longer_cycle_cannot_be_told_from_chaos():
    assert motion_of(record(np.sin(K * 2 * np.pi / 11))) == ("non_periodic", 0)


def test_rounding_that_does_not_shrink_does_not_matter():
    noise = 1e-12 * np.random.default_rng(3).standard_normal(RECORD)
    assert motion_of(record(0.3 + noise)) == ("non_impacting", 1)


def test_a_mass_at_rest_is_periodic():
    assert motion_of(record(np.zeros((RECORD, 2)))) == ("non_impacting", 1)


# Slow convergence


@pytest.mark.parametrize(("factor", "n"), [(0.5, 1), (-0.5, 1), (0.3j, 1), (0.05, 2), (-0.2, 3)])
def test_a_motion_that_has_settled_is_periodic(factor, n):
    cycle = np.sin(K * 2 * np.pi / n + 0.3)
    assert motion_of(record(cycle + 0.01 * (factor**K).real)) == ("non_impacting", n)


@pytest.mark.parametrize("factor", [0.9, 0.97, 0.999, -0.9, -0.97, -0.999, 0.95j, 0.9 * np.exp(1j)])
@pytest.mark.parametrize("size", [1e-3, 1e-5])
def test_a_motion_that_settles_slowly_has_not_settled(factor, size):
    assert motion_of(record(0.3 + size * (np.asarray(factor) ** K).real)) == ("not_settled", 0)


def test_close_to_a_period_doubling_two_periods_are_not_taken_for_a_cycle():
    # After two periods it returns to 2e-7, but is still 1e-4 from the cycle of one period.
    ds = record(0.3 + 1e-4 * (-0.999) ** K)
    assert motion_of(ds) == ("not_settled", 0)
    assert vx.classify(ds).recurrence_error.item() < 1e-6
    # This one has doubled.
    assert motion_of(record(0.3 + 1e-4 * (-1.0) ** K)) == ("non_impacting", 2)


def test_a_motion_that_leaves_an_unstable_cycle_has_not_settled():
    assert motion_of(record(0.3 + 1e-12 * 2.0**K)) == ("not_settled", 0)


def test_how_long_a_motion_needs_is_unknown_where_it_leaves_a_cycle_however_fast():
    """The power of 1e20 that is looked at is beyond all numbers."""
    found = Recurrence(np.array([0, 0]), np.array([1.0, 1e-3]), np.array([1e20, 0.9]), np.array([True, True]))
    left = periods_left(found, 1e-9, RECORD)
    assert np.isnan(left[0])
    assert left[1] == np.ceil(np.log(1e-9 / 9e-3) / np.log(0.9))


def test_the_contraction_is_that_of_a_period():
    cycle = np.sin(K * np.pi + 0.3)
    found = vx.classify(record(cycle + 1e-3 * 0.6**K))
    assert found.num_periods.item() == 2
    assert found.contraction.item() == pytest.approx(0.6, rel=1e-3)


def test_in_single_precision_a_motion_is_told_to_what_can_be_known():
    cycle = np.sin(K * np.pi + 0.3) + 1e-5 * np.random.default_rng(5).uniform(-0.03, 0.03, RECORD)
    ds = record(cycle)
    assert motion_of(ds) == ("not_settled", 0)
    assert motion_of(ds.assign(section_v=ds.section_v.astype(np.float32))) == ("non_impacting", 2)


def test_a_larger_tolerance_settles_earlier():
    ds = record(0.3 + 1e-3 * 0.8**K)
    assert motion_of(ds) == ("not_settled", 0)
    assert motion_of(ds, tolerance=1e-3) == ("non_impacting", 1)


# Chaos


def logistic(rate: float, points: int) -> np.ndarray:
    """Orbits of x -> rate x (1 - x), (points, periods)."""
    x = np.random.default_rng(4).uniform(0.1, 0.9, points)
    orbit = []
    for _ in range(500 + RECORD):
        x = rate * x * (1 - x)
        orbit.append(x)
    return np.array(orbit[500:]).T


@pytest.mark.parametrize("rate", [3.7, 3.9, 4.0])
def test_chaos_is_never_called_periodic_and_seldom_called_settling(rate):
    v = logistic(rate, 20_000)
    section = np.stack([v, np.ones_like(v)], axis=-1)
    dims = (POINT, "period", "mass")
    many = record(v[0]).isel({POINT: np.zeros(len(v), int)})
    many = many.assign(section_v=(dims, section), section_x=(dims, 0 * section))
    kinds = vx.classify(many).motion.values
    not_settled, non_periodic = 4, 3
    assert set(kinds) <= {not_settled, non_periodic}
    assert (kinds == non_periodic).mean() > 0.98


def test_the_periodic_windows_between_are_called_periodic():
    for rate, n in ((3.2, 2), (3.5, 4), (3.84, 3)):
        assert motion_of(record(logistic(rate, 1)[0])) == ("non_impacting", n)


# Chatter, cut logs, failures


def test_a_complete_chatter_counts_as_infinitely_many_impacts():
    bounces = [((k - 0.6 + 0.3 * (1 - 0.7**j)) * PERIOD, 0.7**j, 0, j == 9) for k in K for j in range(10)]
    held = np.zeros((1, RECORD, 2))
    held[..., 0] = 0.2
    ds = record(np.ones(RECORD), [*bounces, *(((k - 0.5) * PERIOD, 0.3, 1) for k in K)], held_time=held)
    assert motion_of(ds) == ("chattering", 1)
    assert impacts_of(ds) == [np.inf, 1]
    np.testing.assert_allclose(vx.classify(ds).held_time, [[0.2, 0.0]])


def test_a_cut_log_leaves_the_motion_known_and_the_counts_unknown():
    hits = [((k - 0.5) * PERIOD, 0.3, 1) for k in K]
    ds = record(np.cos(np.pi * K), hits, logged=12)
    assert motion_of(ds) == ("periodic", 2)
    found = vx.classify(ds)
    assert np.isnan(found.num_impacts).all()
    assert np.isnan(found.num_double_impacts).all()
    pairs = vx.impact_map(ds)
    assert pairs.sizes["impact"] == 12
    assert np.isfinite(pairs.next_velocity).sum() == 11


def test_a_point_that_failed_says_so_and_leaves_its_neighbours_alone():
    hits = [((k - 0.5) * PERIOD, 0.3, 1) for k in K]
    sound = record(np.cos(np.pi * K), hits)
    broken = record(np.where(K < 15, 1.0, np.nan), hits[:14], room=RECORD)
    found = vx.classify(xr.concat([sound, broken, sound], POINT))
    assert found.motion.values.tolist() == [1, 5, 1]
    assert found.num_periods.values.tolist() == [2, 0, 2]
    for name in ("recurrence_error", "contraction", "num_double_impacts"):
        assert np.isfinite(found[name]).values.tolist() == [True, False, True]
    assert np.isnan(found.num_impacts[1]).all()


def test_what_belongs_to_n_periods_is_not_a_number_without_n():
    found = vx.classify(record(logistic(3.9, 1)[0], [((k - 0.5) * PERIOD, 0.3, 1) for k in K]))
    for name in ("num_impacts", "held_time", "num_double_impacts"):
        assert np.isnan(found[name]).all()
    assert 0 < found.recurrence_error.item() < 2


def test_an_impact_is_never_paired_with_one_of_another_point():
    hits = [((k - 0.5) * PERIOD, 0.1 * k, 0) for k in K]
    one, other = (record(np.ones(RECORD), hits[:count], room=RECORD) for count in (20, 7))
    pairs = vx.impact_map(xr.concat([one, other], POINT))
    np.testing.assert_array_equal(np.isfinite(pairs.velocity).sum("impact"), [20, 7])
    np.testing.assert_array_equal(np.isfinite(pairs.next_velocity).sum("impact"), [19, 6])
    np.testing.assert_allclose(pairs.next_velocity[:, :6], pairs.velocity[:, 1:7])


def test_a_sweep_in_any_order_of_its_dimensions_is_read_alike():
    hits = [((k - 0.5) * PERIOD, 0.3, 1) for k in K]
    ds = record(np.cos(np.pi * K), hits)
    turned = ds.transpose("mass", "stop", "impact", "period", POINT)
    assert vx.classify(turned).identical(vx.classify(ds))
    assert vx.impact_map(turned).identical(vx.impact_map(ds))


def test_without_stops_a_motion_is_still_told():
    ds = record(np.cos(np.pi * K))
    empty = ds.isel(stop=slice(0, 0))
    assert motion_of(empty) == ("non_impacting", 2)
    assert vx.impact_map(empty).sizes["impact"] == 0


def test_motions_that_have_not_settled_are_counted_with_the_time_that_they_need():
    machine = vx.models.impact_oscillator(1.0, position=0.2, damping_ratio=0.01, restitution=0.8)
    values = {"forcing.frequency": [1.8, 1.9]}
    ds = vx.sweep(machine, values, transient=30, record=16, progress=False)
    with pytest.warns(
        UserWarning, match=r"[12] of 2 motions have not settled. Run on for about \d+ forcing periods more"
    ) as said:
        vx.classify(ds)
    assert len(said) == 1
    more = int(str(said[0].message).split("about ")[1].split()[0])
    again = vx.sweep(machine, values, transient=30 + 2 * more, record=16, progress=False)
    assert (vx.classify(again).num_periods > 0).all()
