"""The record of tolerances: all are in it, each with its unit and reason."""

import ast
import re
from pathlib import Path

import pytest

import vijax
from vijax._branches import tolerances

FOLDER = Path(vijax.__file__).parent / "_branches"
RECORD = Path(tolerances.__file__)
# Densities and shares of samples, which decide nothing.
OF_SAMPLES = {"_DENSITY", "_DENSER", "_STICKS", "_AFTER", "_BEFORE", "_NODES"}
UNITS = "cycle|start|parameter|periods|multiplier|share|eps|none|chords|size of the function|speeds of the impacts that vanish"


def has_real(node: ast.expr) -> bool:
    reals = (one.value for one in ast.walk(node) if isinstance(one, ast.Constant))
    return any(isinstance(value, float) for value in reals)


def constants_of(file: Path) -> list[ast.Assign]:
    """Assignments of real numbers in the body of a module."""
    body = ast.parse(file.read_text()).body
    return [one for one in body if isinstance(one, ast.Assign) and has_real(one.value)]


@pytest.mark.parametrize("file", sorted(FOLDER.rglob("*.py")), ids=lambda file: file.stem)
def test_no_other_file_has_a_tolerance(file):
    if file == RECORD:
        return
    for one in constants_of(file):
        names = {node.id for target in one.targets for node in ast.walk(target) if isinstance(node, ast.Name)}
        words = {str(node.value) for node in ast.walk(one.value) if isinstance(node, ast.Constant)}
        is_angle = words >= {"1:1", "1:2"}
        assert is_angle or names & OF_SAMPLES, f"{names} in {file.name}"


def test_each_has_its_unit_and_reason():
    lines = RECORD.read_text().splitlines()
    for one in constants_of(RECORD):
        first = one.lineno - 2
        while lines[first - 1].startswith("# "):
            first -= 1
        assert re.match(rf"# ({UNITS})[,:]", lines[first]), lines[first]
