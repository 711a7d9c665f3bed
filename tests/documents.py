"""The Python code of the README and of the pages, for whoever runs or checks it.

`python tests/documents.py FOLDER` writes that of each into a file of its own.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def pages() -> list[str]:
    """The pages that are written, in the folders of `docs/` and beside them; not those that building them adds."""
    folders = (ROOT / "docs" / name for name in ("", "tutorials", "how_to", "explanation", "reference"))
    files = (file for folder in folders for file in sorted(folder.glob("*.md")))
    return [str(file.relative_to(ROOT)) for file in files if file.name != "gallery.md"]


def documents() -> list[str]:
    """The README and the pages that hold Python code."""
    return [document for document in ("README.md", *pages()) if python_of(document)]


def python_of(document: str) -> str:
    """The Python blocks of a document, one after the other."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", (ROOT / document).read_text(), re.M | re.S))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for document in documents():
        name = document.removesuffix(".md").replace("/", "_")
        (folder / f"{name}.py").write_text(python_of(document))
