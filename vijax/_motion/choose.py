"""The motion that serves a machine best."""

from .._system.system import ImpactSystem
from .flow import AbstractFlow
from .modes import modal_flow
from .taylor import TaylorFlow


def choose_flow(system: ImpactSystem, *, can_stick: bool) -> AbstractFlow:
    """Mode by mode where that is exact, else by Taylor series."""
    return modal_flow(system, can_stick=can_stick) or TaylorFlow()
