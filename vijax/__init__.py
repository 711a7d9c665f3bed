"""Vibro-impact machines in JAX: exact between impacts, no impact missed, differentiable, in batches."""

import typing as _typing
from importlib import import_module as _import_module

from . import models as models
from ._attractors.attractors import attractors as attractors
from ._attractors.basins import basins as basins, uncertainty_exponent as uncertainty_exponent
from ._attractors.chart import chart as chart
from ._attractors.classify import classify as classify
from ._attractors.cycles import periodic_orbits as periodic_orbits
from ._attractors.follow import follow_attractors as follow_attractors
from ._attractors.lyapunov import lyapunov_exponents as lyapunov_exponents
from ._attractors.sections import impact_map as impact_map, stroboscopic_section as stroboscopic_section
from ._attractors.spectrum import power_spectrum as power_spectrum
from ._branches.bifurcation_value import bifurcation_value as bifurcation_value
from ._branches.branch import Bifurcation as Bifurcation, Branch as Branch
from ._branches.branches import branches as branches
from ._branches.continuation import continuation as continuation
from ._branches.curve import bifurcation_curve as bifurcation_curve
from ._branches.switch import switch_branch as switch_branch
from ._contact.law import (
    impact_configurations as impact_configurations,
    modal_restitution_matrix as modal_restitution_matrix,
    restitution_matrix as restitution_matrix,
)
from ._contact.sticking_region import (
    StickingRegion as StickingRegion,
    sticking_region as sticking_region,
)
from ._dataset_attributes import version as _version
from ._execution.settings import ExecutionSettings as ExecutionSettings
from ._explorer.explore import explore as explore
from ._flow.choose import load_diffrax_flow as _load_diffrax_flow
from ._flow.modal import ModalFlow as ModalFlow
from ._flow.taylor import TaylorFlow as TaylorFlow
from ._keep import keep_compiled as keep_compiled
from ._orbits.find_many import find_periodic_orbits as find_periodic_orbits
from ._orbits.maps import (
    monodromy_matrix as monodromy_matrix,
    saltation_matrix as saltation_matrix,
    stroboscopic_map as stroboscopic_map,
)
from ._orbits.next_crossing import next_crossing as next_crossing
from ._orbits.next_impact import next_impact as next_impact
from ._orbits.orbit import ORBIT_RESULTS as ORBIT_RESULTS, PeriodicOrbit as PeriodicOrbit
from ._orbits.periodic_orbit import periodic_orbit as periodic_orbit
from ._refusal import SimulationError as SimulationError
from ._sweep.combine import combine as combine
from ._sweep.provenance import system_of as system_of
from ._sweep.sweep import sweep as sweep
from ._system.base import base_excitation as base_excitation
from ._system.contact import Contact as Contact
from ._system.files import load as load, save as save
from ._system.forcing import Harmonic as Harmonic
from ._system.stop import Stop as Stop
from ._system.system import ImpactSystem as ImpactSystem, chain as chain
from ._trajectory.event_log import IMPACT as IMPACT, RELEASE as RELEASE, STICK as STICK, EventLog as EventLog
from ._trajectory.simulate import simulate as simulate
from ._trajectory.solution import RESULTS as RESULTS, Solution as Solution

if _typing.TYPE_CHECKING:
    from . import plot as plot
    from ._flow.diffrax_flow import DiffraxFlow as DiffraxFlow
else:  # hidden from type checkers, or every misspelt name would pass as a late import

    def __getattr__(name: str) -> object:
        """Import `vijax.plot`, and with it matplotlib, and diffrax, when they are first asked for."""
        if name == "plot":
            return _import_module(".plot", __name__)
        if name == "DiffraxFlow":
            return _load_diffrax_flow()
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__version__ = _version("vijax")

__all__ = [
    "IMPACT",
    "ORBIT_RESULTS",
    "RELEASE",
    "RESULTS",
    "STICK",
    "Bifurcation",
    "Branch",
    "Contact",
    "DiffraxFlow",
    "EventLog",
    "ExecutionSettings",
    "Harmonic",
    "ImpactSystem",
    "ModalFlow",
    "PeriodicOrbit",
    "SimulationError",
    "Solution",
    "StickingRegion",
    "Stop",
    "TaylorFlow",
    "attractors",
    "base_excitation",
    "basins",
    "bifurcation_curve",
    "bifurcation_value",
    "branches",
    "chain",
    "chart",
    "classify",
    "combine",
    "continuation",
    "explore",
    "find_periodic_orbits",
    "follow_attractors",
    "impact_configurations",
    "impact_map",
    "keep_compiled",
    "load",
    "lyapunov_exponents",
    "modal_restitution_matrix",
    "models",
    "monodromy_matrix",
    "next_crossing",
    "next_impact",
    "periodic_orbit",
    "periodic_orbits",
    "plot",
    "power_spectrum",
    "restitution_matrix",
    "saltation_matrix",
    "save",
    "simulate",
    "sticking_region",
    "stroboscopic_map",
    "stroboscopic_section",
    "sweep",
    "switch_branch",
    "system_of",
    "uncertainty_exponent",
]


def __dir__() -> list[str]:
    """All names, those that are imported late among them."""
    return sorted({*globals(), *__all__})
