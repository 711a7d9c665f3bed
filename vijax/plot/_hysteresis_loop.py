"""Force of Jenkins elements against the motion along their row: the loop of hysteresis."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from .._orbits.orbit import PeriodicOrbit
from .._trajectory.solution import Solution
from ._axes import check_index, create_axes
from ._colors import curve_colors, merge_style
from ._contacts import in_symbols, row_of
from ._labels import LENGTH, Units, with_unit
from ._orbits import solution_of
from ._trajectories import sample_times, span_of


def hysteresis_loop(
    sol: Solution | PeriodicOrbit,
    element: int | None = None,
    *,
    span: tuple[float, float] | None = None,
    units: Units | None = None,
    ax: Axes | None = None,
    num_samples: int = 2000,
    **style: Any,
) -> Axes:
    """Draw the force of a Jenkins element against the position along its row.

    In a periodic motion the curve is closed, and its area is the energy that the element dissipates in a cycle. With
    `element=None` it is the force of all elements, which must have the row of the first: the loop of an Iwan model.

    Args:
        sol: one trajectory, or one periodic orbit, drawn over one cycle.
        element: the element, by its number in `ImpactSystem(..., hysteresis=...)`; all of them together if left out.
        span: first and last time; the whole trajectory if omitted.
        units: units of `length` and `force`, as in `{"length": "mm", "force": "N"}`; labels show none if omitted.
        ax: the axes to draw into, over their content; new axes if omitted.
        num_samples: number of evenly spaced times to draw, beside those of the events.
        **style: properties of the curve for matplotlib's `plot`: `color`, `linewidth`, `label`, ...

    Returns:
        The axes.

    Raises:
        ValueError: if the element does not exist, elements drawn together differ in their rows, the span lies outside the
            trajectory, or the orbit was not found.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.5], frequency=0.9)
        joint = vx.models.iwan(0, [0.5, 0.5], [0.1, 0.3])
        system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, hysteresis=joint)
        sol = vx.simulate(system, 0.0, 100.0)
        ax = vx.plot.hysteresis_loop(sol, span=(90.0, 100.0))
        ```

    References:
        W. D. Iwan, "A distributed-element model for hysteresis and its steady-state dynamic response", J. Applied Mechanics
        33 (1966) 893-900.
    """
    sol = solution_of(sol)
    if not sol.num_sliders:
        raise ValueError("The machine of the trajectory has no Jenkins elements: give it `hysteresis=[...]`.")
    if element is not None:
        check_index("element", element, sol.num_sliders)
    first = sol.machine.contacts.num - sol.num_sliders
    rows = np.array([row_of(sol, first + k) for k in range(sol.num_sliders)])
    row = rows[element or 0]
    if element is None and (rows != row).any():
        raise ValueError("The elements have different rows: draw one, by `element=0` for instance.")
    t = sample_times(sol, span_of(sol, span), num_samples)
    force = np.asarray(sol.hysteresis_force(t))
    force = force.sum(axis=1) if element is None else force[:, element]
    ax = create_axes() if ax is None else ax
    name = "hysteresis" if element is None else f"hysteresis {element}"
    look = merge_style(style, color=curve_colors(1)[0], linewidth=1.0, label=name)
    ax.plot(np.asarray(sol.evaluate(t)[0]) @ row, force, **look)
    ax.set_xlabel(with_unit(f"${in_symbols(row)}$", LENGTH, units))
    ax.set_ylabel(with_unit("Force $S$", "{force}", units))
    return ax
