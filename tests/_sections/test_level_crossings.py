"""First passages, crossings and peaks: exact for a cosine, and in closed form for a linear oscillator under white noise."""

import numpy as np
import pytest

import vijax as vx

# The cubic between saved times is exact to the fourth power of the time between them.
CUBIC = 1e-6
# Standard errors by which a mean of samples with a fixed seed may miss.
ERRORS = 3.0


def free(load=None) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load or vx.Harmonic([0.0], 1.0), [])


@pytest.mark.thorough
def test_a_free_vibration_passes_levels_at_its_times():
    heights = np.array([0.5, 1.0, 2.0])
    ts = np.linspace(0.0, 21.0, 301)
    ds = vx.sweep(free(), {"v0[0]": heights}, duration=21.0, ts=ts, progress=False)
    found = vx.level_crossings(ds, [0.7, 1.5])
    np.testing.assert_allclose(found.first_passage[1:, 0], np.arcsin([0.7, 0.35]), atol=CUBIC)
    assert np.isnan(found.first_passage[0]).all()
    np.testing.assert_allclose(found.passage_share, [2 / 3, 1 / 3])
    np.testing.assert_allclose(found.peak, heights, atol=CUBIC)
    # Four upward crossings of 0.7 in 21 of time, by two of three samples.
    np.testing.assert_allclose(found.crossing_rate[0], 8 / 3 / 21.0)
    assert float(found.peak_mean_error) == pytest.approx(heights.std(ddof=1) / np.sqrt(3), rel=1e-5)


@pytest.mark.thorough
def test_excursions_shorter_than_a_step_are_counted():
    ds = vx.sweep(
        free(), {"v0[0]": [1.0, 1.0001]}, duration=12.0, ts=np.arange(0.0, 12.01, 0.3), progress=False
    )
    found = vx.level_crossings(ds, [0.999])
    assert float(found.crossing_rate[0]) == pytest.approx(2 / 12.0)


@pytest.mark.thorough
def test_a_sample_beyond_the_level_at_first_has_passed_it():
    ds = vx.sweep(free(), {"x0[0]": [1.0, 0.2]}, duration=9.0, ts=np.linspace(0, 9, 91), progress=False)
    found = vx.level_crossings(ds, [0.5], after=0.05)
    assert float(found.first_passage[0, 0]) == pytest.approx(0.1)
    assert np.isnan(found.first_passage[1, 0])


@pytest.mark.thorough
def test_an_oscillator_under_white_noise_has_its_variance_and_the_rate_of_rice():
    density, c, duration = 0.01, 0.4, 60.0
    rng = np.random.default_rng(5)
    noise = lambda w: density + 0 * w  # noqa: E731
    loads = [vx.random_load(noise, duration, rng, max_frequency=6.0) for _ in range(128)]
    system = vx.ImpactSystem([1.0], [[c]], [[1.0]], loads[0], [])
    records, ts = np.stack([load.values for load in loads]), np.linspace(0.0, duration, 601)
    ds = vx.sweep(system, {"forcing.values": records}, duration=duration, ts=ts, progress=False)
    # Beyond the cut the spectrum would add 2 S / (3 w^3) to the variance of x, and 2 S / w to that of v.
    of_x = np.pi * density / c - 2 * density / (3 * 6.0**3)
    of_v = np.pi * density / c - 2 * density / 6.0
    late = ds.sel(time=slice(30.0, None))
    for values, exact in ((late.xs, of_x), (late.vs, of_v)):
        squares = (values**2).mean(("time", "mass")).values
        assert abs(squares.mean() - exact) < ERRORS * squares.std(ddof=1) / np.sqrt(128)
    levels = np.array([0.0, 0.3, 0.5])
    found = vx.level_crossings(ds, levels, after=30.0)
    rate = np.sqrt(of_v / of_x) / (2 * np.pi) * np.exp(-(levels**2) / (2 * of_x))
    assert (np.abs(found.crossing_rate - rate) < ERRORS * found.crossing_rate_error).all()
    assert (found.crossing_rate_error < 0.1 * rate).all()


def test_datasets_without_states_and_levels_that_are_none_are_refused():
    periods = vx.sweep(free(), {"v0[0]": [0.5, 1.0]}, transient=1, record=1, progress=False)
    with pytest.raises(ValueError, match="has no saved states"):
        vx.level_crossings(periods, [0.1])
    ds = vx.sweep(free(), {"v0[0]": [0.5]}, duration=9.0, ts=[1.0, 2.0], progress=False)
    for arguments, words in (
        (([0.1],), "A single sample"),
        ((0.1,), "`levels` must have shape"),
        (([0.1], 1), "there are 1 masses"),
        (([0.1], 0, 5.0), "Fewer than two"),
    ):
        with pytest.raises(ValueError, match=words):
            vx.level_crossings(ds, *arguments[:2], **({"after": arguments[2]} if len(arguments) > 2 else {}))
