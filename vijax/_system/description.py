"""A machine as lists, numbers and words, such as JSON keeps, and back."""

from typing import Any

import numpy as np
from jax.typing import DTypeLike

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
        "forcing": {name: np.asarray(getattr(system.forcing, name)).tolist() for name in _OF_FORCING},
        "stops": [
            {
                "mass": stop.mass,
                "position": float(stop.position),
                "side": stop.side,
                "restitution": float(stop.restitution),
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
    forcing = {name: np.asarray(description["forcing"][name], dtype) for name in _OF_FORCING}
    stops = [
        Stop(
            stop["mass"],
            np.asarray(stop["position"], dtype),
            stop["side"],
            np.asarray(stop["restitution"], dtype),
        )
        for stop in description["stops"]
    ]
    return ImpactSystem(**arrays, forcing=Harmonic(**forcing), stops=stops)
