"""Drawing of a machine: masses, springs, dampers, stops and contacts."""

from typing import Any

import jax
import numpy as np
from matplotlib.axes import Axes

from ..._jax.arrays import Numbers, a_kind_of
from ..._system.system import AbstractFamily, AnySystem, ImpactSystem, machine_of
from ...plot._axes import create_axes, figure_of
from .arrangement import Pose
from .canvas import TIPS, Canvas, Positive
from .drawing import ROOM, Drawing, draw
from .pendulum import draw_pendulum
from .reading import scheme_of_system
from .scheme import Scheme

# Gap relative to the position of the stop below which it is rounding, and drawn closed.
_CLOSED = 1e-12


def machine(
    system: AnySystem,
    x: Numbers | None = None,
    *,
    t: float = 0.0,
    positive: Positive | None = None,
    ax: Axes | None = None,
    **style: Any,
) -> Axes:
    """Draw a machine: masses as boxes with their numbers, springs, dampers, stops, contacts, loads.

    Springs and dampers are derived from the matrices: an off-diagonal entry -k_ij couples two masses; the sum of all
    entries of a row ties its mass to the ground. Springs between neighbours lie in the row, others are arcs above it. A
    spring of negative stiffness is dashed. With a full mass matrix the boxes are coordinates. A hatched wall is a stop,
    with a double arrow under it if it moves; one under the floor is a base that moves, `vx.base_excitation`, in whose
    frame the masses are. A plate on an arm is the contact of two masses. A loose mass
    that bounces between two ends of another one is drawn in it. Other contacts and a
    `force` are described in words below. Gears form a row like other masses, positive to the right.

    Machines with weight are drawn vertically, with the weight downwards: those in which the mean load accelerates all
    masses equally, and neither springs nor friction hold them. A single `vx.models.PendulumWeight` is drawn as a pendulum at
    its true angle, unless `positive` is given.

    Distances are schematic: displacements and gaps have one scale, chosen so that nothing overlaps.

    Args:
        system: the machine.
        x: positions of the masses, (n,); zero if omitted.
        t: the time, at which moving stops are drawn.
        positive: the direction of positive positions: "right", "up" or "down"; that in which weight acts downwards if
            omitted, "right" without weight.
        ax: the axes to draw into; new axes in a figure of fitting size if omitted.
        **style: properties of the boxes for matplotlib's `Rectangle`: `edgecolor`, `facecolor`, `linewidth`, ...

    Returns:
        The axes.

    Raises:
        ValueError: for a batch of machines, positions of another shape, non-finite numbers, or an unknown direction.

    Example:
        ```python
        import vijax as vx
        ax = vx.plot.machine(vx.models.wagg_bishop_b(0.8), x=[0.1, -0.1])
        ```

    References:
        Wagg & Bishop (2004), Fig. 1.
    """
    check_positive(positive)
    if not isinstance(system, ImpactSystem | AbstractFamily):
        raise ValueError(
            f"Argument `system` must be a machine, a `vx.ImpactSystem` or `vx.Family`, but is {a_kind_of(system)}."
        )
    # NumPy arrays, so that nothing is compiled for a picture.
    own: ImpactSystem = jax.tree.map(np.asarray, machine_of(system))
    scheme = scheme_of_system(own)
    place = np.zeros(scheme.num_masses) if x is None else np.asarray(x, float)
    if place.shape != (scheme.num_masses,):
        raise ValueError(f"Argument `x` must have shape ({scheme.num_masses},), but has shape {place.shape}.")
    if not (np.isfinite(place).all() and np.isfinite(t)):
        raise ValueError("Arguments `x` and `t` must be finite.")
    # Samples of a whole period, of which the first is drawn: the scale is nearly independent of `t`.
    angles = scheme.frequency * t + np.linspace(0, 2 * np.pi, 9)
    limit = np.array([[float(stop.at(angle)) for stop in own.stops] for angle in angles])
    poses, gaps = poses_of(scheme, np.tile(place, (len(angles), 1)), scheme.signs * limit)
    is_new = ax is None
    ax = create_axes() if ax is None else ax
    _, drawing = draw_any(ax, scheme, poses[:1], gaps[0], style, positive=positive, fits_axes=not is_new)
    if is_new:
        figure_of(ax).set_size_inches(drawing.size)
    return ax


def check_positive(positive: Positive | None) -> None:
    """Refuse an unknown direction of positive positions."""
    if positive not in (None, *TIPS):
        raise ValueError(f'Argument `positive` must be "right", "up" or "down", but is {positive!r}.')


def draw_any(
    ax: Axes,
    scheme: Scheme,
    poses: list[Pose],
    gaps: np.ndarray | None,
    style: dict[str, Any],
    *,
    positive: Positive | None,
    fits_axes: bool,
) -> tuple[Canvas, Drawing]:
    """Draw a machine in the first of its poses, with boxes or as a pendulum; see `draw`."""
    if scheme.is_pendulum and positive is None:
        return Canvas(ax, "right"), draw_pendulum(ax, scheme, poses, gaps, style, fits_axes=fits_axes)
    along = positive or scheme.positive
    return Canvas(ax, along), draw(ax, scheme, poses[0], gaps, style, positive=along, fits_axes=fits_axes)


def poses_of(
    scheme: Scheme, x: np.ndarray, limit: np.ndarray, load: np.ndarray | None = None
) -> tuple[list[Pose], np.ndarray]:
    """Poses of a motion, one per time, and its gaps along the rows in units of length, (times, stops).

    Args:
        scheme: the machine.
        x: positions, (times, n).
        limit: positions of stops and contacts along their rows, (times, stops).
        load: loads on the masses, (times, n); all arrows have the same length if omitted.
    """
    gaps = limit - x @ scheme.rows.T
    gaps[abs(gaps) < _CLOSED * np.max(abs(limit), axis=0, initial=0.0)] = 0.0
    unit = np.ones(len(scheme.rows))
    drawn = [one.number for one in scheme.limits]
    unit[drawn] = [one.unit for one in scheme.limits]
    seen = x - x.mean(axis=1, keepdims=True) if scheme.is_followed else x
    largest = max(np.max(abs(seen)), np.max(abs(limit / unit)[:, drawn], initial=0.0))
    scale = ROOM / largest if largest > 0 and not scheme.is_pendulum else 1.0
    if load is None:
        is_waving = scheme.largest_varying_load > 0
        load = np.where(is_waving, 1.0, np.sign(scheme.mean))[None] * np.ones_like(x)
    else:
        load = load / (scheme.largest_load or 1.0)
    return [
        Pose(*one) for one in zip(scale * seen, scale * gaps / unit, 0.5 * load, strict=True)
    ], gaps + 0.0  # no -0
