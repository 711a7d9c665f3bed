"""Region charts: which motion is found where in a plane of two swept quantities."""

from collections import Counter
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_hex
from matplotlib.patches import Patch

from ._axes import label, legend_beside, new_axes, shades

# Only these repeat, and are told apart by impacts and periods.
_REPEATING = ("periodic", "chattering")
_WORDS = {"non_impacting": "no impact", "non_periodic": "non-periodic", "not_settled": "not settled"}
# White, then ever darker, then black: in grey too no two entries of the legend look the same.
_NO_IMPACT, _OTHER, _NON_PERIODIC = "#ffffff", "#dedede", "#000000"
# Instead of a number of impacts: infinitely many, and not counted because the log was cut.
_ENDLESS, _UNKNOWN = -1, -2
_COUNTS = {_ENDLESS: r"$\infty$", _UNKNOWN: "?"}


class _Class(NamedTuple):
    """A kind of motion, with its periods and impacts per stop if it repeats."""

    motion: str
    num_periods: int = 0
    num_impacts: tuple[int, ...] = ()

    @property
    def words(self) -> str:
        if self.motion not in _REPEATING:
            return _WORDS.get(self.motion, self.motion.replace("_", " "))
        impacts = " | ".join(_COUNTS.get(m, str(m)) for m in self.num_impacts)
        return f"{impacts} in {self.num_periods}"


def regions(classes: xr.Dataset, *, max_classes: int = 6, ax: Axes | None = None) -> Axes:
    """Draw the motions found over a plane of two swept quantities as regions of colour.

    "1 | 2 in 1" is a motion that repeats after 1 forcing period, with 1 impact at stop 0 and 2 at
    stop 1 in it; an infinity sign is a complete chatter, a question mark a log that was cut. Motions without
    impacts are white, non-periodic ones black.

    Args:
        classes: what `vx.classify` returned over two swept quantities, the first one drawn to the right and
            the second upwards: `motion`, an integer with the attributes `flag_values` and `flag_meanings`,
            `num_periods`, and with a dimension `stop` more `num_impacts`, infinite or -1 for a complete chatter.
        max_classes: how many motions, the most frequent ones, have a colour of their own beside the white
            and the black; the rest is "other".
        ax: where to draw; new axes if left out.

    Returns:
        The axes.

    Raises:
        ValueError: if a variable or its flags are missing, or there are not two swept dimensions of two values or more.

    Example:
        ```python
        import numpy as np, vijax as vx
        plane = {"forcing.frequency": np.arange(0.4, 2, 0.1), "forcing.amplitude[0]": np.arange(0.2, 1, 0.1)}
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), plane)
        ax = vx.plot.regions(vx.classify(ds))
        ```

    References:
        Wagg & Bishop (2004), Fig. 6.
    """
    _check(classes, max_classes)
    right, up = classes.motion.dims
    classes = classes.sortby([right, up])
    of_point = _classes_of_points(classes)
    colors = _colors(of_point, max_classes)
    names = list(colors)
    code = np.array([names.index(c.words if c.words in colors else "other") for c in of_point])
    ax = new_axes() if ax is None else ax
    ax.pcolormesh(
        classes[right].values,
        classes[up].values,
        code.reshape(classes.motion.shape).T,
        cmap=ListedColormap(list(colors.values())),
        vmin=-0.5,
        vmax=len(names) - 0.5,
        shading="nearest",
        rasterized=True,
    )
    ax.set_xlabel(label(str(right)))
    ax.set_ylabel(label(str(up)))
    patches = [Patch(facecolor=c, edgecolor="black", linewidth=0.6, label=n) for n, c in colors.items()]
    stops = " | ".join(str(j) for j in range(classes.sizes["stop"]))
    legend_beside(ax, handles=patches, title=f"impacts at stop {stops}\nin forcing periods")
    return ax


def words_of_motion(motion: xr.Dataset) -> str:
    """A single motion as the legend of the chart names it, from `motion`, `num_periods` and `num_impacts`."""
    (one,) = _classes_of_points(motion.expand_dims("point"))
    return one.words


def _check(classes: xr.Dataset, max_classes: int) -> None:
    for name in ("motion", "num_periods", "num_impacts"):
        if name not in classes:
            raise ValueError(f"A region chart needs the variable `{name}`, but there are {list(classes)}.")
    motion = classes.motion
    if not {"flag_values", "flag_meanings"} <= set(motion.attrs):
        raise ValueError("The variable `motion` must have the attributes `flag_values` and `flag_meanings`.")
    if motion.ndim != 2:
        raise ValueError(
            f"A region chart needs two swept quantities, but there are {list(motion.dims)}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    if min(motion.shape) < 2:
        raise ValueError(f"A region chart needs two values or more of each quantity, but has {motion.shape}.")
    if max_classes < 0:
        raise ValueError(f"Argument `max_classes` must be 0 or more, but is {max_classes}.")


def _classes_of_points(classes: xr.Dataset) -> list[_Class]:
    """The class of every point, row by row."""
    flags = classes.motion.attrs
    values = np.asarray(flags["flag_values"]).tolist()
    meaning = dict(zip(values, flags["flag_meanings"].split(), strict=True))
    dims = classes.motion.dims
    motion = classes.motion.values.ravel().tolist()
    periods = classes.num_periods.transpose(*dims).values.ravel().tolist()
    counts = classes.num_impacts.transpose(*dims, "stop").values.reshape(len(motion), -1)
    impacts = np.nan_to_num(counts, nan=_UNKNOWN, posinf=_ENDLESS).astype(int).tolist()
    return [
        _Class(meaning[k], n, tuple(m)) if meaning[k] in _REPEATING else _Class(meaning[k])
        for k, n, m in zip(motion, periods, impacts, strict=True)
    ]


def _colors(of_point: list[_Class], max_classes: int) -> dict[str, str]:
    """The entries of the legend with their colours, light to dark."""
    counts = Counter(of_point)
    counted = [c for c, _ in counts.most_common() if c.motion not in ("non_impacting", "non_periodic")]
    named = sorted(counted[:max_classes], key=lambda c: (c.motion not in _REPEATING, c))
    ladder = shades(len(named), first=0.12, last=0.85)[::-1]
    colors: dict[str, str] = {}
    if _Class("non_impacting") in counts:
        colors[_WORDS["non_impacting"]] = _NO_IMPACT
    colors |= {c.words: to_hex(color) for c, color in zip(named, ladder, strict=True)}
    if _Class("non_periodic") in counts:
        colors[_WORDS["non_periodic"]] = _NON_PERIODIC
    if len(counted) > max_classes:
        colors["other"] = _OTHER
    return colors
