"""Clickable diagram of a sweep: impacts or a quantity over one swept quantity, kinds of motion over two.

Many points are drawn by datashader, as an image of the visible part. A chart is always an image: on an even grid every
pixel has the motion of the nearest point.
"""

import re
from collections.abc import Mapping
from functools import reduce
from operator import mul
from typing import Any, NamedTuple

import holoviews as hv
import numpy as np
import panel as pn
import xarray as xr
from matplotlib.colors import to_hex

from ..._sections.classify import classified
from ...plot._bifurcation import label_of_impacts
from ...plot._branch_lines import MARKERS
from ...plot._labels import axis_label
from ...plot._motions import legend_entries, motions_of
from ...plot._ordinates import Ordinate, ordinate_of, ordinates
from .look import FONT, PageStyle
from .motion import nearest_value

hv.extension("bokeh", inline=pn.config.inline)

# Name of the ordinate that every sweep has: impact velocities.
IMPACTS = "velocity"
# Number of points above which a browser becomes slow.
MANY = 20_000
_PIXELS, _CLASSES = 800, 6
_SYMBOLS = {r"\Omega": "Ω", r"\varphi": "φ", r"\dot x": "ẋ", "v^-": "v⁻"}


def plain_label(path: str, ds: xr.Dataset | None = None) -> str:
    """Label of a swept quantity of a dataset without TeX."""
    return plain(axis_label(path, None, ds))


def plain(words: str) -> str:
    """Words without TeX."""
    for tex, sign in _SYMBOLS.items():
        words = words.replace(tex, sign)
    indices = str.maketrans("0123456789,", "₀₁₂₃₄₅₆₇₈₉,")
    words = re.sub(r"_\{([\d,]*)\}", lambda found: found[1].translate(indices), words.replace("\n", " "))
    return re.sub(r"\$|_\{[\w, ]*\}", "", words).replace(r"\times", "*")


class Ordinates(NamedTuple):
    """Quantity that a diagram shows against the swept one.

    Attributes:
        name: "velocity" of the impacts, or a quantity of the sweep.
        stop: index of the stop.
        mass: index of the mass.
    """

    name: str
    stop: int
    mass: int

    def of(self, ds: xr.Dataset) -> xr.DataArray:
        """Values at every point, along dimensions of their own, NaN where there are none."""
        if self.name == IMPACTS:
            return ds["impact_velocity"].where(ds["impact_stop"] == self.stop)
        quantity = self._quantity(ds)
        one = ds[quantity.variable]
        return one.isel({quantity.axis: self.number(ds)}) if quantity.axis else one

    def number(self, ds: xr.Dataset) -> int:
        """Index of the stop or the mass that is drawn."""
        is_of_mass = self.name != IMPACTS and self._quantity(ds).axis == "mass"
        return self.mass if is_of_mass else self.stop

    def label(self, ds: xr.Dataset) -> str:
        """Label of the y axis."""
        masses = ds["stop_mass"].values
        if self.name == IMPACTS:
            return plain(label_of_impacts(IMPACTS, self.stop, masses, None))
        return plain(self._quantity(ds).label(self.number(ds), masses, None))

    def _quantity(self, ds: xr.Dataset) -> Ordinate:
        found = ordinate_of(self.name, ds)
        assert found is not None
        return found


def ordinates_in(ds: xr.Dataset) -> list[str]:
    """Names of what can be drawn of a sweep over one quantity."""
    found = {name: ordinate_of(name, ds) for name in ordinates()}
    return [IMPACTS, *(name for name, one in found.items() if one is not None and one.variable in ds)]


def points_of(ds: xr.Dataset, path: str, ordinate: Ordinates, look: PageStyle) -> Any:
    """Points of a sweep over one quantity, possibly up and down, against this quantity."""
    axes = [
        hv.Dimension("swept", label=plain_label(path, ds)),
        hv.Dimension("ordinate", label=ordinate.label(ds)),
    ]
    layers = []
    for way, color in {"down": look.down, "up": look.up}.items():
        one = ds if "direction" not in ds["result"].dims else ds.sel(direction=way)
        swept, values = xr.broadcast(one[path], ordinate.of(one))
        ours = np.isfinite(values.values)
        points = hv.Points((swept.values[ours], values.values[ours]), axes)
        if len(points) > MANY:
            layers.append(_shaded(points, color))
        else:
            layers.append(points.opts(color=color, size=2.5 if way == "up" else 4))
        if one is ds:
            break
    return reduce(mul, layers)


def _shaded(points: Any, color: str) -> Any:
    """Many points as an image of the visible part."""
    from holoviews.operation.datashader import rasterize, shade  # takes seconds to import, few sweeps need it

    return shade(rasterize(points).apply(_thickened), cmap=[color], min_alpha=110)


def _thickened(image: Any) -> Any:
    """Counts of points by pixel, those of the neighbours included, so that single points are seen.

    `spread` of datashader draws the same, but compiles two seconds for it.
    """
    counts = image.data[image.vdims[0].name]
    rows, columns = counts.shape
    wide = np.pad(counts.values, 1)
    shifted = [wide[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    whole = counts.copy(data=np.sum(shifted, axis=0, dtype=counts.dtype))
    return image.clone(image.data.assign({counts.name: whole}))


def branch_curves(lines: Mapping[bool, tuple[np.ndarray, np.ndarray]], look: PageStyle) -> Any:
    """A branch over the diagram: solid where it is stable, dashed where it is unstable."""
    drawn: list[Any] = [
        hv.Curve(xy, "swept", "ordinate").opts(
            color=look.chosen, line_width=2, line_dash="solid" if is_stable else "dashed"
        )
        for is_stable, xy in lines.items()
    ]
    return reduce(mul, drawn)


# Marker of bokeh, and sign in the legend, for each marker of matplotlib.
_MARKS = {
    "o": ("circle", "○"),
    "D": ("diamond", "◇"),
    "p": ("hex", "⬡"),
    "*": ("star", "☆"),
    "v": ("inverted_triangle", "▽"),
    "d": ("diamond_dot", "◈"),
    "^": ("triangle", "△"),
    "s": ("square", "□"),
}
_OTHER_MARK = ("hex_dot", "⬢")


def sign_of(kind: str) -> str:
    """Sign of a kind of bifurcation in the legend."""
    return _MARKS.get(MARKERS.get(kind, ""), _OTHER_MARK)[1]


def branch_marks(marks: Mapping[str, list[tuple[float, float]]], look: PageStyle) -> list[Any]:
    """The bifurcations of a branch, with a marker for each kind, as in `vx.plot.branch`."""
    style: dict[str, Any] = {"line_color": look.ink, "fill_color": look.page, "line_width": 1.5, "size": 9}
    return [
        hv.Points(places, ["swept", "ordinate"]).opts(
            marker=_MARKS.get(MARKERS.get(kind, ""), _OTHER_MARK)[0], **style
        )
        for kind, places in marks.items()
    ]


def chart_image(ds: xr.Dataset, right: str, up: str, look: PageStyle) -> tuple[Any, dict[str, str]]:
    """Image of the kinds of motion over two swept quantities, and its legend: words and their colours."""
    kinds = classified(ds).transpose(right, up, ...).sortby([right, up])
    with look.style():
        drawn, numbers = legend_entries(motions_of(kinds), _CLASSES)
    colors = {entry.words: to_hex(entry.color) for entry in drawn}
    code = numbers.reshape(kinds["motion"].shape)
    whole = xr.DataArray(code, {right: kinds[right], up: kinds[up]}, (right, up))
    even = {dim: _even(kinds[dim].values) for dim in (right, up)}
    pixels = whole.sel(even, method="nearest").values.T
    image = hv.Image(
        (even[right], even[up], pixels),
        [
            hv.Dimension("right", label=plain_label(right, ds)),
            hv.Dimension("up", label=plain_label(up, ds)),
        ],
        hv.Dimension("kind", range=(-0.5, len(drawn) - 0.5)),
    )
    legend = {words.replace(r"$\infty$", "∞"): color for words, color in colors.items()}
    return image.opts(cmap=list(colors.values()), colorbar=False), legend


def axes_in(look: PageStyle) -> Any:
    """Hook of a diagram that gives its border and axes the colours and the font of the page."""

    def hook(plot: Any, element: Any) -> None:
        del element
        own, ink = plot.state, look.ink
        own.border_fill_color, own.outline_line_color = look.page, look.faint
        for axis in own.axis:
            axis.update(axis_label_text_color=ink, major_label_text_color=ink, axis_line_color=ink,
                major_tick_line_color=ink, minor_tick_line_color=None, axis_label_text_font=FONT,
                major_label_text_font=FONT, axis_label_text_font_style="normal", axis_label_text_font_size="13px",
                major_label_text_font_size="12px")  # fmt: skip

    return hook


def marker(x: float, y: float | None, look: PageStyle) -> Any:
    """Marker of the shown point: a line in a bifurcation diagram, a ring in a chart."""
    if y is None:
        return hv.VLine(x).opts(color=look.chosen, line_width=1)
    style: dict[str, Any] = {"line_color": look.chosen, "fill_alpha": 0, "line_width": 2.5, "size": 12}
    return hv.Points([(x, y)]).opts(**style)


def direction_near(ds: xr.Dataset, path: str, ordinate: Ordinates, at: Mapping[str, float]) -> str:
    """Direction of a sweep up and down whose points are nearer to a place in the diagram."""
    point = nearest_value(ds, path, at["x"])
    values = ordinate.of(point)
    away = abs(values - at["y"]).min([dim for dim in values.dims if dim != "direction"]).fillna(np.inf)
    return str(point["direction"].values[int(away.argmin("direction"))])


def _even(values: np.ndarray) -> np.ndarray:
    """The values if they are evenly spaced and few, else evenly spaced pixels."""
    steps = np.diff(values)
    is_even = len(values) <= _PIXELS and np.allclose(steps, steps[0])
    return values if is_even else np.linspace(values[0], values[-1], _PIXELS)
