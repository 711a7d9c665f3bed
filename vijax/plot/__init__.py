"""Pictures of machines, sweeps, trajectories and periodic orbits, drawn by matplotlib.

Every function draws into the axes it is given, or into new ones, and returns them. Masses, stops and contacts are counted
from 0, as in the machine. Units are written as `units=` gives them, and none where it does not. Colours are those of the style
of matplotlib in use; lightness, strokes, marks or words repeat what they say, for a printer without colour.
"""

import lazy_loader as _lazy_loader

# Each is imported when it is first asked for. `__init__.pyi` lists them for type checkers. Drawings and films of machines
# stand in `studio/`, which imports from this folder.
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
