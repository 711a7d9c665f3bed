"""What is computed of a machine before it is followed, kept for when it is followed again."""

from collections import OrderedDict
from dataclasses import dataclass, field

import jax
import numpy as np

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._machine.numbers import Numbers, numbers_of
from .._system.system import ImpactSystem

_MOST = 64


@dataclass(frozen=True)
class KnownMachine:
    """A machine of known numbers.

    Attributes:
        leaves: of the machine as it was given, which are kept so that no other has their identity.
        system: the machine in NumPy's numbers.
        numbers: the same in arrays, on the device.
        flows: the motions chosen so far, by whether a stop may hold its mass.
    """

    leaves: list
    system: ImpactSystem
    numbers: Numbers
    flows: dict[bool, AbstractFlow] = field(default_factory=dict)

    def flow(self, wanted: AbstractFlow | None, *, can_stick: bool) -> AbstractFlow:
        """The given motion, or the one that serves best."""
        if wanted is not None:
            return choose_flow(self.system, can_stick=can_stick, wanted=wanted)
        if can_stick not in self.flows:
            self.flows[can_stick] = choose_flow(self.system, can_stick=can_stick)
        return self.flows[can_stick]


_kept: OrderedDict = OrderedDict()


def known_machine(system: ImpactSystem) -> KnownMachine:
    """The numbers of a machine, computed once for arrays that cannot change."""
    leaves, structure = jax.tree.flatten(system)
    key = structure, *map(id, leaves)
    found = _kept.get(key)
    if found is None:
        dtype = system.mass.dtype
        in_numpy = jax.tree.unflatten(structure, [np.asarray(a).astype(dtype) for a in leaves])
        found = KnownMachine(leaves, in_numpy, jax.device_put(numbers_of(in_numpy)))
        if all(isinstance(a, jax.Array) for a in leaves):
            _kept[key] = found
        while len(_kept) > _MOST:
            _kept.popitem(last=False)
    return found
