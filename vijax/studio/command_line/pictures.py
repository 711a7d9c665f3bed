"""Pictures of commands: drawn without a window, and written to a file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from .datasets import check_folder


def check_picture(file: Path) -> None:
    """Raise if a picture cannot be written to a file, before anything is computed."""
    if file.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ValueError(f"Pictures end in .png, .svg or .pdf, but this is {str(file)!r}.")
    check_folder(file)


def draw_to(file: Path, draw: Callable[[], Any], *, style: str = "default", dpi: float = 150.0) -> None:
    """Write what a function draws in the current figure."""
    import matplotlib as mpl  # imported only for pictures, and used without a window

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    try:
        with plt.style.context(style):
            draw()
            plt.savefig(file, dpi=dpi, bbox_inches="tight")
    finally:
        plt.close("all")
