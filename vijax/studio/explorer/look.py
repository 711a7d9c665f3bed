"""Colours and matplotlib styles of the page, light and dark."""

from contextlib import AbstractContextManager
from typing import NamedTuple

import matplotlib.pyplot as plt

# Font of the page, that of matplotlib's pictures, or the one from which it was drawn.
FONT = "'DejaVu Sans', 'Bitstream Vera Sans', Verdana, sans-serif"


class PageStyle(NamedTuple):
    """Colours of the page and its pictures.

    Attributes:
        is_dark: whether the page is light on dark.
        page: background.
        ink: lines and words.
        faint: secondary lines and words.
        up: points of a sweep up.
        down: points of a sweep down, or without directions; held masses.
        chosen: the shown point.
    """

    is_dark: bool
    page: str
    ink: str
    faint: str
    up: str
    down: str
    chosen: str

    def style(self) -> AbstractContextManager:
        """Context of the matplotlib style of the pictures."""
        colors = {f"{part}.facecolor": self.page for part in ("figure", "axes", "savefig")}
        own = {"font.size": 9.0, "legend.fontsize": 8.0} | colors
        return plt.style.context(["dark_background", own] if self.is_dark else ["default", own])


LIGHT = PageStyle(False, "#ffffff", "#1a1a1a", "#8a8a8a", "#10264f", "#f59b42", "#d62728")
DARK = PageStyle(True, "#181818", "#e6e6e6", "#8a8a8a", "#bcd4ff", "#d9731a", "#ff6b6b")
