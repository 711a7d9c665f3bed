"""Machines as functions of named values.

A parameter of a machine is one of its leaves; a parameter of a family is one of its values, which may move many leaves at
once. Both are modules whose leaves are found by path (`parameters.py`), and `machine_of` gives the machine of either:
of a machine itself, of a family that of its function. Everything that varies a parameter sets a leaf and asks for the
machine; nothing else knows of families.
"""

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import concrete_evaluation, has_tracer
from .family_program import FamilyProgram, kinds_of
from .spelling import did_you_mean
from .system import AbstractFamily, AnySystem, ImpactSystem, machine_of

# Names of the start of a sweep, which stand beside those of the machine.
_OF_START = ("x0", "v0")


class Family(AbstractFamily):
    """Machines as a function of named values.

    It stands wherever a machine does, and its names are then the parameters: in sweeps, along branches, in derivatives. One
    value may move any number of entries of the machine. Its attributes are those of the machine at its values, as
    `family.forcing.period`.

    As a pytree its leaves are its values: `jax.grad`, `jax.jit` and `jax.vmap` take it like an array.

    Args:
        function: takes numbers or arrays by name and returns a `vx.ImpactSystem`, by operations of JAX. It is traced: what
            it returns must have the same masses, stops, sides and rows at all values; write `jnp.where` in place of `if`.
            Bind what is no number, or must not vary, by `functools.partial`.
        labels: words for names, as in `{"frequency": "Speed (rad/s)"}`, on the axes of pictures.
        values: a value for each name, a number or an array; names left out take the defaults of the function.

    Raises:
        ValueError: for an unknown name, a name without a value, a function that returns no machine, or values that make
            no valid one.

    Example:
        ```python
        import numpy as np, vijax as vx
        def rotor(frequency, eccentricity=0.01, clearance=0.02):
            unbalance = vx.Harmonic([eccentricity * frequency**2], frequency)
            return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], unbalance, [vx.Stop(0, clearance, "upper", 0.7)])
        family = vx.Family(rotor, frequency=0.8)
        ds = vx.sweep(family, {"frequency": np.linspace(0.3, 2.0, 100), "clearance": [0.01, 0.02]})
        ```
    """

    numbers: tuple[Any, ...]
    program: FamilyProgram = eqx.field(static=True)

    def __init__(self, function: Any, /, *, labels: Mapping[str, str] | None = None, **values: Numbers):
        given = _all_values(function, values)
        self.numbers = tuple(as_float(a, name) for name, a in given.items())
        words = _checked_labels(labels, given)
        self.program = FamilyProgram(function, tuple(given), words, kinds_of(self.numbers))
        self.program.check()
        if not has_tracer(self.numbers):
            self.bound_system  # noqa: B018  refuses values that make no machine

    @property
    def values(self) -> dict[str, Any]:
        """Values by their names, in the order of the function's arguments."""
        return dict(zip(self.program.names, self.numbers, strict=True))

    @property
    def function(self) -> Callable:
        """The function."""
        return self.program.function

    @property
    def labels(self) -> dict[str, str]:
        """Words for names."""
        return dict(self.program.labels)

    @property
    def bound_system(self) -> ImpactSystem:
        """The machine at the values, its force bound to its `args`."""
        if has_tracer(self.numbers):
            return self.program.machine(self.numbers)
        has_64_bits = bool(jax.config.read("jax_enable_x64"))
        kept = self.__dict__.get("_kept")
        if kept is None or kept[0] != has_64_bits:
            with concrete_evaluation():
                kept = has_64_bits, self.program.machine(self.numbers)
            object.__setattr__(self, "_kept", kept)
        return kept[1]

    def at(self, **values: Numbers) -> "Family":
        """The family at other values; names left out keep theirs.

        Raises:
            ValueError: for an unknown name, or a value with which the function returns another kind of machine.
        """
        _refuse_unknown(self.program.names, values)
        numbers = tuple(as_float(a, name) for name, a in (self.values | values).items())
        return Family.of_program(self.program.of_kinds(kinds_of(numbers)), numbers)

    @classmethod
    def of_program(cls, program: FamilyProgram, numbers: tuple[Any, ...]) -> "Family":
        """The family of a function that is traced already."""
        found = object.__new__(cls)
        object.__setattr__(found, "numbers", numbers)
        object.__setattr__(found, "program", program)
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {name: a for name, a in self.__dict__.items() if name != "_kept"}

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={_short(a)}" for name, a in self.values.items())
        return f"Family({self.program.name}, {values})"


def structure_of(system: AnySystem) -> ImpactSystem:
    """The machine itself, or that of a family with shapes in place of its arrays: what its elements are, at any values."""
    return system.program.shapes() if isinstance(system, Family) else machine_of(system)


def _short(value: Any) -> str:
    return (
        f"{value}" if has_tracer(value) else np.array2string(np.asarray(value), precision=6, separator=", ")
    )


def _all_values(function: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values by name: those given, and the numbers among the defaults of the function."""
    if not callable(function):
        raise ValueError(
            f"Argument `function` of `vx.Family` must be a function that returns a machine, but is {function!r}."
        )
    parameters = inspect.signature(function).parameters.values()
    fixed = _bound_names(function)
    by_name = [
        a for a in parameters if a.kind in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY) and a.name not in fixed
    ]
    if any(a.kind == a.POSITIONAL_ONLY and a.default is a.empty for a in parameters):
        raise ValueError(
            "The function of a family is called with names: none of its arguments may be positional only."
        )
    if not any(a.kind == a.VAR_KEYWORD for a in parameters):
        _refuse_unknown([a.name for a in by_name], values)
    missing = [a.name for a in by_name if a.default is a.empty and a.name not in values]
    if missing:
        raise ValueError(
            f"The function of a family needs a value for {' and '.join(f'`{name}`' for name in missing)}, which has no default: "
            f"vx.Family({getattr(function, '__name__', 'function')}, {missing[0]}=...)."
        )
    reserved = [name for name in (*(a.name for a in by_name), *values) if name in (*_OF_START, "labels")]
    if reserved:
        raise ValueError(
            f"The name `{reserved[0]}` is no name for a value of a family: `x0` and `v0` are the start, `labels` are words."
        )
    defaults = {a.name: a.default for a in by_name if a.default is not a.empty and _is_numeric(a.default)}
    found = {
        a.name: values.get(a.name, defaults.get(a.name)) for a in by_name if a.name in {**defaults, **values}
    }
    found |= {name: a for name, a in values.items() if name not in found}
    if not found:
        raise ValueError("The function of a family must take at least one number by name.")
    return found


def _bound_names(function: Callable) -> set[str]:
    """Names that `functools.partial` has bound."""
    names: set[str] = set()
    while isinstance(function, partial):
        names |= set(function.keywords)
        function = function.func
    return names


def _is_numeric(default: Any) -> bool:
    """True for a default that is a value of the family: a number, no flag, or an array or list of numbers."""
    if isinstance(default, bool | np.bool_) or default is None or isinstance(default, str):
        return False
    try:
        return np.asarray(default).dtype.kind in "iuf"
    except (ValueError, TypeError):
        return False


def _refuse_unknown(names: Any, values: Mapping[str, Any]) -> None:
    for name in values:
        if name not in names:
            raise ValueError(
                f"The family has no value `{name}`: it has {', '.join(names)}.{did_you_mean(name, names)}"
            )


def _checked_labels(
    labels: Mapping[str, str] | None, names: Mapping[str, Any]
) -> tuple[tuple[str, str], ...]:
    for name in labels or {}:
        _refuse_unknown(names, {name.partition("[")[0]: None})
    return tuple((labels or {}).items())
