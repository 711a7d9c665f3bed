"""Stops and contacts in pictures: their names, the masses they act on, their positions."""

import numpy as np

from .._machine.kinds import RIGID
from .._machine.switching import SwitchingContacts
from .._system.system import ImpactSystem
from .._trajectory.solution import Solution

StopMasses = tuple[int, ...] | np.ndarray


def masses_of_stops(system: ImpactSystem) -> tuple[int, ...]:
    """The mass of each stop, -1 for a contact, as in the `stop_mass` of sweeps."""
    return tuple(stop.slot[0] if stop.slot else -1 for stop in system.stops)


def name_of(number: int, stop_masses: StopMasses) -> str:
    """Legend label of a stop, or of a contact, whose entry in `stop_masses` is negative."""
    return f"{'stop' if stop_masses[number] >= 0 else 'contact'} {number}"


def name_in(sol: Solution, number: int) -> str:
    """Legend label of a stop, contact, friction or Jenkins element of a trajectory."""
    num_stops = sol.machine.contacts.num_stops
    if number >= num_stops + sol.sticking1.shape[-1]:
        return f"hysteresis {number - num_stops - sol.sticking1.shape[-1]}"
    if number >= num_stops:
        return f"friction {number - num_stops}"
    return name_of(number, sol.machine.contacts.masses)


def is_rigid(sol: Solution, number: int) -> bool:
    """True for a rigid stop or contact."""
    contacts = sol.machine.contacts
    return not isinstance(contacts, SwitchingContacts) or contacts.laws.kinds[number] == RIGID


def row_of(sol: Solution, number: int) -> np.ndarray:
    """Coefficients of the positions in a stop or contact, (n,): for a stop of either side, 1 at its mass."""
    row = np.asarray(sol.machine.contacts.rows)[number, : sol.x1.shape[-1]]
    return row if sol.machine.contacts.masses[number] < 0 else np.abs(row)


def masses_of(sol: Solution, number: int) -> list[int]:
    """The masses on which a stop or contact acts."""
    return np.flatnonzero(row_of(sol, number)).tolist()


def place_on_axis(sol: Solution, number: int, t: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Position and velocity of a stop on the axis of its mass; None if it acts on several masses."""
    row, masses = row_of(sol, number), masses_of(sol, number)
    if len(masses) > 1 or number >= sol.machine.contacts.num_stops:
        return None
    x, v = (np.asarray(a)[:, number] / row[masses[0]] for a in sol.evaluate_stops(t))
    return x, v


def in_symbols(row: np.ndarray) -> str:
    """A row times the positions as a formula, positive terms first: x_1 - x_0."""
    terms = sorted(np.flatnonzero(row), key=lambda i: row[i] < 0)
    words = [f"{'-' if row[i] < 0 else '+'} {_factor(abs(row[i]))}x_{{{i}}}" for i in terms]
    return " ".join(words).removeprefix("+ ")


def _factor(size: float) -> str:
    return "" if size == 1 else f"{size:.3g} "
