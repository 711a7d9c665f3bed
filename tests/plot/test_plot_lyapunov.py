"""A picture of Lyapunov exponents shows each at its value, and none that is not finite."""

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh

import vijax as vx

FREQUENCY, AMPLITUDE = "forcing.frequency", "forcing.amplitude[0]"


def exponents(*dims: str) -> xr.Dataset:
    """Exponents of 3 values of each quantity, in falling order; the last of two is sometimes minus infinity."""
    shape = (*(3 for _ in dims), 2)
    values = np.linspace(-0.4, 0.5, int(np.prod(shape))).reshape(shape)[..., ::-1].copy()
    values[0, ..., 1] = -np.inf
    variables = {
        "lyapunov_exponents": ((*dims, "exponent"), values),
        "lyapunov_error": ((*dims, "exponent"), np.full(shape, 0.01)),
    }
    return xr.Dataset(variables, {dim: [3.0, 2.0, 1.0] for dim in dims})


def test_each_exponent_is_a_line_with_a_band_of_two_errors():
    ds = exponents(FREQUENCY)
    ax = vx.plot.lyapunov(ds)
    for k in range(2):
        x, y = ax.lines[k].get_data()
        expected = ds.sortby(FREQUENCY).lyapunov_exponents[:, k]
        assert list(x) == [1.0, 2.0, 3.0]
        np.testing.assert_array_equal(y, expected.where(np.isfinite(expected)))
        band = ax.collections[k].get_paths()[0].vertices[:, 1]
        assert band.max() == pytest.approx(np.nanmax(y) + 0.02)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [r"$\lambda_{1}$", r"$\lambda_{2}$"]
    assert "Forcing frequency" in ax.get_xlabel()


def test_over_two_quantities_the_largest_is_red_where_it_is_positive():
    ds = exponents(FREQUENCY, AMPLITUDE)
    ax = vx.plot.lyapunov(ds)
    (mesh,) = (c for c in ax.collections if isinstance(c, QuadMesh))
    drawn = np.asarray(mesh.get_array()).reshape(3, 3)
    np.testing.assert_allclose(drawn, ds.sortby([FREQUENCY, AMPLITUDE]).lyapunov_exponents[..., 0].values.T)
    colors = mesh.cmap(mesh.norm(np.array([-0.3, 0.0, 0.3])))
    assert colors[0, 2] > colors[0, 0]
    assert colors[2, 0] > colors[2, 2]
    assert (colors[1, :3] > 0.9).all()


def test_what_has_no_exponents_is_refused():
    with pytest.raises(ValueError, match="lyapunov=True"):
        vx.plot.lyapunov(exponents(FREQUENCY).drop_vars("lyapunov_exponents"))
    with pytest.raises(ValueError, match="one or two swept quantities"):
        vx.plot.lyapunov(exponents(FREQUENCY).isel({FREQUENCY: 0}))
