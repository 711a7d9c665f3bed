"""Preparations to follow a machine of known numbers, kept for when it is followed again."""

from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property

import jax
import numpy as np

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._hybrid.sticking import can_any_stick
from .._jax.arrays import Reals, as_known
from .._machine.numbers import MachineNumbers, numbers_of
from .._system.system import ImpactSystem, with_args

_MOST = 64


@dataclass(frozen=True)
class KnownMachine:
    """A machine of known numbers.

    Attributes:
        leaves: of the machine as it was given, which are kept so that no other has their identity.
        system: the machine in NumPy's numbers, its force bound to its `args`.
        numbers: the same in arrays, on the device.
        flows: the motions chosen so far, by whether a stop may hold its mass.
    """

    leaves: list
    system: ImpactSystem
    numbers: MachineNumbers
    flows: dict[bool, AbstractFlow] = field(default_factory=dict)

    @cached_property
    def can_always_stick(self) -> bool:
        """Whether a stop might hold its mass wherever the motion starts."""
        n = self.system.num_masses
        return can_any_stick(self.system, np.full(n, np.nan), np.zeros(n))

    @cached_property
    def fixed_stops(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Rows and limits of the stops; None if any of them moves."""
        if self.numbers.travel is not None:
            return None
        return np.asarray(self.numbers.rows), np.asarray(self.numbers.limit)

    def is_inside(self, x: Reals) -> bool:
        """Whether all masses are clearly between stops that stand still; if not, `validate_start` looks closer."""
        if self.fixed_stops is None:
            return False
        rows, limit = self.fixed_stops
        return bool((rows @ x <= limit).all())

    def flow(self, wanted: AbstractFlow | None, *, can_stick: bool) -> AbstractFlow:
        """The given motion, or the one that serves best."""
        if wanted is not None:
            return choose_flow(self.system, can_stick=can_stick, wanted=wanted)
        if can_stick not in self.flows:
            self.flows[can_stick] = choose_flow(self.system, can_stick=can_stick)
        return self.flows[can_stick]


_kept: OrderedDict = OrderedDict()


def known_machine(system: ImpactSystem, args: object) -> KnownMachine:
    """The numbers of a machine, computed once for arrays that cannot change."""
    leaves, structure = jax.tree.flatten((system, args))
    key = jax.config.read("jax_enable_x64"), structure, *map(id, leaves)
    found = _kept.get(key)
    if found is None:
        bound, others = jax.tree.flatten(with_args(system, args))
        dtype = as_known(0.0).dtype
        in_numpy = jax.tree.unflatten(others, [np.asarray(a).astype(dtype) for a in bound])
        found = KnownMachine(leaves, in_numpy, jax.device_put(numbers_of(in_numpy)))
        if all(isinstance(a, jax.Array) for a in leaves):
            _kept[key] = found
        while len(_kept) > _MOST:
            _kept.popitem(last=False)
    return found
