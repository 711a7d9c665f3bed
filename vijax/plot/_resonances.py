"""Resonances as vertical lines: the natural frequencies of the machine without impacts."""

from typing import Any

import numpy as np
import scipy.linalg
import xarray as xr
from matplotlib.axes import Axes

from .._system.description import build_from
from .._system.force_description import NAMED_FORCE
from .._system.system import mass_matrix
from ._axes import label_if_new
from ._colors import ink

_PATH = "forcing.frequency"
# Square of a frequency, relative to the largest one, below which it is that of a free shift.
_FREE = 1e-12


def natural_frequencies(mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Angular natural frequencies of a machine without dampers and impacts, rising; free shifts have none."""
    squares = scipy.linalg.eigvalsh(stiffness, mass_matrix(mass))
    return np.sqrt(squares[squares > _FREE * np.abs(squares).max()])


def _is_frequency(ds: xr.Dataset, path: str) -> bool:
    """True where the value of a family is the frequency of the load."""
    if "family" not in ds.attrs or "forcing_period" not in ds:
        return False
    return bool(np.allclose(ds["forcing_period"] * ds[path], 2 * np.pi, rtol=1e-9))


def draw_resonances(ax: Axes, ds: xr.Dataset, path: str) -> None:
    """Draw the natural frequencies that lie within the x axis.

    Raises:
        ValueError: if the x axis is not the frequency of the load.
    """
    if path != _PATH and not _is_frequency(ds, path):
        raise ValueError(
            f"Argument `resonances` draws natural frequencies along `{_PATH}`, but the picture is along `{path}`."
        )
    system: Any = build_from(ds.attrs, force=NAMED_FORCE)
    (left, right), style = ax.get_xlim(), {"color": ink("0.55", "0.55"), "linewidth": 0.8, "zorder": 0}
    for frequency in natural_frequencies(np.asarray(system.mass), np.asarray(system.stiffness)):
        if left <= frequency <= right:
            words = label_if_new(ax, "natural frequency")
            ax.axvline(frequency, linestyle=(0, (1, 2)), label=words, **style)
