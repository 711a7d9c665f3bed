"""The code in README.md and in every page of docs/ runs as it is and prints the documented output."""

import re

import jax
import matplotlib
import matplotlib.pyplot as plt
import pytest
from documents import ROOT, documents, pages, pictures_of, python_of

import vijax as vx

# Pages whose code runs before a change goes in. That of the others belongs to the long runs.
SHORT = (
    "README.md",
    "docs/index.md",
    "docs/tutorials/first_machine.md",
    "docs/tutorials/sweeps.md",
    "docs/explanation/accuracy.md",
    "docs/how_to/clusters.md",
    "docs/how_to/files.md",
    "docs/how_to/moving_stops.md",
    "docs/how_to/restitution.md",
    "docs/how_to/stop.md",
)
NUMBER = r"-?\d+\.?\d*(?:e-?\d+)?"


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A folder for files that the code writes, pictures without windows, and JAX's default rule on ranks."""
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    with jax.numpy_rank_promotion("allow"):
        yield tmp_path
    plt.close("all")


def agree(said: str, printed: str) -> bool:
    """Test whether the printed text, rounded to the documented digits, is the documented text."""
    ours, theirs = (re.findall(NUMBER, text) for text in (said, printed))
    words_agree = re.sub(rf"{NUMBER}|\s", "", said) == re.sub(rf"{NUMBER}|\s", "", printed)
    digits = [len(number.partition(".")[2]) for number in ours]
    near = [
        abs(float(a) - float(b)) <= 0.5001 * 10**-d for a, b, d in zip(ours, theirs, digits, strict=False)
    ]
    return words_agree and len(ours) == len(theirs) and all(near)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "document", [a if a in SHORT else pytest.param(a, marks=pytest.mark.slow) for a in documents()]
)
def test_the_code_of_a_document_runs_and_prints_what_it_says(document, elsewhere, capsys):
    code = python_of(document)
    said = re.findall(r"^print\(.*\)  # (.*)$", code, re.M)
    exec(compile(code, document, "exec"), {"__name__": "__main__"})
    printed = capsys.readouterr().out.splitlines()
    assert said
    assert len(said) == len(printed)
    assert [line for pair in zip(said, printed, strict=True) if not agree(*pair) for line in pair] == []
    assert [name for name in pictures_of(document) if not (elsewhere / name).exists()] == []


def test_what_is_printed_is_compared_to_its_last_digit():
    assert agree("True [1.20 -3.]", "True [ 1.2049 -3.4]")
    assert not agree("1.20", "1.206")
    assert not agree("True 1.20", "False 1.20")


def test_the_reference_names_every_result_and_what_to_do():
    page = (ROOT / "docs/reference/results.md").read_text()
    named = re.findall(r"^\| `(\w+)` \|", page, re.M)
    assert named == list(vx.RESULTS._name_to_item)


@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md", *pages()])
def test_every_link_to_a_file_leads_somewhere(document):
    # `../../actions` is the page of the runs, beside the files, on the repository's host.
    links = re.findall(r"\]\((?!https?:|\.\./\.\./actions/)([^)#]+)\)", (ROOT / document).read_text())
    assert [link for link in links if not (ROOT / document).parent.joinpath(link).exists()] == []
