"""Normal modes of a machine, for every set of masses that its stops may hold.

`modal_flow` returns None where modes lose digits or do not apply: traced matrices; contacts that share inertia; damping
that the modes do not diagonalise; asymmetric matrices; a mode without stiffness or with negative damping, at resonance without damping, or heavily overdamped; more
than 8 sets of held masses. `TaylorFlow` serves these machines.
"""

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import jax
import numpy as np

from .._jax.concrete import concrete, concrete_evaluation
from .._machine.numbers import num_harmonics, tones_of
from .._system.checks import is_semidefinite, is_symmetric
from .._system.system import ImpactSystem
from .modal import ModalFlow
from .modal_tables import Modes

MAX_SETS = 8


def modal_flow(
    system: ImpactSystem, *, can_stick: bool, band: tuple[float, float] | None = None
) -> ModalFlow | None:
    """Tabulate the modes of every set of held masses, or return None where they lose digits or do not apply.

    Args:
        system: the machine; its leaves may have lanes as last axis.
        can_stick: whether any stop may hold its mass.
        band: lowest and highest frequency of the load; that of the machine if left out.

    Returns:
        The flow, or None.
    """
    if system.is_coupled:
        return None
    mass, damping, stiffness = (concrete(a) for a in (system.mass, system.damping, system.stiffness))
    holdable = sorted({stop.slot[0] for stop in system.stops if stop.slot}) if can_stick else []
    if mass is None or damping is None or stiffness is None or 2 ** len(holdable) > MAX_SETS:
        return None
    has_lanes = mass.ndim == 2
    most = min(len(system.stops), mass.shape[0]) if can_stick else 0
    with concrete_evaluation():
        matrices = [_Matrix.of(a) for a in (mass, damping, stiffness)]
        # Tables of many lanes would fill the memory.
        is_kept = not has_lanes or max(a.shape[-1] for a in (mass, damping, stiffness)) == 1
        tabulate = _tables if is_kept else _tables.__wrapped__
        tables = tabulate(*matrices, tuple(holdable), most, has_lanes)
    if tables is None:
        return None
    speeds = speeds_of(system, band)
    return tables.flow if all(are_modes_accurate(*own, speeds) for own in tables.of_sets) else None


class _Matrix(NamedTuple):
    """Numbers of an array, hashable."""

    numbers: bytes
    shape: tuple[int, ...]
    dtype: np.dtype

    @classmethod
    def of(cls, array: np.ndarray) -> "_Matrix":
        return cls(array.tobytes(), array.shape, array.dtype)

    def lanes_first(self, *, has_lanes: bool) -> np.ndarray:
        array = np.frombuffer(self.numbers, self.dtype).reshape(self.shape)
        return np.moveaxis(array, -1, 0) if has_lanes else array[None]


class _Tables(NamedTuple):
    """Modes of a machine, and squared frequencies and decay rates of each set of held masses."""

    flow: ModalFlow
    of_sets: list[tuple[np.ndarray, np.ndarray]]


@lru_cache(16)
def _tables(
    mass: _Matrix,
    damping: _Matrix,
    stiffness: _Matrix,
    holdable: tuple[int, ...],
    most: int,
    has_lanes: bool,
) -> _Tables | None:
    """Tabulate all sets of the masses `holdable`; None where a set has no accurate modes at any load."""
    matrices = [a.lanes_first(has_lanes=has_lanes) for a in (mass, damping, stiffness)]
    n, dtype = matrices[0].shape[1], matrices[0].dtype
    sets = [s for k in range(len(holdable) + 1) for s in combinations(holdable, k)]
    tables = []
    for held in sets:
        table = modes_of_set(matrices[0], matrices[1], matrices[2], held)
        if table is None:
            return None
        tables.append(table)
    of_sets = [(table[0], table[1]) for table in tables]
    # Copies of the first set pad the tables to the size of machines with stops on other masses: one program serves all.
    missing = min(2**most, MAX_SETS) - len(sets)
    sets, tables = sets + sets[:1] * missing, tables + tables[:1] * missing
    arrays = [np.moveaxis(np.stack(column), 1, -1).astype(dtype) for column in zip(*tables, strict=True)]
    members = np.array([[i in held for i in range(n)] for held in sets])[..., None]
    if not has_lanes:
        arrays, members = [a[..., 0] for a in arrays], members[..., 0]
    return _Tables(ModalFlow(Modes(*map(jax.device_put, arrays)), jax.device_put(members)), of_sets)


def speeds_of(system: ImpactSystem, band: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Lowest and highest frequency of every harmonic of load and moving stops, (lanes, harmonics); None if traced."""
    tones = tones_of(system)
    frequency = concrete(system.forcing.clock if tones is None else tones.frequencies)
    if frequency is None:
        return None
    if tones is not None:
        speeds = tones.of_rows(frequency).reshape(num_harmonics(system), -1).T
        return speeds, speeds
    orders = np.arange(1, num_harmonics(system) + 1)
    low, high = (np.atleast_1d(a)[:, None] * orders for a in band or (frequency, frequency))
    return low, high


def modes_of_set(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, held: tuple[int, ...]
) -> tuple[np.ndarray, ...] | None:
    """Modes with the masses `held` at rest, lanes first; None where they lose digits or do not apply."""
    n = mass.shape[1]
    # The bounds of `modal.py` need an energy that never grows.
    if not (is_symmetric(stiffness).all() and is_semidefinite(damping).all()):
        return None
    free = [i for i in range(n) if i not in held]
    root = np.sqrt(mass[:, free])
    scale = root[:, :, None] * root[:, None]
    w2, vectors = np.linalg.eigh(stiffness[np.ix_(range(len(stiffness)), free, free)] / scale)
    modal_damping = (
        np.swapaxes(vectors, 1, 2) @ (damping[np.ix_(range(len(damping)), free, free)] / scale) @ vectors
    )
    decay = np.diagonal(modal_damping, axis1=1, axis2=2) / 2
    between = np.abs(modal_damping - np.eye(len(free)) * modal_damping)
    eps = np.finfo(mass.dtype).eps
    if free and (between > 64 * eps * np.abs(modal_damping).max()).any():
        return None
    if (w2 <= 1e-6 * np.abs(w2).max(initial=0.0)).any():
        return None
    if held:
        towards_held = stiffness[np.ix_(range(len(stiffness)), held, free)] / root[:, None]
        vectors = _turned_towards(towards_held, w2, decay, vectors)
    lanes = max(len(w2), len(decay))
    shape, inverse = np.zeros((lanes, n, n)), np.zeros((lanes, n, n))
    modes = range(len(free))
    shape[np.ix_(range(lanes), free, modes)] = vectors / root[:, :, None]
    inverse[np.ix_(range(lanes), modes, free)] = np.swapaxes(vectors * root[:, :, None], 1, 2)
    # Pad the tables with modes that nothing excites, as fast as the machine: steps are too long for the series of faster ones.
    usual = np.mean(np.diagonal(stiffness, axis1=1, axis2=2) / mass, axis=1)[:, None]
    w2, decay = (_padded(a, fill, n - len(free)) for a, fill in ((w2, usual), (decay, np.sqrt(usual))))
    flexibility = shape / w2[:, None] @ np.swapaxes(shape, 1, 2)
    anchor = np.zeros((lanes, n, n))
    for i in held:
        anchor[:, :, i] = -(flexibility @ stiffness[:, :, i, None])[..., 0]
        anchor[:, i, i] = 1.0
    w2, decay = (np.broadcast_to(a, (lanes, n)) for a in (w2, decay))
    return w2, decay, shape, inverse, anchor


def _turned_towards(rows: np.ndarray, w2: np.ndarray, decay: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Modes of equal frequency and decay, recombined so that as few as possible act on the held masses.

    Where a symmetry keeps the force on a held mass zero, it is the sum of such modes. The bounds of the force add
    their absolute values.

    Args:
        rows: stiffness between held masses and free ones, in the coordinates of `vectors`, (lanes, held, free).
        w2: squared frequencies in rising order, (lanes, modes).
        decay: decay rates, (lanes, modes).
        vectors: modes in columns, (lanes, free, modes).

    Returns:
        Modes in columns.
    """
    lanes, slack = max(len(rows), len(vectors)), 64 * np.finfo(w2.dtype).eps
    differs = [
        np.abs(np.diff(a, axis=1)) > slack * np.abs(a).max(axis=1, keepdims=True, initial=0.0)
        for a in (w2, decay)
    ]
    is_new = differs[0] | differs[1]
    if is_new.all():
        return vectors
    rows, vectors = (np.broadcast_to(a, (lanes, *a.shape[1:])).copy() for a in (rows, vectors))
    is_new = np.broadcast_to(is_new, (lanes, is_new.shape[1]))
    for lane in np.flatnonzero(~is_new.all(axis=1)):
        for equal in np.split(np.arange(vectors.shape[2]), np.flatnonzero(is_new[lane]) + 1):
            own = vectors[lane][:, equal]
            vectors[lane][:, equal] = own @ np.linalg.svd(rows[lane] @ own)[2].T
    return vectors


def _padded(a: np.ndarray, fill: np.ndarray, count: int) -> np.ndarray:
    """Columns, (lanes, modes), followed by a column `count` times."""
    lanes = max(len(a), len(fill))
    whole = [np.broadcast_to(part, (lanes, part.shape[1])) for part in (a, np.repeat(fill, count, axis=1))]
    return np.concatenate(whole, axis=1)


def are_modes_accurate(
    w2: np.ndarray, decay: np.ndarray, speeds: tuple[np.ndarray, np.ndarray] | None
) -> bool:
    """Test whether the modes are accurate: none heavily overdamped, none driven near resonance without damping.

    A traced frequency requires this at every frequency.
    """
    if (decay > 4 * np.sqrt(w2)).any():
        return False
    if speeds is None:
        return bool((decay >= 1e-2 * np.sqrt(w2)).all())
    low, high = (a[..., None] for a in speeds)
    speed = np.clip(np.sqrt(w2)[:, None], low, high)  # nearest to resonance
    impedance = w2[:, None] - speed**2 + 2j * decay[:, None] * speed
    return bool((np.abs(impedance) > 1e-2 * (w2[:, None] + speed**2)).all())
