"""The names of `vijax`: all exist, and those that are slow to import are loaded on first use."""

import ast
import importlib.metadata
import subprocess
import sys

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


def test_the_public_names_are_those_that_are_imported():
    lines = ast.walk(ast.parse((ROOT / "vijax/__init__.pyi").read_text()))
    imported = {alias.asname for line in lines if isinstance(line, ast.ImportFrom) for alias in line.names}
    assert set(vx.__all__) == imported


def test_every_public_name_is_there_and_listed():
    assert set(vx.__all__) <= set(dir(vx))
    assert all(getattr(vx, name) is not None for name in vx.__all__)


def test_a_star_brings_all_of_them():
    names = {}
    exec("from vijax import *", names)
    assert names.keys() - {"__builtins__"} == set(vx.__all__)


def test_a_misspelt_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="simulat"):
        vx.simulat  # noqa: B018


def test_what_is_slow_to_import_comes_late():
    program = """
import sys, vijax  # pandas comes with xarray, of which a name stands for it until it is used
print("plot" in dir(vijax), not {"jax", "pandas", "matplotlib", "diffrax"} & set(sys.modules))
vijax.simulate, vijax.ImpactSystem, vijax.models
print(not {"pandas", "matplotlib", "diffrax"} & set(sys.modules))
vijax.sweep, vijax.DiffraxFlow, vijax.plot
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
