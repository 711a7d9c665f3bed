"""Machines to be drawn, and what a drawing shows of them."""

import numpy as np
from matplotlib.patches import Rectangle

import vijax as vx
from vijax.studio.drawing.arrangement import PITCH

MODELS = {
    "wagg_bishop_a": lambda: vx.models.wagg_bishop_a(0.8),
    "two_sided_oscillator": lambda: vx.models.two_sided_oscillator(1.0),
    "impact_damper": lambda: vx.models.impact_damper(1.0),
    "gear_pair": lambda: vx.models.gear_pair(1.0, 1.0),
    "bead_column": lambda: vx.models.bead_column(3, 2.0),
    "twenty masses": lambda: vx.models.uniform_chain(1.0, num_masses=20),
    "ring": lambda: ring(),
    "nothing but a mass": lambda: alone(),
}


def alone() -> vx.ImpactSystem:
    return vx.ImpactSystem([2.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 1.0))


def ring() -> vx.ImpactSystem:
    """Every mass coupled to every other, all of them driven, with a force and a contact of three masses."""
    stiffness = np.array([[3.0, -1.0, -1.0, -1.0], [-1, 4, -1, -1], [-1, -1, 3, -1], [-1, -1, -1, 4]])
    load = vx.base_excitation([1.0, 2.0, 3.0, 4.0], 0.1, 0.8, mean=[-1.0, 0.0, 0.0, 2.0])
    limits = [
        vx.Stop(1, 0.2, "upper", 0.7, vx.Harmonic([0.1], 0.8)),
        vx.Stop(2, -0.3, "lower", 0.5),
        vx.Contact({0: 1.0, 3: -1.0}, 0.2, 0.4),
        vx.Contact({0: 1.0, 1: -2.0, 3: 1.0}, 0.5, 0.3),
    ]
    return vx.ImpactSystem([1.0, 2.0, 3.0, 4.0], 0 * stiffness, stiffness, load, limits, force=push)


def shaken() -> vx.ImpactSystem:
    """A constant force presses mass 1 on its stop; the stop of mass 0 moves."""
    load = vx.Harmonic([0.3, 0.0], 0.8, phase=[0.4, 0.0], mean=[0.0, 0.5])
    stops = [vx.Stop(0, 0.3, "upper", 0.6, vx.Harmonic([0.1], 0.8)), vx.Stop(1, 0.1, "upper", 0.3)]
    return vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops)


def push(t, x, v, args):
    return 0 * x


def boxes(ax) -> list:
    """Boxes of the masses, in order."""
    return [patch for patch in ax.patches if str(patch.get_gid()).startswith("mass ")]


def middle(box: Rectangle) -> float:
    return box.get_x() + box.get_width() / 2


def displacements(ax) -> np.ndarray:
    """Displacements of the boxes, in lengths of the drawing."""
    return np.array([middle(box) for box in boxes(ax)]) - PITCH * np.arange(len(boxes(ax)))


def called(ax, name: str) -> list:
    return [artist for artist in [*ax.lines, *ax.patches] if artist.get_gid() == name]


def wall_at(ax, number: int) -> float:
    (line,) = called(ax, f"limit {number}")
    return float(np.asarray(line.get_xdata())[-1])


def words(ax) -> list[str]:
    return [text.get_text() for text in ax.texts]


def picture_of(ax, patch) -> np.ndarray:
    """Middle of a rectangle in the picture, as shares of its axes."""
    ax.figure.draw_without_rendering()
    box = patch.get_window_extent()
    return ax.transAxes.inverted().transform([(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2])


def axes_of(film) -> tuple:
    """Axes of a film after its first frame: a film that is never drawn warns."""
    film._fig.canvas.draw()
    return tuple(film._fig.axes)


# Numbers of connections between masses and to the ground, by springs and by dampers.
LINKS = [
    ("wagg_bishop_a", 2, 2),
    ("two_sided_oscillator", 1, 0),
    ("impact_damper", 1, 0),
    ("gear_pair", 0, 0),
    ("bead_column", 0, 0),
    ("twenty masses", 20, 20),
    ("ring", 6 + 2, 0),
    ("nothing but a mass", 0, 0),
]


def cavity_with(ends: list, friction: list) -> vx.ImpactSystem:
    """Mass 1 between two ends of mass 0."""
    held = np.diag([1.0, 0.0])
    return vx.ImpactSystem([1.0, 0.2], 0 * held, held, vx.Harmonic([1.0, 0.0], 1.0), ends, friction=friction)


def rigid_ends() -> list:
    rows = {1: 1.0, 0: -1.0}, {0: 1.0, 1: -1.0}
    return [vx.Contact(row, 0.5, 0.6) for row in rows]


def height_of(patch: Rectangle) -> tuple[float, float]:
    return patch.get_y(), patch.get_y() + patch.get_height()
