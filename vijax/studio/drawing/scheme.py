"""Content of a drawing of a machine."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..._system.waves import Waves, phase_of
from ...plot._contacts import in_symbols, name_of
from .canvas import Positive

# Relative to the largest entry of a matrix or load: smaller entries are rounding errors of sums that should vanish.
NOTHING = 1e-9


class DrawnLimit(NamedTuple):
    """A stop or a contact of two masses in a drawing: a wall or a plate beside a mass.

    Attributes:
        number: its index in the machine.
        mass: the mass that it limits.
        side: 1 on the right of the mass, -1 on its left.
        support: the mass that carries it, None for the ground.
        unit: factor of the positions in the row: gaps are lengths times this.
    """

    number: int
    mass: int
    side: int
    support: int | None
    unit: float


class Link(NamedTuple):
    """A spring or damper between two masses, or with `other` None between a mass and the ground."""

    mass: int
    other: int | None
    strength: float


class Rubbing(NamedTuple):
    """Friction element: coefficients of the masses, force, velocity of the surface, and number of the contact that presses.

    With a contact, `force` is the coefficient of friction.
    """

    row: np.ndarray
    force: float
    velocity: float
    contact: int | None = None

    @property
    def law(self) -> str:
        """Law of slip, as a formula."""
        if self.contact is None:
            return f"$F$ = {self.force:.3g}"
        return f"$\\mu$ = {self.force:.3g} on contact {self.contact}"


class DrawnFriction(NamedTuple):
    """A friction element in a drawing: of a mass on the ground or a belt, or between two masses.

    Attributes:
        number: its index among the friction elements.
        mass: a mass that rubs; the loose one where the other is its container.
        support: the mass on which it rubs, None for the ground.
        velocity: velocity of the surface.
    """

    number: int
    mass: int
    support: int | None
    velocity: float


class Scheme(NamedTuple):
    """Data of the drawing of a machine.

    Attributes:
        stiffness: its symmetric part, without first-order states, (n, n).
        damping: likewise, (n, n).
        mean: mean load, (n,).
        waves: harmonics of the load, (harmonics, n).
        frequency: W, that of moving stops.
        speeds: angular frequencies of the harmonics, (harmonics,).
        rows: coefficients of stops and contacts, positive towards them, (stops, n).
        masses: the mass of each stop, -1 for a contact.
        limit: where they stand along their rows in the mean, (stops,).
        restitution: the coefficient of each stop in words, that of light impacts for a law, or the stiffness of a compliant
            one, (stops,).
        is_moving: which of them move, (stops,).
        is_lumped: whether the mass matrix is diagonal; else the boxes are coordinates.
        force: the name of the force that is not linear, if there is one.
        is_compliant: which of the stops and contacts yield, (stops,).
        is_damped: which of those have a damper, (stops,).
        is_preloaded: which of those have a spring under compression at rest, (stops,).
        friction: the friction elements.
        omitted: what the matrices lack, in words; empty if nothing.
        accelerations: M^-1 times the mean load, (n,).
        is_hung: whether the force is the weight of pendulums.
        largest_of_tables: largest loads by tables, (n,); None if there are none.
        of_tables: loads by tables as a function of time, (n,); likewise.
        base: acceleration of the base as a formula; empty where it stands still. Its inertia forces are no part of the loads.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    mean: np.ndarray
    waves: Waves
    frequency: float
    speeds: np.ndarray
    rows: np.ndarray
    masses: tuple[int, ...]
    limit: np.ndarray
    restitution: tuple[str, ...]
    is_moving: np.ndarray
    is_lumped: bool
    force: str | None
    is_compliant: np.ndarray
    is_damped: np.ndarray
    is_preloaded: np.ndarray
    friction: tuple[Rubbing, ...] = ()
    omitted: str = ""
    accelerations: np.ndarray | None = None
    is_hung: bool = False
    largest_of_tables: np.ndarray | None = None
    of_tables: Callable[[float], np.ndarray] | None = None
    base: str = ""

    @property
    def num_masses(self) -> int:
        """Number of masses, n."""
        return len(self.mean)

    @property
    def signs(self) -> np.ndarray:
        """Sign of the position of each stop or contact along its row, (stops,): -1 for lower stops, else 1."""
        is_stop = np.array(self.masses, int) >= 0
        return np.where(is_stop, self.rows.sum(axis=1), 1.0)

    @property
    def limits(self) -> list[DrawnLimit]:
        """Stops, and contacts of one mass or of the distance of two; others cannot be drawn."""
        found, inside = [], self.containers
        for j, row in enumerate(self.rows):
            own = np.flatnonzero(row)
            if len(own) == 1 or is_distance(row):
                support, mass = [None, *own.tolist()][-2:]
                if support in inside:
                    support, mass = mass, support
                found.append(DrawnLimit(j, mass, int(np.sign(row[mass])), support, abs(float(row[mass]))))
        return found

    @property
    def containers(self) -> dict[int, int]:
        """Loose masses that bounce between two ends of another mass, each with that mass.

        They have no links, loads, contacts or friction but those with their container, which is linked to something.
        """
        linked = {i for link, _ in self.links for i in (link.mass, link.other)}
        loaded = set(np.flatnonzero(abs(self.mean) + self.largest_varying_load).tolist())
        found = {}
        for loose in set(range(self.num_masses)) - linked - loaded:
            touching = self.rows[self.rows[:, loose] != 0]
            others = set(np.flatnonzero(touching.any(axis=0)).tolist()) - {loose}
            is_between = (
                len(touching) == 2 and not touching.sum(axis=0).any() and not touching.sum(axis=1).any()
            )
            rubbing = [one.row for one in self.friction if one.row[loose]]
            is_inside = all(
                is_distance(row) and set(np.flatnonzero(row).tolist()) - {loose} == others for row in rubbing
            )
            if is_between and is_inside and len(others) == 1 and others <= linked:
                (found[loose],) = others
        is_single = [list(found.values()).count(container) == 1 for container in found.values()]
        return {loose: found[loose] for loose, single in zip(found, is_single, strict=True) if single}

    @property
    def pads(self) -> list[DrawnFriction]:
        """Friction on the ground, on a belt, or between two masses; other rows cannot be drawn."""
        found, inside = [], self.containers
        for k, one in enumerate(self.friction):
            row, velocity = one.row, one.velocity
            own = np.flatnonzero(row).tolist()
            if len(own) == 1:
                found.append(DrawnFriction(k, own[0], None, velocity / float(row.sum())))
            elif is_distance(row):
                mass, support = own if own[0] in inside else own[::-1]
                found.append(DrawnFriction(k, mass, support, velocity / float(row[mass])))
        return found

    @property
    def has_floor_pads(self) -> bool:
        """Flag of friction on the ground or on a belt."""
        return any(pad.support is None for pad in self.pads)

    @property
    def grounded(self) -> list[int]:
        """Masses tied to the ground by a spring or damper."""
        return sorted({link.mass for link, _ in self.links if link.other is None})

    @property
    def is_followed(self) -> bool:
        """True where no spring or stop ties the machine to the ground: it is drawn relative to its mean position."""
        is_tied = any(link.other is None and is_spring for link, is_spring in self.links)
        return len(self.rows) > 0 and not is_tied and not self.rows.sum(axis=1).any()

    @property
    def weight(self) -> float:
        """Acceleration by the weight, 0 for none.

        A mean load is a weight where it accelerates all masses equally, and no spring ties them to the ground and no
        friction to a floor. No observation in the machine tells it from gravity.
        """
        is_tied = any(link.other is None and is_spring for link, is_spring in self.links)
        if self.accelerations is None or is_tied or self.friction:
            return 0.0
        first = float(self.accelerations[0])
        return first if np.allclose(self.accelerations, first, rtol=NOTHING, atol=0.0) else 0.0

    @property
    def is_pendulum(self) -> bool:
        """True for one pendulum without springs and friction, all of whose stops are angles."""
        is_bare = self.num_masses == 1 and not self.friction and not self.omitted
        return self.is_hung and is_bare and not any(is_spring for _, is_spring in self.links)

    @property
    def positive(self) -> Positive:
        """Direction of positive positions for which the weight acts downwards; right without weight."""
        return "right" if self.weight == 0 else "up" if self.weight < 0 else "down"

    @property
    def links(self) -> list[tuple[Link, bool]]:
        """All springs and dampers, with flags of the springs."""
        return [
            (link, is_spring)
            for matrix, is_spring in ((self.stiffness, True), (self.damping, False))
            for link in _links(matrix)
        ]

    @property
    def notes(self) -> list[str]:
        """Notes on all that the drawing does not show."""
        drawn = {limit.number for limit in self.limits}
        rows = [
            f"{name_of(j, self.masses)}: ${in_symbols(row)} \\leq {self.limit[j]:.3g}$, {', '.join(self.restitution[j].splitlines())}"
            for j, row in enumerate(self.rows)
            if j not in drawn
        ]
        is_negative = any(link.strength < 0 for link, _ in self.links)
        negative = ["dashed: negative stiffness or damping"] if is_negative else []
        inertia = [] if self.is_lumped else ["full mass matrix: boxes are coordinates"]
        negative += [self.omitted] if self.omitted else []
        rubbing = [
            f"friction {k}: of ${in_symbols(one.row)}$, {one.law}" for k, one in enumerate(self.friction)
        ]
        return [
            *([f"base: $\\ddot y$ = {self.base}"] if self.base else []),
            *rows,
            *rubbing,
            *inertia,
            *([f"force: {self.force}"] if self.force and not self.is_pendulum else []),
            *negative,
        ]

    def load_at(self, t: float) -> np.ndarray:
        """The load on every mass at a time, (n,)."""
        load = self.mean + self.waves.at(phase_of(self.speeds * t))
        return load if self.of_tables is None else load + self.of_tables(t)

    @property
    def largest_varying_load(self) -> np.ndarray:
        """Upper bound of the load on every mass without its mean, (n,)."""
        waves = self.waves.bound()
        return waves if self.largest_of_tables is None else waves + self.largest_of_tables

    @property
    def largest_load(self) -> float:
        """Upper bound of the load on any mass."""
        return float(np.max(abs(self.mean) + self.largest_varying_load))

    def load_in_words(self, mass: int) -> str:
        """The load on a mass as a formula; empty for none."""
        if abs(self.mean[mass]) + self.largest_varying_load[mass] <= NOTHING * self.largest_load:
            return ""
        terms = [] if self.mean[mass] == 0 else [_signed(float(self.mean[mass]))]
        waves = self.waves.cosine[:, mass], self.waves.sine[:, mass]
        terms += harmonic_terms(self.speeds, *waves, NOTHING * self.largest_load)
        if self.largest_of_tables is not None and self.largest_of_tables[mass] > 0:
            terms.append(f"+ f_{mass}(t)")
        return formula(terms)


def harmonic_terms(speeds: np.ndarray, cosines: np.ndarray, sines: np.ndarray, least: float) -> list[str]:
    """Terms of a sum of harmonics, each with its sign, without those of no more than a size."""
    terms = []
    for speed, cosine, sine in zip(speeds, cosines, sines, strict=True):
        size, phase = float(np.hypot(cosine, sine)), float(np.arctan2(-sine, cosine))
        if size > least:
            at_pi = abs(phase) > np.pi - NOTHING
            shift = "" if at_pi or abs(phase) < NOTHING else f" {_signed(phase)}"
            angle = rf"{_factor(speed)}t{shift}"
            terms.append(rf"{'-' if at_pi else '+'} {_factor(size)}\cos({angle})")
    return terms


def formula(terms: list[str]) -> str:
    """Sum of terms with signs, after two of them with dots."""
    words = " ".join(terms[:2]).removeprefix("+ ")
    return f"${words}{' + ...' if len(terms) > 2 else ''}$"


def is_distance(row: np.ndarray) -> bool:
    """True for a row that is a multiple of the distance of two masses."""
    return bool(np.count_nonzero(row) == 2 and row.sum() == 0)


def _links(matrix: np.ndarray) -> list[Link]:
    """The springs of a stiffness matrix, or the dampers of a damping matrix.

    An off-diagonal entry -k couples two masses; the sum of a row ties its mass to the ground.
    """
    nothing = NOTHING * np.max(abs(matrix))
    left = matrix.sum(axis=1)
    ground = [Link(int(i), None, float(left[i])) for i in np.flatnonzero(abs(left) > nothing)]
    pairs = np.argwhere(np.triu(abs(matrix) > nothing, 1)).tolist()
    return [*ground, *(Link(i, j, -float(matrix[i, j])) for i, j in pairs)]


def _factor(size: float) -> str:
    words = f"{size:.3g}"
    return "" if words == "1" else rf"{words}\,"


def _signed(number: float) -> str:
    return f"{'-' if number < 0 else '+'} {abs(number):.3g}"
