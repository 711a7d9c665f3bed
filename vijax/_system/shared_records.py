"""Records of many machines at once, of which several have the same."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._jax.arrays import Reals
from .checks import Rule
from .load import AbstractLoad, LoadSum
from .tabulated import Tabulated


class SharedRecords(AbstractLoad):
    """Loads by tables of many machines in lanes, each table held once.

    Attributes:
        times: times of the knots, (tables or 1, knots, 1).
        values: forces there, (tables or 1, knots, n, 1).
        number: number of the table of each machine, (lanes,).
        kind: as for `vx.Tabulated`.
        from_base: likewise.
    """

    times: Reals
    values: Reals
    number: Reals
    kind: str = eqx.field(static=True)
    from_base: bool = eqx.field(static=True)

    @classmethod
    def of(cls, tables: Tabulated, number: np.ndarray) -> "SharedRecords":
        """Tables whose last axis counts them, and which of them each lane has."""
        times, values = (np.moveaxis(np.asarray(a), -1, 0)[..., None] for a in (tables.times, tables.values))
        number = number.astype(values.dtype)
        return cls(times, values, number, tables.kind, tables.from_base)  # pyright: ignore[reportCallIssue]

    @property
    def tables(self) -> Tabulated:
        """The tables, counted by the last axis."""
        found = object.__new__(Tabulated)
        times, values = (np.moveaxis(a[..., 0], 0, -1) for a in (self.times, self.values))
        fields = {"times": times, "values": values, "kind": self.kind, "from_base": self.from_base}
        for name, field in fields.items():  # without the checks of one table
            object.__setattr__(found, name, field)
        return found

    @property
    def frequency(self) -> np.ndarray:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Zero, as a table has no frequency."""
        return np.zeros(1, self.times.dtype)

    @property
    def why_not_periodic(self) -> str:
        """Reason why there is no forcing period."""
        return self.tables.why_not_periodic

    def check_lanes(self, check_every: Callable[[str, Any, Rule], None]) -> None:
        """Reject times that do not rise."""
        self.tables.check_lanes(check_every)

    def num_columns(self, lane_axes: int = 0) -> int:
        """Number of masses."""
        return self.values.shape[2]

    def size(self) -> Reals:
        """Largest value of every mass, (n, lanes)."""
        sizes = self.tables.size()
        return sizes if sizes.shape[-1] == 1 else sizes[..., self.number.astype(int)]

    def with_more(self, count: int) -> "SharedRecords":
        """The loads, zero on some more coordinates."""
        room = np.zeros((*self.values.shape[:2], count, 1), self.values.dtype)
        return eqx.tree_at(lambda s: s.values, self, np.concatenate([self.values, room], axis=2))

    def at(self, lanes: np.ndarray) -> "SharedRecords":
        """The loads of some lanes, with their tables alone."""
        kept, number = np.unique(self.number[lanes], return_inverse=True)
        of_kept = lambda a: a if len(a) == 1 else a[kept.astype(int)]  # noqa: E731
        number = number.astype(self.number.dtype)
        of_lanes = of_kept(self.times), of_kept(self.values), number
        return eqx.tree_at(lambda s: (s.times, s.values, s.number), self, of_lanes)


def with_shared_records(system: Any, tables: Any, number: np.ndarray) -> Any:
    """Machines in lanes with the records of other machines, of which `number` tells one for each lane."""
    loads = [
        SharedRecords.of(of_tables, number) if isinstance(own, Tabulated) else own
        for own, of_tables in zip(system.forcing.loads, tables.forcing.loads, strict=True)
    ]
    if isinstance(system.forcing, LoadSum):
        return eqx.tree_at(lambda s: s.forcing.parts, system, tuple(loads))
    return eqx.tree_at(lambda s: s.forcing, system, loads[0])


def places_of_records(system: Any) -> set[int]:
    """Places of the numbers of records among the leaves of a machine."""
    is_record = lambda part: isinstance(part, Tabulated)  # noqa: E731
    flagged = lambda part: jax.tree.map(lambda _: is_record(part), part)  # noqa: E731
    flags = jax.tree.map(flagged, system, is_leaf=is_record)
    return {k for k, flag in enumerate(jax.tree.leaves(flags)) if flag}
