"""One table of all public names, made from the pages of the reference when the pages are built."""

import re
from pathlib import Path

REFERENCE = Path(__file__).parent.parent / "reference"
_HEAD = """All names
=========

Every public name with one line. The pages below explain each.
"""


def setup(app):
    app.connect("builder-inited", _write_table)


def _write_table(app):
    """Write `names.rst`: for each page of the reference its title and its names, without pages of their own."""
    contents = re.findall(r"^api/(\w+)$", (REFERENCE / "index.md").read_text(), re.M)
    text = "\n".join([_HEAD, *(_table(REFERENCE / f"api/{page}.rst") for page in contents)])
    (REFERENCE / "names.rst").write_text(text)


def _table(page: Path) -> str:
    """Names of a page, module by module; constants have their descriptions on the page itself."""
    lines = page.read_text().splitlines()
    module, rows, data = "", [], []
    for line in lines:
        if match := re.fullmatch(r"\.\. currentmodule:: (\S+)", line):
            module = match[1]
        elif match := re.fullmatch(r"   (\w+)", line):
            rows.append(f"   ~{module}.{match[1]}")
        elif match := re.fullmatch(r"\.\. py:data:: (\w+)", line):
            data.append(f":py:data:`~{module}.{match[1]}`")
    title = f":doc:`{lines[0]} <api/{page.stem}>`"
    table = [".. autosummary::", "   :nosignatures:", "", *rows, ""]
    constants = [f"Kinds of events: {', '.join(data)}.", ""] if data else []
    return "\n".join([lines[0], "-" * len(lines[0]), "", f"See {title}.", "", *table, *constants])
