"""Content of a drawing, taken from an `ImpactSystem` or from the machine of a trajectory."""

from typing import Any, NamedTuple

import jax
import numpy as np

from ..._machine.machine import Machine
from ..._machine.switching import COMPLIANT, SwitchingContacts
from ..._system.compliant import CompliantContact, CompliantStop
from ..._system.force import name_of_force
from ..._system.restitution import (
    AbstractRestitution,
    Restitution,
    light_coefficient,
    restitution_of_contacts,
)
from ..._system.system import AnyStop, ImpactSystem
from ..._system.waves import Waves
from ..._trajectory.solution import Solution
from ...plot._contacts import in_symbols, masses_of_stops, name_of

# Relative to the largest entry of a matrix or load: smaller entries are rounding errors of sums that should vanish.
_NOTHING = 1e-9


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
    """Friction element: coefficients of the masses, force, and velocity of the surface."""

    row: np.ndarray
    force: float
    velocity: float


class Scheme(NamedTuple):
    """Data of the drawing of a machine.

    Attributes:
        stiffness: its symmetric part, without first-order states, (n, n).
        damping: likewise, (n, n).
        mean: mean load, (n,).
        waves: harmonics of the load, (harmonics, n).
        frequency: W.
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
        friction: the friction elements.
        omitted: what the matrices lack, in words; empty if nothing.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    mean: np.ndarray
    waves: Waves
    frequency: float
    rows: np.ndarray
    masses: tuple[int, ...]
    limit: np.ndarray
    restitution: tuple[str, ...]
    is_moving: np.ndarray
    is_lumped: bool
    force: str | None
    is_compliant: np.ndarray
    is_damped: np.ndarray
    friction: tuple["Rubbing", ...] = ()
    omitted: str = ""

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
            if len(own) == 1 or (len(own) == 2 and row[own].sum() == 0):
                support, mass = [None, *own.tolist()][-2:]
                if support in inside:
                    support, mass = mass, support
                found.append(DrawnLimit(j, mass, int(np.sign(row[mass])), support, abs(float(row[mass]))))
        return found

    @property
    def containers(self) -> dict[int, int]:
        """Loose masses that bounce between two ends of another mass, each with that mass.

        They have no links, loads or contacts but the two with their container, which is linked to something.
        """
        linked = {i for link, _ in self.links for i in (link.mass, link.other)}
        loaded = set(np.flatnonzero(abs(self.mean) + self.waves.bound()).tolist())
        rubbing = {i for one in self.friction for i in np.flatnonzero(one.row).tolist()}
        found = {}
        for loose in set(range(self.num_masses)) - linked - loaded - rubbing:
            touching = self.rows[self.rows[:, loose] != 0]
            others = set(np.flatnonzero(touching.any(axis=0)).tolist()) - {loose}
            is_between = (
                len(touching) == 2 and not touching.sum(axis=0).any() and not touching.sum(axis=1).any()
            )
            if is_between and len(others) == 1 and others <= linked:
                (found[loose],) = others
        is_single = [list(found.values()).count(container) == 1 for container in found.values()]
        return {loose: found[loose] for loose, single in zip(found, is_single, strict=True) if single}

    @property
    def pads(self) -> list[tuple[int, float]]:
        """Masses that rub on the ground or on a belt, and the velocity of that."""
        return [
            (int(np.flatnonzero(one.row)[0]), one.velocity / float(one.row.sum()))
            for one in self.friction
            if np.count_nonzero(one.row) == 1
        ]

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
            f"{name_of(j, self.masses)}: ${in_symbols(row)} \\leq {self.limit[j]:.3g}$, {self.restitution[j]}"
            for j, row in enumerate(self.rows)
            if j not in drawn
        ]
        is_negative = any(link.strength < 0 for link, _ in self.links)
        negative = ["dashed: negative stiffness or damping"] if is_negative else []
        inertia = [] if self.is_lumped else ["full mass matrix: boxes are coordinates"]
        negative += [self.omitted] if self.omitted else []
        rubbing = [
            f"friction {k}: of ${in_symbols(one.row)}$, $F$ = {one.force:.3g}"
            for k, one in enumerate(self.friction)
        ]
        return [*rows, *rubbing, *inertia, *([f"force: {self.force}"] if self.force else []), *negative]

    def load_at(self, t: float) -> np.ndarray:
        """The load on every mass at a time, (n,)."""
        return self.mean + self.waves.at_angle(self.frequency * t)

    @property
    def largest_load(self) -> float:
        """Upper bound of the load on any mass."""
        return float(np.max(abs(self.mean) + self.waves.bound()))

    def load_in_words(self, mass: int) -> str:
        """The load on a mass as a formula; empty for none."""
        if abs(self.mean[mass]) + self.waves.bound()[mass] <= _NOTHING * self.largest_load:
            return ""
        terms = [] if self.mean[mass] == 0 else [_signed(float(self.mean[mass]))]
        for h, (cosine, sine) in enumerate(
            zip(self.waves.cosine[:, mass], self.waves.sine[:, mass], strict=True), 1
        ):
            size, phase = float(np.hypot(cosine, sine)), float(np.arctan2(-sine, cosine))
            if size > _NOTHING * self.largest_load:
                at_pi = abs(phase) > np.pi - _NOTHING
                shift = "" if at_pi or abs(phase) < _NOTHING else f" {_signed(phase)}"
                angle = rf"{_factor(h * self.frequency)}t{shift}"
                sign = "-" if at_pi else "+"
                terms.append(rf"{sign} {_factor(size)}\cos({angle})")
        words = " ".join(terms[:2]).removeprefix("+ ")
        return f"${words}{' + ...' if len(terms) > 2 else ''}$"


def scheme_of_system(system: ImpactSystem) -> Scheme:
    """Scheme of one machine; raise for a batch."""
    if system.stiffness.ndim != 2:
        raise ValueError(
            f"Machines are drawn one by one, but this is a batch of shape {system.stiffness.shape[2:]}: draw its parts."
        )
    n = system.num_masses
    rows = np.array([_row(n, stop.coefficients) for stop in system.stops]).reshape(-1, n)
    moving = [stop.motion is not None and bool(np.any(stop.motion.amplitude)) for stop in system.stops]
    (stiffness, damping), omitted = _drawn(
        np.asarray(system.stiffness), np.asarray(system.damping), system.num_states
    )
    return Scheme(
        stiffness,
        damping,
        np.asarray(system.forcing.mean),
        waves=jax.tree.map(np.asarray, system.forcing.waves()),
        frequency=float(system.forcing.frequency),
        rows=rows,
        masses=masses_of_stops(system),
        limit=np.array([float(stop.sign * stop.centre) for stop in system.stops]),
        restitution=tuple(map(_law_in_words, system.stops)),
        is_moving=np.array(moving, bool),
        is_lumped=not system.has_full_mass,
        force=None if system.force is None else _name(system.force),
        is_compliant=np.array([stop.is_compliant for stop in system.stops], bool),
        is_damped=np.array([bool(getattr(stop, "damping", 0) > 0) for stop in system.stops], bool),
        friction=tuple(
            Rubbing(_row(n, one.coefficients), float(one.force), float(one.velocity))
            for one in system.friction
        ),
        omitted=omitted,
    )


def _row(num_masses: int, coefficients: dict[int, Any]) -> np.ndarray:
    row = np.zeros(num_masses)
    for i, a in coefficients.items():
        row[i] = float(a)
    return row


def _law_in_words(stop: AnyStop) -> str:
    if isinstance(stop, CompliantStop | CompliantContact):
        return f"$k$ = {float(stop.stiffness):.3g}"
    (words,) = _coefficients(restitution_of_contacts([stop.restitution], np.zeros(())))
    return words


def _coefficients(restitution: Restitution) -> tuple[str, ...]:
    symbol = "r(0)" if isinstance(restitution, AbstractRestitution) else "r"
    return tuple(f"${symbol}$ = {r:.3g}" for r in np.asarray(light_coefficient(restitution)))


def scheme_of_solution(sol: Solution, places: np.ndarray) -> Scheme:
    """Scheme of the machine of a trajectory; `places` are the positions of its stops, (times, stops)."""
    machine = sol.machine
    contacts, n = machine.contacts, machine.num_masses
    (stiffness, damping), omitted = _drawn(
        np.asarray(machine.stiffness), np.asarray(machine.damping), machine.num_states
    )
    rows, num_stops = np.asarray(contacts.rows).reshape(contacts.num, n), contacts.num_stops
    words, friction = _coefficients(contacts.restitution), ()
    is_compliant = is_damped = np.zeros(num_stops, bool)
    if isinstance(contacts, SwitchingContacts):
        laws, is_compliant = contacts.laws, np.array(contacts.laws.kinds[:num_stops]) == COMPLIANT
        added, force, velocity = (np.asarray(a) for a in (laws.stiffness, laws.force, laws.velocity))
        is_damped = np.asarray(laws.damping)[:num_stops] > 0
        words = tuple(f"$k$ = {added[j]:.3g}" if is_compliant[j] else words[j] for j in range(num_stops))
        friction = tuple(
            Rubbing(rows[j], float(force[j]), float(velocity[j])) for j in range(num_stops, contacts.num)
        )
    return Scheme(
        stiffness,
        damping,
        np.asarray(machine.mean),
        waves=_load_in_space(machine),
        frequency=float(machine.frequency),
        rows=rows[:num_stops],
        masses=contacts.masses[:num_stops],
        limit=np.asarray(contacts.limit)[:num_stops],
        restitution=words,
        is_moving=np.ptp(places, axis=0) > 0,
        is_lumped=machine.inverse_mass.ndim == 1,
        force=None if machine.extra is None else _name(machine.extra.force),
        is_compliant=is_compliant,
        is_damped=is_damped,
        friction=friction,
        omitted=omitted,
    )


def _drawn(stiffness: np.ndarray, damping: np.ndarray, num_states: int) -> tuple[list[np.ndarray], str]:
    """Symmetric parts of the matrices, without the states, and what they lack in words."""
    first = len(stiffness) - num_states
    is_mass = np.arange(len(stiffness)) < first
    between = [np.where(np.outer(is_mass, is_mass), a, 0) for a in (stiffness, damping)]
    names = [
        f"asymmetric part of the {name}"
        for name, a in zip(("stiffness", "damping"), between, strict=True)
        if np.abs(a - a.T).max() > _NOTHING * np.abs(a).max()
    ]
    if num_states:
        names.append(
            "links of the last box, a state"
            if num_states == 1
            else f"links of the last {num_states} boxes, states"
        )
    return [(a + a.T) / 2 for a in between], f"not drawn: {', '.join(names)}" if names else ""


def _links(matrix: np.ndarray) -> list[Link]:
    """The springs of a stiffness matrix, or the dampers of a damping matrix.

    An off-diagonal entry -k couples two masses; the sum of a row ties its mass to the ground.
    """
    nothing = _NOTHING * np.max(abs(matrix))
    left = matrix.sum(axis=1)
    ground = [Link(int(i), None, float(left[i])) for i in np.flatnonzero(abs(left) > nothing)]
    pairs = np.argwhere(np.triu(abs(matrix) > nothing, 1)).tolist()
    return [*ground, *(Link(i, j, -float(matrix[i, j])) for i, j in pairs)]


def _load_in_space(machine: Machine) -> Waves:
    """Harmonics of the load in space: without -M w'' - C w' - K w if the machine moves with its stops (`frame`)."""
    waves, frame = jax.tree.map(np.asarray, machine.waves), machine.frame
    if frame is not None:
        inertia = frame.load(1 / machine.inverse_mass, machine.damping, machine.stiffness)
        waves = jax.tree.map(
            lambda a, b: np.where(abs(a - b) > _NOTHING * abs(b), a - b, 0.0), waves, inertia
        )
    return waves


def _name(force: object) -> str:
    """The name of a force without its parameters."""
    return name_of_force(force).partition("(")[0].strip("<>")  # pyright: ignore[reportArgumentType]


def _factor(size: float) -> str:
    words = f"{size:.3g}"
    return "" if words == "1" else rf"{words}\,"


def _signed(number: float) -> str:
    return f"{'-' if number < 0 else '+'} {abs(number):.3g}"
