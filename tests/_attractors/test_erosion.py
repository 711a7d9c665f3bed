"""Integrity along a parameter is that of the basins at each value."""

import jax.numpy as jnp
import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
from coexisting_motions import QUIET, states
from drawings import words_of_legend

import vijax as vx

PATH, VALUES = "forcing.frequency", np.array([2.9, 3.0])
GRID = {"x0[0]": np.linspace(-0.5, 0.5, 24), "v0[0]": np.linspace(-3.0, 3.0, 24)}
MEASURES = ("share", "local_integrity", "integrity_factor", "local_integrity_error")


@pytest.mark.thorough
def test_the_erosion_is_that_of_the_basins_at_each_value_and_is_drawn():
    followed = vx.follow_attractors(QUIET, PATH, VALUES, GRID, integrity=True, progress=False)
    at = followed.isel({PATH: 1})
    basins = vx.basins(QUIET, GRID, progress=False)
    alone = vx.integrity(basins)
    for number in range(basins.sizes["attractor"]):
        away = np.abs(states(at) - states(basins)[number]).max(axis=1)
        same = int(np.nanargmin(away))
        assert away[same] < 1e-9
        for name in MEASURES:
            np.testing.assert_allclose(at[name][same], alone[name][number], rtol=1e-12)
    for name in ("basin_entropy", "boundary_basin_entropy"):
        assert followed[name].dims == (PATH,)
        np.testing.assert_allclose(at[name], alone[name], rtol=1e-12)
    ax = vx.plot.erosion(followed)
    drawn = [line.get_ydata() for line in ax.lines]
    assert len(drawn) == 3 * followed.sizes["attractor"]
    first = int(followed.share.max(PATH).values.argmax())
    np.testing.assert_array_equal(drawn[0], followed.share[:, first])
    np.testing.assert_array_equal(drawn[2], followed.local_integrity[:, first])
    assert {"share of the starts", "integrity factor", "local integrity"} <= {*words_of_legend(ax)}


def test_what_no_grid_tells_is_refused():
    for starts in (20, {"x0[0]": [0.0, 0.1]}, {"x0[0]": [0.0, 0.1], "v0[0]": np.arange(6.0)}):
        with pytest.raises(ValueError, match="must be a grid"):
            vx.follow_attractors(QUIET, PATH, jnp.asarray(VALUES), starts, integrity=True)
