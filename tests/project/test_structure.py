"""A file imports only from folders above its own."""

import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "vijax"
ORDER = (
    "_writing _signatures _jax _calls _lanes _series _written_numbers _descriptions _printing _progress _dataset_attributes _dataset_checks _system models _machine _hybrid _flow _trajectory "
    "_execution _sweep _sections _orbits _attractors _charts _branches _manifolds _tori _precompile plot studio __main__ __init__"
).split()
FILES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))


def imports_of(file: Path) -> set[Path]:
    """Files and folders of the package that a file imports at its own import."""
    found = set()
    for dots, target in re.findall(r"^from (\.+)([\w.]*) import", (PACKAGE / file).read_text(), re.M):
        place = Path(*file.parts[: len(file.parts) - len(dots)], *filter(None, target.split(".")))
        found.add(next((path for path in FILES if path.with_suffix("") == place), place))
    return found


def rank(path: Path) -> int:
    return ORDER.index(path.with_suffix("").parts[0])


def test_every_part_has_its_place():
    assert {path.with_suffix("").parts[0] for path in FILES} == set(ORDER)


@pytest.mark.parametrize("file", FILES, ids=str)
def test_a_file_imports_from_its_folder_and_from_above(file):
    outside = [path for path in imports_of(file) if path.parts and path.parts[0] != file.parts[0]]
    assert [str(path) for path in outside if rank(path) >= rank(file)] == []


def test_there_is_no_circle():
    waiting = {file: {path for path in imports_of(file) if path in FILES and path != file} for file in FILES}
    while free := {file for file, needs in waiting.items() if not needs & waiting.keys()}:
        waiting = {file: needs for file, needs in waiting.items() if file not in free}
    assert sorted(map(str, waiting)) == []


FOLDERS = sorted({file.parent for file in FILES if len(file.parts) > 1})


@pytest.mark.parametrize("folder", FOLDERS, ids=str)
def test_the_readme_of_a_folder_names_its_files(folder):
    readme = (PACKAGE / folder.parts[0] / "README.md").read_text()
    names = {file.name for file in FILES if file.parent == folder} - {"__init__.py"}
    assert sorted(name for name in names if f"{name}`" not in readme) == []
