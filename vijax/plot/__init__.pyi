"""The pictures, and where each is drawn; see `__init__.py`."""

from ..studio.drawing.animate import animate as animate
from ..studio.drawing.machine import machine as machine
from ._basins import basins as basins
from ._bifurcation import bifurcation as bifurcation
from ._branch import branch as branch
from ._curves import curves as curves
from ._erosion import erosion as erosion
from ._hysteresis_loop import hysteresis_loop as hysteresis_loop
from ._impact_map import impact_map as impact_map
from ._inset import inset as inset
from ._lyapunov import lyapunov as lyapunov
from ._manifolds import manifolds as manifolds
from ._multipliers import multipliers as multipliers
from ._plane import plane as plane
from ._regions import regions as regions
from ._relative_motion import relative_motion as relative_motion
from ._section import section as section
from ._shares import shares as shares
from ._sticking import sticking_region as sticking_region
from ._torus import torus as torus
from ._trajectories import phase_portrait as phase_portrait, time_series as time_series
