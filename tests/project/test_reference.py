"""The pages of the reference list every public name, and no other."""

import re

from documents import ROOT
from test_public_names import imported

import vijax as vx

PAGES = sorted((ROOT / "docs/reference/api").glob("*.rst"))


def listed() -> list[str]:
    """Names on all pages, in tables and alone, and the modules that contain them."""
    names = []
    for page in PAGES:
        module = ""
        for line in page.read_text().splitlines():
            if match := re.fullmatch(r"\.\. (currentmodule|automodule):: (\S+)", line):
                module = match[2]
                names += [module] * (match[1] == "automodule")
            elif match := re.fullmatch(r"   (\w+)|\.\. py:data:: (\w+)", line):
                names.append(f"{module}.{match[1] or match[2]}")
    return names


def public() -> list[str]:
    return [f"{part.__name__}.{name}" for part in (vx, vx.models, vx.plot) for name in imported(part)]


def test_the_reference_has_every_public_name_once():
    assert sorted(listed()) == sorted(public())


def test_every_page_of_the_reference_is_in_its_contents():
    contents = (ROOT / "docs/reference/index.md").read_text()
    assert sorted(re.findall(r"^api/(\w+)$", contents, re.M)) == [page.stem for page in PAGES]
