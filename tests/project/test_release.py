"""Release data that are written twice agree: versions, bounds of dependencies, data of the archive."""

import json
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


def test_the_archive_says_what_the_citation_says():
    """Zenodo takes `.zenodo.json`, GitHub `CITATION.cff`."""
    archive, citation = json.loads((ROOT / ".zenodo.json").read_text()), (ROOT / "CITATION.cff").read_text()
    fields = {
        name: re.search(rf"^{name}: (.*)$", citation, re.M)[1].strip('"') for name in ("title", "license")
    }
    assert fields == {name: archive[name] for name in fields}
    assert re.search(r"^keywords: \[(.*)\]$", citation, re.M)[1].split(", ") == archive["keywords"]
    assert (
        " ".join(re.search(r"^abstract: >-\n((?:  .*\n)+)", citation, re.M)[1].split())
        == archive["description"]
    )
    assert [one["name"] for one in archive["creators"]] == re.findall(r"^  - name: (.*)$", citation, re.M)
    assert [one["identifier"] for one in archive["related_identifiers"]] == re.findall(
        r"doi: (.*)$", citation, re.M
    )
    assert archive["license"] == PROJECT["license"]


def test_codemeta_says_what_the_citation_and_the_project_say():
    """Archives and indexes of software read `codemeta.json`: terms of CodeMeta 3.0, https://w3id.org/codemeta/3.0."""
    meta, citation = json.loads((ROOT / "codemeta.json").read_text()), (ROOT / "CITATION.cff").read_text()
    archive = json.loads((ROOT / ".zenodo.json").read_text())
    assert meta["@context"] == "https://w3id.org/codemeta/3.0"
    assert meta["type"] == "SoftwareSourceCode"
    same = {"name": "title", "version": "version", "datePublished": "date-released"}
    assert {meta[name] for name in same} == {
        re.search(rf"^{field}: (.*)$", citation, re.M)[1].strip('"') for field in same.values()
    }
    assert meta["license"] == f"https://spdx.org/licenses/{PROJECT['license']}"
    assert [meta["description"], meta["keywords"]] == [archive["description"], archive["keywords"]]
    assert [one["name"] for one in meta["author"]] == [one["name"] for one in archive["creators"]]
    assert [one["identifier"].removeprefix("https://doi.org/") for one in meta["citation"]] == re.findall(
        r"doi: (.*)$", citation, re.M
    )
    assert meta["citation"][0]["name"] in citation
    assert meta["runtimePlatform"] == f"Python {PROJECT['requires-python'].removeprefix('>=')} or later"
    assert meta["softwareRequirements"] == PROJECT["dependencies"]


def test_the_paper_has_the_sections_and_the_length_that_the_journal_asks_for():
    """Of the Journal of Open Source Software: 750 to 1750 words, without references."""
    text = (ROOT / "paper.md").read_text().split("---\n", 2)[2]
    sections = re.findall(r"^# (.*)$", text, re.M)
    assert sections[:5] == [
        "Summary",
        "Statement of need",
        "State of the field",
        "Software design",
        "Research impact statement",
    ]
    assert "AI usage disclosure" in sections
    assert 750 <= len(text.split()) <= 1750
    cited, known = (
        set(re.findall(r"@(\w+)", text)),
        set(re.findall(r"@\w+\{(\w+),", (ROOT / "paper.bib").read_text())),
    )
    assert cited <= known
