"""Pictures of one motion, drawn by `vx.plot`."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ... import plot
from ..._jax.arrays import is_single_precision
from .look import PageStyle
from .motion import PointMotion

PICTURES = ("time series", "phase portrait", "impact map", "multipliers")
SIZE = (4.4, 2.9)  # inches
DPI = 100


def pictures_of(motion: PointMotion | None, mass: int, look: PageStyle) -> dict[str, Figure]:
    """Time series, phase portrait of a mass, impact map and multipliers, without an orbit its section; empty without a motion."""
    draws: tuple[Callable[[PointMotion, Axes], object], ...] = (
        lambda m, ax: plot.time_series(m.solution, span=m.shown, ax=ax),
        lambda m, ax: plot.phase_portrait(m.solution, mass, span=m.shown, ax=ax),
        lambda m, ax: plot.impact_map(m.solution, None, ax=ax),
        lambda m, ax: _multipliers(m, mass, ax),
    )
    with look.style():
        return {name: _figure(motion, draw, look) for name, draw in zip(PICTURES, draws, strict=True)}


def words_of_multipliers(motion: PointMotion) -> str:
    """The Floquet multipliers of the orbit, the largest first, and its stability as text."""
    if motion.orbit is None:
        return f"none: {'they need 64-bit numbers' if is_single_precision(motion.system) else 'no periodic orbit'}"
    parts = [
        f"{a.real:.4g}" if a.imag == 0 else f"{a.real:.4g} {'+' if a.imag > 0 else '-'} {abs(a.imag):.4g}i"
        for a in np.asarray(motion.orbit.multipliers).tolist()
    ]
    return f"{', '.join(parts)} ({'stable' if motion.orbit.is_stable else 'unstable'})"


def _multipliers(motion: PointMotion, mass: int, ax: Axes) -> object:
    """The multipliers of the orbit; the section of a motion that is none."""
    if motion.orbit is None:
        plot.section(motion.solution, mass, ax=ax)
        return ax.set_title("stroboscopic section: no periodic orbit here", fontsize="medium")
    return plot.multipliers(motion.orbit, ax=ax)


def _figure(
    motion: PointMotion | None, draw: Callable[[PointMotion, Axes], object], look: PageStyle
) -> Figure:
    """A picture; the error message in its place if it cannot be drawn."""
    figure = Figure(figsize=SIZE, dpi=DPI, layout="constrained")
    ax = figure.subplots()
    try:
        if motion is not None:
            draw(motion, ax)
    except ValueError as error:
        ax.clear()
        ax.text(0.5, 0.5, str(error), ha="center", va="center", color=look.faint, transform=ax.transAxes)
    if not ax.has_data():
        ax.set_axis_off()
    return figure
