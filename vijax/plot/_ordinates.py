"""Quantities as ordinates of diagrams: their variables, words and units."""

from collections.abc import Mapping
from typing import NamedTuple

import xarray as xr

from ._contacts import StopMasses, name_of
from ._labels import ACCELERATION, LENGTH, RATE, VELOCITY, Units, axis_label, with_unit

Labels = Mapping[str, str]


class Ordinate(NamedTuple):
    """A quantity on the y axis.

    Attributes:
        variable: its variable in the dataset of a sweep.
        words: words of the axis, with a place for the number of the mass or the name of the stop.
        unit: see `with_unit`.
        axis: "mass" or "stop", of which one is drawn; empty for a number.
    """

    variable: str
    words: str
    unit: str
    axis: str

    @property
    def has_sign(self) -> bool:
        """True if the picture shows zero, as for a position at one instant; a largest position may lie far from it."""
        return self.variable in ("section_x", "section_v")

    def label(self, number: int, stop_masses: StopMasses, units: Units | None) -> str:
        """Label of the y axis."""
        place = name_of(number, stop_masses) if self.axis == "stop" else str(number)
        return with_unit(self.words.format(place), self.unit, units)


def _of_mass(variable: str, words: str, unit: str) -> Ordinate:
    return Ordinate(variable, words, unit, "mass")


def _of_stop(variable: str, words: str, unit: str) -> Ordinate:
    return Ordinate(variable, words + "\nat {}", unit, "stop")


_X, _V, _A = "$x_{{{}}}$", "$\\dot x_{{{}}}$", "$\\ddot x_{{{}}}$"
_EXACT = {
    "section_position": _of_mass("section_x", f"Position {_X}\nat the end of each period", LENGTH),
    "section_velocity": _of_mass("section_v", f"Velocity {_V}\nat the end of each period", VELOCITY),
    "max_position": _of_mass("max_position", f"Largest position {_X}", LENGTH),
    "min_position": _of_mass("min_position", f"Smallest position {_X}", LENGTH),
    "peak_to_peak": _of_mass("peak_to_peak", f"Peak to peak of position {_X}", LENGTH),
    "max_velocity": _of_mass("max_velocity", f"Largest velocity {_V}", VELOCITY),
    "min_velocity": _of_mass("min_velocity", f"Smallest velocity {_V}", VELOCITY),
    "rms_position": _of_mass("rms_position", f"Root mean square of position {_X}", LENGTH),
    "rms_velocity": _of_mass("rms_velocity", f"Root mean square of velocity {_V}", VELOCITY),
    "max_acceleration": _of_mass("max_acceleration", f"Largest acceleration {_A}", ACCELERATION),
    "min_acceleration": _of_mass("min_acceleration", f"Smallest acceleration {_A}", ACCELERATION),
    "rms_acceleration": _of_mass("rms_acceleration", f"Root mean square of acceleration {_A}", ACCELERATION),
    "max_absolute_acceleration": _of_mass(
        "max_absolute_acceleration", "Largest absolute acceleration\nof mass {}", ACCELERATION
    ),
    "mean_velocity": _of_mass("mean_velocity", f"Mean of velocity {_V}", VELOCITY),
    "max_force": _of_stop("max_force", "Largest contact force", "{force}"),
    "impulse": _of_stop("impulse", "Impulse in a period", "{force} {time}"),
    "dissipated_energy": _of_stop("dissipated_energy", "Energy lost in a period", "{force} {length}"),
    "impact_rate": _of_stop("impact_rate", "Impacts per unit of time", RATE),
}


def ordinates() -> tuple[str, ...]:
    """Names of all quantities."""
    return tuple(_EXACT)


def ordinate_of(name: str, ds: xr.Dataset) -> Ordinate | None:
    """The quantity of a name; None unless it is known, or a variable of the user's own."""
    if name in _EXACT:
        return _EXACT[name]
    if name not in ds:
        return None
    axes = [axis for axis in ("mass", "stop") if axis in ds[name].dims]
    return Ordinate(name, name.replace("_", " ").capitalize(), "", axes[0] if axes else "")


def label_of(path: str, labels: Labels | None, units: Units | None, ds: xr.Dataset | None = None) -> str:
    """Words of a swept quantity or parameter, the user's own if there are any."""
    return (labels or {}).get(path) or axis_label(path, units, ds)
