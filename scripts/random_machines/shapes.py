"""Shapes of random machines, for which programs are compiled."""

from typing import Literal, NamedTuple

import numpy as np

# A row that names two masses has the coefficients 1 and -1.
Row = tuple[int, ...]
Side = Literal["upper", "lower"]


class Shape(NamedTuple):
    """What all machines of a batch have in common.

    Attributes:
        masses: n.
        is_full: whether the mass matrix is full.
        stops: mass and side of each rigid stop.
        contacts: masses of each rigid contact.
        cushions: mass and side of each compliant stop.
        pads: masses of each friction element of constant normal force.
        rubs: masses of each friction element tied to a contact, and the number of that, stops, contacts and cushions in one row.
        sliders: masses of each Jenkins element.
        harmonics: of the load.
        is_driven: whether there is a load, a mean load, a moving stop or a belt.
        is_moving: whether stop 0 moves.
        is_general: whether the damping is not proportional.
        load: harmonics, a wave form in their place, or a record beside them.
        kind: of the wave form or record.
        is_parametric: whether the stiffness changes in time.
        is_nonlinear: whether there are cubic springs.
        buffers: masses of each compliant contact.
        walls: mass and side of each compliant stop that is given as a force.
    """

    masses: int
    is_full: bool = False
    stops: tuple[tuple[int, Side], ...] = ()
    contacts: tuple[Row, ...] = ()
    cushions: tuple[tuple[int, Side], ...] = ()
    pads: tuple[Row, ...] = ()
    rubs: tuple[tuple[Row, int], ...] = ()
    sliders: tuple[Row, ...] = ()
    harmonics: int = 1
    is_driven: bool = True
    is_moving: bool = False
    is_general: bool = False
    load: str = "harmonic"
    kind: str = "linear"
    is_parametric: bool = False
    is_nonlinear: bool = False
    buffers: tuple[Row, ...] = ()
    walls: tuple[tuple[int, Side], ...] = ()

    @property
    def is_switching(self) -> bool:
        """Whether forces switch: friction, Jenkins elements or compliant stops."""
        return bool(self.cushions or self.buffers or self.pads or self.rubs or self.sliders)

    @property
    def is_periodic(self) -> bool:
        """Whether there is a forcing period."""
        return self.is_driven and self.load != "table"

    @property
    def is_linear(self) -> bool:
        """Whether the motion is exact between events, no Taylor series."""
        return not (self.is_parametric or self.is_nonlinear or self.walls)

    @property
    def is_rigid(self) -> bool:
        """Whether all contacts are rigid stops of one mass."""
        return not (self.contacts or self.is_switching)


def draw_shape(rng: np.random.Generator, most_masses: int) -> Shape:
    """Draw a shape; small machines are the most frequent."""
    n = min(int(rng.geometric(0.4)), most_masses)
    sides: tuple[Side, Side] = "lower", "upper"
    whole = [(i, side) for i in range(n) for side in sides]
    places = [whole[k] for k in rng.permutation(len(whole))]
    kind = rng.choice(["stops", "contacts", "friction", "cushions", "rubbing", "hysteresis", "all"])
    stops = places[: rng.integers(1, min(4, 2 * n) + 1)]
    contacts: list[Row] = []
    cushions: list[tuple[int, Side]] = []
    pads: list[Row] = []
    if kind in ("contacts", "all") and n > 1:
        contacts = [_pair(rng, n) for _ in range(rng.integers(1, 3))]
        contacts = list(dict.fromkeys(contacts))
    if kind in ("cushions", "all"):
        cushions, stops = stops[:2], stops[2:]
    if kind in ("friction", "all"):
        pads = [_row(rng, n) for _ in range(rng.integers(1, 3))]
        pads = list(dict.fromkeys(pads))
    pressing = len(stops) + len(contacts) + len(cushions)
    rubs: list[tuple[Row, int]] = []
    if pressing and (kind == "rubbing" or (kind == "all" and rng.random() < 0.3)):
        rubs = [(_row(rng, n), int(rng.integers(pressing))) for _ in range(rng.integers(1, 3))]
        rubs = list(dict.fromkeys(rubs))
    sliders: list[Row] = []
    if kind == "hysteresis" or (kind == "all" and rng.random() < 0.3):
        sliders = [_row(rng, n) for _ in range(rng.integers(1, 3))]
    is_driven = bool(rng.random() < 0.85)
    return Shape(
        masses=n,
        is_full=bool(n > 1 and rng.random() < 0.2),
        stops=tuple(stops),
        contacts=tuple(contacts),
        cushions=tuple(cushions),
        pads=tuple(pads),
        rubs=tuple(rubs),
        sliders=tuple(sliders),
        harmonics=int(rng.choice([1, 1, 1, 2, 3])),
        is_driven=is_driven,
        is_moving=bool(is_driven and stops and rng.random() < 0.2),
        is_general=bool(n > 1 and rng.random() < 0.4),
    )


def _pair(rng: np.random.Generator, n: int) -> Row:
    return tuple(int(i) for i in rng.permutation(n)[:2])


def _row(rng: np.random.Generator, n: int) -> Row:
    return _pair(rng, n) if n > 1 and rng.random() < 0.4 else (int(rng.integers(n)),)
