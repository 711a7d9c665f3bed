"""Layers of a bifurcation diagram: the points of a sweep in one colour, with the stability of their orbits."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._sweep.short_names import with_paths
from ._axes import label_if_new
from ._colors import curve_colors, faded, ink, lightness_of, merge_style, point_colors
from ._legend import add_legend
from ._orbits import STABLE, UNKNOWN, UNSTABLE, OrbitsLike, as_sweep, list_of_orbits, stability_of
from ._ordinates import Ordinate
from ._scattered import is_scattered, levels_of

# Marker sizes: sweep down, single sweep, sweep up, separate orbits.
_LARGE, _MIDDLE, _SMALL, _OVER = 4.0, 2.0, 1.8, 3.0
# Number of swept values whose points of these sizes join into a line, and the largest factor of the sizes for fewer.
_LINE, _LARGER = 400, 2.0
# Marker size of the points of a sweep in the legend.
_IN_LEGEND = 5.0
# Size of scattered points of the sweep down, relative to those of the sweep up.
_WIDER = 1.5
# Marker size of matplotlib's "." of diameter 1.
_DOT = 2.0
# Share left of a style colour in the sweep down, and the difference in lightness from the ink beyond which all is left.
_LEFT, _APART = 0.6, 0.3
# Stability of the orbit: marker, factor of its size, width of its edge, label.
_MARKS = {
    UNKNOWN: (".", 1.0, 0.0, ""),
    STABLE: (".", 2.2, 0.0, "stable orbit"),
    UNSTABLE: ("o", 1.8, 0.7, "unstable orbit"),
}


class Layer(NamedTuple):
    """Impacts in one colour: `ds` has the variables of a sweep, and the `stability` of their orbits.

    `wider` is a factor of the size of scattered points.
    """

    ds: xr.Dataset
    words: str
    color: Any
    size: float
    is_swept: bool = True
    wider: float = 1.0


def layers_of(sweeps: dict[str, xr.Dataset], path: str, orbits: OrbitsLike) -> list[Layer]:
    """All layers, in drawing order from the lowest."""
    if isinstance(orbits, xr.Dataset):
        if len(sweeps) > 1:
            raise ValueError(
                "Argument `orbits` is of one sweep, but several are drawn: mark them one by one."
            )
        ((name, ds),) = sweeps.items()
        sweeps, over = {name: ds.assign(stability=stability_of(ds, with_paths(orbits)))}, []
    else:
        found = list_of_orbits(orbits)
        num_stops = next(iter(sweeps.values())).sizes["stop"]
        over = [Layer(as_sweep(found, path, num_stops), "", ink(), _OVER, False)] if found else []
        sweeps = {
            name: ds.assign(stability=xr.full_like(ds["result"], UNKNOWN)) for name, ds in sweeps.items()
        }
    colors = point_colors(len(sweeps)) if len(sweeps) > 1 else [ink()]
    colored = zip(sweeps.items(), colors, strict=True)
    return [one for (name, ds), color in colored for one in _layers_of_sweep(ds, path, name, color)] + over


def _layers_of_sweep(ds: xr.Dataset, path: str, name: str, color: Any) -> list[Layer]:
    """The layers of one sweep: two if it runs up and down."""
    larger = float(np.clip(_LINE / ds["result"].sizes[path], 1.0, _LARGER))
    if "direction" not in ds["result"].dims:
        return [Layer(ds, name or "swept", color, larger * _MIDDLE)]
    pale = faded(color, 0.5) if name else _beside_ink()
    # Drawing order: the small points of the sweep up over the large ones of the sweep down, dark in light where both agree.
    looks = {"down": (pale, larger * _LARGE), "up": (color, larger * _SMALL)}
    before = f"{name}, " if name else ""
    return [
        Layer(ds.sel(direction=way), f"{before}swept {way}", *look, wider=_WIDER if way == "down" else 1.0)
        for way, look in looks.items()
    ]


def _beside_ink() -> str:
    """A colour of the style that differs from the ink in greyscale too."""
    color = curve_colors(2)[1][:3]
    far = abs(lightness_of(color) - lightness_of(ink())) > _APART
    return faded(color, 1.0 if far else _LEFT)


def draw_layer(
    layer: Layer,
    path: str,
    number: int,
    ordinate: Ordinate | str,
    ax: Axes,
    style: dict[str, Any],
    xlim: tuple[float, float] | None,
) -> None:
    """Draw the impacts of a layer at a stop, or a quantity of a stop or a mass; `ordinate` is a variable or a quantity."""
    if isinstance(ordinate, Ordinate):
        shown = layer.ds[ordinate.variable]
        shown = shown.isel({ordinate.axis: number}) if ordinate.axis else shown
        is_ours = shown.notnull()
    else:
        shown = layer.ds[ordinate]
        is_ours = layer.ds["impact_stop"] == number
    together = xr.broadcast(layer.ds[path], shown, is_ours, layer.ds["stability"])
    swept, drawn, is_ours, stability = (a.values for a in together)
    for known in _MARKS:
        is_it = is_ours & (stability == known)
        if known == UNKNOWN or is_it.any():
            words = layer.words if known == UNKNOWN else ""
            look = style if layer.is_swept else {}
            x, y = swept[is_it], drawn[is_it]
            if known != UNKNOWN:
                _draw_points(ax, x, y, known, layer, look, words)
                continue
            lies = is_scattered(x, y)
            _draw_points(ax, x[~lies], y[~lies], known, layer, look, words)
            if lies.any():
                spans = float(np.ptp(swept) if xlim is None else np.ptp(xlim)), float(np.ptp(y))
                _draw_scattered(ax, x[lies], y[lies], spans, layer, look)


def _draw_scattered(
    ax: Axes, x: np.ndarray, y: np.ndarray, spans: tuple[float, float], layer: Layer, style: dict[str, Any]
) -> None:
    size = merge_style(style).get("markersize")
    for points, diameter, alpha in levels_of(x, y, spans, ax, size and size / _DOT):
        dots = layer._replace(size=layer.wider * diameter * _DOT)
        _draw_points(ax, x[points], y[points], UNKNOWN, dots, {"alpha": alpha, **style}, "")


def _draw_points(
    ax: Axes, x: np.ndarray, y: np.ndarray, stability: int, layer: Layer, style: dict[str, Any], words: str
) -> None:
    marker, larger, edge, _ = _MARKS[stability]
    color = merge_style(style).get("color", layer.color)
    own = {
        "linestyle": "none",
        "marker": marker,
        "markersize": larger * layer.size,
        "markeredgewidth": edge,
        "markerfacecolor": "none" if edge else color,
        "color": color,
        "rasterized": True,
    }
    ax.plot(x, y, label=words, **merge_style(style, **own))


def draw_legend(layers: list[Layer], ax: Axes, *, has_lines: bool) -> None:
    """Add the legend of the colours, and of the stability markers present at any stop; `has_lines` if of lines too."""
    present = np.concatenate([layer.ds["stability"].values.ravel() for layer in layers])
    sample = layers[0]._replace(color=ink(), size=min(layer.size for layer in layers if layer.is_swept))
    for stability in (STABLE, UNSTABLE):
        if stability in present and (words := label_if_new(ax, _MARKS[stability][-1])):
            _draw_points(ax, np.empty(0), np.empty(0), stability, sample, {}, words)
    if len(ax.get_legend_handles_labels()[0]) > (0 if has_lines else 1):
        add_legend(ax, markerscale=_IN_LEGEND / sample.size)
