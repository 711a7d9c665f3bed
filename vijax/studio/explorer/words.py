"""Words about the shown motion: a table by name, in HTML too."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

from ..._branches.branch import Branch
from .diagram import plain_label
from .look import PageStyle
from .motion import PointMotion
from .pictures import words_of_multipliers


def words_about(
    place: Mapping[str, Any],
    changes: Mapping[str, float],
    motion: PointMotion | None,
    branches: Sequence[Branch],
) -> dict[str, str]:
    """Words about the point, its kind of motion and multipliers, and the branches, by name."""
    shown = {
        plain_label(name): value if isinstance(value, str) else f"{value:.6g}"
        for name, value in place.items()
    }
    shown |= {f"changed: {path}": f"{value:.6g}" for path, value in changes.items()}
    if motion is not None:
        shown |= {"Motion": motion.words, "Multipliers": words_of_multipliers(motion)}
    for k, branch in enumerate(branches):
        points = ", ".join(f"{point.kind} {point.value:.6g}" for point in branch.bifurcations)
        name = "Branch" if len(branches) == 1 else f"Branch {k}"
        shown[name] = f"{len(branch)} orbits; {points or 'no bifurcation'}; ends {', '.join(branch.ends)}"
    return shown


def table_of(words: Mapping[str, str], notes: Mapping[str, str], look: PageStyle) -> str:
    """Table as HTML, below it notes by their class."""
    rows = [f"<tr><td style='padding-right: 1em; white-space: nowrap; color: {look.faint}'>{html.escape(name)}</td>"
            f"<td><b>{html.escape(text)}</b></td></tr>" for name, text in words.items()]  # fmt: skip
    alarm = "".join(
        f"<p class='{kind}' style='color: {look.chosen}'>{html.escape(note)}</p>"
        for kind, note in notes.items()
        if note
    )
    return f"<div class='found' style='color: {look.ink}; font-size: 14px'><table>{''.join(rows)}</table>{alarm}</div>"
