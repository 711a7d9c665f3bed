"""A picture of shares stacks, at each value of the parameter, the shares of starts that lead to each attractor."""

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
import xarray as xr
from drawings import words_of_legend
from matplotlib.colors import same_color

import vijax as vx

PATH = "forcing.frequency"
MOTIONS = ("non_impacting", "periodic", "chattering", "non_periodic", "not_settled", "failed")
# The second ends where the others begin; at the third value one start in twenty is not assigned.
SHARES = np.array([[0.5, 0.5, 0, 0], [0.45, 0.55, 0, 0], [0.9, 0, 0, 0.05], [0.7, 0, 0.3, 0]])
VALUES = [1.0, 1.1, 1.2, 1.4]
WORDS = [
    "1 in 1, up to 90 %",
    "3 in 2, up to 55 %",
    "no impact, up to 30 %",
    "non-periodic, up to 5 %",
    "not known",
]


def followed(order: slice = slice(None)) -> xr.Dataset:
    flags = {"flag_values": np.arange(6, dtype=np.int8), "flag_meanings": " ".join(MOTIONS)}
    is_found, along = SHARES > 0, (PATH, "attractor")
    return xr.Dataset(
        {
            "share": (along, SHARES),
            "motion": (along, np.where(is_found, [1, 1, 0, 3], -1).astype(np.int8), flags),
            "num_periods": (along, np.where(is_found, [1, 2, 1, 0], 0)),
            "num_impacts": ((*along, "stop"), np.where(is_found, [1, 3, 0, 0], np.nan)[..., None]),
        },
        {PATH: VALUES},
    ).isel({PATH: order})


def height_at(band, value: float) -> float:
    """Drawn height of a band at a value."""
    (path,) = band.get_paths()
    y = [point[1] for point in path.interpolated(40).vertices if abs(point[0] - value) < 4e-3]
    return max(y) - min(y) if y else 0.0


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)], ids=["up", "down"])
def test_each_attractor_is_as_high_as_its_share_at_every_value(order):
    ax = vx.plot.shares(followed(order))
    assert words_of_legend(ax) == WORDS
    patches = [patch.get_facecolor() for patch in ax.get_legend().get_patches()]
    bands = {
        k: band
        for band in ax.collections
        for k, p in enumerate(patches)
        if same_color(band.get_facecolor(), p)
    }
    assert [bool(bands[k].get_hatch()) for k in range(5)] == [False] * 4 + [True]
    left = 1 - SHARES.sum(axis=1, keepdims=True)
    for value, row in zip(VALUES, np.concatenate([SHARES, left], axis=1), strict=True):
        assert [height_at(bands[k], value) for k in range(5)] == pytest.approx(row, abs=1e-9)
    assert ax.get_xlim() == pytest.approx((0.95, 1.5))
    assert ax.get_xlabel() == r"Forcing frequency $\Omega$"
    # Each mark is in the middle of its band, where the band is widest.
    marks = [tuple(np.ravel(line.get_data())) for line in ax.lines]
    assert marks == [pytest.approx(place) for place in ((1.2, 0.45), (1.1, 0.725), (1.4, 0.85), (1.2, 0.925))]


def test_attractors_beyond_those_with_a_colour_are_others():
    ax = vx.plot.shares(followed(), max_attractors=2, alpha=0.5)
    assert words_of_legend(ax) == [*WORDS[:2], "other", "not known"]
    assert {band.get_alpha() for band in ax.collections} == {0.5}


def test_what_has_no_shares_along_a_parameter_is_refused():
    for ds in (followed().drop_vars("share"), followed(slice(0, 1)), followed().isel({PATH: 0})):
        with pytest.raises(ValueError, match=r"what `vx\.follow_attractors` returned for two values"):
            vx.plot.shares(ds)
    with pytest.raises(ValueError, match="`max_attractors` must lie in 0 to 8, but is 9"):
        vx.plot.shares(followed(), max_attractors=9)
