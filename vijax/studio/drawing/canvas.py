"""Axes that are drawn on along and across the motion, which runs to the right, up or down in the picture.

Every part has two coordinates: along, in the direction of positive positions, and across. In a horizontal drawing
across is upwards and the masses roll on a floor. In a vertical one across is to the right, the masses are free, and
the outermost walls are floors and ceilings wider than a box.
"""

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Text
from matplotlib.transforms import Affine2D, Transform

from ...plot._colors import ink

if TYPE_CHECKING:
    Positive = Literal["right", "up", "down"]
else:  # at run time wrong words are refused in sentences
    Positive = str

# Radius of the wheels, coordinate of the floor, and thickness of a hatch.
WHEEL = 0.1
FLOOR, HATCHED = -2 * WHEEL, 0.14
# Coordinate across of the double arrows of moving stops, and of the load arrows.
TRAVEL, LOAD = FLOOR - 0.14, 1.15
# Both ends of a wall, and middle of the spring of a compliant stop: horizontal, vertical.
_WALLS, _CUSHIONS = ((FLOOR, 0.2), (-0.15, 1.15)), (0.0, 0.5)
# Markers of arrows against and along the motion.
TIPS = {"right": "<>", "up": "v^", "down": "^v"}


class Canvas(NamedTuple):
    """The axes, and the direction of positive positions in the picture."""

    ax: Axes
    positive: Positive

    @property
    def is_vertical(self) -> bool:
        """Flag of a drawing along a vertical line."""
        return self.positive != "right"

    @property
    def sign(self) -> int:
        """-1 where positive positions are at the left of, or below, the others."""
        return -1 if self.positive == "down" else 1

    def wall(self, *, is_outermost: bool) -> tuple[float, float]:
        """Both ends of a wall, across: springs pass beside one that is not outermost."""
        return _WALLS[self.is_vertical and is_outermost]

    def cushion(self, *, is_outermost: bool) -> float:
        """Middle of the spring of a compliant stop, across."""
        return _CUSHIONS[self.is_vertical and is_outermost]

    @property
    def turned(self) -> Affine2D:
        """From along and across to the data of the axes."""
        return Affine2D([[0, 1, 0], [self.sign, 0, 0], [0, 0, 1]]) if self.is_vertical else Affine2D()

    @property
    def transform(self) -> Transform:
        """From along and across to the picture."""
        return self.turned + self.ax.transData

    def tip(self, *, is_forward: bool | np.bool_) -> str:
        """Marker of an arrow along the motion."""
        return TIPS[self.positive][int(is_forward)]

    def line(self, x: Any = (), y: Any = (), **style: Any) -> Line2D:
        """Draw a line."""
        (line,) = self.ax.plot(x, y, transform=self.transform, **style)
        return line

    def text(self, x: float, y: float, words: str, **style: Any) -> Text:
        """Write upright words."""
        return self.ax.text(x, y, words, transform=self.transform, **style)

    def rectangle(self, x: float, y: float, length: float, width: float, **style: Any) -> Rectangle:
        """Draw a rectangle from its lower corner, with its length along the motion."""
        rectangle = Rectangle((x, y), length, width, **style)
        self.ax.add_patch(rectangle)
        rectangle.set_transform(self.transform)
        return rectangle

    def block(self, gid: str, zorder: float) -> Polygon:
        """Draw a block in ink, whose corners are set later."""
        block = Polygon(np.zeros((4, 2)), facecolor=ink(), linewidth=0, gid=gid, zorder=zorder)
        self.ax.add_patch(block)
        block.set_transform(self.transform)
        return block

    def hatch(self, x: float, y: float, length: float, width: float, gid: str | None = None) -> Rectangle:
        """Draw a hatched piece of the ground."""
        style = {"facecolor": "none", "edgecolor": ink("0.35", "0.7"), "hatch": "/////", "linewidth": 0}
        return self.rectangle(x, y, length, width, gid=gid, **style)

    def double_arrow(self, gid: str | None = None) -> list[Line2D]:
        """Draw an arrow along the motion with a tip at each end."""
        common = {"color": ink(), "linewidth": 1, "markersize": 5, "gid": gid}
        return [self.line(marker=self.tip(is_forward=bool(end)), markevery=[end], **common) for end in (0, 1)]
