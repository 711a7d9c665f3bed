"""Stable and unstable manifolds of a saddle, in the plane of two states."""

from typing import Any

import xarray as xr
from matplotlib.axes import Axes

from ._axes import check_index, create_axes, label_if_new, label_phase_plane, legend_beside
from ._colors import curve_colors, ink, merge_style, with_lightness
from ._labels import Units

# Lightness of unstable manifolds; stable ones are drawn in ink.
_LIGHTNESS = 0.5


def manifolds(
    curves: xr.Dataset,
    mass: int = 0,
    *,
    units: Units | None = None,
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
    if "piece" not in curves or not curves["kind"].ndim or not curves.sizes["branch"]:
        raise ValueError("Argument `curves` must be what `vx.manifolds` returned, or some of its branches.")
    check_index("mass", mass, curves.sizes["mass"])
    is_new = ax is None or not ax.has_data()
    ax = create_axes() if ax is None else ax
    limits = ax.get_xlim(), ax.get_ylim()
    colors = {"unstable": with_lightness(curve_colors(2)[1, :3], _LIGHTNESS), "stable": ink()}
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
        legend_beside(ax)
    else:
        ax.set(xlim=limits[0], ylim=limits[1])
        _add_to_legend(ax)
    return ax


def _add_to_legend(ax: Axes) -> None:
    """Add the curves to the legend that the picture has; without one, begin it."""
    old = ax.get_legend()
    own, words = ax.get_legend_handles_labels()
    if old is None:
        legend_beside(ax)
        return
    known = [text.get_text() for text in old.get_texts()]
    new = [(handle, text) for handle, text in zip(own, words, strict=True) if text not in known]
    ax.add_artist(old).set_clip_on(False)  # else layouts leave no room for it
    ax.legend(*zip(*new, strict=True), loc="lower left", bbox_to_anchor=(1.0, 0.0), frameon=False)
