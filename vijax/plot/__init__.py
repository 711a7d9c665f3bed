"""Pictures of machines, sweeps, trajectories and periodic orbits, drawn by matplotlib.

Every function draws into the given axes, or into new ones, and returns them. Masses, stops and contacts are counted
from 0, as in the machine. Labels show the units given by `units=`, otherwise none. Colours are those of the current
matplotlib style; lightness, line styles, markers or words repeat their information, for greyscale prints.
"""

import lazy_loader as _lazy_loader

# Functions are imported on first access; `__init__.pyi` lists them for type checkers. Drawings and films of machines
# are in `studio/`, which imports from this folder.
_PLACES = {
    "plot._basins": ["basins"],
    "plot._bifurcation": ["bifurcation"],
    "plot._branch": ["branch"],
    "plot._curves": ["curves"],
    "plot._impact_map": ["impact_map"],
    "plot._lyapunov": ["lyapunov"],
    "plot._multipliers": ["multipliers"],
    "plot._plane": ["plane"],
    "plot._regions": ["regions"],
    "plot._relative_motion": ["relative_motion"],
    "plot._section": ["section"],
    "plot._shares": ["shares"],
    "plot._sticking": ["sticking_region"],
    "plot._trajectories": ["phase_portrait", "time_series"],
    "studio.drawing.animate": ["animate"],
    "studio.drawing.machine": ["machine"],
}
__getattr__, __dir__, __all__ = _lazy_loader.attach("vijax", submod_attrs=_PLACES)
