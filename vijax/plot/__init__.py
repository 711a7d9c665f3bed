"""Pictures of machines, sweeps, trajectories and periodic orbits, drawn by matplotlib.

Every function draws into the given axes, or into new ones, and returns them. Masses, stops and contacts are counted
from 0, as in the machine. Labels show the units given by `units=`, otherwise none. Colours are those of the current
matplotlib style; lightness, line styles, markers or words repeat their information, for greyscale prints.
"""

from importlib import import_module as _import_module

from .._calls import with_explained_errors as _with_explained_errors
from .._signatures import with_short_signature as _with_short_signature

# Each is imported when it is first used; `__init__.pyi` lists them for type checkers. Drawings and films of machines stand in
# `studio/`, which imports from this folder: lazy_loader attaches the names of a package's own modules alone.
_PLACES = {
    "animate": "studio.drawing.animate",
    "basins": "plot._basins",
    "bifurcation": "plot._bifurcation",
    "branch": "plot._branch",
    "curves": "plot._curves",
    "erosion": "plot._erosion",
    "hysteresis_loop": "plot._hysteresis_loop",
    "impact_map": "plot._impact_map",
    "inset": "plot._inset",
    "lyapunov": "plot._lyapunov",
    "machine": "studio.drawing.machine",
    "manifolds": "plot._manifolds",
    "multipliers": "plot._multipliers",
    "phase_portrait": "plot._trajectories",
    "plane": "plot._plane",
    "regions": "plot._regions",
    "relative_motion": "plot._relative_motion",
    "section": "plot._section",
    "shares": "plot._shares",
    "sticking_region": "plot._sticking",
    "time_series": "plot._trajectories",
    "torus": "plot._torus",
}
__all__ = [*_PLACES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name not in _PLACES:
        raise AttributeError(f"No vijax.plot attribute {name}")
    found = getattr(_import_module(f"vijax.{_PLACES[name]}"), name)
    globals()[name] = found = _with_explained_errors(_with_short_signature(found), __name__)
    return found


def __dir__() -> list[str]:
    return __all__
