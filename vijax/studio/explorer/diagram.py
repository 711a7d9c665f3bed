"""Clickable diagram of a sweep: impacts over one swept quantity, kinds of motion over two.

Many points are drawn by datashader, as an image of the visible part. A chart is always an image: on an even grid every
pixel has the motion of the nearest point.
"""

import re
from collections.abc import Mapping
from functools import reduce
from operator import mul
from typing import Any

import holoviews as hv
import numpy as np
import panel as pn
import xarray as xr
from holoviews.operation.datashader import datashade, spread
from matplotlib.colors import to_hex

from ..._sections.classify import classify
from ...plot._labels import axis_label
from ...plot._motions import legend_entries, motions_of
from .look import PageStyle
from .motion import nearest_value

hv.extension("bokeh", inline=pn.config.inline)

# Number of points above which a browser becomes slow.
MANY = 20_000
_PIXELS, _CLASSES = 800, 6
_SYMBOLS = {r"\Omega": "Ω", r"\varphi": "φ", r"\dot x": "ẋ"}


def plain_label(path: str) -> str:
    """Label of a swept quantity without TeX."""
    words = axis_label(path)
    for tex, sign in _SYMBOLS.items():
        words = words.replace(tex, sign)
    return re.sub(r"\$|_\{[\d,]*\}", "", words).replace(r"\times", "*")


def impacts(ds: xr.Dataset, path: str, stop: int, look: PageStyle) -> Any:
    """Velocities of the impacts at a stop against the swept quantity.

    Args:
        ds: a sweep over one quantity, possibly up and down.
        path: path of the quantity.
        stop: index of the stop.
        look: colours.
    """
    axes = [
        hv.Dimension("swept", label=plain_label(path)),
        hv.Dimension("velocity", label=f"Velocity before impact at stop {stop}"),
    ]
    layers = []
    for way, color in {"down": look.down, "up": look.up}.items():
        one = ds if "direction" not in ds["result"].dims else ds.sel(direction=way)
        swept, velocity, of_stop = xr.broadcast(one[path], one["impact_velocity"], one["impact_stop"])
        ours = of_stop.values == stop
        points = hv.Points((swept.values[ours], velocity.values[ours]), axes)
        if len(points) > MANY:
            layers.append(spread(datashade(points, cmap=[color], min_alpha=110), px=1))
        else:
            layers.append(points.opts(color=color, size=2.5 if way == "up" else 4))
        if one is ds:
            break
    return reduce(mul, layers)


def chart_image(ds: xr.Dataset, right: str, up: str, look: PageStyle) -> tuple[Any, dict[str, str]]:
    """Image of the kinds of motion over two swept quantities, and its legend: words and their colours."""
    kinds = classify(ds).transpose(right, up, ...).sortby([right, up])
    with look.style():
        drawn, numbers = legend_entries(motions_of(kinds), _CLASSES)
    colors = {entry.words: to_hex(entry.color) for entry in drawn}
    code = numbers.reshape(kinds["motion"].shape)
    whole = xr.DataArray(code, {right: kinds[right], up: kinds[up]}, (right, up))
    even = {dim: _even(kinds[dim].values) for dim in (right, up)}
    pixels = whole.sel(even, method="nearest").values.T
    image = hv.Image(
        (even[right], even[up], pixels),
        [hv.Dimension("right", label=plain_label(right)), hv.Dimension("up", label=plain_label(up))],
        hv.Dimension("kind", range=(-0.5, len(drawn) - 0.5)),
    )
    legend = {words.replace(r"$\infty$", "∞"): color for words, color in colors.items()}
    return image.opts(cmap=list(colors.values()), colorbar=False), legend


def marker(x: float, y: float | None, look: PageStyle) -> Any:
    """Marker of the shown point: a line in a bifurcation diagram, a ring in a chart."""
    if y is None:
        return hv.VLine(x).opts(color=look.chosen, line_width=1)
    style: dict[str, Any] = {"line_color": look.chosen, "fill_alpha": 0, "line_width": 2.5, "size": 12}
    return hv.Points([(x, y)]).opts(**style)


def direction_near(ds: xr.Dataset, path: str, stop: int, at: Mapping[str, float]) -> str:
    """Direction of a sweep up and down whose impacts at a stop are nearer to a place in the diagram."""
    point = nearest_value(ds, path, at["x"])
    away = (
        abs(point["impact_velocity"].where(point["impact_stop"] == stop) - at["y"])
        .min("impact")
        .fillna(np.inf)
    )
    return str(point["direction"].values[int(away.argmin("direction"))])


def _even(values: np.ndarray) -> np.ndarray:
    """The values if they are evenly spaced and few, else evenly spaced pixels."""
    steps = np.diff(values)
    is_even = len(values) <= _PIXELS and np.allclose(steps, steps[0])
    return values if is_even else np.linspace(values[0], values[-1], _PIXELS)
