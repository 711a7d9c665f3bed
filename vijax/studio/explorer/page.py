"""The page: diagram, motion at the clicked point, and the widgets that change it."""

import html
from typing import Any

import holoviews as hv
import panel as pn
import xarray as xr
from holoviews.streams import Pipe, Tap

from ..._sweep.provenance import system_of
from ..._sweep.short_names import with_paths
from ...plot._labels import swept_paths
from .diagram import chart_image, direction_near, impacts, marker, plain_label
from .film import film_of, frames_of
from .look import DARK, LIGHT, PageStyle
from .motion import PointMotion, check, motion_at, nearest_value, point_at, scalar_parameters
from .pictures import DPI, SIZE, pictures_of, words_of_multipliers

_TITLE = "vijax"
# Range of the slider to either side, relative to the number that it changes.
_REACH = 0.5


def page_of(ds: xr.Dataset, *, dark: bool) -> pn.viewable.Viewable:
    """Build the page of a sweep, see `vx.explore`."""
    pn.extension(theme="dark" if dark else "default")
    return Explorer(ds, DARK if dark else LIGHT).view()


def serve(ds: xr.Dataset, *, port: int, show: bool, dark: bool) -> None:
    """Serve the page of a sweep until Ctrl-C, a separate one for every browser."""
    check(ds)
    pn.config.raw_css = [f"body {{ background: {(DARK if dark else LIGHT).page} }}"]
    pn.serve(lambda: page_of(ds, dark=dark), port=port, show=show, title=_TITLE)


class Explorer:
    """The chosen point, its motion, and the widgets that show it.

    Attributes:
        ds: the sweep.
        place: the chosen value of each dimension.
        changes: changed parameters of the machine, by path.
    """

    def __init__(self, ds: xr.Dataset, look: PageStyle):
        ds = with_paths(ds)
        self.ds, self.look, self.swept = ds, look, swept_paths(ds["result"])
        self.drawn, self.is_fitting = self.swept[:2], False
        self.place: dict[str, Any] = {dim: ds[dim].values[ds.sizes[dim] // 2] for dim in self.swept}
        if "direction" in ds["result"].dims:
            self.place["direction"] = "up"
        self.changes: dict[str, float] = {}
        self.numbers = scalar_parameters(system_of(ds))
        self._make_widgets()
        self.film = film_of(ds.sizes["mass"], look)
        self.words, self.pictures = pn.pane.HTML(sizing_mode="stretch_width"), self._panes()
        self.legend = pn.pane.HTML(sizing_mode="stretch_width")
        self.diagram = pn.pane.HoloViews(self._diagram(), sizing_mode="stretch_width", height=420)
        self.go()

    def go(self, *_: object) -> None:
        """Simulate the chosen motion and show it, or the error message."""
        motion, trouble = None, ""
        try:
            motion = motion_at(self.ds, self.place, self.changes)
            pictures = pictures_of(motion, self.mass.value, self.look)
            frames = frames_of(motion)
        except (ValueError, RuntimeError) as error:
            trouble, pictures, frames = str(error), pictures_of(None, 0, self.look), {}
        self.words.object, self.film.frames = self._words(motion, trouble), frames
        for name, picture in pictures.items():
            self.pictures[name].object = picture

    def view(self) -> pn.viewable.Viewable:
        """Lay out the whole page."""
        chosen = pn.Row(*self.sliders, self.stop, self.mass)
        changed = pn.Row(self.parameter, self.value, self.back)
        left = pn.Column(chosen, self.diagram, self.legend, changed, self.film, width=620)
        # Two pictures per row; one in a narrow cell of a notebook.
        pictures = pn.FlexBox(*self.pictures.values(), max_width=round(2.2 * DPI * SIZE[0]))
        right = pn.Column(self.words, pictures, sizing_mode="stretch_width")
        styles = {"background": self.look.page, "color": self.look.ink, "padding": "10px"}
        return pn.Row(left, right, styles=styles, sizing_mode="stretch_width")

    def _make_widgets(self) -> None:
        """Create sliders of the dimensions not in the diagram, and widgets of stop, mass and changed parameter."""
        self.sliders: list[pn.widgets.Widget] = [
            pn.widgets.DiscreteSlider(
                name=plain_label(dim), options=self.ds[dim].values.tolist(), value=float(self.place[dim])
            )
            for dim in self.swept[2:]
        ]
        if "direction" in self.place and len(self.drawn) == 2:
            self.sliders.append(pn.widgets.Select(name="direction", options=["up", "down"]))
        for dim, slider in zip([*self.swept[2:], "direction"], self.sliders, strict=False):
            slider.param.watch(
                lambda event, dim=dim: self._choose({dim: event.new}, redraw=True),
                "value_throttled" if dim != "direction" else "value",
            )
        stops, masses = range(self.ds.sizes["stop"]), range(self.ds.sizes["mass"])
        self.stop = pn.widgets.Select(
            name="stop", options=list(stops), width=80, visible=len(self.drawn) == 1
        )
        self.mass = pn.widgets.Select(name="mass", options=list(masses), width=80)
        self.stop.param.watch(lambda _: self._redraw(), "value")
        self.mass.param.watch(self.go, "value")
        self.parameter = pn.widgets.Select(name="change", options=list(self.numbers), width=200)
        self.value = pn.widgets.EditableFloatSlider(name="to", width=300)
        self.back = pn.widgets.Button(name="back", align="end", width=60)
        self.parameter.param.watch(lambda _: self._fit_slider(), "value")
        self.value.param.watch(self._change, "value_throttled")
        self.back.on_click(lambda _: self._choose({}))
        self._fit_slider()

    def _choose(self, place: dict[str, Any], *, redraw: bool = False) -> None:
        """Go to another point, with its parameters in the sweep."""
        self.place |= place
        self.changes = {}
        self._fit_slider()
        if redraw:
            self._redraw()
        self.marker.send(self._chosen())
        self.go()

    def _fit_slider(self) -> None:
        """Set the slider to the current value of the parameter."""
        path = self.parameter.value
        numbers = scalar_parameters(system_of(point_at(self.ds, self.place)))
        here = self.changes.get(path, numbers[path])
        reach = _REACH * abs(here) or 1.0
        low, high = here - reach, here + reach
        if path.endswith("restitution"):
            low, high = 0.0, 1.0
        self.is_fitting = True
        self.value.param.update(start=low, end=high, step=(high - low) / 200, value=here)
        self.is_fitting = False

    def _change(self, event: Any) -> None:
        """Simulate the motion with another value of the parameter."""
        if self.is_fitting:
            return
        self.changes = self.changes | {self.parameter.value: float(event.new)}
        self.go()

    def _diagram(self) -> Any:
        """The diagram with the marker of the chosen point and the listener of clicks."""
        ds = self.ds
        for dim in self.swept[2:]:
            ds = nearest_value(ds, dim, self.place[dim])
        if len(self.drawn) == 1:
            drawn = impacts(ds, self.drawn[0], self.stop.value, self.look)
        else:
            ds = ds.sel(direction=self.place["direction"]) if "direction" in self.place else ds
            right, up = self.drawn
            drawn, colors = chart_image(ds, right, up, self.look)
            self.legend.object = _legend(colors, self.look)
        self.marker = Pipe(data=self._chosen())
        marked = hv.DynamicMap(lambda data: marker(data[0], data[1], self.look), streams=[self.marker])
        self.tap = Tap(source=marked, x=None, y=None)
        self.tap.add_subscriber(self._click)
        style = {
            "bgcolor": self.look.page,
            "responsive": True,
            "height": 420,
            "show_grid": False,
            "active_tools": [],
        }
        return (drawn * marked).opts(hv.opts.Overlay(**style, hooks=[self._colour_axes]))

    def _redraw(self) -> None:
        self.diagram.object = self._diagram()

    def _chosen(self) -> tuple[float, float | None]:
        x, *rest = (float(self.place[dim]) for dim in self.drawn)
        return x, rest[0] if rest else None

    def _click(self, x: float | None, y: float | None) -> None:
        if x is None or y is None:
            return
        place: dict[str, Any] = {}
        for dim, value in zip(self.drawn, (x, y), strict=False):
            place[dim] = nearest_value(self.ds, dim, value)[dim].values
        if "direction" in self.place and len(self.drawn) == 1:
            place["direction"] = direction_near(self.ds, self.drawn[0], self.stop.value, {"x": x, "y": y})
        self._choose(place)

    def _colour_axes(self, plot: Any, element: Any) -> None:
        """Set the colours of border and axes of the diagram to those of the page."""
        del element
        own, ink = plot.state, self.look.ink
        own.border_fill_color, own.outline_line_color = self.look.page, self.look.faint
        for axis in own.axis:
            axis.update(axis_label_text_color=ink, major_label_text_color=ink, axis_line_color=ink,
                major_tick_line_color=ink, minor_tick_line_color=None)  # fmt: skip

    def _panes(self) -> dict[str, pn.pane.Matplotlib]:
        return {
            name: pn.pane.Matplotlib(picture, dpi=DPI, tight=False, width=round(DPI * SIZE[0]))
            for name, picture in pictures_of(None, 0, self.look).items()
        }

    def _words(self, motion: PointMotion | None, trouble: str) -> str:
        """Table of the point, its kind of motion and multipliers, as HTML."""
        shown = {plain_label(dim): f"{self.place[dim]:.6g}" for dim in self.swept}
        shown |= {"direction": str(self.place["direction"])} if "direction" in self.place else {}
        shown |= {f"changed: {path}": f"{value:.6g}" for path, value in self.changes.items()}
        if motion is not None:
            shown |= {"Motion": motion.words, "Multipliers": words_of_multipliers(motion)}
        rows = [f"<tr><td style='padding-right: 1em; color: {self.look.faint}'>{html.escape(name)}</td>"
                f"<td><b>{html.escape(words)}</b></td></tr>" for name, words in shown.items()]  # fmt: skip
        alarm = (
            f"<p class='trouble' style='color: {self.look.chosen}'>{html.escape(trouble)}</p>"
            if trouble
            else ""
        )
        return f"<div class='found' style='color: {self.look.ink}; font-size: 14px'><table>{''.join(rows)}</table>{alarm}</div>"


def _legend(colors: dict[str, str], look: PageStyle) -> str:
    """Legend of coloured squares with words, as HTML."""
    square = "display: inline-block; width: 0.9em; height: 0.9em; border: 1px solid"
    entries = [f"<span style='margin-right: 1em; white-space: nowrap'><span style='{square} {look.faint}; "
               f"background: {color}'></span> {html.escape(words)}</span>" for words, color in colors.items()]  # fmt: skip
    return f"<div style='color: {look.ink}'>impacts at each stop in forcing periods: {''.join(entries)}</div>"
