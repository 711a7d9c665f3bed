"""Colours of the style in use: of curves, of what is ordered, of ink; how light they are on paper."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import cbook
from matplotlib.artist import Artist
from matplotlib.colors import to_hex, to_rgb, to_rgba_array
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle

# Curves that a printer without colour makes equally grey differ in their strokes.
STROKES = ("-", (0, (6, 1.5)), (0, (4, 1, 1, 1)), (0, (2, 1)))
# What a printer without colour makes of red, green and blue.
_LIGHTNESS = np.array([0.299, 0.587, 0.114])
# By how much greys of curves differ that are told apart, of 1 from black to white.
_TOLD_APART = 0.15
# From the darkest to the lightest of points that lightness tells apart.
_LADDER = (0.1, 0.75)


def styled(style: Mapping[str, Any], kind: type[Artist] = Line2D, /, **own: Any) -> dict[str, Any]:
    """What matplotlib is told: what the user says, by any of its names for it, else our own choice."""
    given = cbook.normalize_kwargs(dict(style), kind)
    if not MarkerStyle(given.get("marker") or "o").is_filled():
        own.pop("markeredgewidth", None)  # of a cross there would be nothing left
    return own | given


def of_curves(count: int) -> np.ndarray:
    """The first colours of the style in use, again from its beginning where it has fewer."""
    cycle = [to_rgb(one) for one in plt.rcParams["axes.prop_cycle"].by_key().get("color", ["C0"])]
    return np.array([(*cycle[k % len(cycle)], 1.0) for k in range(count)]).reshape(-1, 4)


def of_points(count: int) -> np.ndarray:
    """Colours of small points: those of the style, lighter or darker if a printer without colour would mix them up."""
    colors = of_curves(count)
    if _are_apart(colors):
        return colors
    ladder = np.linspace(_LADDER[0], _LADDER[1], count)
    lightness = 1 - ladder if is_dark() else ladder
    colors[:, :3] = [
        with_lightness(own[:3], one) for own, one in zip(colors, lightness.tolist(), strict=True)
    ]
    return colors


def of_order(count: int) -> np.ndarray:
    """Colours of what follows one another, dark to light, or light to dark where the background is dark."""
    ends = (1.0, 0.4) if is_dark() else (0.0, 0.75)
    return plt.get_cmap(plt.rcParams["image.cmap"])(np.linspace(*ends, count))


def ink(on_light: str = "black", on_dark: str = "white") -> str:
    """A colour that is seen on the background of the style in use."""
    return on_dark if is_dark() else on_light


def faded(color, share: float) -> str:
    """A colour of which a share is left, the rest is background."""
    background = to_rgb(plt.rcParams["axes.facecolor"])
    red, green, blue = (b + share * (a - b) for a, b in zip(to_rgb(color), background, strict=True))
    return to_hex((red, green, blue))


def with_lightness(color, lightness: float) -> np.ndarray:
    """The same hue as light as is asked for, 0 for black and 1 for white, once it is printed in grey."""
    rgb = np.array(to_rgb(color))
    own = lightness_of(rgb)
    if lightness <= own:
        return rgb * lightness / own
    return 1 - (1 - rgb) * (1 - lightness) / (1 - own)


def lightness_of(color) -> float:
    """How light a colour is in grey."""
    return float(_LIGHTNESS @ np.array(to_rgb(color)))


def is_dark() -> bool:
    """Whether the background of the style in use is."""
    return lightness_of(plt.rcParams["axes.facecolor"]) < 0.5


def looks_of(count: int, style: Mapping[str, Any]) -> list[tuple[np.ndarray, Any]]:
    """Colours and strokes of curves, unbroken ones if grey tells them apart, as it does not if the user gives all one colour."""
    color = styled(style).get("color")
    colors = of_curves(count) if color is None else to_rgba_array([color] * count)
    of_style = plt.rcParams["axes.prop_cycle"].by_key().get("linestyle")
    strokes = of_style or (STROKES[:1] if _are_apart(colors) else STROKES)
    return [(own, strokes[k % len(strokes)]) for k, own in enumerate(colors)]


def _are_apart(colors: np.ndarray) -> bool:
    """Whether grey tells colours apart."""
    greys = np.sort([lightness_of(color[:3]) for color in colors])
    return bool(np.all(np.diff(greys) >= _TOLD_APART))
