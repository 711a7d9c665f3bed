"""Labels of axes: words, symbol and unit of a quantity.

A machine has no units of its own, so labels show only units given by the user; angles are in radians.
"""

import re
from collections.abc import Mapping

import xarray as xr

from .._sweep.short_names import LABEL

Labelled = xr.Dataset | xr.DataArray
Units = Mapping[str, str]

LENGTH, VELOCITY, TIME, ANGLE, RATE = "{length}", "{length}/{time}", "{time}", "rad", "1/{time}"
ACCELERATION = "{length}/{time}²"
_KINDS = ("length", "time", "mass", "force")
_QUANTITIES = {
    "mass": ("Mass", "m", "{mass}"),
    "damping": ("Damping", "C", "{force} {time}/{length}"),
    "stiffness": ("Stiffness", "K", "{force}/{length}"),
    "forcing.amplitude": ("Forcing amplitude", "A", "{force}"),
    "forcing.frequency": ("Forcing frequency", r"\Omega", "rad/{time}"),
    "forcing.phase": ("Forcing phase", r"\varphi", ANGLE),
    "forcing.mean": ("Constant force", "F", "{force}"),
    "stops.position": ("Stop position", "s", LENGTH),
    "stops.restitution": ("Restitution", "r", ""),
    "stops.motion.amplitude": ("Travel of the stop", "A", LENGTH),
    "stops.motion.phase": ("Phase of the stop", r"\varphi", ANGLE),
    "stops.motion.mean": ("Stop position", "s", LENGTH),
    "hysteresis.stiffness": ("Stiffness of Jenkins element {}", "", "{force}/{length}"),
    "hysteresis.limit": ("Force limit of Jenkins element {}", "", "{force}"),
    "hysteresis.slider": ("Slider at the start of Jenkins element {}", "", LENGTH),
    "stops.stiffness": ("Stiffness of stop {}", "", "{force}/{length}"),
    "stops.damping": ("Damping of stop {}", "", "{force} {time}/{length}"),
    "stops.preload": ("Preload of stop {}", "", "{force}"),
    "friction.force": ("Friction force of element {}", "", "{force}"),
    "friction.static": ("Static friction force of element {}", "", "{force}"),
    "friction.velocity": ("Velocity of the surface of element {}", "", VELOCITY),
    "parametric.stiffness": ("Amplitude of the stiffness", "", "{force}/{length}"),
    "parametric.damping": ("Amplitude of the damping", "", "{force} {time}/{length}"),
    "parametric.frequency": ("Frequency of the stiffness", "", "rad/{time}"),
    "parametric.phase": ("Phase of the stiffness", "", ANGLE),
    "x0": ("Start position", "x", LENGTH),
    "v0": ("Start velocity", r"\dot x", VELOCITY),
}


def with_unit(words: str, unit: str, units: Units | None) -> str:
    """Append the unit in brackets, if all its parts were given.

    Args:
        words: the label without a unit.
        unit: composed of kinds of units, `"{length}/{time}"`; empty for a ratio.
        units: units of the user by kind.
    """
    given = checked_units(units)
    try:
        written = unit.format(**given)
    except KeyError:  # a kind of unit was not given
        return words
    return f"{words} ({written})" if written else words


def axis_label(path: str, units: Units | None = None, ds: Labelled | None = None) -> str:
    """Words, symbol and unit of a swept quantity: its own words in a dataset, or its path, if it has none.

    The position of a contact is the clearance of its masses, where the dataset has the masses of the stops.
    """
    if words := label_in(ds, path):
        return with_unit(words, checked_units(units).get(path, ""), units)
    name, indices = re.sub(r"\[.*?\]", "", path), re.findall(r"\[(\d+)\]", path)
    words, symbol, unit = _QUANTITIES.get(name, (path, "", ""))
    if name == "stops.position" and indices and _is_of_contact(ds, int(indices[0])):
        words = f"Clearance of contact {indices[0]}"
    words = (
        words.format(", ".join(indices)) if indices else words.replace(" {}", "s" if "{}" in words else "")
    )
    if symbol:
        subscript = f"_{{{','.join(indices)}}}" if indices else ""
        words = f"{words} ${symbol}{subscript}$"
    return with_unit(words, checked_units(units).get(path, unit), units)


def _is_of_contact(ds: Labelled | None, stop: int) -> bool:
    """True where a dataset says that a stop is a contact between masses."""
    if ds is None or ("stop_mass" not in ds.coords and "stop_mass" not in getattr(ds, "data_vars", ())):
        return False
    masses = ds["stop_mass"].values
    return stop < masses.size and int(masses[stop]) < 0


def label_in(ds: Labelled | None, path: str) -> str:
    """Words that the user has given to a quantity of a family; empty if there are none."""
    return str(ds.coords[path].attrs.get(LABEL, "")) if ds is not None and path in ds.coords else ""


def checked_units(units: Units | None) -> dict[str, str]:
    """Check the given units: of length, time, mass and force, and of swept quantities by path."""
    given = dict(units or {})
    unknown = [
        name for name in given if name not in (*_KINDS, *_QUANTITIES) and not re.search(r"[.\[]", name)
    ]
    if unknown:
        raise ValueError(
            f"Argument `units` must name units of {', '.join(_KINDS)}, or of a swept quantity by its path, but "
            f"has {unknown}."
        )
    return given


def swept_paths(points: xr.DataArray) -> list[str]:
    """Paths of the swept quantities, `direction` left out."""
    return [str(dim) for dim in points.dims if dim != "direction"]


def swept_quantity(points: xr.DataArray, picture: str) -> str:
    """The path of the only swept quantity; raise if there are none or several."""
    swept = swept_paths(points)
    if len(swept) != 1:
        raise ValueError(
            f"{picture} needs one swept quantity, but there are {swept}: "
            "select one value of the others, as in `ds.sel({path: value})`."
        )
    return swept[0]
