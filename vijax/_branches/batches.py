"""Kernels called for batches of branches: sizes of batches, families, packed rows."""

from collections.abc import Callable, Hashable, Sequence as Many
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from .._jax.packing import Packed, pack
from .._jax.xla import jit_for_lanes, jit_lightly, jit_quickly
from .._system.system import machine_of
from .padding import ROOM_OF_SIMULATION
from .parameter_family import ParameterFamily
from .step_kernel import each_row, first_corrections, take_steps

# `_WORTH_IT`: fewest branches of one call for which kernels are compiled for `BATCHES`.
# `_CHEAPER`: fewest of them that wait for a kernel for which these are taken. All branches of a batch wait for the slowest: one
# by one, branches that differ take a tenth of the time.
# What earlier calls have compiled must not count: the two forms differ in the last bits.
_WORTH_IT, _CHEAPER = 512, 32


class FamilyStack:
    """Stacked families of one tree structure and shapes; several tasks may share one.

    Attributes:
        has_grip: True with friction of contacts.
        switches: True for machines whose forces switch.
        has_second: True for families of two parameters.
        known: answers that hold for all of them, see `HostCall`.
    """

    def __init__(self, families: dict[int, ParameterFamily]):
        # What a family has depends on its tree structure and shapes alone: it is not asked of each.
        first = next(iter(families.values()))
        self.switches, self.has_grip = machine_of(first.system).is_switching, first.has_tied_friction
        self.has_second, self.known = first.second is not None, {}
        own = {id(family): family for family in families.values()}
        self.rows = pack(stacked(list(own.values())), has_rows=True)
        rows = {one: row for row, one in enumerate(own)}
        self.place = {k: rows[id(family)] for k, family in families.items()}

    def form(self, num: int) -> "Form":
        """Form in which a kernel is called for so many of the tasks."""
        few = RUNS_BEHIND if self.switches else SINGLES
        return BATCHES if len(self.place) >= _WORTH_IT and num >= _CHEAPER else few

    def of(self, tasks: Many[int]) -> Packed:
        """Families of some tasks."""
        return self.rows.at(np.array([self.place[k] for k in tasks]))


class Form(NamedTuple):
    """Form in which kernels are compiled: size of the batch; tries and room of `take_steps`, see there."""

    size: int
    tries: int
    room: int | None


# SINGLES: each of few branches takes many steps in a call, and one program serves most simulations. It is that of one branch
# without `vmap`, see `each_row`.
# RUNS_BEHIND: the same of machines whose forces switch, whose runs are made by the program of `simulate`. That costs 0.3 ms a
# point, a fifteenth of it; of rigid contacts alone it would be a third.
# BATCHES: corrections of many are written out, one step in a call, which runs as often as there are branches for it.
SINGLES, RUNS_BEHIND, BATCHES = Form(1, 16, ROOM_OF_SIMULATION), Form(1, 16, None), Form(64, 1, 0)


def stacked(trees: list) -> Any:
    """Trees stacked along a first axis."""
    return jax.tree.map(lambda *a: np.array(a), *trees)


def call(
    program: Callable, stack: FamilyStack, tasks: Many[int], rows: Any, form: Form | None = None
) -> dict[int, Any]:
    """Results of a kernel for some tasks and the rows of its other arguments, computed batch by batch, in a form."""
    size = (form or stack.form(len(tasks))).size
    run = compiled(program, size)
    return answers(tasks, in_batches(run, size, stack.of(tasks), pack(rows, has_rows=True))[0])


def answers(tasks: Many[int], found: Packed) -> dict[int, Any]:
    """Results of a kernel, one for each task."""
    return dict(zip(tasks, found.each_unpacked(), strict=True))


def in_batches(run: Callable, size: int, *arguments: Any) -> tuple[Packed, ...]:
    """Call a compiled kernel for parts of a batch, each of a size, and join its results."""
    num = len(arguments[0].reals)
    # The last part is filled up with its last row.
    parts = [np.minimum(np.arange(k, k + size), num - 1) for k in range(0, num, size)]
    found = [run(*(_taken(a, part) for a in arguments)) for part in parts]
    return tuple(joined([one.in_numpy() for one in own], num) for own in zip(*found, strict=True))


def joined(parts: list[Packed], num: int | None = None) -> Packed:
    """Batches of one layout as one batch, or its first rows."""
    reals, wholes = (
        own[0] if len(own) == 1 else np.concatenate(own)
        for own in zip(*((a.reals, a.wholes) for a in parts), strict=True)
    )
    return Packed(reals[:num], wholes[:num], parts[0].layout)


def _taken(rows: Packed | np.ndarray, part: np.ndarray) -> Packed | np.ndarray:
    return rows.at(part) if isinstance(rows, Packed) else rows[part]


@cache
def compiled(program: Callable, size: int) -> Callable:
    """A compiled kernel of packed rows, batches of which have a size."""

    def of_rows(families: Packed, arguments: Packed) -> tuple[Packed]:
        def of_row(family: Packed, arguments: Packed) -> Packed:
            return pack(program(family.unpacked(), *arguments.unpacked()))

        return (each_row(of_row)(families, arguments),)

    of_rows.__name__ = program.__name__  # its name in profiles
    jit = jit_quickly if size == 1 else jit_lightly  # one row: it runs where a branch meets something
    return jit(of_rows, name=(program.__module__, program.__qualname__))


@cache
def compiled_steps(form: Form) -> Callable:
    """`take_steps` for packed rows: points from which to step on, and the other results."""

    def of_rows(
        families: Packed, requests: Packed, points: Packed, ds: Any, most: Any, *known: Packed
    ) -> tuple[Packed, Packed]:
        own = families.unpacked(), requests.unpacked(), points, ds, most
        found = take_steps(*own, tries=form.tries, room=form.room, cycle=known[0] if known else None)
        return found.point, pack(found._replace(point=None), has_rows=True)

    of_rows.__name__ = "take_steps"
    run = jit_lightly(of_rows, name=(take_steps.__module__, *form))
    if form is not BATCHES:
        return run
    correct = _compiled_corrections()
    return lambda *rows: run(*rows, correct(*rows[:4]))


@cache
def _compiled_corrections() -> Callable:
    """`first_corrections` for packed rows."""

    def of_rows(families: Packed, requests: Packed, points: Packed, ds: Any) -> Packed:
        found = first_corrections(families.unpacked(), requests.unpacked(), points, ds)
        return pack(found, points.layout, has_rows=True)

    of_rows.__name__ = "first_corrections"
    return jit_for_lanes(of_rows, name=(take_steps.__module__, of_rows.__name__))


def makes_of(families: Many[ParameterFamily]) -> tuple[list[int], list[FamilyStack]]:
    """Number of the make (tree structure and shapes) of each family, and the stacked families of each make."""
    members: dict[int, dict[int, ParameterFamily]] = {}
    numbers: dict[Hashable, int] = {}
    makes, known = [], {}
    for k, family in enumerate(families):
        if id(family) not in known:
            leaves, structure = jax.tree.flatten(family)
            make = structure, *map(np.shape, leaves)
            known[id(family)] = numbers.setdefault(make, len(numbers))
        makes.append(known[id(family)])
        members.setdefault(makes[-1], {})[k] = family
    return makes, [FamilyStack(own) for own in members.values()]
