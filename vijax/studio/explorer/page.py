"""The page: diagram, motion at the clicked point, and what changes them."""

from collections.abc import Callable
from typing import Any
from urllib.parse import urlencode

import panel as pn
import xarray as xr
from matplotlib.figure import Figure

from ..._branches.branch import Branch
from ..._sweep.provenance import system_of
from ..._sweep.short_names import with_paths
from ...plot._labels import swept_paths
from .address import Shown, query_of, shown_by
from .code import code_of
from .diagram import IMPACTS, Ordinates, ordinates_in, plain_label
from .diagram_pane import DiagramPane
from .film import film_of, frames_of
from .look import FONT, PageStyle
from .motion import PointMotion, motion_at, nearest_value, point_at, scalar_parameters
from .orbits import bounds_of, branch_through, orbit_near
from .pictures import PICTURES, pictures_of
from .saved import archive_of
from .widgets import Changes, button, copy_button, select
from .words import table_of, words_about

# Time after which a browser has drawn that something long is under way, in milliseconds.
_MOMENT = 60
# Least width of a column of the page, and least and largest of a picture, in pixels: a wide window has several in a row.
_COLUMN, _PICTURE = 520, (300, 400)


class Explorer:
    """The chosen point, its motion, and the widgets that show it.

    Attributes:
        ds: the sweep.
        place: the chosen value of each dimension.
        motion: the shown motion, or None.
        branches: the branches over the diagram.
    """

    def __init__(self, ds: xr.Dataset, look: PageStyle, ordinate: str = IMPACTS, file: str = ""):
        ds = with_paths(ds)
        self.ds, self.look, self.file, self.swept = ds, look, file, swept_paths(ds["result"])
        self.diagram = DiagramPane(ds, self.swept, look, self._choose)
        self.motion: PointMotion | None = None
        self.branches: list[Branch] = []
        self.figures: dict[str, Figure] = {}
        numbers = scalar_parameters(system_of(ds))
        shown = self._shown_by_address([*numbers])
        middle = {dim: ds[dim].values[ds.sizes[dim] // 2] for dim in self.swept}
        self.place: dict[str, Any] = {
            dim: self._nearest(dim, shown.place.get(dim, middle[dim])) for dim in self.swept
        }
        if "direction" in ds["result"].dims:
            self.place["direction"] = shown.place.get("direction", "up")
        self._make_widgets([*numbers], {"ordinate": ordinate} | shown.chosen)
        self.film = film_of(ds.sizes["mass"], look)
        self.words = pn.pane.HTML(sizing_mode="stretch_width")
        self.pictures = self._panes()
        self._redraw()
        self.changes.reset(shown.changes)
        self.words.object = self._words("simulating ...")
        pn.state.onload(self._compute)  # the page is there before its first motion

    def view(self) -> pn.viewable.Viewable:
        """Lay out the whole page: two columns, below each other in a narrow window or cell of a notebook."""
        column = {"flex": f"1 1 {_COLUMN}px", "min-width": "300px"}
        wide: dict[str, Any] = {"sizing_mode": "stretch_width"}
        chosen = pn.FlexBox(*self.sliders, self.ordinate, self.stop, self.mass, **wide)
        actions = pn.FlexBox(*self.buttons, **wide)
        code = pn.Card(self.code, copy_button(self.code), title="code", collapsed=True, **wide)
        left = pn.Column(
            chosen,
            self.diagram.pane,
            self.diagram.legend,
            actions,
            self.changes.panel,
            self.film,
            styles=column,
            **wide,
        )
        pictures = pn.FlexBox(*self.pictures.values(), **wide)
        right = pn.Column(self.words, pictures, code, styles=column, **wide)
        styles = {
            "background": self.look.page,
            "color": self.look.ink,
            "padding": "10px",
            "font-family": FONT,
        }
        return pn.FlexBox(left, right, styles=styles, **wide)

    def _shown_by_address(self, numbers: list[str]) -> Shown:
        """State in the address of the page; none in a notebook."""
        query = pn.state.location.query_params if pn.state.location is not None else {}
        return shown_by(query, self.swept, numbers)

    def _make_widgets(self, numbers: list[str], chosen: dict[str, Any]) -> None:
        ds, is_line = self.ds, len(self.diagram.drawn) == 1
        self.sliders: list[pn.widgets.Widget] = [
            pn.widgets.DiscreteSlider(
                name=plain_label(dim, ds), options=ds[dim].values.tolist(), value=float(self.place[dim])
            )
            for dim in self.swept[2:]
        ]
        for dim, slider in zip(self.swept[2:], self.sliders, strict=True):
            slider.param.watch(
                lambda event, dim=dim: self._choose({dim: event.new}, redraw=True), "value_throttled"
            )
        if "direction" in self.place and not is_line:
            choose = lambda event: self._choose({"direction": event.new}, redraw=True)  # noqa: E731
            self.sliders.append(select("direction", ["up", "down"], self.place["direction"], choose))
        redraw = lambda _: (self._redraw(), self._tell_address())  # noqa: E731
        ordinates = ordinates_in(ds) if is_line else [IMPACTS]
        self.ordinate = select("ordinate", ordinates, chosen["ordinate"], redraw)
        stops = [*range(ds.sizes["stop"])] if is_line else [0]
        self.stop = select("stop", stops, chosen.get("stop"), redraw)
        self.mass = select(
            "mass", [*range(ds.sizes["mass"])], chosen.get("mass"), lambda _: self._choose({}, redraw=True)
        )
        self.changes = Changes(numbers, self._value_of, lambda: self._later(self._compute))
        save = pn.widgets.FileDownload(
            callback=self._archive, filename="vijax.zip", label="save all", width=130
        )
        self.buttons = [
            button("orbit here", self._find_orbit),
            button("continue from here", self._continue),
            button("back", self._go_back),
            save,
        ]
        self.buttons[1].visible = is_line
        self.code = pn.widgets.TextAreaInput(
            disabled=True, auto_grow=True, rows=8, sizing_mode="stretch_width"
        )

    def _value_of(self, path: str) -> float:
        """Value of a number of the machine at the chosen point."""
        return scalar_parameters(system_of(point_at(self.ds, self.place)))[path]

    def _nearest(self, dim: str, value: Any) -> float:
        return float(nearest_value(self.ds, dim, value)[dim].values)

    def _later(self, work: Callable[[], None], busy: str = "computing ...") -> None:
        """Do something long, once the browser has drawn that it is under way."""
        self.words.object = self._words(busy)
        document = pn.state.curdoc
        if document is None or document.session_context is None:
            work()
        else:
            document.add_timeout_callback(work, _MOMENT)

    def _compute(self) -> None:
        """Simulate the chosen motion and show it, or the error message."""
        self.motion = None
        self._show(lambda: motion_at(self.ds, self.place, self.changes.values))

    def _orbit(self) -> PointMotion:
        """The orbit near the shown motion."""
        if self.motion is None:
            raise RuntimeError("There is no motion here.")
        return orbit_near(self.motion)

    def _find_orbit(self) -> None:
        self._later(lambda: self._show(self._orbit))

    def _continue(self) -> None:
        """Follow the orbit of the shown motion, and draw the branch over the diagram."""

        def follow() -> PointMotion:
            motion = self._orbit()
            assert motion.orbit is not None
            path, name = self.diagram.drawn[0], self.ordinate.value
            column = "" if name == IMPACTS else name
            self.branches.append(branch_through(motion.orbit, path, bounds_of(self.ds, path), column))
            self._redraw()
            return motion

        self._later(
            lambda: self._show(follow), "following the branch ... the first one compiles for a minute"
        )

    def _go_back(self) -> None:
        self.branches = []
        self._choose({}, redraw=True)

    def _show(self, find: Callable[[], PointMotion]) -> None:
        """Show a motion, or why there is none."""
        trouble = ""
        try:
            self.motion = find()
        except (ValueError, RuntimeError) as error:
            trouble = str(error)
        frames = {} if self.motion is None else frames_of(self.motion)
        self.figures = pictures_of(self.motion, self.mass.value, self.look)
        self.words.object, self.film.frames = self._words(trouble=trouble), frames
        for name, picture in self.figures.items():
            self.pictures[name].object = picture
        record, transient = int(self.ds.attrs["record"]), int(self.ds.attrs["transient"])
        self.code.value = code_of(
            self.file, self.place, self.changes.values, self.mass.value, record, transient
        )
        self._tell_address()

    def _tell_address(self) -> None:
        if pn.state.location is not None:
            chosen = {"stop": self.stop.value, "mass": self.mass.value, "ordinate": self.ordinate.value}
            pn.state.location.search = "?" + urlencode(query_of(self.place, self.changes.values, chosen))

    def _choose(self, place: dict[str, Any], *, redraw: bool = False) -> None:
        """Go to another point, with its parameters in the sweep."""
        self.place |= place
        self.changes.reset({})
        if redraw:
            self._redraw()
        self.diagram.mark(self.place)
        self._later(self._compute)

    def _archive(self) -> Any:
        rows = [f"{name}: {words}" for name, words in self._rows().items()]
        return archive_of(self.motion, self.figures, self.code.value, "\n".join(rows) + "\n", self.branches)

    def _ordinates(self) -> Ordinates:
        return Ordinates(self.ordinate.value, self.stop.value, self.mass.value)

    def _redraw(self) -> None:
        self.diagram.redraw(self.place, self._ordinates(), self.branches)

    def _panes(self) -> dict[str, pn.pane.Matplotlib]:
        # All of one size, also the last one alone in its row.
        style = {"flex": f"1 1 {_PICTURE[0]}px", "max-width": f"{_PICTURE[1]}px"}
        how: dict[str, Any] = {
            "format": "svg",
            "tight": False,
            "sizing_mode": "stretch_width",
            "styles": style,
        }
        return {name: pn.pane.Matplotlib(None, **how) for name in PICTURES}

    def _rows(self) -> dict[str, str]:
        return words_about(self.place, self.changes.values, self.motion, self.branches)

    def _words(self, busy: str = "", trouble: str = "") -> str:
        """Table about the point, with a note: a computation under way, or the reason why there is no motion."""
        return table_of(self._rows(), {"trouble": trouble, "busy": busy}, self.look)
