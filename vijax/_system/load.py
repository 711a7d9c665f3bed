"""Base class of all loads, and their sum."""

import abc
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._descriptions import described_by
from .._jax.arrays import Reals
from .._jax.concrete import concrete
from .._printing import describe_loads
from .checks import NOT_NEGATIVE, Rule, check_number


class AbstractLoad(eqx.Module):
    """A force on the masses that depends on the time alone. The sum of two is a load too.

    To add a kind of load, write its fields and the methods here, and let `numbers_of` put it into arrays.
    """

    frequency: eqx.AbstractVar[
        Any
    ]  # angular frequency; 0 where the load has none, None in a sum that has one for all

    @property
    def period(self) -> Float[Array, "..."]:
        """Period of the load, 2 pi / W.

        Raises:
            ValueError: if it has none.
        """
        if self.frequency is None:
            raise ValueError(
                "Loads of a sum and motions of stops have the frequency of the whole load: ask for `forcing.period` of the machine."
            )
        if self.why_not_periodic:
            raise ValueError(self.why_not_periodic)
        return 2 * jnp.pi / self.frequency

    @property
    def loads(self) -> "tuple[AbstractLoad, ...]":
        """The loads of a sum, or this one."""
        return (self,)

    @property
    def why_not_periodic(self) -> str:
        """Reason why there is no forcing period, and what to do; empty if there may be one."""
        return ""

    @property
    def clock(self) -> Reals:
        """Angular frequency by which the engine counts periods; 0 for none."""
        return self.frequency

    @property
    def has_waves(self) -> bool:
        """True for harmonics."""
        return False

    def check_lanes(self, check_every: Callable[[str, Any, Rule], None]) -> None:
        """Reject values that make no valid load, of many machines at once; lanes last."""
        if self.frequency is not None:
            check_every("frequency", self.frequency, NOT_NEGATIVE)

    @abc.abstractmethod
    def num_columns(self, lane_axes: int = 0) -> int:
        """Number of masses; lanes may be last."""

    @abc.abstractmethod
    def size(self) -> Reals:
        """Size of the force on every mass, (n,); lanes may be last."""

    @abc.abstractmethod
    def with_more(self, count: int) -> "AbstractLoad":
        """The load, zero on some more coordinates."""

    def __add__(self, other: object) -> "LoadSum":
        if not isinstance(other, AbstractLoad):
            return NotImplemented
        return LoadSum([self, other])

    def __radd__(self, other: object) -> "AbstractLoad":
        """The load itself for `sum(loads)`, which begins with 0."""
        return self if isinstance(other, int) and other == 0 else NotImplemented


def with_more_columns(values: Float[Array, "..."], count: int) -> Float[Array, "..."]:
    """Forces that are zero on some more coordinates, the last axis."""
    return jnp.concatenate([values, jnp.zeros((*values.shape[:-1], count), values.dtype)], axis=-1)


class LoadSum(AbstractLoad):
    """Sum of loads, made by `+`.

    Loads of one frequency share it: it is `frequency` of the sum, and a change there moves all of them. Constant loads,
    harmonics of frequency 0, have none. Sums of other loads have no period: each load keeps its frequency, also if another
    has the same one.

    Attributes:
        parts: the loads, without those that are sums themselves.
        common: the frequency of all; None if the sum has no period.
    """

    parts: tuple[AbstractLoad, ...]
    common: Float[Array, "..."] | None

    def __init__(self, loads: Sequence[AbstractLoad]):
        parts = [part for load in loads for part in with_own_frequencies(load)]
        columns = [part.num_columns() for part in parts]
        if len(set(columns)) > 1:
            raise ValueError(
                f"Loads of a sum must act on the same masses, but they have {' and '.join(map(str, columns))} columns: give each "
                "a column for every mass, zero where it does not act."
            )
        self.parts, self.common = _sharing_frequency(parts)

    def __check_init__(self):
        if self.common is not None:
            check_number("frequency", self.common, NOT_NEGATIVE)

    @property
    def frequency(self) -> Reals:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Angular frequency of all loads; 0 if they have different ones, or one has none."""
        return np.zeros(np.shape(self.clock), self.clock.dtype) if self.common is None else self.common

    @property
    def loads(self) -> tuple[AbstractLoad, ...]:
        """The loads."""
        return self.parts

    @property
    def why_not_periodic(self) -> str:
        """Reason why there is no forcing period, and what to do; empty if there may be one."""
        if self.common is not None:
            return ""
        reasons = [part.why_not_periodic for part in self.parts if part.why_not_periodic]
        is_all_constant = all(map(is_constant, self.parts))
        return reasons[0] if reasons else "" if is_all_constant else _DIFFERENT

    @property
    def clock(self) -> Reals:
        """Frequency of the harmonics, else of the first wave form; 0 for none."""
        if self.common is not None:
            return self.common
        moving = [part for part in self.parts if not (part.why_not_periodic or is_constant(part))]
        moving.sort(key=lambda part: not part.has_waves)
        return moving[0].frequency if moving else self.parts[0].frequency

    def num_columns(self, lane_axes: int = 0) -> int:
        """Number of masses; lanes may be last."""
        return self.parts[0].num_columns(lane_axes)

    def size(self) -> Reals:
        """Sum of the sizes."""
        return sum(part.size() for part in self.parts)

    def with_more(self, count: int) -> "LoadSum":
        """The loads, zero on some more coordinates."""
        return eqx.tree_at(lambda s: s.parts, self, tuple(part.with_more(count) for part in self.parts))

    def __getitem__(self, index: int) -> AbstractLoad:
        return self.parts[index]

    def __len__(self) -> int:
        return len(self.parts)

    __repr__, _repr_html_ = described_by(describe_loads)


_DIFFERENT = (
    "The loads have different frequencies, so there is no forcing period: give them one frequency, or follow the motion in time "
    "with `vx.simulate` or `vx.sweep(..., duration=...)`."
)


def with_own_frequencies(load: Any) -> tuple[AbstractLoad, ...]:
    """Parts of a load, each with its own frequency."""
    if not isinstance(load, LoadSum):
        return (load,)
    return tuple(
        part if part.frequency is not None else _with_frequency(part, load.common) for part in load.parts
    )


def _with_frequency(load: AbstractLoad, frequency: Any) -> AbstractLoad:
    return eqx.tree_at(lambda f: f.frequency, load, frequency, is_leaf=lambda leaf: leaf is None)


def _sharing_frequency(parts: list[AbstractLoad]) -> tuple[tuple[AbstractLoad, ...], Any]:
    """Loads without the frequency that all share, and that frequency; None if there is none.

    Of traced frequencies only one and the same is known to be equal.
    """
    turning = [part for part in parts if not is_constant(part)]
    found = _common(turning) if turning and not any(part.why_not_periodic for part in turning) else []
    if not found:
        return tuple(parts), None
    same = (part if is_constant(part) else _with_frequency(part, None) for part in parts)
    return tuple(same), found[0]


def is_constant(load: AbstractLoad) -> bool:
    """True for harmonics of frequency 0."""
    frequency = None if load.frequency is None else concrete(load.frequency)
    return load.has_waves and frequency is not None and not frequency.any()


def _common(loads: list[AbstractLoad]) -> list[Any]:
    """The frequency that all loads have, or nothing."""
    first, *others = (load.frequency for load in loads)
    for other in others:
        if other is not first:
            differs = concrete(first != other)
            if differs is None or differs.any():
                return []
    return [first]
