"""Stable and unstable manifolds of a saddle, in the plane of two states."""

from typing import Any

import xarray as xr
from matplotlib.axes import Axes

from .._dataset_checks import check_is_dataset
from ._axes import check_index, create_axes, label_if_new, label_phase_plane
from ._colors import curve_colors, ink, is_dark, merge_style, with_lightness
from ._labels import Units
from ._legend import add_legend

# Lightness of unstable manifolds on a light and on a dark background; stable ones are drawn in ink.
_LIGHTNESS, _LIGHTNESS_ON_DARK = 0.5, 0.8


def manifolds(
    curves: xr.Dataset,
    mass: int = 0,
    *,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the stable and the unstable manifold of a saddle in the plane of position and velocity of one mass.

    Stable ones have the colour of the axes, unstable ones the second colour of the style; a circle is the saddle. Over a picture of
    basins, the limits and the labels of its axes stay.

    Args:
        curves: result of `vx.manifolds`, or some of its branches.
        mass: index of the mass.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content, such as `vx.plot.basins`; new axes if omitted.
        **style: properties of the lines for matplotlib's `plot`: `color`, `linewidth`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if there are no curves, or the mass does not exist.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.two_sided_oscillator(3.0, damping_ratio=0.025)
        saddle = vx.periodic_orbit(system, [-0.496], [-0.472], 2)
        ax = vx.plot.manifolds(vx.manifolds(saddle, length=20.0))
        ```

    References:
        J. Guckenheimer & P. Holmes, Nonlinear Oscillations (1983), Sec. 4.5.
    """
    check_is_dataset(curves, "curves", "`vx.manifolds`")
    if "piece" not in curves or not curves["kind"].ndim or not curves.sizes["branch"]:
        raise ValueError("Argument `curves` must be what `vx.manifolds` returned, or some of its branches.")
    check_index("mass", mass, curves.sizes["mass"])
    is_new = ax is None or not ax.has_data()
    ax = create_axes() if ax is None else ax
    limits = ax.get_xlim(), ax.get_ylim()
    lightness = _LIGHTNESS_ON_DARK if is_dark() else _LIGHTNESS
    colors = {"unstable": with_lightness(curve_colors(2)[1, :3], lightness), "stable": ink()}
    one = curves.isel(mass=mass)
    for k, kind in enumerate(one["kind"].values.tolist()):
        words = label_if_new(ax, f"{kind} manifold")
        look = merge_style(
            style, color=colors[kind], linewidth=0.9, label=words, zorder=1.9
        )  # under attractors
        ax.plot(one["x0"].values[k], one["v0"].values[k], **look)
    ax.plot(
        one["x0"].values[:, 0],
        one["v0"].values[:, 0],
        linestyle="none",
        marker="o",
        markerfacecolor="white",
        markeredgecolor="black",
        label=label_if_new(ax, "saddle"),
        zorder=2.6,
    )
    if is_new:
        label_phase_plane(ax, mass, units)
        add_legend(ax, is_shown=legend)
    else:
        ax.set(xlim=limits[0], ylim=limits[1])
        before = ax.get_legend()
        known = [] if before is None else [text.get_text() for text in before.get_texts()]
        own = zip(*ax.get_legend_handles_labels(), strict=True)
        new = [(handle, words) for handle, words in own if words not in known]
        if new:
            handles, words = map(list, zip(*new, strict=True))
            add_legend(ax, is_shown=legend, is_second=before is not None, handles=handles, labels=words)
    return ax
