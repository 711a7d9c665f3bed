"""Invariant circles of quasi-periodic motions, and their rotation number."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from .._dataset_checks import check_is_dataset
from ._axes import check_index, label_phase_plane
from ._colors import merge_style, ordered_colors
from ._labels import Units
from ._legend import add_legend
from ._ordinates import Labels, label_of

# Strokes of stable and unstable circles.
_STROKES = {True: "-", False: (0, (3, 2))}
# Most circles drawn: every further one hides another.
_MOST_CIRCLES = 12


def torus(
    ds: xr.Dataset,
    *,
    mass: int = 0,
    units: Units | None = None,
    labels: Labels | None = None,
    legend: bool = True,
    ax: Sequence[Axes] | np.ndarray | None = None,
    **style: Any,
) -> np.ndarray:
    """Draw the quasi-periodic motions behind a Neimark-Sacker bifurcation, as `vx.follow_torus` returns them.

    The first panel shows the rotation number over the parameter, the second one the invariant circles in the section,
    position and velocity of one mass, of at most 12 points, coloured in their order. Stable motions are solid, others dashed.

    Args:
        ds: result of `vx.follow_torus`.
        mass: the mass whose state is drawn.
        units: of `length` and `time`, as in `{"length": "mm", "time": "s"}`; none are written if left out.
        labels: words of the axes, by the path of the parameter or as `rotation_number`.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: two axes to draw into; new ones if left out.
        **style: of the lines, as matplotlib's `plot` takes them: `color`, `linewidth`, ...

    Returns:
        Both axes.

    Raises:
        ValueError: if the dataset has no invariant circles, or the mass does not exist.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        load, stop = vx.Harmonic([1.0, 0.0], 1.6), vx.Stop(0, 0.11, "upper", 0.8)
        system = vx.chain([1.0, 1.29], [0.02, 0.02], [1.0, 1.1], load, [stop])
        run = vx.simulate(system, 0.0, 500 * system.forcing.period)
        branch = vx.continuation(vx.periodic_orbit(system, run.x1, run.v1), "forcing.frequency", (1.5, 1.7))
        (point,) = [a for a in branch.bifurcations if a.kind == "ns"]
        axes = vx.plot.torus(vx.follow_torus(point, (1.54, 1.6)))
        ```
    """
    check_is_dataset(ds, "ds", "`vx.follow_torus`")
    if "rotation_number" not in ds or not ds.sizes["point"]:
        raise ValueError("Argument `ds` holds no invariant circle: give what `vx.follow_torus` returned.")
    check_index("mass", mass, ds.sizes["mass"])
    if ax is None:
        ax = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")[1]
    numbers, section = np.ravel(np.asarray(ax, dtype=object))
    path = ds.attrs["path"]
    values, rotation, is_stable = (ds[name].values for name in (path, "rotation_number", "is_stable"))
    # A piece between two circles is stable if both are.
    pieces = {
        "stable": is_stable,
        "unstable": ~is_stable | ~np.append(is_stable[1:], True) | ~np.append(True, is_stable[:-1]),
    }
    for words, shown in pieces.items():
        look = merge_style(style, color="C0", linestyle=_STROKES[words == "stable"], marker=".", markersize=4)
        if shown.any():
            numbers.plot(values, np.where(shown, rotation, np.nan), label=words, **look)
    numbers.xaxis.set_major_locator(MaxNLocator(5))
    numbers.set(xlabel=label_of(path, labels, units, ds))
    numbers.set_ylabel((labels or {}).get("rotation_number") or "Rotation number $\\rho$")
    add_legend(numbers, is_shown=legend)
    chosen = np.unique(np.linspace(0, len(values) - 1, _MOST_CIRCLES).round().astype(int))
    for k, color in zip(chosen, ordered_colors(len(chosen)), strict=True):
        x, v = (np.append(ds[name].values[k, :, mass], ds[name].values[k, 0, mass]) for name in ("x", "v"))
        section.plot(
            x, v, **merge_style(style, color=color, linestyle=_STROKES[bool(is_stable[k])], linewidth=1.2)
        )
    label_phase_plane(section, mass, units)
    return np.array([numbers, section], dtype=object)
