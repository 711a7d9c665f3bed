"""Functions say in a sentence what they take where they are given something else, whichever of them is asked."""

import jaxtyping
import matplotlib as mpl
import numpy as np
import pytest

import vijax as vx

mpl.use("Agg")

_GRID = {"x0[0]": [0.0, 0.1], "v0[0]": [0.0, 0.1]}
_VALUES = {"forcing.frequency": np.linspace(0.7, 0.9, 3)}
_BOUNDS = {"forcing.frequency": (0.7, 0.9), "forcing.amplitude[0]": (0.5, 1.0)}
# Functions of a machine, and what follows it.
_OF_MACHINES = {
    "simulate": (0.0, 1.0),
    "sweep": (_VALUES,),
    "basins": (_GRID,),
    "attractors": (_GRID,),
    "lyapunov_exponents": (),
    "nonsmooth_modes": (1.0,),
    "stroboscopic_map": ([0.0], [0.0]),
    "monodromy_matrix": ([0.0], [0.0]),
    "next_impact": (0.0, [0.0], [0.0], 0),
    "periodic_orbit": ([0.0], [0.0]),
    "follow_attractors": ("forcing.frequency", [0.7, 0.8]),
    "chart": (_VALUES,),
    "precompile": (["simulate"],),
    "sticking_region": (0,),
}
# Functions of what others returned.
_OF_RESULTS = {
    "switch_branch": (),
    "bifurcation_curve": ("forcing.amplitude[0]", _BOUNDS),
    "bifurcation_value": (None,),
    "homoclinic_tangencies": (),
    "continuation": ("forcing.frequency", (0.7, 0.9)),
    "branches": (),
    "periodic_orbits": (),
    "classify": (),
    "impacts": (),
    "impact_map": (),
    "stroboscopic_section": (),
    "power_spectrum": (),
    "edge_state": (),
    "integrity": (),
    "uncertainty_exponent": (),
}
_WRONG = [None, 3, [1, 2]]


@pytest.fixture(autouse=True)
def _unchecked():
    """Annotations are not checked, as for users: the next test sets its own choice."""
    jaxtyping.config.update("jaxtyping_disable", True)


@pytest.mark.parametrize("name", _OF_MACHINES)
@pytest.mark.parametrize("wrong", _WRONG, ids=str)
def test_functions_of_a_machine_refuse_what_is_none(name, wrong):
    with pytest.raises(ValueError, match="must be one machine"):
        getattr(vx, name)(wrong, *_OF_MACHINES[name])


@pytest.mark.parametrize("name", _OF_RESULTS)
@pytest.mark.parametrize("wrong", _WRONG, ids=str)
def test_functions_of_results_refuse_what_is_none(name, wrong):
    with pytest.raises(ValueError, match=r"Argument `.*` must be"):
        getattr(vx, name)(wrong, *_OF_RESULTS[name])


@pytest.mark.parametrize("name", ["plane", "torus", "manifolds"])
def test_pictures_refuse_what_is_no_dataset(name):
    with pytest.raises(ValueError, match=r"Argument `.*` must be"):
        getattr(vx.plot, name)(None)
