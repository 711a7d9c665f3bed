"""Points of a motion on a section of its phase space: stroboscopic, or at the crossings of a surface."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from .._orbits.orbit import PeriodicOrbit
from .._sections.sections import stroboscopic_section
from .._sweep.short_names import with_paths
from .._trajectory.solution import Solution
from ._axes import check_index, check_one_machine, create_axes, label_phase_plane
from ._cloud import Cloud, draw_clouds, name_clouds
from ._labels import Units
from ._motions import label_of_motion
from ._orbits import solution_of

States = Solution | PeriodicOrbit | xr.Dataset | tuple[Any, Any]

# Variable names of the points in a dataset.
_NAMES = (("section_x", "section_v"), ("x", "v"))
# Dimensions that are not swept quantities.
_OWN = ("period", "section", "direction", "attractor", "mass")


def section(
    states: States | Mapping[str, States],
    mass: int = 0,
    *,
    units: Units | None = None,
    legend: bool = True,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw the points of a section in the plane of position and velocity of one mass.

    A motion that repeats after n forcing periods has n points in the stroboscopic section, taken at the ends of forcing
    periods; a motion with two incommensurate frequencies is a closed curve, chaos a cloud. Thousands of points are
    drawn transparent, so places with many are darker.

    Args:
        states: a trajectory or a periodic orbit, sampled at the end of each forcing period since its start; one
            machine, with any starts, selected from the result of `vx.sweep`, `vx.stroboscopic_section` or
            `vx.attractors`, whose attractors differ in colour; or the points of any section, positions and velocities,
            ((points, n), (points, n)), as from `vx.stroboscopic_map` or `vx.next_crossing`. Several are given by name,
            as in `{"up": one, "down": other}`, and differ in colour.
        mass: index of the mass.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        legend: whether to draw a legend: inside the axes, or beside them if the figure is new.
        ax: the axes to draw into, over their content; new axes if omitted.
        **style: point properties for matplotlib's `plot`: `color`, `marker`, `markersize`, `alpha`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the mass does not exist, there are no points, they belong to several machines, or positions and
            velocities differ in shape.

    Example:
        ```python
        import numpy as np, vijax as vx
        values = {"forcing.frequency": np.array([2.05]), "x0[1]": np.linspace(-0.5, 0.0, 8)}
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), values, transient=300, record=400)
        ax = vx.plot.section(ds, mass=1)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2.
    """
    named = states if isinstance(states, Mapping) and not isinstance(states, xr.Dataset) else {"": states}
    clouds = [cloud for name, one in named.items() for cloud in _clouds(name, one, mass)]
    if not any(len(cloud.x) for cloud in clouds):
        raise ValueError("There are no points to draw: a section needs one forcing period or more.")
    ax = create_axes() if ax is None else ax
    draw_clouds(ax, clouds, style)
    label_phase_plane(ax, mass, units)
    name_clouds(ax, clouds, style, is_shown=legend)
    return ax


def _clouds(name: str, states: States, mass: int) -> list[Cloud]:
    """The points of one motion, or of each of several attractors."""
    if isinstance(states, tuple):
        x, v = (np.asarray(a, float) for a in states)
        if x.shape != v.shape or x.ndim != 2:
            raise ValueError(
                f"Positions and velocities must have one shape, (points, n), but have {x.shape} and {v.shape}."
            )
        check_index("mass", mass, x.shape[1])
        return [_finite_cloud(name, x[:, mass], v[:, mass])]
    is_dataset = isinstance(states, xr.Dataset)
    ds = states if is_dataset else stroboscopic_section(solution_of(states))
    names = next((pair for pair in _NAMES if set(pair) <= set(ds) and "mass" in ds[pair[0]].dims), None)
    if names is None:
        raise ValueError(
            f"A section needs the variables `section_x` and `section_v`, but there are {list(ds)}."
        )
    check_index("mass", mass, ds.sizes["mass"])
    x, v = (ds[one].isel(mass=mass) for one in names)
    check_one_machine(dict(with_paths(x).sizes), "A section", _OWN)
    if "attractor" not in x.dims:
        return [_finite_cloud(name, x.values.ravel(), v.transpose(*x.dims).values.ravel())]
    found = []
    for k in range(ds.sizes["attractor"]):
        words = ", ".join(filter(None, (name, label_of_motion(ds.isel(attractor=k)))))
        one, other = (a.isel(attractor=k).values.ravel() for a in (x, v))
        found.append(_finite_cloud(words, one, other))
    return found


def _finite_cloud(name: str, x: np.ndarray, v: np.ndarray) -> Cloud:
    """A cloud without the NaN of unknown motions, or of those with fewer points than others."""
    is_known = np.isfinite(x) & np.isfinite(v)
    return Cloud(name, x[is_known], v[is_known])
