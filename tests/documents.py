"""Python code of the README and of the documentation pages, to be run or checked.

`python tests/documents.py FOLDER` writes the code of each into its own file.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def pages() -> list[str]:
    """Written pages, in `docs/` and its folders; without those that the build adds."""
    folders = (ROOT / "docs" / name for name in ("", "tutorials", "how_to", "explanation", "reference"))
    files = (file for folder in folders for file in sorted(folder.glob("*.md")))
    return [str(file.relative_to(ROOT)) for file in files if file.name != "gallery.md"]


def documents() -> list[str]:
    """README and pages that contain Python code."""
    return [document for document in ("README.md", *pages()) if python_of(document)]


def python_of(document: str) -> str:
    """Python blocks of a document, joined."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", (ROOT / document).read_text(), re.M | re.S))


def pictures_of(document: str) -> list[str]:
    """Names of the pictures in `docs/pictures` that a page shows; its own code draws them."""
    return re.findall(r"\]\((?:\.\./)?pictures/([\w.]+)\)", (ROOT / document).read_text())


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for document in documents():
        name = document.removesuffix(".md").replace("/", "_")
        (folder / f"{name}.py").write_text(python_of(document))
