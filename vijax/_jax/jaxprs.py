"""Programs of JAX compared by what they compute, and which of their results depend on which arguments."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr, Literal

# Equations that call a program with their own arguments.
_CALLS = frozenset(
    "checkpoint closed_call core_call custom_jvp_call custom_vjp_call custom_vjp_call_jaxpr jit pjit remat remat2".split()
)


def key_of_jaxpr(program: Any) -> tuple:
    """Key of a closed program: equal for programs that compute the same with the same constants.

    The text of a program does not serve: it leaves arrays out, and tells functions by addresses.
    """
    return _key(program.jaxpr), tuple(map(_key_of_value, program.consts))


def reached_outputs(jaxpr: Any, moves: Sequence[bool]) -> list[bool]:
    """Flags of the results of a program that depend on the flagged arguments."""
    moving = {v for v, moved in zip(jaxpr.invars, moves, strict=True) if moved}
    is_moving = lambda v: not isinstance(v, Literal) and v in moving  # noqa: E731
    for equation in jaxpr.eqns:
        flags = [is_moving(v) for v in equation.invars]
        if any(flags):
            inner = _called(equation)
            outputs = [True] * len(equation.outvars) if inner is None else reached_outputs(inner, flags)
            moving |= {v for v, moved in zip(equation.outvars, outputs, strict=True) if moved}
    return [is_moving(v) for v in jaxpr.outvars]


def without_arguments(
    program: ClosedJaxpr, is_passed: Sequence[bool]
) -> tuple[ClosedJaxpr, list[int], list[int | None]]:
    """A closed program whose results are no arguments, and whose arguments are all read.

    Args:
        program: a program.
        is_passed: flags of what it is given, constants first, that is to be an argument; the rest are constants.

    Returns:
        The program; the numbers of its arguments; and for each result of the given one the number of what it hands back, or
        None.
    """
    jaxpr, values = program.jaxpr, dict(zip(program.jaxpr.constvars, program.consts, strict=True))
    variables = [*jaxpr.constvars, *jaxpr.invars]
    places = {v: k for k, v in enumerate(variables)}
    given = [None if isinstance(v, Literal) else places.get(v) for v in jaxpr.outvars]
    results = [v for v, k in zip(jaxpr.outvars, given, strict=True) if k is None]
    read, kept = {v for v in results if not isinstance(v, Literal)}, []
    for equation in reversed(jaxpr.eqns):
        if any(v in read for v in equation.outvars):
            kept.append(equation)
            read |= {v for v in equation.invars if not isinstance(v, Literal)}
    numbers = [k for k, v in enumerate(variables) if v in read and is_passed[k]]
    constants = [v for k, v in enumerate(variables) if v in read and not is_passed[k]]
    own = jaxpr.replace(
        constvars=constants, invars=[variables[k] for k in numbers], outvars=results, eqns=kept[::-1]
    )
    return ClosedJaxpr(own, [values[v] for v in constants]), numbers, given


def _called(equation: Any) -> Any:
    """The program that an equation calls with its own arguments, or None."""
    if equation.primitive.name not in _CALLS:
        return None
    for name in ("jaxpr", "call_jaxpr", "fun_jaxpr"):
        program = equation.params.get(name)
        inner = getattr(program, "jaxpr", program)
        if hasattr(inner, "eqns") and len(inner.invars) == len(equation.invars):
            return inner
    return None


def _key(jaxpr: Any) -> tuple:
    numbers: dict[Any, int] = {}

    def key_of(v: Any) -> Any:
        if isinstance(v, Literal):
            return _key_of_value(v.val), str(v.aval)
        return numbers.setdefault(v, len(numbers)), str(v.aval)

    arguments = tuple(map(key_of, [*jaxpr.constvars, *jaxpr.invars]))
    equations = tuple(
        (
            equation.primitive.name,
            tuple(map(key_of, equation.invars)),
            tuple(map(key_of, equation.outvars)),
            tuple((name, _key_of_param(a)) for name, a in sorted(equation.params.items())),
        )
        for equation in jaxpr.eqns
    )
    return len(jaxpr.constvars), arguments, equations, tuple(map(key_of, jaxpr.outvars))


def _key_of_param(value: Any) -> Any:
    inner = getattr(value, "jaxpr", value)
    if hasattr(inner, "eqns"):
        return _key(inner), tuple(map(_key_of_value, getattr(value, "consts", ())))
    if isinstance(value, tuple | list):
        return type(value), tuple(map(_key_of_param, value))
    if isinstance(value, dict):
        return tuple((name, _key_of_param(a)) for name, a in value.items())
    if isinstance(value, np.ndarray) or hasattr(value, "__array__"):
        return _key_of_value(value)
    try:
        hash(value)
    except TypeError:
        return _Same(value)
    # Key by (type, value): 1 == True would collide.
    return type(value), value


def _key_of_value(value: Any) -> Any:
    """Key of a number or an array, to the bit."""
    array = np.asarray(value)
    if array.dtype.kind not in "biufcV":
        return _Same(value)
    return str(array.dtype), array.shape, array.tobytes()


class _Same:
    """An object that equals itself alone, kept alive so that no other gets its `id`."""

    def __init__(self, value: Any):
        self._value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self._value is other._value

    def __hash__(self) -> int:
        return id(self._value)

    def __repr__(self) -> str:
        return type(self._value).__name__
