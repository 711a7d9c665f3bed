"""Pictures of sweeps, trajectories and periodic orbits, drawn by matplotlib.

Every function draws into the axes it is given, or into new ones, and returns them. Units are those
in which the machine was described, so the axes name the kind of unit alone. Colours differ in
lightness as well, so that the pictures survive a printer without colour.
"""

from ._animate import animate as animate
from ._basins import basins as basins
from ._bifurcation import bifurcation as bifurcation
from ._branch import branch as branch
from ._impact_map import impact_map as impact_map
from ._lyapunov import lyapunov as lyapunov
from ._machine import machine as machine
from ._multipliers import multipliers as multipliers
from ._regions import regions as regions
from ._relative_motion import relative_motion as relative_motion
from ._sticking import sticking_region as sticking_region
from ._trajectories import phase_portrait as phase_portrait, time_series as time_series
