"""Vibro-impact machines in JAX: exact between impacts, no impact missed, differentiable, in batches."""

import importlib

from . import models as models
from ._attractors.maps import impact_map as impact_map, stroboscopic_section as stroboscopic_section
from ._attractors.motion_class import classify as classify
from ._contact.restitution import (
    impact_configurations as impact_configurations,
    modal_restitution_matrix as modal_restitution_matrix,
    restitution_matrix as restitution_matrix,
)
from ._contact.sticking_region import (
    StickingRegion as StickingRegion,
    sticking_region as sticking_region,
)
from ._log import IMPACT as IMPACT, RELEASE as RELEASE, STICK as STICK, EventLog as EventLog
from ._motion.choose import load_diffrax_flow
from ._motion.modal import ModalFlow as ModalFlow
from ._motion.taylor import TaylorFlow as TaylorFlow
from ._orbits.maps import (
    monodromy_matrix as monodromy_matrix,
    saltation_matrix as saltation_matrix,
    stroboscopic_map as stroboscopic_map,
)
from ._refusal import SimulationError as SimulationError
from ._simulate import simulate as simulate
from ._solution import RESULTS as RESULTS, Solution as Solution
from ._sweep.origin import system_of as system_of
from ._sweep.sweep import sweep as sweep
from ._system.base import base_excitation as base_excitation
from ._system.forcing import Harmonic as Harmonic
from ._system.stop import Stop as Stop
from ._system.system import ImpactSystem as ImpactSystem, chain as chain


def __getattr__(name: str):
    """Import `vijax.plot`, and with it matplotlib, and diffrax, when they are first asked for."""
    if name == "plot":
        return importlib.import_module(".plot", __name__)
    if name == "DiffraxFlow":
        return load_diffrax_flow()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
