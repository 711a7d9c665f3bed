"""Sections of a motion: at its impacts, or once a forcing period."""

import math

import numpy as np
import xarray as xr

from .._dataset_checks import check_columns
from .._sweep.outcomes import warn_of_endings
from .._trajectory.solution import Solution
from .record import dims_of, forcing_periods, held_intervals, impacts_of, labelled, stop_masses

# Columns of the section of a sweep, and their dimensions besides those of the points.
_SECTION = {"section_x": ("period", "mass"), "section_v": ("period", "mass"), "held_time": ("period", "stop")}


def impact_map(source: Solution | xr.Dataset, stop: int | None = None) -> xr.Dataset:
    """Pair every impact with the next: the individual and the global impact maps.

    The impacts of one stop give its individual map P_i, from (phase, velocity) to the next (phase, velocity), whatever
    is hit in between. Those of all stops together give the global map P_g. With more than one mass these are not
    functions of the two numbers, as the next impact also depends on the other masses. The function of all numbers,
    with its derivatives, is `vx.next_impact`.

    Args:
        source: result of `vx.simulate` or `vx.sweep`.
        stop: the stop whose impacts are paired; all stops, in the order of time, if left out.

    Returns:
        With the dimensions of the sweep, and `impact`: `phase` (W t mod 2 pi, radians) and signed
        `velocity` before each impact, `next_phase`, `next_velocity`, and `stop`; padded with NaN and -1.
        The next impact is NaN where it is not in the log: after the last impact, and after the
        last bounce of a complete chatter, since the lightest of its infinitely many bounces are left out.

    Raises:
        ValueError: if there is no such stop, or the load has no frequency.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(2.05), 0.0, 300.0)
        pairs = vx.impact_map(sol, stop=1)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2 and Fig. 9.
    """
    num_stops = len(stop_masses(source))
    if stop is not None and not 0 <= stop < num_stops:
        raise ValueError(f"Argument `stop` must lie in 0 to {num_stops - 1}, but is {stop}.")
    if isinstance(source, xr.Dataset):
        warn_of_endings(source, "max_impacts_reached")
    impacts = impacts_of(source)
    is_ours = slice(None) if stop is None else impacts.stop == stop
    point, _, phase, velocity, of_stop, sticks = (a[is_ours] for a in impacts)
    has_next = np.append(point[1:] == point[:-1], False)[: len(point)] & ~sticks
    num_points = math.prod(dims_of(source).values())
    counts = np.bincount(point, minlength=num_points)
    slot = np.arange(len(point)) - np.repeat(np.cumsum(counts) - counts, counts)

    def table(a: np.ndarray, fill: float | int) -> tuple[tuple[str, ...], np.ndarray]:
        rows = np.full((num_points, counts.max(initial=0)), fill, a.dtype)
        rows[point, slot] = a
        return ("impact",), rows

    columns = {"phase": phase, "velocity": velocity}
    columns |= {f"next_{name}": np.where(has_next, np.roll(a, -1), np.nan) for name, a in columns.items()}
    tables = {name: table(a, np.nan) for name, a in columns.items()}
    return labelled(source, tables | {"stop": table(of_stop, -1)})


def stroboscopic_section(source: Solution | xr.Dataset) -> xr.Dataset:
    """Sample a motion once a forcing period.

    Args:
        source: result of `vx.simulate` or `vx.sweep`.

    Returns:
        With the dimensions of the sweep, at the end of each whole `period` since the start of the trajectory (of the
        recorded ones of a sweep): `x` and `v` (..., period, mass), and `held_time` (..., period, stop), the time in
        that period during which each stop held its mass. NaN where the motion is unknown.

    Raises:
        ValueError: if the load has no frequency.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(2.05), 0.0, 300.0)
        points = vx.stroboscopic_section(sol)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2.
    """
    (period,) = forcing_periods(source)[:1]
    if isinstance(source, xr.Dataset):
        check_columns(source, "`vx.sweep`", _SECTION)
        section = source[list(_SECTION)]
        return section.rename(section_x="x", section_v="v")
    t0, t1 = float(source.t0), float(source.t1)
    # Rounding may put t1 just before the end of the last period.
    num_periods = int(np.floor((t1 - t0) / period * (1 + 1e-12)))
    edges = np.minimum(t0 + period * np.arange(num_periods + 1), t1)
    x, v = (np.asarray(a)[None] for a in source.evaluate(edges[1:]))
    held_time = np.reshape(
        [_time_held(source, j, edges) for j in range(len(stop_masses(source)))], (-1, num_periods)
    ).T
    held_time = np.where(np.isnan(x[..., :1]), np.nan, held_time[None])
    own = ("period", "mass")
    return labelled(source, {"x": (own, x), "v": (own, v), "held_time": (("period", "stop"), held_time)})


def _time_held(sol: Solution, stop: int, edges: np.ndarray) -> np.ndarray:
    """Time during which a stop holds its mass between one edge and the next."""
    starts, ends = held_intervals(sol, stop)
    return np.diff([(np.clip(edge - starts, 0, ends - starts)).sum() for edge in edges])
