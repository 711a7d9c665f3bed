"""The function of a family as a program: traced once, keyed by what it computes, evaluated for many points at once.

Two functions with the same program are one to everything that is compiled, as the cell of a notebook that is run again.
"""

import hashlib
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array

from .._dataset_attributes import version
from .._jax.concrete import ERRORS_OF_TRACERS, concrete_evaluation, is_tracer
from .._jax.jaxprs import key_of_jaxpr, reached_outputs
from .._jax.xla import compile_lightly
from .force import force_of
from .system import ImpactSystem, check_again, with_args

Kinds = tuple[tuple[tuple[int, ...], Any], ...]

# Points of one call. One size for all: the bits of a point do not depend on how many there are.
_TOGETHER = 256
_TRACED = (
    "The function of a family is traced: use `jnp.where` in place of `if`, and `jax.numpy` in place of NumPy, on its values. Bind "
    "what is no number by `functools.partial`."
)


def kinds_of(numbers: Iterable[Any]) -> Kinds:
    """Shapes and types of numbers."""
    return tuple((tuple(np.shape(a)), jnp.result_type(a)) for a in numbers)


class FamilyProgram:
    """The function of a family, its names, and its trace; equal to another of the same trace.

    Args:
        function: takes numbers by name and returns a machine.
        names: of the numbers.
        labels: words for names.
        kinds: shapes and types of the numbers.
    """

    def __init__(
        self, function: Callable, names: tuple[str, ...], labels: tuple[tuple[str, str], ...], kinds: Kinds
    ):
        self.function, self.names, self.labels, self.kinds = function, names, labels, kinds

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, FamilyProgram) and self._key == other._key)

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return self.name

    def __reduce__(self) -> tuple:
        # The trace is made where it is needed: a worker may read this before it sets its precision.
        return FamilyProgram, (self.function, self.names, self.labels, self.kinds)

    @property
    def name(self) -> str:
        """Name of the function."""
        function = self.function
        while not hasattr(function, "__qualname__") and hasattr(function, "func"):
            function = function.func
        return str(getattr(function, "__qualname__", type(function).__name__)).rpartition(".")[2]

    def check(self) -> None:
        """Trace the function, which refuses one that makes no machine."""
        self._traced  # noqa: B018

    def of_kinds(self, kinds: Kinds) -> "FamilyProgram":
        """The program for numbers of other shapes.

        Raises:
            ValueError: if the function then returns another kind of machine.
        """
        if kinds == self.kinds:
            return self
        found = FamilyProgram(self.function, self.names, self.labels, kinds)
        _check_alike(self.shapes(), found.shapes())
        return found

    def shapes(self) -> ImpactSystem:
        """The machine as shapes and types of its arrays, its force bound."""
        return self._traced[2]

    def machine(self, numbers: tuple[Any, ...]) -> ImpactSystem:
        """The machine at numbers, its force bound. Concrete numbers are checked, and evaluated one operation after another."""
        own = self.of_kinds(kinds_of(numbers))
        leaves = own._run(*numbers)
        if not any(map(is_tracer, numbers)):  # results that are arguments or constants may be NumPy's
            leaves = map(jnp.asarray, leaves)
        found = jax.tree.unflatten(jax.tree.structure(own.shapes()), leaves)
        check_again(found)
        return found

    def machines(
        self,
        machine: ImpactSystem,
        numbers: tuple[Any, ...],
        lanes: Mapping[int, np.ndarray],
        *,
        without: Collection[int] = (),
    ) -> ImpactSystem:
        """Machines in lanes, their forces bound: NumPy arrays, lanes last.

        Args:
            machine: the machine at the numbers, its force bound.
            numbers: all numbers, concrete.
            lanes: by their places the numbers that move, with lanes as last axis.
            without: places of leaves that are not computed.

        Returns:
            The machines; leaves that no number that moves reaches, and those not computed, are those of `machine`, with a single lane.
        """
        flags = tuple(flag and k not in without for k, flag in enumerate(self.reached_by(lanes)))
        shared, structure = jax.tree.flatten(machine)
        moved = [np.moveaxis(np.asarray(lanes[k]), -1, 0) for k in sorted(lanes)]
        fixed = [np.asarray(a) for k, a in enumerate(numbers) if k not in lanes]
        which, found = tuple(k in lanes for k in range(len(numbers))), iter(())
        if any(flags):
            with concrete_evaluation():
                found = iter(_in_parts(self, which, flags, moved, fixed))
        leaves = [
            next(found) if flag else np.asarray(a)[..., None] for flag, a in zip(flags, shared, strict=True)
        ]
        return jax.tree.unflatten(structure, leaves)

    def reached_by(self, places: Collection[int]) -> tuple[bool, ...]:
        """Flags of the leaves of the machine that depend on the numbers at some places."""
        jaxpr = self._traced[0].jaxpr
        return tuple(reached_outputs(jaxpr, [k in places for k in range(len(jaxpr.invars))]))

    @cached_property
    def digest(self) -> str:
        """Digest of the releases that make the program, and of the program, which other processes find too."""
        releases = repr([(name, version(name)) for name in ("vijax", "jax", "equinox")])
        # Functions are told by their names; what a force computes is told by its program.
        text = re.sub(r"0x[0-9a-f]+", "", repr((self._key, _key_of_force(self.shapes()))))
        return "-".join(hashlib.sha256(a.encode()).hexdigest()[:24] for a in (releases, text))

    @cached_property
    def _run(self) -> Callable:
        return jaxpr_as_fun(self._traced[0])

    @cached_property
    def _traced(self) -> tuple[Any, Any, ImpactSystem]:
        """The program, the structure of the machine, and the shapes of its arrays."""
        structure: Any = None

        def leaves_of(*numbers: Array) -> list:
            nonlocal structure
            found = self.function(**dict(zip(self.names, numbers, strict=True)))
            _check_machine(found)
            leaves, structure = jax.tree.flatten(with_args(found, None))
            _refuse_enclosed(found.force)
            return leaves

        shapes = [jax.ShapeDtypeStruct(*kind) for kind in self.kinds]
        try:
            program, found = jax.make_jaxpr(leaves_of, return_shape=True)(*shapes)
        except ERRORS_OF_TRACERS as error:
            error.args = (f"{_TRACED}\n{error}",)
            raise
        except ValueError as error:
            if "Tracer" in str(error):  # a check of a number that must be known, such as a count
                error.args = (f"{error} {_TRACED}",)
            raise
        if any(map(is_tracer, program.consts)):
            raise ValueError(
                "The function of a family reads a traced number that is none of its values: give it as a value, "
                "vx.Family(function, name=number)."
            )
        return program, structure, jax.tree.unflatten(structure, found)

    @cached_property
    def _key(self) -> tuple:
        program, structure, _ = self._traced
        return self.names, self.kinds, structure, key_of_jaxpr(program)

    @cached_property
    def _hash(self) -> int:
        return hash(self._key)


def _key_of_force(shapes: ImpactSystem) -> tuple | None:
    """Key of the program of a force, bound; None if there is none."""
    if shapes.force is None:
        return None
    t, x = shapes.forcing.frequency, jax.ShapeDtypeStruct((shapes.num_masses,), shapes.stiffness.dtype)
    return key_of_jaxpr(jax.make_jaxpr(lambda force, *at: force(*at))(force_of(shapes, t), t, x, x))


def _in_parts(
    program: FamilyProgram, which: tuple[bool, ...], flags: tuple[bool, ...], moved: list, fixed: list
) -> list[np.ndarray]:
    """The leaves flagged, for parts of the lanes, joined; lanes last."""
    num = len(moved[0])
    parts = [np.minimum(np.arange(k, k + _TOGETHER), num - 1) for k in range(0, num, _TOGETHER)]
    found = [_leaves_of_lanes(program, which, flags, [a[part] for a in moved], fixed) for part in parts]
    return [
        np.concatenate([np.asarray(a) for a in own], axis=-1)[..., :num] for own in zip(*found, strict=True)
    ]


@compile_lightly
def _leaves_of_lanes(
    program: FamilyProgram, which: tuple[bool, ...], flags: tuple[bool, ...], moved: list, fixed: list
) -> list[Array]:
    def leaves_at(moved: list) -> list[Array]:
        of_moved, of_fixed = iter(moved), iter(fixed)
        numbers = [next(of_moved if moves else of_fixed) for moves in which]
        leaves = jax.tree.leaves(program.machine(tuple(numbers)))
        return [a for a, flag in zip(leaves, flags, strict=True) if flag]

    return jax.vmap(leaves_at, out_axes=-1)(moved)


def _check_machine(found: Any) -> None:
    if not isinstance(found, ImpactSystem):
        raise ValueError(
            f"The function of a family must return a machine, a `vx.ImpactSystem`, but returned {type(found).__name__}."
        )


def _check_alike(one: ImpactSystem, other: ImpactSystem) -> None:
    """Refuse machines of which one has other masses, stops or sides than the other."""
    first, second = map(_make, (one, other))
    if first != second:
        raise ValueError(
            "The function of a family must return machines of one kind: the same masses, stops, sides and rows, loads of as many "
            "harmonics and the same force at all values. What differs needs a family of its own."
        )


def _make(system: ImpactSystem) -> tuple:
    elements = [
        (type(one), getattr(one, "mass", None), getattr(one, "side", None), tuple(one.coefficients))
        for one in (*system.stops, *system.friction, *system.hysteresis)
    ]
    return elements, system.num_states, [tuple(a.shape) for a in jax.tree.leaves(system)]


def _refuse_enclosed(force: Any) -> None:
    """Refuse a force that encloses traced values, which would outlive the trace."""
    for leaf in jax.tree.leaves(getattr(force, "rest", force), is_leaf=callable):
        cells = getattr(leaf, "__closure__", None) or ()
        if any(is_tracer(cell.cell_contents) for cell in cells):
            raise ValueError(
                "The `force` of a family's machine encloses values of the family: make it an `eqx.Module` whose fields are these "
                "numbers, or a `jax.tree_util.Partial` of them."
            )
