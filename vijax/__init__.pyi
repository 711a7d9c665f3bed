"""The public names, and where each is; see `__init__.py`."""

from . import models as models, plot as plot
from ._attractors.attractors import attractors as attractors
from ._attractors.basins import basins as basins, uncertainty_exponent as uncertainty_exponent
from ._attractors.critical_shock import critical_shock as critical_shock
from ._attractors.edge_state import edge_state as edge_state
from ._attractors.follow import follow_attractors as follow_attractors
from ._attractors.integrity import integrity as integrity
from ._attractors.tipping import tipping_probability as tipping_probability
from ._branches.bifurcation_value import bifurcation_value as bifurcation_value, peak_height as peak_height
from ._branches.branch import Bifurcation as Bifurcation, Branch as Branch, Peak as Peak
from ._branches.branches import branches as branches
from ._branches.continuation import continuation as continuation
from ._branches.curve import bifurcation_curve as bifurcation_curve
from ._branches.grazing_form import GrazingForm as GrazingForm
from ._branches.nonsmooth_modes import nonsmooth_modes as nonsmooth_modes
from ._branches.normal_form import NormalForm as NormalForm
from ._branches.switch import switch_branch as switch_branch
from ._charts.chart import chart as chart
from ._execution.settings import ExecutionSettings as ExecutionSettings
from ._flow.diffrax_flow import DiffraxFlow as DiffraxFlow
from ._flow.modal import ModalFlow as ModalFlow
from ._flow.taylor import TaylorFlow as TaylorFlow
from ._hybrid.law import (
    impact_configurations as impact_configurations,
    modal_restitution_matrix as modal_restitution_matrix,
    restitution_matrix as restitution_matrix,
)
from ._hybrid.limits import (
    CLOSE as CLOSE,
    IMPACT as IMPACT,
    OPEN as OPEN,
    RELEASE as RELEASE,
    SLIP as SLIP,
    STICK as STICK,
    TURN as TURN,
)
from ._hybrid.sticking_region import (
    StickingRegion as StickingRegion,
    sticking_region as sticking_region,
)
from ._jax.compilation_cache import keep_compiled as keep_compiled
from ._jax.errors import SimulationError as SimulationError
from ._manifolds.homoclinic import homoclinic_tangencies as homoclinic_tangencies
from ._manifolds.manifolds import manifolds as manifolds
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
from ._orbits.sweep_orbits import periodic_orbits as periodic_orbits
from ._precompile.precompile import precompile as precompile
from ._precompile.process import Precompilation as Precompilation
from ._progress import Interrupted as Interrupted
from ._sections.classify import classify as classify
from ._sections.impact_table import impacts as impacts
from ._sections.level_crossings import level_crossings as level_crossings
from ._sections.lyapunov import lyapunov_exponents as lyapunov_exponents
from ._sections.sections import impact_map as impact_map, stroboscopic_section as stroboscopic_section
from ._sections.spectrum import power_spectrum as power_spectrum
from ._sweep.combine import combine as combine
from ._sweep.ensemble import ensemble as ensemble
from ._sweep.provenance import system_of as system_of
from ._sweep.random_load import random_load as random_load
from ._sweep.sensitivity import sensitivity as sensitivity
from ._sweep.sweep import sweep as sweep
from ._system.base import base_excitation as base_excitation
from ._system.chain import chain as chain
from ._system.compliant import CompliantContact as CompliantContact, CompliantStop as CompliantStop
from ._system.contact import Contact as Contact
from ._system.family import Family as Family
from ._system.files import load as load, save as save
from ._system.forcing import Harmonic as Harmonic
from ._system.friction import Friction as Friction
from ._system.hysteresis import Jenkins as Jenkins
from ._system.parametric import Parametric as Parametric
from ._system.restitution import (
    AbstractRestitution as AbstractRestitution,
    FallingRestitution as FallingRestitution,
)
from ._system.states import with_states as with_states
from ._system.stop import Stop as Stop
from ._system.symmetry import Symmetry as Symmetry
from ._system.system import ImpactSystem as ImpactSystem
from ._system.tabulated import Tabulated as Tabulated, Waveform as Waveform
from ._tori.torus import follow_torus as follow_torus
from ._trajectory.event_log import EventLog as EventLog
from ._trajectory.results import RESULTS as RESULTS
from ._trajectory.simulate import simulate as simulate
from ._trajectory.solution import Solution as Solution
from .studio.explorer.explore import explore as explore

__version__: str
