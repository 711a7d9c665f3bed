"""Pictures of sweeps, trajectories and periodic orbits, drawn by matplotlib.

Every function draws into the axes it is given, or into new ones, and returns them. Masses, stops and contacts are counted
from 0, as in the machine. Units are written as `units=` gives them, and none where it does not. Colours are those of the style
of matplotlib in use; what they tell, lightness, strokes, marks or words tell too, on a printer without colour.
"""

from ._animate import animate as animate
from ._basins import basins as basins
from ._bifurcation import bifurcation as bifurcation
from ._branch import branch as branch
from ._curves import curves as curves
from ._impact_map import impact_map as impact_map
from ._lyapunov import lyapunov as lyapunov
from ._machine import machine as machine
from ._multipliers import multipliers as multipliers
from ._plane import plane as plane
from ._regions import regions as regions
from ._relative_motion import relative_motion as relative_motion
from ._section import section as section
from ._shares import shares as shares
from ._sticking import sticking_region as sticking_region
from ._trajectories import phase_portrait as phase_portrait, time_series as time_series
