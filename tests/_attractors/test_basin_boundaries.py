"""Dimensions of basin boundaries."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx


def grid_of(label: np.ndarray) -> xr.Dataset:
    return xr.Dataset({"label": (("x0[0]", "v0[0]"), label.astype(int))})


def test_a_smooth_boundary_has_the_exponent_one():
    x, v = np.meshgrid(np.linspace(-1, 1, 600), np.linspace(-1, 1, 600))
    found = vx.uncertainty_exponent(grid_of(x + 0.4 * v**2 > 0.1))
    # Near e = 1 step the grid has an effect, within the error.
    assert float(found.exponent) == pytest.approx(1.0, abs=0.03)
    assert float(found.dimension) == pytest.approx(1.0, abs=0.03)
    assert 0 < float(found.exponent_error) < 0.02


def test_a_boundary_of_cantor_sets_has_its_dimension():
    # Gaps of the middle-thirds set belong alternately to one attractor and the other, by their level.
    level, x = np.zeros(3**6, int), np.arange(3**6)
    for k in range(6):
        digit = x // 3 ** (5 - k) % 3
        level[(level == 0) & (digit == 1)] = k + 1
    row = np.pad(level % 2, 150)
    found = vx.uncertainty_exponent(grid_of(np.tile(row[:, None], (1, len(row)))))
    exact = 1 - np.log(2) / np.log(3)
    # With six levels sampled at steps of sqrt(2), the fractions rise in stairs.
    assert float(found.exponent) == pytest.approx(exact, abs=0.05)


def test_starts_that_are_not_known_do_not_count():
    x = np.tile(np.linspace(-1, 1, 200), (200, 1))
    label = np.where(x > 0, 1, 0)
    label[:, 150:] = -1
    whole, part = (vx.uncertainty_exponent(grid_of(a)).fraction for a in (x > 0, label))
    np.testing.assert_allclose(part[0] / whole[0], 150 / 124, rtol=1e-12)


def test_exponents_of_anything_else_are_refused():
    with pytest.raises(ValueError, match="has no `label` over a grid"):
        vx.uncertainty_exponent(xr.Dataset())
    with pytest.raises(ValueError, match="The grid has 9 x 9 starts: 32 along each axis"):
        vx.uncertainty_exponent(grid_of(np.eye(9)))
    with pytest.raises(ValueError, match="No boundary of basins passes"):
        vx.uncertainty_exponent(grid_of(np.zeros((64, 64))))
