"""Preparations to follow a machine of concrete numbers, cached for the next time."""

from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property

import jax
import numpy as np

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._hybrid.sticking import can_any_stick
from .._jax.arrays import Reals, as_numpy_float
from .._machine.numbers import MachineNumbers, numbers_of
from .._system.system import ImpactSystem, with_args
from .one_call import PackedMachine, packed_machine

_MOST = 64


@dataclass(frozen=True)
class ConcreteMachine:
    """Machine of concrete numbers.

    Attributes:
        leaves: leaves of the machine as given, kept alive so that no other object gets their `id`.
        system: the machine in NumPy numbers, its force bound to its `args`.
        numbers: the same as `MachineNumbers`, on the device.
        flows: flows chosen so far, by whether a stop may hold its mass.
        calls: the machine packed with each of these flows.
    """

    leaves: list
    system: ImpactSystem
    numbers: MachineNumbers
    flows: dict[bool, AbstractFlow] = field(default_factory=dict)
    calls: dict[bool, PackedMachine] = field(default_factory=dict)

    @cached_property
    def can_always_stick(self) -> bool:
        """True if a stop may hold its mass whatever the start."""
        n = self.system.num_masses
        return can_any_stick(self.system, np.full(n, np.nan), np.zeros(n))

    @cached_property
    def fixed_stops(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Rows and limits of the stops; None if any stop moves."""
        if self.numbers.travel is not None:
            return None
        return np.asarray(self.numbers.rows), np.asarray(self.numbers.limit)

    def is_inside(self, x: Reals) -> bool:
        """True if all masses lie between stops that stand still; otherwise `validate_start` decides."""
        if self.fixed_stops is None:
            return False
        rows, limit = self.fixed_stops
        return bool((rows @ x <= limit).all())

    def flow(self, wanted: AbstractFlow | None, *, can_stick: bool) -> AbstractFlow:
        """Return the given flow, or choose one and cache it."""
        if wanted is not None:
            return choose_flow(self.system, can_stick=can_stick, wanted=wanted)
        if can_stick not in self.flows:
            self.flows[can_stick] = choose_flow(self.system, can_stick=can_stick)
        return self.flows[can_stick]

    def packed(self, wanted: AbstractFlow | None, *, can_stick: bool) -> PackedMachine:
        """The machine packed with the given flow, or with the chosen one and cached."""
        if wanted is not None:
            return packed_machine(self.numbers, self.flow(wanted, can_stick=can_stick), can_stick=can_stick)
        if can_stick not in self.calls:
            flow = self.flow(None, can_stick=can_stick)
            self.calls[can_stick] = packed_machine(self.numbers, flow, can_stick=can_stick)
        return self.calls[can_stick]


_kept: OrderedDict = OrderedDict()


def known_machine(system: ImpactSystem, args: object) -> ConcreteMachine:
    """Concrete numbers of a machine, cached if its arrays are immutable."""
    leaves, structure = jax.tree.flatten((system, args))
    key = jax.config.read("jax_enable_x64"), structure, *map(id, leaves)
    found = _kept.get(key)
    if found is None:
        bound, others = jax.tree.flatten(with_args(system, args))
        dtype = as_numpy_float(0.0).dtype
        in_numpy = jax.tree.unflatten(others, [np.asarray(a).astype(dtype) for a in bound])
        found = ConcreteMachine(leaves, in_numpy, jax.device_put(numbers_of(in_numpy)))
        if all(isinstance(a, jax.Array) for a in leaves):
            _kept[key] = found
        while len(_kept) > _MOST:
            _kept.popitem(last=False)
    return found
