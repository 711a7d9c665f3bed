"""Vibro-impact machines in JAX: exact between impacts, no impact missed, differentiable, in batches."""

from . import models as models
from ._contact.restitution import (
    impact_configurations as impact_configurations,
    modal_restitution_matrix as modal_restitution_matrix,
    restitution_matrix as restitution_matrix,
)
from ._motion.taylor import TaylorFlow as TaylorFlow
from ._simulate import simulate as simulate
from ._solution import (
    IMPACT as IMPACT,
    RELEASE as RELEASE,
    RESULTS as RESULTS,
    STICK as STICK,
    EventLog as EventLog,
    Solution as Solution,
)
from ._system.forcing import Harmonic as Harmonic
from ._system.stop import Stop as Stop
from ._system.system import ImpactSystem as ImpactSystem, chain as chain
from ._sweep.sweep import sweep as sweep
