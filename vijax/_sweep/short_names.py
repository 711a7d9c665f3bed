"""Short names of swept quantities: `A` for "forcing.amplitude[0]", the path in an attribute of the coordinate.

All computations refer to quantities by their paths. Names are removed where values are given, and added to the
dimensions of the dataset at the end; what reads a dataset takes the paths back.
"""

import keyword
from collections.abc import Collection, Hashable, Mapping
from typing import Any, TypeVar

import equinox as eqx
import xarray as xr

from .._dataset_attributes import is_taken
from .._jax.arrays import Numbers
from .._system.family import Family
from .._system.parameters import is_parameter
from .._system.system import AnySystem

Values = Mapping[str, Numbers | tuple[str, Numbers]]
Labelled = TypeVar("Labelled", xr.Dataset, xr.DataArray)

# Attribute of a coordinate with words of the user.
LABEL = "label"
# Attribute of a coordinate with a short name.
_PATH = "path"
# End of the name of a coordinate that holds swept arrays, whose dimension counts them.
_ARRAYS = ".values"
# First parts of paths.
_PARTS = ("forcing", "stops", "friction", "hysteresis", "force", "args")


def without_names(
    values: Values, whole: eqx.Module, *, free: Collection[str] = ()
) -> tuple[dict[str, Numbers], dict[str, str]]:
    """Values by their paths, and the short names of those paths that have one.

    Args:
        values: values by paths, or pairs of a path and values by short names.
        whole: the machine, or the module that holds it beside its start.
        free: names of variables of other datasets that the one to be made does not have.

    Raises:
        ValueError: for a name that may not be used, or a path that is given twice.
    """
    if not isinstance(values, Mapping):
        raise ValueError(
            "Argument `values` must give the values of each quantity by its path, as {'forcing.frequency': [0.8, 0.9]}, but is "
            f"{values!r}."
        )
    found: dict[str, Numbers] = {}
    names: dict[str, str] = {}
    for name, given in values.items():
        if not isinstance(name, str):
            raise ValueError(
                f"Argument `values` must name each quantity by its path, as 'forcing.frequency', but has {name!r}: give each a "
                "path and values of its own; quantities that vary together are one `vx.sweep` for each."
            )
        path, numbers = name, given
        if isinstance(given, tuple) and given and isinstance(given[0], str):
            path, numbers = _pair(name, given)
            _check_name(name, whole, free)
            names[path] = name
        if path in found:
            raise ValueError(f"The path `{path}` is swept twice: give its values once, under one name.")
        found[path] = numbers
    return found, names


def with_names(ds: xr.Dataset, names: Mapping[str, str]) -> xr.Dataset:
    """The dataset with short names for some of its paths, from the attributes of their coordinates."""
    pairs = [(path, name) for path, name in names.items() if path in ds.coords]
    if not pairs:
        return ds
    found = ds.rename({path + end: name + end for path, name in pairs for end in _ends(ds, path)})
    for path, name in pairs:
        for end in _ends(ds, path):
            found[name + end].attrs[_PATH] = path
    return found


def with_labels(ds: xr.Dataset, system: AnySystem) -> xr.Dataset:
    """The dataset with the words of a family for its names, in the attributes of their coordinates."""
    labels = system.labels if isinstance(system, Family) else {}
    for name in ds.coords if labels else ():
        path = path_of(ds, name)
        words = labels.get(path, labels.get(path.partition("[")[0]))
        if words:
            ds[name].attrs |= {LABEL: words, "long_name": words}
    return ds


def with_paths(ds: Labelled) -> Labelled:
    """The dataset or array with all its quantities named by their paths."""
    new = {name: path_of(ds, name) for name, a in ds.coords.items() if _PATH in a.attrs}
    # A short name has no dot, so that this is the end of a name, not of a path.
    new = {name: path + (_ARRAYS if str(name).endswith(_ARRAYS) else "") for name, path in new.items()}
    found = ds.rename(new)
    for path in new.values():
        found[path].attrs = {key: a for key, a in found[path].attrs.items() if key != _PATH}
    return found


def path_of(ds: xr.Dataset | xr.DataArray, name: Hashable) -> str:
    """The path of the quantity that a coordinate holds: its attribute, or its name."""
    attributes = ds.coords[name].attrs if name in ds.coords else {}
    return str(attributes.get(_PATH, str(name).removesuffix(_ARRAYS)))


def _ends(ds: xr.Dataset, path: str) -> list[str]:
    return ["", _ARRAYS] if f"{path}{_ARRAYS}" in ds.coords else [""]


def _pair(name: str, given: tuple[Any, ...]) -> tuple[str, Any]:
    if len(given) != 2:
        raise ValueError(
            f'The quantity `{name}` must have a path and its values, as {{"{name}": ("forcing.frequency", values)}}, '
            f"but has {len(given)} entries."
        )
    return given


def _check_name(name: str, whole: eqx.Module, free: Collection[str]) -> None:
    """Refuse an invalid short name, or one with another meaning."""
    if not name.isidentifier() or keyword.iskeyword(name):
        trouble = "is no identifier: use letters, digits and underscores, as `A` or `gap_1`"
    elif is_parameter(whole, name) or name in _PARTS:
        trouble = "is a path of the machine: use a name that no path has, or the path without a name"
    elif is_taken(name) and name not in free:
        trouble = "names a variable or a dimension of the dataset: use another"
    else:
        return
    raise ValueError(f"The short name `{name}` {trouble}.")
