"""Names of branches in the legend, and lines of their quantities."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from .._branches.branch import Branch
from .._jax.arrays import a_kind_of
from ._ordinates import Ordinate, ordinate_of, ordinates

# More branches than these share colours and legend entries, one for each kind of motion.
_FEW = 8
# Largest number of kinds with an entry of their own.
_KINDS = 9
_OTHERS = "others"


def named_branches(
    branches: Branch | Sequence[Branch] | Mapping[str, Branch],
) -> tuple[list[Branch], list[str]]:
    """The branches and the names of their legend entries, which many of them share.

    A single branch without a name has none. Of many branches without names, those whose orbits mostly have m impacts in n
    periods are "m in n".
    """
    given: Any = [branches] if isinstance(branches, Branch) else branches
    several: list[Any] = [None]
    if isinstance(given, Iterable):
        several = [*given.values()] if isinstance(given, Mapping) else [*given]
    if not all(isinstance(one, Branch) for one in several):
        raise ValueError(
            "Argument `branches` must be what `vx.continuation` returned, several such in a list, or by their names in a "
            f"dict, but is {a_kind_of(branches)}."
        )
    if isinstance(branches, Mapping):
        return several, list(branches)
    if len(several) <= _FEW:
        return several, [f"branch {k}" if len(several) > 1 else "" for k in range(len(several))]
    motions = [_motion(one.points) for one in several]
    known = [one for one, _ in Counter(motions).most_common(_KINDS)]
    kinds = sorted(known, key=lambda motion: motion[::-1])
    order = [f"{m} in {n}" for m, n in kinds]
    names = [f"{m} in {n}" if (m, n) in known else _OTHERS for m, n in motions]
    by_motion = sorted(zip(several, names, strict=True), key=lambda pair: [*order, _OTHERS].index(pair[1]))
    return [one for one, _ in by_motion], [name for _, name in by_motion]


def _motion(points: xr.Dataset) -> tuple[int, int]:
    """Impacts m in n periods of most orbits of a branch."""
    counts = points["num_impacts"].values.sum(axis=1)
    return int(np.bincount(counts).argmax()), int(points.attrs["num_periods"])


def checked_ordinate(branches: list[Branch], name: str) -> Ordinate | None:
    """The quantity of a name, None for the velocity of the impacts; refused if a branch has no such column."""
    if name == "velocity":
        return None
    found = ordinate_of(name, branches[0].points)
    if found is None:
        names = ", ".join(f'"{one}"' for one in ("velocity", *ordinates()))
        raise ValueError(
            f'Argument `ordinate` must be one of {names}, or a column of the branches, but is "{name}".'
        )
    if any(name not in one.points for one in branches):
        raise ValueError(
            f'Argument `ordinate` is "{name}", which a branch does not have: give `vx.continuation` '
            f'`quantities=["{name}"]`.'
        )
    return found


def quantity_lines(points: xr.Dataset, name: str, quantity: Ordinate, number: int) -> list[tuple]:
    """Point numbers and values of the unbroken lines of a quantity, one for each period if it has several."""
    column = points[name].isel({quantity.axis: number}) if quantity.axis else points[name]
    rows = column.transpose("point", ...).values.reshape(points.sizes["point"], -1)
    lines = []
    for values in rows.T:
        known = np.flatnonzero(np.isfinite(values))
        parts = np.split(known, np.flatnonzero(np.diff(known) > 1) + 1)
        lines += [(part, values[part]) for part in parts if part.size]
    return lines
