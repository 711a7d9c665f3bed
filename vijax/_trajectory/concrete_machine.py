"""Preparations to follow a machine of concrete numbers, cached for the next time."""

from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from typing import NamedTuple
from weakref import ref

import jax
import numpy as np

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._hybrid.sticking import can_any_stick
from .._jax.arrays import Reals, as_numpy_float
from .._machine.numbers import MachineNumbers, numbers_of
from .._system.system import AnySystem, ImpactSystem, with_args
from .one_call import KnownMachine

_MOST = 64


@dataclass(frozen=True)
class ConcreteMachine:
    """Machine of concrete numbers.

    Attributes:
        leaves: leaves of the machine as given, kept alive so that no other object gets their `id`.
        system: the machine in NumPy numbers, its force bound to its `args`.
        in_numpy: the same as `MachineNumbers`.
        flows: flows chosen so far, by whether a stop may hold its mass.
        calls: the machine packed with each of these flows.
    """

    leaves: list
    system: ImpactSystem
    in_numpy: MachineNumbers
    flows: dict[bool, AbstractFlow] = field(default_factory=dict)
    calls: dict[bool, KnownMachine] = field(default_factory=dict)

    @cached_property
    def numbers(self) -> MachineNumbers:
        """Numbers of the machine, on the device."""
        return jax.device_put(self.in_numpy)

    @cached_property
    def can_always_stick(self) -> bool:
        """True if a stop may hold its mass whatever the start."""
        n = self.system.num_masses
        return can_any_stick(self.system, np.full(n, np.nan), np.zeros(n))

    @cached_property
    def fixed_stops(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Rows and limits of the stops; None if any stop moves or yields."""
        numbers = self.in_numpy
        is_fixed = numbers.travel is None and numbers.laws is None
        return (numbers.rows, numbers.limit) if is_fixed else None

    def admits(self, t0: Reals, t1: Reals, x: Reals, v: Reals) -> bool:
        """True if a start is valid, between stops that stand still; otherwise `validate_start` decides."""
        if self.fixed_stops is None:
            return False
        rows, limit = self.fixed_stops
        is_finite = isfinite(t0) and isfinite(t1) and np.isfinite(x).all() and np.isfinite(v).all()
        return bool(is_finite and t0 <= t1 and (rows @ x <= limit).all())

    def flow(self, wanted: AbstractFlow | None, *, can_stick: bool) -> AbstractFlow:
        """Return the given flow, or choose one and cache it."""
        if wanted is not None:
            return choose_flow(self.system, can_stick=can_stick, wanted=wanted)
        if can_stick not in self.flows:
            self.flows[can_stick] = choose_flow(self.system, can_stick=can_stick)
        return self.flows[can_stick]

    def packed(self, wanted: AbstractFlow | None, *, can_stick: bool) -> KnownMachine:
        """The machine packed with the given flow, or with the chosen one and cached."""
        if wanted is not None:
            return KnownMachine(self.in_numpy, self.flow(wanted, can_stick=can_stick), can_stick=can_stick)
        if can_stick not in self.calls:
            flow = self.flow(None, can_stick=can_stick)
            self.calls[can_stick] = KnownMachine(self.in_numpy, flow, can_stick=can_stick)
        return self.calls[can_stick]


_kept: OrderedDict = OrderedDict()


class _Seen(NamedTuple):
    """A machine object that was known before; weak, and dropped with it."""

    system: ref
    has_64_bits: bool
    found: ConcreteMachine


_seen: dict[int, _Seen] = {}


def remembered(system: ImpactSystem, args: object) -> ConcreteMachine | None:
    """Cached concrete numbers of a machine object, by `known_machine`; None if there are none.

    To compare the leaves of a machine takes longer than to follow it. Objects are enough where none can be changed: all
    arrays are of JAX, and a `force`, whose own fields may be lists, is none.
    """
    seen = _seen.get(id(system))
    if seen is None or args is not None or seen.system() is not system:
        return None
    return seen.found if seen.has_64_bits == jax.config.read("jax_enable_x64") else None


def _remember(system: AnySystem, found: ConcreteMachine) -> None:
    key = id(system)
    weak = ref(system, lambda _: _seen.pop(key, None))
    _seen[key] = _Seen(weak, jax.config.read("jax_enable_x64"), found)


def known_machine(system: AnySystem, args: object) -> ConcreteMachine:
    """Concrete numbers of a machine, cached if its arrays are immutable."""
    leaves, structure = jax.tree.flatten((system, args))
    key = jax.config.read("jax_enable_x64"), structure, *map(id, leaves)
    found = _kept.get(key)
    if found is None:
        bound, others = jax.tree.flatten(with_args(system, args))
        dtype = as_numpy_float(0.0).dtype
        in_numpy = jax.tree.unflatten(others, [np.asarray(a).astype(dtype) for a in bound])
        found = ConcreteMachine(leaves, in_numpy, numbers_of(in_numpy))
    if all(isinstance(a, jax.Array) for a in leaves):
        _kept[key] = found
        if args is None and system.force is None:
            _remember(system, found)
    while len(_kept) > _MOST:
        _kept.popitem(last=False)
    return found
