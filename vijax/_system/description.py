"""A machine as lists, numbers and words, such as JSON keeps, and back."""

from typing import Any

import jax
import numpy as np
from jax.typing import DTypeLike

from .contact import Contact
from .force import name_of_force
from .forcing import Harmonic
from .stop import Stop
from .system import ImpactSystem

_ARRAYS, _OF_FORCING = ("mass", "damping", "stiffness"), ("amplitude", "frequency", "phase", "mean")


def describe(system: ImpactSystem) -> dict[str, Any]:
    """All that a machine is made of. Floats are Python's, which JSON returns bit for bit.

    A force is told by its name alone.
    """
    return {
        **{name: np.asarray(getattr(system, name)).tolist() for name in _ARRAYS},
        "forcing": _lists(system.forcing),
        "stops": [
            _place(stop)
            | {
                "position": float(stop.position),
                "restitution": float(stop.restitution),
                "motion": None if stop.motion is None else _lists(stop.motion),
            }
            for stop in system.stops
        ],
        "force": None if system.force is None else name_of_force(system.force),
    }


def build(description: dict[str, Any], dtype: DTypeLike) -> ImpactSystem:
    """The machine of a description, in numbers of type `dtype`.

    Raises:
        ValueError: for a machine with a force.
    """
    if description.get("force") is not None:
        raise ValueError(
            f"The machine has the force {description['force']}, which no text can hold: build the machine "
            "as it was built for the sweep."
        )
    arrays = {name: np.asarray(description[name], dtype) for name in _ARRAYS}
    forcing = Harmonic(**{name: np.asarray(description["forcing"][name], dtype) for name in _OF_FORCING})
    stops = [_stop(stop, forcing, dtype) for stop in description["stops"]]
    system = ImpactSystem(**arrays, forcing=forcing, stops=stops)
    # Made in the precision that JAX is set to, which holds every number of a narrower one.
    narrow = jax.dtypes.canonicalize_dtype(dtype)
    return jax.tree.map(lambda a: a.astype(narrow), system)


def _place(stop: Stop | Contact) -> dict[str, Any]:
    """The mass and side of a stop, the row of a contact."""
    if isinstance(stop, Stop):
        return {"mass": stop.mass, "side": stop.side}
    return {"row": [[i, float(a)] for i, a in stop.coefficients.items()]}


def _stop(lists: dict[str, Any], forcing: Harmonic, dtype: DTypeLike) -> Stop | Contact:
    position, restitution = (np.asarray(lists[name], dtype) for name in ("position", "restitution"))
    motion = _motion(lists.get("motion"), forcing, dtype)
    if "row" in lists:
        row = {i: np.asarray(a, dtype) for i, a in lists["row"]}
        return Contact(row, position, restitution, motion)
    return Stop(lists["mass"], position, lists["side"], restitution, motion)


def _lists(harmonic: Harmonic) -> dict[str, Any]:
    """A load, or a motion, which has no frequency of its own."""
    values = ((name, getattr(harmonic, name)) for name in _OF_FORCING)
    return {name: np.asarray(value).tolist() for name, value in values if value is not None}


def _motion(lists: dict[str, Any] | None, forcing: Harmonic, dtype: DTypeLike) -> Harmonic | None:
    if lists is None:
        return None
    return Harmonic(frequency=forcing.frequency, **{name: np.asarray(a, dtype) for name, a in lists.items()})
