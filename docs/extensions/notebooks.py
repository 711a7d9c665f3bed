"""The notebooks as pages, and their pictures as a gallery.

Sphinx reads what is in its own folder, so the notebooks are copied there. They are stored with their outputs, which
`.ci/run` makes anew: nothing is run to build the pages, and no picture is kept a second time. For the gallery the scripts
of sphinx-gallery were rejected: they would take minutes to run, beside notebooks that already draw the same.
"""

import base64
import json
import re
import shutil
from pathlib import Path

HERE = Path(__file__).parent.parent
NOTEBOOKS = HERE.parent / "notebooks"
_CARD = """
:::{{grid-item-card}} {title}
:img-top: {picture}
:img-alt: {title}
:link: notebooks/{name}.html#{place}

{drawn_by}
:::
"""


def setup(app):
    app.connect("builder-inited", _write_pages)
    app.connect("source-read", _turn_links)


def _write_pages(app):
    """Copy the notebooks, each picture's cell named so that the gallery can link to it."""
    pages, pictures = HERE / "notebooks", HERE / "gallery"
    for folder in (pages, pictures):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    gallery = ["# Gallery", "", "Every picture leads to the code that draws it."]
    titles = []
    for file in sorted(NOTEBOOKS.glob("*.ipynb")):
        notebook = json.loads(file.read_text())
        title, cards = _cards(notebook, file.stem, pictures)
        (pages / file.name).write_text(json.dumps(notebook))
        gallery += ["", f"## [{title}](notebooks/{file.name})", "", "::::{grid} 1 2 3 3", *cards, "::::"]
        titles.append(file.stem)
    (HERE / "gallery.md").write_text("\n".join(gallery) + "\n")
    contents = ["```{toctree}", *titles, "```"]
    introduction = (
        "# Notebooks\n\nOne idea each, with an exact answer beside what is computed wherever there is one.\n"
    )
    (pages / "index.md").write_text("\n".join([introduction, *contents]) + "\n")


def _cards(notebook: dict, name: str, pictures: Path) -> tuple[str, list[str]]:
    """The title of a notebook and a card for each of its pictures; a target is put above the cells that draw them."""
    title, heading, cards, cells = "", "", [], []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        for level, words in re.findall(r"^(#+) (?:\d+\. )?(.*)$", source, re.M):
            if cell["cell_type"] == "markdown":
                title, heading = (words, words) if level == "#" else (title, words)
        for ending, picture in _pictures(cell):
            place = f"picture-{name}-{len(cards) + 1}".replace("_", "-")  # as Sphinx would write it
            file = pictures / f"{place}.{ending}"
            file.write_bytes(base64.b64decode(picture))
            cells.append({"cell_type": "markdown", "id": place, "metadata": {}, "source": f"({place})="})
            functions = dict.fromkeys(re.findall(r"vx\.plot\.(\w+)\(", source))
            drawn_by = ", ".join(f"{{py:func}}`plot.{f} <vijax.plot.{f}>`" for f in functions) or "matplotlib"
            cards.append(
                _CARD.format(
                    title=heading, picture=f"gallery/{file.name}", name=name, place=place, drawn_by=drawn_by
                )
            )
        cells.append(cell)
    notebook["cells"] = cells
    return title, cards


def _pictures(cell: dict) -> list[tuple[str, str]]:
    """What a cell shows as a picture or a film: the ending of its file, and what is in it."""
    shown = (output.get("data", {}) for output in cell.get("outputs", []))
    return [
        (ending, data[kind])
        for data in shown
        for ending in ("png", "gif")
        if (kind := f"image/{ending}") in data
    ]


def _turn_links(app, name, source):
    """Links to the notebooks, as they lead in the repository, to their copies."""
    source[0] = source[0].replace("../notebooks/", "notebooks/")
