"""Which resets a machine has."""

from types import ModuleType

from .._machine.machine import Machine
from . import coupled_impacts, diagonal_impacts, switching_resets


def resets_of(machine: Machine) -> ModuleType:
    """Resets of the contacts of a machine: stops alone, contacts that share inertia, or friction and compliant ones too."""
    if machine.contacts.is_switching:
        return switching_resets
    return coupled_impacts if machine.contacts.is_coupled else diagonal_impacts
