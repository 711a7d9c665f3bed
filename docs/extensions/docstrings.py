"""Docstrings as they are read in an editor, turned into what Sphinx reads; names of the library in pages, as links.

Docstrings hold fenced code and single backticks, as Markdown has them. Fences become code blocks; what stands in backticks
becomes a link where it names something of the library, or of one of those whose pages are linked, and code elsewhere.
"""

import re

import equinox as eqx
import numpy as np
import xarray as xr
from matplotlib.axes import Axes

import vijax

_FENCE = re.compile(r"^(\s*)```(\w*)$")
_CODE = re.compile(r"`([^`]+)`")
_LETTER = re.compile(r"(: \w)\.$")
_ABBREVIATED = {"vx": "vijax", "np": "numpy", "xr": "xarray", "plt": "matplotlib.pyplot"}
_LINKED = ("diffrax", "equinox", "jax", "matplotlib", "numpy", "xarray")
# What functions may return, by the name under which it is documented.
_RETURNED = {xr.Dataset: "xarray.Dataset", Axes: "matplotlib.axes.Axes", np.ndarray: "numpy.ndarray"}
_RETURNED |= {
    getattr(vijax, name): f"vijax.{name}" for name in vijax.__all__ if isinstance(getattr(vijax, name), type)
}


def setup(app):
    app.connect("autodoc-process-docstring", _process, priority=100)  # before napoleon
    app.connect("autodoc-process-signature", _tell_returned)
    app.connect("source-read", _link_names)


def _process(app, what, name, obj, options, lines):
    lines[:] = translated(lines)
    if what == "class" and issubclass(obj, eqx.Enumeration):
        for member in obj._name_to_item:
            told = obj[getattr(obj, member)].removeprefix(f"{member}: ")
            lines += ["", f".. py:attribute:: {member}", "", f"   {translated([told])[0]}"]


def _tell_returned(app, what, name, obj, options, signature, returned):
    annotation = getattr(obj, "__annotations__", {}).get("return")
    return signature, _RETURNED.get(annotation) if isinstance(annotation, type) else None


def translated(lines: list[str]) -> list[str]:
    """The lines of a docstring as reStructuredText, but for the sections that napoleon knows."""
    # Napoleon would take what stands before a colon for the type of what is returned.
    text = re.sub(r"^Returns:\n {4}(?=\S)", ":returns: ", "\n".join(lines), flags=re.M)
    found, fence = [], None
    for line in text.split("\n"):
        if match := _FENCE.match(line):
            opens = fence is None
            fence = match[1] if opens else None
            found += [f"{match[1]}.. code-block:: {match[2]}", ""] if opens else [""]
        elif fence is not None:
            found.append(f"    {line}" if line.strip() else "")
        else:
            # Bars would be substitutions, and a letter with a full stop behind an argument the beginning of a list.
            found.append(_LETTER.sub(r"\1\\.", _CODE.sub(_link, line.replace("|", r"\|"))))
    return found


def _link(match: re.Match) -> str:
    text = match[1].replace(" . ", " · ")  # a full stop and a blank would end the summary of a docstring
    target = _target(text)
    return f":py:obj:`{text} <{target}>`" if target else f"``{text}``"


def _target(text: str) -> str | None:
    """What a piece of code names or calls: something of the library, or of one whose pages are linked."""
    first, _, rest = text.partition("(")[0].partition(".")
    target = f"{_ABBREVIATED.get(first, first)}.{rest}"
    known = target.startswith("vijax.") and _is_public(target)
    return target if known or re.fullmatch(rf"({'|'.join(_LINKED)})(\.\w+)+", target) else None


def _link_names(app, docname, source):
    """Link what pages in Markdown name of the library; code blocks stay as they are."""
    if str(app.env.doc2path(docname)).endswith(".md"):
        blocks = re.split(r"(^```.*?^```$)", source[0], flags=re.M | re.S)
        blocks[::2] = [re.sub(r"(?<!`)`(vx\.[^`<>]+)`(?!`)", _role, block) for block in blocks[::2]]
        source[0] = "".join(blocks)


def _role(match: re.Match) -> str:
    target = _target(match[1])
    return f"{{py:obj}}`{match[1]} <{target}>`" if target else match[0]


def _is_public(path: str) -> bool:
    found = vijax
    for name in path.split(".")[1:]:
        if not hasattr(found, name):
            return False
        found = getattr(found, name)
    return True
