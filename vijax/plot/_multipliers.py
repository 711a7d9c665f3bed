"""Floquet multipliers of periodic orbits in the complex plane."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PathCollection
from matplotlib.colors import ListedColormap, Normalize, to_rgba_array
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Circle

from .._orbits.orbit import PeriodicOrbit
from .._sweep.short_names import with_paths
from ._axes import create_axes
from ._cloud import MARKERS
from ._colors import ink, merge_style, ordered_colors
from ._labels import Units, axis_label, swept_quantity
from ._legend import add_legend
from ._orbits import OrbitsLike, list_of_orbits

_DIRECTIONS = {"up": ("^", "swept up"), "down": ("v", "swept down")}
# Largest number of orbits with a marker and a name each.
_NAMED = 5
# (largest count, marker area).
_SIZES = ((40, 30.0), (400, 14.0), (np.inf, 6.0))
# Ratio of the axis limit to the outermost drawn multiplier, or to the circle.
_WIDER = 1.15


def multipliers(
    orbits: OrbitsLike,
    *,
    limit: float = 3.0,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw Floquet multipliers in the complex plane, with the unit circle.

    Markers are filled inside the circle, where perturbations of an orbit decay, and open elsewhere. An orbit passes a
    fold where a multiplier crosses 1, and a period doubling where one crosses -1. Multipliers beyond `limit`, and
    infinite ones of grazing orbits, are stars on the edge of the picture, in their direction, counted in the legend.

    Args:
        orbits: one orbit, or several, which differ in colour and marker, more than five in colour alone, ordered from
            first to last; or the result of `vx.periodic_orbits` over one swept quantity, which the colours show.
        limit: largest real and imaginary part drawn at their true position; greater than 1.
        units: unit of the swept quantity, as in `{"time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into; new axes if omitted.
        **style: properties of the points for matplotlib's `scatter`: `color`, `marker`, `s`, `linewidths`, ...; and
            `markersize`, as in its `plot`.

    Returns:
        The axes.

    Raises:
        ValueError: if there is no orbit, one was not found, not exactly one quantity is swept, or `limit` is too small.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), {"forcing.frequency": np.arange(0.7, 0.9, 0.005)})
        ax = vx.plot.multipliers(vx.periodic_orbits(ds))
        ```

    References:
        Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, Sec. 4.1.
    """
    if not limit > 1:
        raise ValueError(f"Argument `limit` must be greater than 1, the unit circle, but is {limit}.")
    groups, bar = (
        _of_sweep(orbits) if isinstance(orbits, xr.Dataset) else (_of_list(list_of_orbits(orbits)), None)
    )
    style = _of_points(style)
    if "color" in style:
        color = to_rgba_array(style.pop("color"))
        groups, bar = [one._replace(colors=color.repeat(one.values.size, 0)) for one in groups], None
    reach = np.concatenate([_reach(group.values) for group in groups] or [np.empty(0)])
    if not reach.size:
        raise ValueError("Argument `orbits` holds no orbit that was found: give one or more.")
    ax = create_axes() if ax is None else ax
    ax.add_patch(Circle((0, 0), 1, facecolor=ink("0.94", "0.16"), edgecolor="0.5", zorder=0))
    for group in groups:
        _draw_near(ax, group, limit, next(size for most, size in _SIZES if reach.size <= most), style)
    edge = _WIDER * reach[reach <= limit].max(initial=1)
    _draw_far(ax, groups, limit, edge)
    ax.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal")
    ax.set_xlabel(r"Real part of the multipliers, $\mathrm{Re}\,\mu$")
    ax.set_ylabel(r"Imaginary part, $\mathrm{Im}\,\mu$")
    if bar is not None:
        path, colors = bar
        # Inset axes, as high as the axes: a bar that takes room from square axes would not be.
        ax.figure.colorbar(colors, cax=ax.inset_axes((1.04, 0, 0.05, 1)), label=axis_label(path, units))
    add_legend(ax, is_shown=legend)
    return ax


class _Group(NamedTuple):
    """Multipliers with one marker, and their colours, (multipliers, 4)."""

    values: np.ndarray
    colors: np.ndarray
    words: str
    marker: str


def _of_list(orbits: list[PeriodicOrbit]) -> list[_Group]:
    """A group for each orbit, named if there are several but few."""
    groups, is_named = [], 1 < len(orbits) <= _NAMED
    for k, (orbit, color) in enumerate(zip(orbits, ordered_colors(len(orbits)), strict=True)):
        values = np.asarray(orbit.multipliers)
        words, marker = (f"orbit {k}", MARKERS[k]) if is_named else ("", "o")
        groups.append(_Group(values, np.tile(color, (values.size, 1)), words, marker))
    return groups


def _of_sweep(orbits: xr.Dataset) -> tuple[list[_Group], tuple[str, ScalarMappable]]:
    """A group for each direction of the sweep; the path of the swept quantity, and its colours."""
    orbits = with_paths(orbits)
    path = swept_quantity(orbits["converged"], "A picture of multipliers")
    swept = orbits[path].values
    colors = ScalarMappable(Normalize(swept.min(), swept.max()), ListedColormap(ordered_colors(256)))
    ways = _DIRECTIONS if "direction" in orbits["converged"].dims else {None: ("o", "")}
    groups = []
    for way, (marker, words) in ways.items():
        one = orbits if way is None else orbits.sel(direction=way)
        is_orbit = one["converged"].values
        values = one["multipliers"].transpose(path, "multiplier").values[is_orbit]
        of_points = np.repeat(swept[is_orbit], values.shape[1])
        groups.append(_Group(values.ravel(), colors.to_rgba(of_points), words, marker))
    return groups, (path, colors)


def _of_points(style: dict[str, Any]) -> dict[str, Any]:
    """Properties of the points for `scatter`, whose size is the square of the `markersize` of `plot`."""
    style = dict(style)
    size = style.pop("markersize", style.pop("ms", None))
    return merge_style(style, PathCollection, **({} if size is None else {"s": size**2}))


def _reach(values: np.ndarray) -> np.ndarray:
    """Axis limit needed to show each multiplier."""
    return np.maximum(np.abs(np.real(values)), np.abs(np.imag(values)))


def _draw_near(ax: Axes, group: _Group, limit: float, size: float, style: dict[str, Any]) -> None:
    """Draw the multipliers within the limit."""
    is_near = _reach(group.values) <= limit
    mu, colors = group.values[is_near], group.colors[is_near]
    own = {"s": size, "marker": group.marker, "linewidths": 0.8, "label": group.words}
    if MarkerStyle(style.get("marker", group.marker)).is_filled():
        own |= {"facecolors": np.where(np.abs(mu)[:, None] < 1, colors, 0.0), "edgecolors": colors.tolist()}
    else:  # unfilled marker
        own |= {"facecolors": colors}
    ax.scatter(np.real(mu), np.imag(mu), **merge_style(own, PathCollection) | style)


def _draw_far(ax: Axes, groups: list[_Group], limit: float, edge: float) -> None:
    """Draw the multipliers beyond the limit on the edge of the picture."""
    values = np.concatenate([group.values for group in groups])
    is_far = _reach(values) > limit
    if not is_far.any():
        return
    mu, colors = values[is_far], np.concatenate([group.colors for group in groups])[is_far]
    is_infinite, labelled = np.isinf(np.abs(mu)), []
    if not is_infinite.all():
        largest = np.abs(mu[~is_infinite]).max()
        labelled.append(f"{np.count_nonzero(~is_infinite)} farther out,\nup to $|\\mu|$ = {largest:.3g}")
    if is_infinite.any():
        labelled.append(f"{np.count_nonzero(is_infinite)} infinite")
    # Infinity has no direction: near grazing a real multiplier diverges, and may return from the other side.
    mu = np.where(is_infinite, 1, mu)
    at = edge * mu / _reach(mu)
    ax.scatter(
        np.real(at),
        np.imag(at),
        s=60,
        marker="*",
        c=colors,
        linewidths=0,
        clip_on=False,
        zorder=3,
        label="\n".join(labelled),
    )
