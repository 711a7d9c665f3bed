"""Normal modes of a machine with friction or compliant contacts, for every set of held masses and closed contacts.

Slip is a constant load and leaves the modes. Friction that sticks, a rigid contact that holds and a mass at rest on a
preloaded compliant contact hold a mass. A closed compliant contact on a mass that moves adds its spring and damper.

`switching_modal_flow` returns None where this does not apply: traced numbers of matrices and springs; rows that name several
masses; belts and contacts that move; friction of contacts; Jenkins elements, whose stretches are no modes; more than 8 sets or 2
elements; or where the modes of a set lose digits, see `modes.py`. `TaylorFlow` serves these machines.
"""

from itertools import combinations

import jax
import numpy as np

from .._jax.concrete import concrete, concrete_evaluation
from .._machine.table_numbers import is_by_tables
from .._system.compliant import CompliantContact, CompliantStop
from .._system.friction import Friction
from .._system.system import ImpactSystem
from .modal import ModalFlow
from .modal_tables import Modes
from .modes import MAX_SETS, are_modes_accurate, modes_of_set, speeds_of


def switching_modal_flow(
    system: ImpactSystem, *, band: tuple[float, float] | None = None
) -> ModalFlow | None:
    """Tabulate the modes of all sets, or return None; arguments as `modal_flow` takes them."""
    known = [concrete(a) for a in (system.mass, system.damping, system.stiffness)]
    matrices, elements = [a for a in known if a is not None], _elements(system)
    if (
        is_by_tables(system)
        or system.hysteresis
        or elements is None
        or len(matrices) < len(known)
        or system.has_full_mass
    ):
        return None
    with concrete_evaluation():
        has_lanes = matrices[0].ndim == 2
        mass, damping, stiffness = (np.moveaxis(a, -1, 0) if has_lanes else a[None] for a in matrices)
        sets = _sets(elements)
        if len(sets) > MAX_SETS or len(elements) > _MAX_ELEMENTS:
            return None
        tables, speeds = [], speeds_of(system, band)
        for held, closed in sets:
            own_stiffness, own_damping = stiffness, damping
            for j in closed:
                mass_number, k, c, _ = elements[j]
                place = np.zeros((1, *stiffness.shape[1:]))
                place[0, mass_number, mass_number] = 1.0
                own_stiffness = own_stiffness + k[:, None, None] * place
                own_damping = own_damping + c[:, None, None] * place
            table = modes_of_set(mass, own_damping, own_stiffness, held)
            if table is None or not are_modes_accurate(table[0], table[1], speeds):
                return None
            tables.append(table)
        return _flow(sets, tables, mass.shape[1], len(elements), mass.dtype, has_lanes=has_lanes)


# With more elements the loop over lanes takes minutes to compile, which modes do not win back.
_MAX_ELEMENTS = 2

# Mass of an element, its stiffness and damping over lanes, and whether it may hold the mass.
_Element = tuple[int, np.ndarray, np.ndarray, bool]


def _elements(system: ImpactSystem) -> list[_Element] | None:
    """Elements of a machine; None where one names several masses, may move, is traced, or is friction of a contact."""
    found: list[_Element] = []
    for element in (*system.stops, *system.friction):
        if len(element.coefficients) != 1:
            return None
        ((mass, coefficient),) = element.coefficients.items()
        numbers = [coefficient, element.velocity] if isinstance(element, Friction) else [coefficient]
        is_compliant = isinstance(element, CompliantStop | CompliantContact)
        if is_compliant:
            numbers += [element.stiffness, element.damping, element.preload]
        known = [a for a in map(concrete, numbers) if a is not None]
        if len(known) < len(numbers):
            return None
        if isinstance(element, Friction):
            if element.is_tied or known[1].any():
                return None
        elif element.motion is not None:
            return None
        k, c, can_hold = np.zeros(1), np.zeros(1), True
        if is_compliant:
            square = np.atleast_1d(known[0]) ** 2
            k, c, can_hold = square * known[1], square * known[2], bool(known[3].any())
        found.append((mass, k, c, can_hold))
    return found


def _sets(elements: list[_Element]) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Sets of held masses and of compliant contacts closed on others; nothing held and closed first."""
    holdable = sorted({mass for mass, _, _, can_hold in elements if can_hold})
    springs = [j for j, (_, k, c, _) in enumerate(elements) if k.any() or c.any()]
    sets = []
    for held in _subsets(holdable):
        free = [j for j in springs if elements[j][0] not in held]
        sets += [(held, closed) for closed in _subsets(free)]
    return sets


def _subsets(items: list[int]) -> list[tuple[int, ...]]:
    return [some for size in range(len(items) + 1) for some in combinations(items, size)]


def _flow(
    sets: list[tuple[tuple[int, ...], tuple[int, ...]]],
    tables: list[tuple[np.ndarray, ...]],
    n: int,
    num_elements: int,
    dtype: np.dtype,
    *,
    has_lanes: bool,
) -> ModalFlow:
    arrays = []
    for column in zip(*tables, strict=True):
        lanes = max(len(a) for a in column)
        column = [np.broadcast_to(a, (lanes, *a.shape[1:])) for a in column]
        arrays.append(np.moveaxis(np.stack(column), 1, -1).astype(dtype))
    held = np.array([[i in masses for i in range(n)] for masses, _ in sets])[..., None]
    closed = np.array([[j in contacts for j in range(num_elements)] for _, contacts in sets])[..., None]
    if not has_lanes:
        arrays, held, closed = [a[..., 0] for a in arrays], held[..., 0], closed[..., 0]
    return ModalFlow(Modes(*map(jax.device_put, arrays)), jax.device_put(held), jax.device_put(closed))
