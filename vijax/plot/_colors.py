"""Colours of the current style: of curves, ordered series and ink; their lightness in greyscale."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import cbook
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb, to_rgba_array
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle

# Line styles of curves whose colours are too close in greyscale.
LINE_STYLES = ("-", (0, (6, 1.5)), (0, (4, 1, 1, 1)), (0, (2, 1)))
# Weights of red, green and blue in greyscale.
_LIGHTNESS = np.array([0.299, 0.587, 0.114])
# Least difference of distinguishable greys, 0 for black and 1 for white.
_LEAST_CONTRAST = 0.15
# Darkest and lightest colour of points that differ in lightness.
_LADDER = (0.1, 0.75)


def merge_style(style: Mapping[str, Any], kind: type[Artist] = Line2D, /, **own: Any) -> dict[str, Any]:
    """Properties for matplotlib: the user's, under any alias, over our defaults `own`."""
    given = cbook.normalize_kwargs(dict(style), kind)
    if not MarkerStyle(given.get("marker") or "o").is_filled():
        own.pop("markeredgewidth", None)  # an unfilled marker, as a cross, would vanish without its edge
    return own | given


def curve_colors(count: int) -> np.ndarray:
    """The first colours of the current style, repeated if it has fewer, (count, 4)."""
    cycle = [to_rgb(one) for one in plt.rcParams["axes.prop_cycle"].by_key().get("color", ["C0"])]
    return np.array([(*cycle[k % len(cycle)], 1.0) for k in range(count)]).reshape(-1, 4)


def colors_apart(ax: Axes, count: int) -> np.ndarray:
    """The first colours of the style that no line of the axes has, (count, 4); those of the style if they do not suffice."""
    used = {to_hex(line.get_color()) for line in ax.lines if to_hex(line.get_color()) != to_hex(ink())}
    every = dict.fromkeys(map(to_hex, curve_colors(len(plt.rcParams["axes.prop_cycle"]))))
    free = [one for one in every if one not in used]
    return to_rgba_array(free[:count]) if len(free) >= count else curve_colors(count)


def point_colors(count: int) -> np.ndarray:
    """Colours of small points: those of the style, with new lightness if they are too close in greyscale."""
    colors = curve_colors(count)
    if _are_apart(colors):
        return colors
    ladder = np.linspace(_LADDER[0], _LADDER[1], count)
    lightness = 1 - ladder if is_dark() else ladder
    colors[:, :3] = [
        with_lightness(own[:3], one) for own, one in zip(colors, lightness.tolist(), strict=True)
    ]
    return colors


def ordered_colors(count: int) -> np.ndarray:
    """Colours of an ordered series, dark to light, or light to dark on a dark background."""
    ends = (1.0, 0.4) if is_dark() else (0.0, 0.75)
    return plt.get_cmap(plt.rcParams["image.cmap"])(np.linspace(*ends, count))


def ink(on_light: str = "black", on_dark: str = "white") -> str:
    """The first colour on a light background of the current style, the second on a dark one."""
    return on_dark if is_dark() else on_light


def faded(color, share: float) -> str:
    """A colour blended into the background; `share` is what remains of it."""
    background = to_rgb(plt.rcParams["axes.facecolor"])
    red, green, blue = (b + share * (a - b) for a, b in zip(to_rgb(color), background, strict=True))
    return to_hex((red, green, blue))


def with_lightness(color, lightness: float) -> np.ndarray:
    """The same hue with the given lightness in greyscale, 0 for black and 1 for white."""
    rgb = np.array(to_rgb(color))
    own = lightness_of(rgb)
    if lightness <= own:
        return rgb * lightness / own
    return 1 - (1 - rgb) * (1 - lightness) / (1 - own)


def lightness_of(color) -> float:
    """Lightness of a colour in greyscale."""
    return float(_LIGHTNESS @ np.array(to_rgb(color)))


def is_dark() -> bool:
    """Flag of a dark background in the current style."""
    return lightness_of(plt.rcParams["axes.facecolor"]) < 0.5


def curve_styles(count: int, style: Mapping[str, Any]) -> list[tuple[np.ndarray, Any]]:
    """Colours and line styles of curves, all solid if the colours differ in greyscale."""
    color = merge_style(style).get("color")
    colors = curve_colors(count) if color is None else to_rgba_array([color] * count)
    of_style = plt.rcParams["axes.prop_cycle"].by_key().get("linestyle")
    strokes = of_style or (LINE_STYLES[:1] if _are_apart(colors) else LINE_STYLES)
    return [(own, strokes[k % len(strokes)]) for k, own in enumerate(colors)]


def _are_apart(colors: np.ndarray) -> bool:
    """True where all colours differ in greyscale."""
    greys = np.sort([lightness_of(color[:3]) for color in colors])
    return bool(np.all(np.diff(greys) >= _LEAST_CONTRAST))
