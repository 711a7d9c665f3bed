"""Attractors, basins and their following under wave forms and sums of loads: each start and each motion against its own run."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow

STARTS = {"x0[0]": np.linspace(-0.5, 0.5, 6), "v0[0]": np.linspace(-3.0, 3.0, 6)}
# A motion that repeats is solved to rounding; one that has settled for 400 periods is on it.
ROUNDING, SETTLED = 1e-13, 1e-6


def triangle(height, frequency):
    return vx.Waveform(np.pi / 2 * np.arange(4), height * np.array([[1.0], [0.0], [-1.0], [0.0]]), frequency)


LOADS = {
    "triangle": lambda w: triangle(1.0, w),
    "triangle and harmonic": lambda w: triangle(0.5, w) + vx.Harmonic([0.5], w),
}


def between_stops(load):
    stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
    return vx.ImpactSystem([1.0], [[0.05]], [[1.0]], load, stops)


def after(system, num_periods, x, v):
    end = vx.simulate(system, 0.0, num_periods * system.forcing.period, x, v, max_events=8, throw=False)
    return np.concatenate([end.x1, end.v1])


@pytest.mark.parametrize("name", LOADS)
def test_every_start_of_a_grid_ends_where_its_run_does(name):
    system = between_stops(LOADS[name](3.0))
    basins = vx.basins(system, STARTS, progress=False)
    assert basins.sizes["attractor"] == 2
    assert basins.num_periods.values.tolist() == [1, 1]
    ends = np.concatenate([basins.x0.values, basins.v0.values], axis=1)
    for end in ends:
        np.testing.assert_allclose(after(system, 1, end[:1], end[1:]), end, rtol=0, atol=ROUNDING)
    for i, x in enumerate(STARTS["x0[0]"]):
        for k, v in enumerate(STARTS["v0[0]"]):
            reached = np.abs(after(system, 400, [x], [v]) - ends).max(axis=1)
            assert reached.argmin() == basins.label.values[i, k]
            assert reached.min() < SETTLED


def test_motions_that_are_followed_repeat_at_each_frequency():
    system, frequencies = between_stops(triangle(1.0, 3.0)), np.array([2.9, 3.0, 3.1])
    found = vx.follow_attractors(system, "forcing.frequency", frequencies, STARTS, progress=False)
    assert found.is_found.values.all()
    np.testing.assert_allclose(found.share.sum("attractor"), 1, rtol=1e-12)
    for w in frequencies:
        own = found.sel({"forcing.frequency": w})
        assert own.num_periods.values.tolist() == [1, 1]
        for k in range(2):
            x, v = own.x0.values[k], own.v0.values[k]
            once = after(between_stops(triangle(1.0, w)), 1, x, v)
            np.testing.assert_allclose(once, np.concatenate([x, v]), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("load", "words"),
    [
        (triangle(1.0, 3.0) + vx.Harmonic([0.5], 2.0), "different frequencies"),
        (vx.Tabulated([0.0, 1.0, 2.0], [[0.0], [1.0], [0.0]]), "does not repeat"),
    ],
)
def test_loads_without_a_period_are_refused(load, words):
    system = between_stops(load)
    for call in (vx.attractors, vx.basins):
        with pytest.raises(ValueError, match=words):
            call(system, STARTS, progress=False)
    with pytest.raises(ValueError, match=words):
        vx.follow_attractors(system, "stops[0].position", [0.4, 0.5], STARTS, progress=False)
