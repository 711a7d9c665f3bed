"""Pictures of the pages: runs the code of every page that shows one, and keeps what it draws in docs/pictures.

`python scripts/page_pictures.py [PAGES]`, for example `docs/tutorials/sweeps.md`; all pages if none is named.
"""

import os
import shutil
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests"))

from documents import (  # noqa: E402  # pyright: ignore[reportMissingImports]
    documents,
    pictures_of,
    python_of,
)


def draw(document: str) -> list[str]:
    """Run the code of a page in an empty folder and copy the pictures that the page shows."""
    names = pictures_of(document)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        exec(compile(python_of(document), document, "exec"), {"__name__": "__main__"})
        for name in names:
            shutil.copyfile(name, ROOT / "docs/pictures" / name)
        os.chdir(ROOT)
    plt.close("all")
    return names


if __name__ == "__main__":
    mpl.use("Agg")
    chosen = sys.argv[1:] or [document for document in documents() if pictures_of(document)]
    for document in chosen:
        print(document, *draw(document))
