"""Stops and contacts as pictures tell of them: their names, the masses that they bear on, where they stand."""

import jax.numpy as jnp
import numpy as np

from .._trajectory.solution import Solution


def name_of(number: int, stop_masses: tuple[int, ...] | np.ndarray) -> str:
    """What the legend calls a stop, or a contact, which has no mass of its own."""
    return f"{'stop' if stop_masses[number] >= 0 else 'contact'} {number}"


def name_in(sol: Solution, number: int) -> str:
    """The same, of a trajectory."""
    return name_of(number, sol.machine.contacts.masses)


def row_of(sol: Solution, number: int) -> np.ndarray:
    """Of which combination of positions it limits the motion, (n,): of a stop the position of its mass."""
    row = np.asarray(sol.machine.contacts.rows)[number]
    return row if sol.machine.contacts.masses[number] < 0 else np.abs(row)


def masses_of(sol: Solution, number: int) -> list[int]:
    """The masses that it bears on."""
    return np.flatnonzero(row_of(sol, number)).tolist()


def masses_moved_by(sol: Solution, number: int) -> list[int]:
    """The masses whose velocities jump when it is hit: with a full mass matrix others as well."""
    return np.flatnonzero(np.asarray(sol.machine.contacts.freed(jnp.asarray(row_of(sol, number))))).tolist()


def place_on_axis(sol: Solution, number: int, t: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Where it stands on the axis of its mass, and how fast it moves; None if it bears on several."""
    row, masses = row_of(sol, number), masses_of(sol, number)
    if len(masses) > 1:
        return None
    x, v = (np.asarray(a)[:, number] / row[masses[0]] for a in sol.evaluate_stops(t))
    return x, v


def in_symbols(row: np.ndarray) -> str:
    """A row times the positions, what is added first: x_1 - x_0."""
    terms = sorted(np.flatnonzero(row), key=lambda i: row[i] < 0)
    words = [f"{'-' if row[i] < 0 else '+'} {_factor(abs(row[i]))}x_{{{i}}}" for i in terms]
    return " ".join(words).removeprefix("+ ")


def _factor(size: float) -> str:
    return "" if size == 1 else f"{size:.3g} "
