"""The diagram on the page: with branches, a marker of the chosen point, a legend, and a listener of clicks."""

from collections.abc import Callable
from functools import reduce
from operator import mul
from typing import Any

import holoviews as hv
import panel as pn
import xarray as xr
from holoviews.streams import Pipe, Tap

from ..._branches.branch import Branch
from ...plot._branch import label_of_kind
from ...plot._branch_lines import lines_of_branch, marks_of_branch
from .diagram import (
    IMPACTS,
    Ordinates,
    axes_in,
    branch_curves,
    branch_marks,
    chart_image,
    direction_near,
    marker,
    points_of,
    sign_of,
)
from .look import PageStyle
from .motion import nearest_value
from .widgets import legend, legend_of_points

_HEIGHT = 420

Place = dict[str, Any]


class DiagramPane:
    """The diagram of a sweep.

    Attributes:
        drawn: the dimensions along its axes, one for a line of points, two for a chart.
        pane: the pane on the page.
        legend: its legend.
    """

    def __init__(self, ds: xr.Dataset, swept: list[str], look: PageStyle, clicked: Callable[[Place], None]):
        self.ds, self.look, self.clicked = ds, look, clicked
        self.drawn, self.others = swept[:2], swept[2:]
        self.ordinates = Ordinates(IMPACTS, 0, 0)
        self.legend = pn.pane.HTML(sizing_mode="stretch_width")
        self.pane = pn.pane.HoloViews(None, sizing_mode="stretch_width", height=_HEIGHT)

    def redraw(self, place: Place, ordinates: Ordinates, branches: list[Branch]) -> None:
        """Draw all anew, at the chosen point."""
        self.ordinates = ordinates
        ds, look = self.ds, self.look
        for dim in self.others:
            ds = nearest_value(ds, dim, place[dim])
        if len(self.drawn) == 1:
            drawn = points_of(ds, self.drawn[0], ordinates, look)
            kinds: dict[str, str] = {}
            for lines, marks in self._lines(branches):
                drawn = reduce(mul, [drawn, branch_curves(lines, look), *branch_marks(marks, look)])
                kinds |= {label_of_kind(kind): sign_of(kind) for kind in marks}
            self.legend.object = legend_of_points(look, "direction" in place, bool(branches), kinds)
        else:
            ds = ds.sel(direction=place["direction"]) if "direction" in place else ds
            drawn, colors = chart_image(ds, self.drawn[0], self.drawn[1], look)
            entries = {words: ("fill", color) for words, color in colors.items()}
            self.legend.object = legend(entries, "impacts at each stop in forcing periods", look)
        self.pane.object = self._listening(drawn, place)

    def mark(self, place: Place) -> None:
        """Move the marker to a point."""
        self.marker.send(self._point(place))

    def _listening(self, drawn: Any, place: Place) -> Any:
        """The diagram with marker and listener."""
        look = self.look
        self.marker = Pipe(data=self._point(place))
        marked = hv.DynamicMap(lambda data: marker(data[0], data[1], look), streams=[self.marker])
        self.tap = Tap(source=marked, x=None, y=None)
        self.tap.add_subscriber(self._click)
        style = {
            "bgcolor": look.page,
            "responsive": True,
            "height": _HEIGHT,
            "show_grid": False,
            "active_tools": [],
        }
        return (drawn * marked).opts(hv.opts.Overlay(**style, show_legend=False, hooks=[axes_in(look)]))

    def _lines(self, branches: list[Branch]) -> list[Any]:
        """Lines and marks of the branches that have the ordinate, and an impact where it needs one."""
        own = self.ordinates
        return [
            tuple(of(branch, own.number(self.ds), own.name) for of in (lines_of_branch, marks_of_branch))
            for branch in branches
            if own.name == IMPACTS or own.name in branch.points
        ]

    def _point(self, place: Place) -> tuple[float, float | None]:
        x, *rest = (float(place[dim]) for dim in self.drawn)
        return x, rest[0] if rest else None

    def _click(self, x: float | None, y: float | None) -> None:
        if x is None or y is None:
            return
        place: Place = {
            dim: float(nearest_value(self.ds, dim, value)[dim].values)
            for dim, value in zip(self.drawn, (x, y), strict=False)
        }
        if "direction" in self.ds["result"].dims and len(self.drawn) == 1:
            place["direction"] = direction_near(self.ds, self.drawn[0], self.ordinates, {"x": x, "y": y})
        self.clicked(place)
