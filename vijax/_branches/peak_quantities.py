"""Quantities of a cycle whose peaks along a branch are located: sums of extremes of positions and velocities."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .._system.spelling import did_you_mean
from .._system.system import AnySystem
from .extremes import Extremes

# Rows of `Extremes`.
_LARGEST, _SMALLEST = 0, 1
# Of each quantity: whether it is of velocities, and its extremes with their signs.
_TERMS: dict[str, tuple[bool, tuple[tuple[int, float], ...]]] = {
    "max_position": (False, ((_LARGEST, 1.0),)),
    "min_position": (False, ((_SMALLEST, 1.0),)),
    "peak_to_peak": (False, ((_LARGEST, 1.0), (_SMALLEST, -1.0))),
    "max_velocity": (True, ((_LARGEST, 1.0),)),
    "min_velocity": (True, ((_SMALLEST, 1.0),)),
}


class PeakQuantity(NamedTuple):
    """A quantity of one mass.

    Attributes:
        name: as in `vx.sweep`.
        mass: number of the mass.
        num_coordinates: length of the positions in a state: Jenkins elements have some as well.
    """

    name: str
    mass: int
    num_coordinates: int

    @property
    def words(self) -> str:
        """Name with the mass, as users give and read it."""
        return f"{self.name}[{self.mass}]"

    @property
    def coordinate(self) -> int:
        """Number of its coordinate of the state."""
        return self.mass + self.num_coordinates * _TERMS[self.name][0]

    @property
    def rows(self) -> np.ndarray:
        """Rows of its extremes, (terms,)."""
        return np.array([row for row, _ in _TERMS[self.name][1]])

    @property
    def signs(self) -> np.ndarray:
        """Signs with which they add up, (terms,)."""
        return np.array([sign for _, sign in _TERMS[self.name][1]])

    def of(self, values: Any) -> float:
        """The quantity, or its derivative, from those of all extremes, (2, 2 n)."""
        return float(self.signs @ np.asarray(values)[self.rows, self.coordinate])

    def places(self, extremes: Extremes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Flights, times and sides of its extremes, (terms,) each."""
        at = lambda a: np.asarray(a)[self.rows, self.coordinate]  # noqa: E731
        return at(extremes.flight), at(extremes.since), at(extremes.side)


def peak_quantity(words: str, system: AnySystem) -> PeakQuantity:
    """The quantity of a name with a mass, of a machine."""
    name, mass = re.fullmatch(r"(\w+)\[(\d+)\]", words).groups()  # pyright: ignore[reportOptionalMemberAccess]
    return PeakQuantity(name, int(mass), system.num_coordinates)


def checked_peak_quantities(wanted: Sequence[str], system: AnySystem) -> list[PeakQuantity]:
    """Quantities of a machine by their names, of all masses where a name has none.

    Raises:
        ValueError: for other names, or masses.
    """
    if isinstance(wanted, str):
        raise ValueError(f"Argument `peaks` must be a list of names, as [{wanted!r}].")
    found, num_masses = [], system.num_masses
    for words in wanted:
        parts = re.fullmatch(r"(\w+?)(?:\[(\d+)\])?", words) if isinstance(words, str) else None
        name = parts.group(1) if parts else words
        if parts is None or name not in _TERMS:
            known = ", ".join(f'"{one}"' for one in _TERMS)
            raise ValueError(
                f"Argument `peaks` has {words!r}: the quantities whose peaks are located are {known}, of all masses, or of one, as "
                f'"max_position[0]".{did_you_mean(str(name), [*_TERMS])}'
            )
        mass = parts.group(2)
        if mass is not None and int(mass) >= num_masses:
            raise ValueError(f"Argument `peaks` has {words!r}, but there are {num_masses} masses, from 0 on.")
        masses = range(num_masses) if mass is None else [int(mass)]
        found += [PeakQuantity(name, one, system.num_coordinates) for one in masses]
    return list(dict.fromkeys(found))
