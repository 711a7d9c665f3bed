"""Widgets of the page: choices of the drawn quantity, sliders for numbers of the machine, and buttons."""

import html
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import panel as pn

from .look import PageStyle

# Range of a slider to either side, relative to the number that it changes.
_REACH = 0.5
# Numbers whose sliders are there at first, if the machine has them.
_FIRST = ("forcing.amplitude[0]", "stops[0].restitution")


class Changes:
    """Sliders of numbers of the machine; those that have a slider are chosen by name.

    Attributes:
        values: changed numbers by path.
        panel: the widgets.
    """

    def __init__(self, paths: list[str], value_of: Callable[[str], float], changed: Callable[[], None]):
        self.values: dict[str, float] = {}
        self.value_of, self.changed, self.is_fitting = value_of, changed, False
        self.paths = pn.widgets.MultiChoice(
            name="change", options=paths, value=[path for path in _FIRST if path in paths],
            sizing_mode="stretch_width", margin=(5, 10),
        )  # fmt: skip
        self.sliders: dict[str, pn.widgets.EditableFloatSlider] = {}
        self.column = pn.FlexBox(sizing_mode="stretch_width")
        self.panel = pn.Column(self.paths, self.column, sizing_mode="stretch_width")
        self.paths.param.watch(lambda _: self.fit(), "value")

    def reset(self, values: Mapping[str, float]) -> None:
        """Take other changed numbers; their sliders are there."""
        self.values = dict(values)
        missing = [path for path in values if path not in self.paths.value]
        if missing:
            self.paths.value = [*self.paths.value, *missing]  # fits
        else:
            self.fit()

    def fit(self) -> None:
        """Make a slider for each chosen number, around its value."""
        self.is_fitting = True
        chosen = list(self.paths.value)
        for path in chosen:
            if path not in self.sliders:
                slider = pn.widgets.EditableFloatSlider(
                    name=path, sizing_mode="stretch_width", styles={"flex": "1 1 240px", "min-width": "220px"}
                )
                slider.param.watch(lambda event, path=path: self._change(path, event.new), "value_throttled")
                self.sliders[path] = slider
            here = self.values.get(path, self.value_of(path))
            reach = _REACH * abs(here) or 1.0
            low, high = (0.0, 1.0) if path.endswith("restitution") else (here - reach, here + reach)
            self.sliders[path].param.update(start=low, end=high, step=(high - low) / 200, value=here)
        self.column.objects = [self.sliders[path] for path in chosen]
        self.is_fitting = False

    def _change(self, path: str, value: float) -> None:
        if not self.is_fitting:
            self.values = self.values | {path: float(value)}
            self.changed()


def select(name: str, options: list[Any], value: Any, watcher: Callable[..., Any]) -> pn.widgets.Select:
    """A choice; invisible where there is nothing to choose."""
    one = pn.widgets.Select(
        name=name, options=options, value=value if value in options else options[0], visible=len(options) > 1,
        width=150 if name == "ordinate" else 90,
    )  # fmt: skip
    one.param.watch(watcher, "value")
    return one


def button(name: str, action: Callable[[], Any]) -> pn.widgets.Button:
    """A button; a hint of Panel's would cover what is beside it."""
    one = pn.widgets.Button(name=name)
    one.on_click(lambda _: action())
    return one


def copy_button(code: pn.widgets.TextAreaInput) -> pn.widgets.Button:
    """A button that copies the text of another widget."""
    one = pn.widgets.Button(name="copy the code")
    one.js_on_click(args={"code": code}, code="navigator.clipboard.writeText(code.value)")
    return one


def legend(entries: Mapping[str, tuple[str, str]], title: str, look: PageStyle) -> str:
    """Legend as HTML: by words a CSS border style, "fill", or "sign" for words that begin with one, and a colour."""
    parts = []
    for words, (stroke, color) in entries.items():
        look_of = (
            f"height: 0.9em; width: 0.9em; border: 1px solid {look.faint}; background: {color}"
            if stroke == "fill"
            else ""
            if stroke == "sign"
            else f"height: 0.3em; width: 2.2em; border-top: 3px {stroke} {color}"
        )
        parts.append(
            f"<span style='margin-right: 1em; white-space: nowrap'><span style='display: inline-block; {look_of}'></span> "
            f"{html.escape(words)}</span>"
        )
    head = f"{html.escape(title)}: " if title else ""
    return f"<div class='legend' style='color: {look.ink}'>{head}{' '.join(parts)}</div>"


def legend_of_points(
    look: PageStyle, has_directions: bool, has_branches: bool, marks: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Legend of a diagram over one quantity, with the signs of its marks; empty where nothing needs words."""
    entries: dict[str, tuple[str, str]] = {}
    if has_directions:
        entries = {f"swept {way}": ("dotted", color) for way, color in (("up", look.up), ("down", look.down))}
    if has_branches:
        entries |= {"branch, stable": ("solid", look.chosen), "unstable": ("dashed", look.chosen)}
    entries |= {f"{sign} {words}": ("sign", "") for words, sign in marks.items()}
    return legend(entries, "", look) if entries else ""
