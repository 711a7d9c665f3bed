"""Release data that are written twice agree: versions, and bounds of dependencies."""

import re
import tomllib

from documents import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = (ROOT / "conda/recipe.yaml").read_text()


def test_the_version_is_the_same_everywhere():
    citation = (ROOT / "CITATION.cff").read_text()
    newest = re.search(r"^## (\S+) \((.*)\)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest.groups() == tuple(
        re.search(rf"^{field}: (.*)$", citation, re.M)[1] for field in ("version", "date-released")
    )
    assert {newest[1], re.search(r'^  version: "(.*)"$', RECIPE, re.M)[1]} == {PROJECT["version"]}


def test_the_conda_recipe_asks_for_what_the_project_asks_for():
    run = RECIPE.partition("\n  run:\n")[2].partition("\n\n")[0]
    asked = dict(re.findall(r"^    - (\S+) >=(\S+)$", run, re.M))
    asked["matplotlib"] = asked.pop("matplotlib-base")  # conda's name for it without a GUI
    needed = dict(re.fullmatch(r"([\w-]+)>=(\S+)", line).groups() for line in PROJECT["dependencies"])
    assert asked == needed | {"python": PROJECT["requires-python"].removeprefix(">=")}
    assert len(run.splitlines()) == len(asked)


def test_the_conda_recipe_has_the_same_commands():
    entry_points = re.findall(r"^      - (\S+) = (\S+)$", RECIPE, re.M)
    assert dict(entry_points) == PROJECT["scripts"]
