"""Carried sweeps, in which every point starts where the one before it ended, against one point after another."""

import jax
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._execution import lane_loop
from vijax._execution.settings import ExecutionSettings

FREQUENCY = "forcing.frequency"
TRANSIENT, RECORD = 60, 5
# Difference that another computation leaves in a settled motion.
SETTLED = 1e-9


def sweep(frequencies, **options):
    return vx.sweep(
        vx.models.wagg_bishop_a(1.0),
        {FREQUENCY: frequencies},
        transient=TRANSIENT,
        record=RECORD,
        progress=False,
        **options,
    )


@jax.jit
def run(frequency, x, v) -> tuple[jax.Array, jax.Array]:
    """End state of one point."""
    system = vx.models.wagg_bishop_a(frequency)
    end = (TRANSIENT + RECORD) * system.forcing.period
    sol = vx.simulate(system, 0.0, end, x, v, max_events=0, throw=False)
    return sol.x1, sol.v1


def one_after_another(frequencies, x0=(0.0, 0.0), v0=(0.0, 0.0)):
    """End states carried by hand from point to point, (points, 2, n)."""
    x, v, ends = np.array(x0), np.array(v0), []
    for frequency in frequencies:
        x, v = run(frequency, x, v)
        ends.append((np.asarray(x), np.asarray(v)))
    return np.array(ends)


# Periodic motions of one impact a period, of two, and of none; at some frequencies two of them coexist.
COEXISTING = np.array([0.82, 0.88, 0.94, 1.0, 1.06, 1.12])


@pytest.fixture(scope="module")
def both():
    return sweep(COEXISTING, carry="both")


def test_the_ends_are_those_of_one_point_after_another(both):
    up = one_after_another(COEXISTING)
    down = one_after_another(COEXISTING[::-1], *up[-1])[::-1]
    for k, ends in enumerate((up, down)):
        np.testing.assert_allclose(both.x[k], ends[:, 0], rtol=0, atol=SETTLED)
        np.testing.assert_allclose(both.v[k], ends[:, 1], rtol=0, atol=SETTLED)


def test_up_and_down_find_different_motions_where_they_coexist(both):
    counts = both.num_impacts.sum("stop")
    assert (counts.sel(direction="up") != counts.sel(direction="down")).any()


def test_one_direction_is_half_of_both(both):
    up = sweep(COEXISTING, carry="up")
    assert up.attrs["carry"] == "up"
    np.testing.assert_allclose(up.x, both.x.sel(direction="up"), rtol=0, atol=SETTLED)
    np.testing.assert_array_equal(up.num_impacts, both.num_impacts.sel(direction="up"))
    down = sweep(COEXISTING, carry="down", carry_from=up)
    np.testing.assert_allclose(down.x, both.x.sel(direction="down"), rtol=0, atol=SETTLED)
    np.testing.assert_array_equal(down.num_impacts, both.num_impacts.sel(direction="down"))


def test_the_impacts_are_those_of_the_last_run_of_each_point(both):
    counts = np.isfinite(both.impact_time).sum("impact")
    np.testing.assert_array_equal(counts, both.num_impacts.sum("stop"))
    assert int(counts.sum()) > 0


def test_without_carry_a_sweep_goes_on_point_by_point():
    first = sweep(COEXISTING)
    second = sweep(COEXISTING, carry_from=first)
    for k, frequency in enumerate(COEXISTING):
        ends = one_after_another([frequency, frequency])
        np.testing.assert_allclose(second.x[k], ends[1, 0], rtol=0, atol=SETTLED)


def test_other_dimensions_are_independent_chains():
    starts = np.array([0.0, 0.05])
    system = vx.models.wagg_bishop_a(1.0)
    grid = vx.sweep(
        system, {FREQUENCY: COEXISTING, "x0[1]": starts}, transient=TRANSIENT, record=RECORD, carry="up",
        progress=False,
    )  # fmt: skip
    for k, start in enumerate(starts):
        ends = one_after_another(COEXISTING, x0=(0.0, start))
        np.testing.assert_allclose(grid.x[:, k], ends[:, 0], rtol=0, atol=SETTLED)


@pytest.mark.thorough
def test_a_stop_that_moves_in_pushes_its_mass_back():
    ds = vx.sweep(
        vx.models.wagg_bishop_a(0.5), {"stops[*].position": np.array([0.3, 0.2, 0.1])}, carry="up",
        transient=0, record=3, progress=False,
    )  # fmt: skip
    assert (ds.result == 0).all()
    assert (ds.x <= np.array([0.3, 0.2, 0.1])[:, None]).all()


def test_what_cannot_be_carried_is_refused():
    with pytest.raises(ValueError, match="carry"):
        sweep(COEXISTING, carry="left")
    with pytest.raises(ValueError, match="sweep the same grid"):
        sweep(COEXISTING, carry_from=sweep(COEXISTING[:2]))


def test_pieces_of_chains_change_nothing_and_are_not_compiled_anew(both, monkeypatch):
    traces = []
    original = lane_loop.advance
    monkeypatch.setattr(lane_loop, "advance", lambda *args: traces.append(1) or original(*args))
    in_pieces = sweep(COEXISTING, carry="both", settings=ExecutionSettings(visits=5))
    assert not traces
    xr.testing.assert_equal(in_pieces, both)


@pytest.mark.parametrize("carry", ["up", "down"])
def test_a_chaotic_motion_goes_on_where_the_point_before_it_ended_bit_for_bit(carry):
    frequencies = np.linspace(0.55, 0.6, 4)
    ds = sweep(frequencies, carry=carry).isel({FREQUENCY: slice(None, None, 1 if carry == "up" else -1)})
    for k in (1, 2):
        before, here = ds.isel({FREQUENCY: k - 1}), ds.isel({FREQUENCY: k})
        again = sweep(ds[FREQUENCY].values[k : k + 2], carry="up", x0=before.x.values, v0=before.v.values)
        again = again.isel({FREQUENCY: 0})
        for name in ("num_impacts", "x", "v", "section_x"):
            np.testing.assert_array_equal(again[name], here[name])
