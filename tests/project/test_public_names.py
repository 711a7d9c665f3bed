"""The names of `vijax`: all exist, and those that are slow to import are loaded on first use."""

import ast
import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest
from documents import ROOT

import vijax as vx


def in_a_new_process(program: str, **where) -> str:
    """Output of a program in a new process with the library on its path."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        **({"cwd": ROOT} | where),
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


PUBLIC = {
    "vijax": """
        Bifurcation Branch CLOSE CompliantContact CompliantStop Contact DiffraxFlow EventLog
        ExecutionSettings Friction GrazingForm Harmonic IMPACT OPEN SLIP TURN ImpactSystem Interrupted ModalFlow NormalForm ORBIT_RESULTS PeriodicOrbit RELEASE RESULTS STICK
        SimulationError Solution StickingRegion Stop Symmetry TaylorFlow attractors base_excitation basins
        bifurcation_curve bifurcation_value branches chain chart classify combine continuation critical_shock
        edge_state ensemble explore find_periodic_orbits follow_attractors follow_torus homoclinic_tangencies impact_configurations impact_map impacts integrity
        keep_compiled level_crossings load lyapunov_exponents manifolds modal_restitution_matrix models monodromy_matrix
        next_crossing next_impact nonsmooth_modes peak_height Peak periodic_orbit periodic_orbits plot power_spectrum Precompilation precompile random_load
        restitution_matrix saltation_matrix save sensitivity simulate sticking_region stroboscopic_map
        stroboscopic_section sweep switch_branch system_of
        Parametric Tabulated Waveform tipping_probability uncertainty_exponent with_states
    """,
    "vijax.plot": """
        animate basins bifurcation branch curves erosion impact_map inset lyapunov machine manifolds multipliers
        phase_portrait plane regions relative_motion section shares sticking_region time_series torus
    """,
    "vijax.models": """
        CubicSpring FrictionLoss PendulumWeight ball_between_walls ball_on_table bead_column bouncing_ball
        cantilever capsule_robot drill_bit drop_hammer duffing_oscillator friction_damped_pair friction_oscillator gear_mesh
        gear_pair impact_damper impact_oscillator impact_pair impacting_pendulum multi_piston percussive_drill
        pounding_buildings shaken_oscillator soft_impact_oscillator two_sided_oscillator unbalanced_rotor
        uniform_chain vibro_impact_harvester wagg_bishop_a wagg_bishop_b woodpecker
    """,
}
PARTS = pytest.mark.parametrize("part", [vx, vx.plot, vx.models], ids=lambda part: part.__name__)


def imported(part) -> set[str]:
    """The names that a part of the library imports for users: its stub does, where it has one."""
    own = Path(part.__file__)
    stub = own.with_suffix(".pyi")
    lines = ast.walk(ast.parse((stub if stub.exists() else own).read_text()))
    return {alias.asname for line in lines if isinstance(line, ast.ImportFrom) for alias in line.names} - {
        None
    }


@pytest.mark.parametrize("part", [vx, vx.plot], ids=lambda part: part.__name__)
def test_the_names_of_a_stub_are_those_that_are_imported(part):
    assert set(part.__all__) == imported(part)


@PARTS
def test_no_public_name_is_lost(part):
    """The names that others rely on: a name goes only by the rules of CONTRIBUTING.md, and then from this list too."""
    assert set(PUBLIC[part.__name__].split()) <= imported(part) <= set(dir(part))
    assert all(getattr(part, name) is not None for name in imported(part))


def test_a_star_brings_all_of_them():
    names = {}
    exec("from vijax import *", names)
    assert names.keys() - {"__builtins__"} == set(vx.__all__)


def test_a_misspelt_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="simulat"):
        vx.simulat  # noqa: B018


@pytest.mark.thorough
def test_what_is_slow_to_import_comes_late():
    program = """
import sys, vijax  # pandas comes with xarray, of which a name stands for it until it is used
print("plot" in dir(vijax), not {"jax", "pandas", "matplotlib", "diffrax"} & set(sys.modules))
vijax.simulate, vijax.ImpactSystem, vijax.models
print(not {"pandas", "matplotlib", "diffrax"} & set(sys.modules))
vijax.sweep, vijax.DiffraxFlow, vijax.plot.bifurcation
print({"pandas", "matplotlib", "diffrax"} <= set(sys.modules))
"""
    assert in_a_new_process(program).split() == ["True"] * 4


def test_to_import_all_of_it_starts_no_backend():
    """Otherwise the number of devices, the platform or a cluster could not be chosen after `import vijax`."""
    program = """
from vijax import *
from jax._src import xla_bridge
print(xla_bridge._backends)
"""
    assert in_a_new_process(program).split() == ["{}"]


def test_the_version_is_that_of_the_package():
    assert vx.__version__ == importlib.metadata.version("vijax")


def test_a_checkout_that_is_not_installed_has_a_version(tmp_path):
    program = f"""
import importlib.metadata, sys
found = importlib.metadata.version
def version(name):
    if name == "vijax":
        raise importlib.metadata.PackageNotFoundError(name)
    return found(name)
importlib.metadata.version = version
sys.path.insert(0, {str(ROOT)!r})
import vijax
print(vijax.__version__)
"""
    assert in_a_new_process(program, cwd=tmp_path).strip() == "0+not.installed"
