"""Random loads: Gaussian records with the variance and the correlation of their spectrum."""

import numpy as np
import pytest

import vijax as vx
from vijax._sweep.random_load import _cumulative, _integrals

# Standard errors by which a mean of samples with a fixed seed may miss.
ERRORS = 4.0


def white(w: np.ndarray) -> np.ndarray:
    return 0.5 + 0 * w


def test_records_have_the_correlation_of_band_limited_white_noise():
    rng, highest = np.random.default_rng(1), 3.0
    loads = [vx.random_load(white, 10.0, rng, max_frequency=highest) for _ in range(500)]
    t = np.asarray(loads[0].times)
    values = np.stack([load.values[:, 0] for load in loads])
    assert np.abs(values.mean(axis=0)).max() < ERRORS * np.sqrt(2 * 0.5 * highest / 500)
    found, exact = values.T @ values / 500, 2 * 0.5 * highest * np.sinc(highest * (t[:, None] - t) / np.pi)
    # The variance of a product of two jointly normal numbers.
    error = np.sqrt((exact**2 + exact[0, 0] ** 2) / 500)
    # Images by the end of twice the record, which decay as the correlation does.
    image = 2 * 0.5 / (20.0 - np.abs(t[:, None] - t))
    assert (np.abs(found - exact) / (ERRORS * error + image)).max() < 1.2
    kurtosis = (values**4).mean() / (values**2).mean() ** 2
    assert abs(kurtosis - 3) < 0.1


def test_a_narrow_spectrum_has_its_variance_in_records_shorter_than_its_memory():
    narrow = lambda w: 1 / ((1 - w**2) ** 2 + (0.02 * w) ** 2)  # noqa: E731
    width = 2 * np.pi / 40.0
    cells = np.append(0.0, (np.arange(200) + 0.5) * width)
    assert 2 * _integrals(narrow, cells).sum() == pytest.approx(np.pi / 0.02, rel=2e-4)


def test_a_pair_is_integrated_exactly():
    w, s = np.array([0.5, 1.0, 3.0]), np.array([0.0, 2.0, 1.0])
    edges = np.array([0.0, 0.7, 1.5, 2.0, 5.0])
    fine = np.linspace(0, 5, 500_001)
    density = np.interp(fine, w, s, left=0, right=0)
    whole = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])
    np.testing.assert_allclose(
        _cumulative(w, s, edges), np.interp(edges, fine, whole), atol=2e-5
    )  # the trapezoids of the jumps


def test_a_pair_and_a_function_draw_the_same_record():
    pair = vx.random_load(([0.0, 2.0], [0.5, 0.5]), 20.0, 7)
    function = vx.random_load(white, 20.0, 7, max_frequency=2.0)
    np.testing.assert_allclose(pair.values, function.values, atol=1e-13)
    np.testing.assert_array_equal(pair.times, function.times)


def test_all_masses_of_a_direction_feel_one_record_and_a_base_shakes_them():
    one = vx.random_load(white, 20.0, 3, max_frequency=2.0)
    two = vx.random_load(white, 20.0, 3, max_frequency=2.0, direction=[1.0, -0.5])
    values = np.asarray(one.values)
    np.testing.assert_array_equal(two.values, values * np.array([1.0, -0.5]))
    base = vx.base_excitation([1.0, 2.0], acceleration=one)
    np.testing.assert_array_equal(base.values, -values * np.array([1.0, 2.0]))


def test_a_function_is_cut_off_where_a_thousandth_of_its_variance_is_left():
    load = vx.random_load(lambda w: 1 / (1 + w**4), 50.0, 0)
    highest = 2 * np.pi * (len(load.times) - 1) / 12 / 50.0
    # The integral of 1 / (1 + w^4) from 0 is pi / (2 sqrt 2), and about 1 / (3 w^3) from w on.
    assert 1 / (3 * highest**3) == pytest.approx(1e-3 * np.pi / (2 * np.sqrt(2)), rel=0.05)


@pytest.mark.parametrize(
    ("spectrum", "words"),
    [
        (lambda w: 1 + 0 * w, "no finite variance"),
        (lambda w: 0 * w, "zero at all"),
        (lambda w: w - 1, "none negative"),
        (([0.0, 1.0], [1.0, 2.0, 3.0]), "as many densities"),
        (([1.0, 0.0], [1.0, 2.0]), "rising"),
        (([0.0, 1.0], [1.0, -2.0]), "none negative"),
        (3.0, "a function of angular frequencies"),
    ],
)
def test_other_spectra_are_refused(spectrum, words: str):
    with pytest.raises(ValueError, match=words):
        vx.random_load(spectrum, 10.0, 0)


def test_records_that_are_no_records_are_refused():
    with pytest.raises(ValueError, match="must be positive"):
        vx.random_load(white, -1.0, 0, max_frequency=1.0)
    with pytest.raises(ValueError, match="more than 2000000 knots"):
        vx.random_load(white, 1e7, 0, max_frequency=1.0)
    with pytest.raises(ValueError, match="`direction` must have shape"):
        vx.random_load(white, 10.0, 0, max_frequency=1.0, direction=1.0)
