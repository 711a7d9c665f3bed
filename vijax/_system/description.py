"""Machines as tables, lists, numbers and strings, as in JSON and TOML, and back."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np
from jax.typing import DTypeLike

from .compliant import LAW_OF_COMPLIANCE, CompliantContact, CompliantStop
from .contact import Contact
from .force import parametric_of, users_force
from .force_description import build_force, describe_force
from .forces_by_path import Allowed
from .forcing import Harmonic
from .friction import Friction
from .hysteresis import Jenkins
from .load import AbstractLoad
from .load_description import build_load, describe_load
from .parametric import Parametric
from .parts import AnyStop
from .restitution import AbstractRestitution, describe_restitution, laws_by_name
from .stop import Stop
from .system import ImpactSystem
from .tables import arrays_of, check_names, lists_of, one_array, table_of

_ARRAYS = ("mass", "damping", "stiffness")
_OPTIONAL = "stops", "friction", "hysteresis", "force", "args", "num_states", "parametric"
_OF_TERMS = "stiffness", "damping", "frequency", "phase"
_OF_MOTION = "amplitude", "phase", "mean"
_OF_LIMIT = "position", "restitution"
# Numbers of friction, the one that it must have first.
_OF_FRICTION = "force", "static", "velocity"
_OF_TIED_FRICTION = "coefficient", "static_coefficient", "velocity"
_TYPES = ("float32", "float64")


def describe(system: ImpactSystem) -> dict[str, Any]:
    """Table of all parts of a machine. Floats are Python's, which JSON and TOML return bit for bit.

    A force is described by its import path and its numbers; by its name alone if it cannot be imported.
    """
    return {
        **{name: np.asarray(getattr(system, name)).tolist() for name in _ARRAYS},
        **describe_force(users_force(system.force)),
        **_described_terms(system),
        "forcing": describe_load(system.forcing),
        "stops": [_place(stop) | {"position": float(stop.position)} | _law(stop) for stop in system.stops],
        **({"friction": [_rubbing(element) for element in system.friction]} if system.friction else {}),
        **({"hysteresis": [_slider(element) for element in system.hysteresis]} if system.hysteresis else {}),
        **({"num_states": system.num_states} if system.num_states else {}),
    }


def build(
    description: dict[str, Any],
    dtype: DTypeLike,
    *,
    allow_forces: Allowed = False,
    force: Callable | None = None,
) -> ImpactSystem:
    """Machine of a description, in numbers of type `dtype`; its force is bound to `args`, if there are any.

    Args:
        description: made by `describe`, or written by hand.
        dtype: type of the numbers.
        allow_forces: the modules from which forces may be imported, see `vx.load`.
        force: replacement for the force of the description.

    Raises:
        ValueError: for a description that makes no machine, or a force that is not allowed or cannot be imported.
    """
    check_names("The machine", description, (*_ARRAYS, "forcing"), _OPTIONAL)
    arrays = {name: one_array(name, description[name], dtype) for name in _ARRAYS}
    forcing = build_load(description["forcing"], dtype)
    stops = [
        _stop(f"stops[{j}]", lists, forcing, dtype) for j, lists in enumerate(_tables("stops", description))
    ]
    friction, hysteresis = (
        [read(f"{part}[{k}]", lists, dtype) for k, lists in enumerate(_tables(part, description))]
        for part, read in (("friction", _friction), ("hysteresis", _jenkins))
    )
    own = build_force(description, allow_forces, force)
    num_states = description.get("num_states", 0)
    terms = _terms(description.get("parametric"), dtype)
    elements = {"stops": stops, "friction": friction, "hysteresis": hysteresis, "parametric": terms}
    system = ImpactSystem(**arrays, forcing=forcing, force=own, num_states=num_states, **elements)
    # Built in JAX's precision, which holds every number of a narrower one.
    narrow = jax.dtypes.canonicalize_dtype(dtype)
    return jax.tree.map(lambda a: a.astype(narrow), system)


def build_from(
    attributes: Mapping[Any, Any], *, allow_forces: Allowed = False, force: Callable | None = None
) -> ImpactSystem:
    """Machine of the attributes of a dataset, see `build`."""
    text, dtype = attributes.get("system"), attributes.get("dtype")
    if not isinstance(text, str) or dtype not in _TYPES:
        raise ValueError(
            f"Datasets of vijax have attributes `system`, a text, and `dtype`, one of {', '.join(_TYPES)}, but `dtype` is {dtype!r}."
        )
    name = "The attribute `system` of the dataset"
    return build(table_of(text, "JSON", name), dtype, allow_forces=allow_forces, force=force)


def _described_terms(system: ImpactSystem) -> dict[str, Any]:
    """Parametric terms; their frequency is left out where it is that of the load."""
    terms = parametric_of(system.force)
    if terms is None:
        return {}
    numbers = {name: getattr(terms, name) for name in _OF_TERMS}
    return {"parametric": {name: np.asarray(a).tolist() for name, a in numbers.items() if a is not None}}


def _terms(given: Any, dtype: DTypeLike) -> Parametric | None:
    if given is None:
        return None
    check_names("`parametric`", given, (), _OF_TERMS)
    return Parametric(**{name: one_array(f"parametric.{name}", a, dtype) for name, a in given.items()})


def _place(stop: AnyStop) -> dict[str, Any]:
    """Mass and side of a stop, or row of a contact."""
    if isinstance(stop, Stop | CompliantStop):
        return {"mass": stop.mass, "side": stop.side}
    return _described_row(stop)


def _tables(part: str, description: dict[str, Any]) -> list:
    given = description.get(part, [])
    if not isinstance(given, list):
        raise ValueError(f"`{part}` must be a list of tables, but is {given!r}.")
    return given


def _described_row(element: Contact | CompliantContact | Friction | Jenkins) -> dict[str, Any]:
    return {"row": {str(i): float(a) for i, a in element.coefficients.items()}}


def _law(stop: AnyStop) -> dict[str, Any]:
    """Law of a stop: its restitution and its motion, or its spring and damper."""
    if isinstance(stop, CompliantStop | CompliantContact):
        return {name: float(getattr(stop, name)) for name in LAW_OF_COMPLIANCE}
    return {
        "restitution": describe_restitution(stop.restitution),
        "motion": None if stop.motion is None else lists_of(stop.motion, _OF_MOTION),
    }


def _rubbing(element: Friction) -> dict[str, Any]:
    numbers = {name: getattr(element, name) for name in (*_OF_FRICTION, *_OF_TIED_FRICTION)}
    known = {name: float(a) for name, a in numbers.items() if a is not None}
    return _described_row(element) | known | ({"contact": element.contact} if element.is_tied else {})


def _slider(element: Jenkins) -> dict[str, Any]:
    numbers = {"stiffness": element.stiffness, "limit": element.limit, "slider": element.slider}
    return _described_row(element) | {name: float(a) for name, a in numbers.items() if a is not None}


@contextmanager
def _in_element(name: str) -> Iterator[None]:
    """Name the element of the machine in the errors of its class."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"In `{name}`: {error}") from error


def _stop(name: str, lists: Any, forcing: AbstractLoad, dtype: DTypeLike) -> AnyStop:
    own = ("row",) if isinstance(lists, dict) and "row" in lists else ("mass", "side")
    if isinstance(lists, dict) and "stiffness" in lists:
        return _compliant_stop(name, lists, own, dtype)
    check_names(f"`{name}`", lists, (*own, *_OF_LIMIT), ("motion",))
    position = one_array(f"{name}.position", lists["position"], dtype)
    restitution = _restitution(f"{name}.restitution", lists["restitution"], dtype)
    motion = _motion(f"{name}.motion", lists.get("motion"), forcing, dtype)
    with _in_element(name):
        if "row" not in lists:
            return Stop(lists["mass"], position, lists["side"], restitution, motion)
        return Contact(_row(f"{name}.row", lists["row"], dtype), position, restitution, motion)


def _compliant_stop(
    name: str, lists: dict[str, Any], own: tuple[str, ...], dtype: DTypeLike
) -> CompliantStop | CompliantContact:
    check_names(f"`{name}`", lists, (*own, "position", "stiffness"), ("damping", "preload"))
    numbers = {
        a: one_array(f"{name}.{a}", lists[a], dtype) for a in ("position", *LAW_OF_COMPLIANCE) if a in lists
    }
    with _in_element(name):
        if "row" not in lists:
            return CompliantStop(lists["mass"], side=lists["side"], **numbers)
        return CompliantContact(_row(f"{name}.row", lists["row"], dtype), **numbers)


def _friction(name: str, lists: Any, dtype: DTypeLike) -> Friction:
    is_tied = isinstance(lists, dict) and "coefficient" in lists
    names = _OF_TIED_FRICTION if is_tied else _OF_FRICTION
    check_names(f"`{name}`", lists, ("row", names[0]), (*names[1:], *(("contact",) if is_tied else ())))
    numbers = {a: one_array(f"{name}.{a}", lists[a], dtype) for a in names if a in lists}
    with _in_element(name):
        row = _row(f"{name}.row", lists["row"], dtype)
        return Friction(row, **numbers, contact=lists.get("contact", 0) if is_tied else None)


def _jenkins(name: str, lists: Any, dtype: DTypeLike) -> Jenkins:
    check_names(f"`{name}`", lists, ("row", "stiffness", "limit"), ("slider",))
    numbers = {
        a: one_array(f"{name}.{a}", lists[a], dtype) for a in ("stiffness", "limit", "slider") if a in lists
    }
    with _in_element(name):
        return Jenkins(_row(f"{name}.row", lists["row"], dtype), **numbers)


def _restitution(name: str, given: Any, dtype: DTypeLike) -> np.ndarray | AbstractRestitution:
    """A number, or the law of a table."""
    if not isinstance(given, dict):
        return one_array(name, given, dtype)
    laws = laws_by_name()
    if not isinstance(given.get("law"), str) or given["law"] not in laws:
        raise ValueError(
            f"`{name}` must be a number, or a table with `law`, one of {', '.join(sorted(laws))}, and its numbers, but is {given!r}."
        )
    law: Any = laws[given["law"]]
    check_names(f"`{name}`", given, ("law", *law.rules))
    return law(**{a: one_array(f"{name}.{a}", given[a], dtype) for a in law.rules})


def _row(name: str, given: Any, dtype: DTypeLike) -> dict[int, np.ndarray]:
    """Coefficients of a contact; text has the numbers of the masses as strings."""
    if not isinstance(given, dict) or not all(str(i).isdecimal() for i in given):
        raise ValueError(
            f"`{name}` must be a table of coefficients by the numbers of masses, but is {given!r}."
        )
    return {int(i): one_array(f"{name}.{i}", a, dtype) for i, a in given.items()}


def _motion(name: str, lists: Any, forcing: AbstractLoad, dtype: DTypeLike) -> Harmonic | None:
    if lists is None:
        return None
    check_names(f"`{name}`", lists, ("amplitude",), _OF_MOTION)
    arrays: dict[str, Any] = dict(arrays_of(name, lists, dtype))
    return Harmonic(frequency=forcing.frequency, **arrays)
