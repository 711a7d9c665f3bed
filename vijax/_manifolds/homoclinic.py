"""Homoclinic tangencies: values of a parameter at which the unstable manifold of a saddle touches its stable one."""

import numpy as np
import xarray as xr

from .._branches.branch import Branch
from .._dataset_attributes import versions, with_words
from .._jax.arrays import Count, check_type, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles, tqdm
from .tangency_search import Saddles, Tangency, TangencySearch

# Least multiplier of a saddle: one closer to the unit circle is left too slowly.
_LEAST = 1.1


@says_what_compiles
@padding_allowed
def homoclinic_tangencies(
    branch: Branch,
    *,
    num_values: Count = 65,
    max_returns: Count = 2,
    progress: bool = True,
) -> xr.Dataset:
    """Find the values of a parameter at which the manifolds of a saddle touch, along its branch.

    On one side of such a value the unstable manifold passes by the stable one, on the other it crosses it. From there on
    boundaries of basins are fractal, and motions may be chaotic, for a while or for ever. The motions that leave the saddle are
    followed until they are near it again. There the stable manifold is a plane, so that masses may stick, and restitution may be 0.

    Args:
        branch: result of `vx.continuation`. Its saddles are the orbits that the machine follows with one multiplier outside the unit circle,
            of magnitude 1.1 at least.
        num_values: values of the parameter at which turns of the unstable manifold are looked for. A turn is seen only near the
            stable manifold, and a tangency is missed whose turn passes by between two values: take more, or a shorter branch.
        max_returns: maps, beyond those that lead away from the saddle, within which a motion is back near it. Behind a tangency
            there are mostly more, without end, with longer motions.
        progress: show a progress bar.

    Returns:
        A dataset along `tangency`, in the order of the parameter: the parameter by its path; `error`, its change where the last
        return is left out, and where the motion begins nearer to the saddle; `meet`, 1 where the manifolds cross above the value, -1 below;
        `is_smooth`, false where they touch with a corner, which a grazing impact makes, or where many motions stick and become one; `side` and `period` of the
        unstable manifold, as in `vx.manifolds`; `saddle_x0`, `saddle_v0` (tangency, mass); the homoclinic motion `x`, `v`
        (tangency, return, mass) from the saddle and back, at the phase of the branch, NaN behind its end; `num_periods` (tangency,),
        forcing periods from one return to the next. Attribute: `phase`, in radians.

    Raises:
        ValueError: for a branch without saddles, or of cycles without load; if the map is not smooth near a saddle; in single precision.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        stops = [vx.Stop(0, 1.0, "upper", 0.8), vx.Stop(0, -1.0, "lower", 0.8)]
        pendulum = vx.ImpactSystem([1.0], [[0.2]], [[-1.0]], vx.Harmonic([0.4], 1.5), stops)
        saddle = vx.periodic_orbit(pendulum, [-0.12], [0.02])
        branch = vx.continuation(saddle, "forcing.amplitude[0]", (0.3, 0.46))
        vx.homoclinic_tangencies(branch)["forcing.amplitude[0]"].values
        ```

    References:
        S. W. Shaw & R. H. Rand, Int. J. Non-Linear Mech. 24 (1989) 41; W.-J. Beyn & J.-M. Kleinkauf, SIAM J. Numer. Anal. 34
        (1997) 1207.
    """
    count, returns = whole_number("num_values", num_values, 2), whole_number("max_returns", max_returns, 1)
    parts = [Saddles(branch, points) for points in _parts(branch)]
    span = sum(one.span for one in parts)
    found: list[tuple[TangencySearch, Tangency]] = []
    with tqdm(unit="value", disable=not progress) as bar:
        for saddles in parts:
            share = max(int(np.ceil(count * saddles.span / span)), 2)
            search = TangencySearch(
                saddles, np.linspace(saddles.values[0], saddles.values[-1], share), returns
            )
            found += [(search, one) for one in search.run(bar.update)]
    return _dataset(branch, sorted(found, key=lambda pair: pair[1].value))


def _parts(branch: Branch) -> list[np.ndarray]:
    """Numbers of the points of each part of a branch that consists of saddles.

    Raises:
        ValueError: if there is none.
    """
    check_type("branch", branch, Branch, "a branch, one that `vx.continuation` or `vx.branches` returned")
    refuse_single_precision("homoclinic_tangencies", branch.points["x0"])
    if not branch.points.attrs["num_periods"]:
        raise ValueError(
            "`homoclinic_tangencies` is for orbits under a load: cycles without one have no stroboscopic map."
        )
    size = np.abs(branch.points["multipliers"].values)
    is_saddle = branch.points["is_admissible"].values & ((size > 1).sum(axis=1) == 1)
    is_saddle &= np.isfinite(size).all(axis=1) & (size.max(axis=1) >= _LEAST)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], is_saddle, [False]]).astype(int)))
    parts = [np.arange(*pair) for pair in ends.reshape(-1, 2)]
    parts = [part for part in parts if np.ptp(branch.values[part]) > 0]
    if not parts:
        raise ValueError(
            "The branch has no saddles, orbits with one multiplier of magnitude 1.1 or more: follow one that is unstable, such as "
            "the orbit of `vx.edge_state`."
        )
    return parts


def _dataset(branch: Branch, found: list[tuple[TangencySearch, Tangency]]) -> xr.Dataset:
    """The tangencies, one after another."""
    n = branch.points.sizes["mass"]
    shape = len(found), max((one.turn.maps + 1 for _, one in found), default=0), 2 * n
    saddles, motions = np.full((len(found), 2 * n), np.nan), np.full(shape, np.nan)
    for k, (search, one) in enumerate(found):
        at = search.motions(one.which, one.value)
        scale, path = at.seed.map.scale, at.motions(np.array([one.turn.place]), one.turn.maps)
        saddles[k], motions[k, : len(path)] = at.target / scale, path[:, 0] / scale
    names = [search.saddles.names[one.which] for search, one in found]
    of = lambda name, kind: np.array([getattr(one, name) for _, one in found], kind)  # noqa: E731
    sides, periods = (np.array([name[k] for name in names], int) for k in (1, 3))
    num_periods = np.array([search.saddles.num_periods for search, _ in found], int)
    columns = {
        branch.path: ("tangency", of("value", float), "parameter"),
        "error": ("tangency", of("error", float), "error of the parameter"),
        "meet": ("tangency", of("meet", int), "side of the value on which manifolds cross"),
        "is_smooth": ("tangency", of("is_smooth", bool), "whether no corner touches"),
        "side": ("tangency", sides, "side of the saddle"),
        "period": ("tangency", periods, "forcing periods since the start of the orbit"),
        "num_periods": ("tangency", num_periods, "forcing periods from one return to the next"),
        "saddle_x0": (("tangency", "mass"), saddles[:, :n], "position of the saddle"),
        "saddle_v0": (("tangency", "mass"), saddles[:, n:], "velocity of the saddle"),
        "x": (("tangency", "return", "mass"), motions[..., :n], "position of the homoclinic motion"),
        "v": (("tangency", "return", "mass"), motions[..., n:], "velocity of the homoclinic motion"),
    }
    attrs = {"path": branch.path, "phase": 2 * np.pi * float(branch.points.attrs["phase"])}
    return xr.Dataset(with_words(columns), attrs=attrs | versions())
