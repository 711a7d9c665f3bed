"""Calls of public functions: where an argument of a wrong kind makes one fail, a sentence names it; another follows Ctrl-C.

What a function refuses itself it says best, and passes unchanged. Else Python speaks from deep inside, as "'str' object has no attribute
'lanes'", and the annotations say which argument cannot be what it is. Nothing is looked at before a call fails, so calls cost what they did, and
none is refused that works. Calls inside the package do not come here. Rejected alternative: beartype or jaxtyping at each call, whose messages are a
page, and which refuse an integer where a number stands.
"""

import functools
import inspect
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from numbers import Real
from os import PathLike
from types import FunctionType, NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    SupportsFloat,
    SupportsIndex,
    Union,
    get_args,
    get_origin,
)

import jax
import numpy as np
from jaxtyping import AbstractArray

from ._jax.concrete import ERRORS_OF_TRACERS, has_tracer

# Longer lists are not looked through: they are, where they become an array.
_LONGEST = 1000


class _Kind(NamedTuple):
    """Kind of arguments: whether a value is of it, and its words, as "a number"."""

    accepts: Callable[[Any], bool]
    words: str


def with_explained_errors(public: Any, module: str) -> Any:
    """A function of the public `module` whose errors name the argument of a wrong kind; what is no function stays as it is."""
    if not isinstance(public, FunctionType):
        return public

    @functools.wraps(public)
    def explained(*args: Any, **named: Any) -> Any:
        try:
            return public(*args, **named)
        except KeyboardInterrupt as stopped:
            if stopped.args:  # says itself what is kept
                raise
            told = KeyboardInterrupt("Stopped; nothing is kept, and the same call begins anew.")
        except (TypeError, AttributeError, LookupError, ValueError) as error:
            sentence = _explanation(public, args, named, error)
            if sentence is None:
                raise
            told = ValueError(sentence)
        raise told

    explained.__module__ = module  # where `pickle` finds this one
    return explained


def _explanation(
    public: FunctionType, args: tuple[Any, ...], named: Mapping[str, Any], error: Exception
) -> str | None:
    """Sentence in place of an error, None where it says best itself what is wrong: where a name stands in its first line."""
    if isinstance(error, (ValueError, *ERRORS_OF_TRACERS)) and "`" in str(error).partition("\n")[0]:
        return None
    if isinstance(error, ERRORS_OF_TRACERS):
        return _first_traced(public, args, named)
    return _unknown_property(public, named, error) or _first_wrong(public, args, named)


def _given(
    public: FunctionType, args: tuple[Any, ...], named: Mapping[str, Any]
) -> Iterator[tuple[str, Any]]:
    """Names and values of the arguments."""
    parameters = inspect.signature(public).parameters.values()
    by_place = [one.name for one in parameters if one.kind is one.POSITIONAL_OR_KEYWORD]
    yield from zip(by_place, args, strict=False)
    yield from named.items()


def _first_traced(public: FunctionType, args: tuple[Any, ...], named: Mapping[str, Any]) -> str | None:
    """Sentence on the first argument with traced numbers, None if there is none."""
    for name, value in _given(public, args, named):
        if has_tracer(value):
            return f"Argument `{name}` must be made of known numbers here: call `{public.__name__}` outside of `jax.jit`, `jax.vmap` and derivatives."
    return None


def _first_wrong(public: FunctionType, args: tuple[Any, ...], named: Mapping[str, Any]) -> str | None:
    """Sentence on the first argument of a kind that its annotation does not have, None if there is none."""
    for name, value in _given(public, args, named):
        kinds = _kinds(public.__annotations__.get(name, Any))
        if kinds and not any(kind.accepts(value) for kind in kinds):
            return _sentence(name, value, kinds)
    return None


def _unknown_property(public: FunctionType, named: Mapping[str, Any], error: Exception) -> str | None:
    """Sentence on an argument that a picture handed to matplotlib, which has no such property; None if the error is another."""
    name = re.search(r"unexpected keyword argument '(\w+)'", str(error))
    parameters = inspect.signature(public).parameters.values()
    if name is None or name[1] not in named or not any(one.kind is one.VAR_KEYWORD for one in parameters):
        return None
    own = ", ".join(f"`{one.name}`" for one in parameters if one.kind is not one.VAR_KEYWORD)
    return f"Argument `{name[1]}` must be one of {own}, or a property of what matplotlib draws, as `color`, but is neither."


def _sentence(name: str, value: Any, kinds: Sequence[_Kind]) -> str:
    is_short = isinstance(value, str | Real | list | tuple | dict | None)
    given = reprlib.repr(value) if is_short else f"a {type(value).__name__}"
    return f"Argument `{name}` must be {_either(kinds)}, but is {given}."


def _either(kinds: Sequence[_Kind]) -> str:
    return " or ".join(dict.fromkeys(kind.words for kind in kinds))


def _kinds(annotation: Any) -> tuple[_Kind, ...]:
    """Kinds of the members of a union; none where one of them is not told from others here."""
    members = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    numbers = ()
    if jax.Array in members:
        members = tuple(one for one in members if one not in _OF_NUMBERS)
        numbers = (_NUMBERS,)
    found = tuple(_kind(one) for one in members)
    return () if None in found else (*numbers, *(kind for kind in found if kind is not None))


def _kind(annotation: Any) -> _Kind | None:
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:  # `Count`, which functions look at themselves
        return _A_COUNT
    if origin is tuple:
        return _tuple_of(parts)
    if origin in (Sequence, list):
        return _list_of(_kinds(parts[0]))
    if origin in (Mapping, dict) or annotation is Mapping:
        return _dictionary_of(*map(_kinds, parts or (Any, Any)))
    if origin is Literal:  # which of the words is looked at by the function
        return _Kind(lambda value: isinstance(value, str), " or ".join(map(repr, parts)))
    if origin is Callable or annotation is Callable:
        return _Kind(callable, "a function")
    if origin is PathLike or annotation is PathLike:
        return _Kind(lambda value: isinstance(value, PathLike), "a path")
    return _KINDS.get(annotation) or _of_class(annotation)


def _of_class(annotation: Any) -> _Kind | None:
    """Results, datasets, axes; machines, loads and flows have sentences of their own where they are read."""
    if not isinstance(annotation, type):
        return None
    if issubclass(annotation, AbstractArray):
        return _NUMBERS
    library, name = annotation.__module__.partition(".")[0], annotation.__name__
    if library not in _HOMES or name.startswith("Abstract") or name in ("ImpactSystem", "Family"):
        return None
    return _Kind(lambda value: isinstance(value, annotation), f"a `{_HOMES[library]}{name}`")


def _list_of(entries: tuple[_Kind, ...]) -> _Kind:
    def accepts(value: Any) -> bool:
        if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
            return False
        is_open = not entries or not isinstance(value, Sized) or len(value) > _LONGEST
        return is_open or all(any(kind.accepts(one) for kind in entries) for one in value)

    return _Kind(accepts, f"a list, each entry {_either(entries)}" if entries else "a list")


def _dictionary_of(keys: tuple[_Kind, ...], values: tuple[_Kind, ...]) -> _Kind:
    def accepts(value: Any) -> bool:
        return isinstance(value, Mapping) and all(
            not kinds or any(kind.accepts(one) for kind in kinds)
            for kinds, part in ((keys, value.keys()), (values, value.values()))
            for one in part
        )

    words = [f"each {name} {_either(kinds)}" for name, kinds in (("key", keys), ("value", values)) if kinds]
    return _Kind(accepts, ", ".join(["a dictionary", *words]))


def _tuple_of(parts: tuple[Any, ...]) -> _Kind:
    entries = [_kinds(part) for part in parts]
    words = {_either(kinds) for kinds in entries}

    def accepts(value: Any) -> bool:
        if (
            isinstance(value, str | Mapping)
            or not isinstance(value, Sized)
            or not isinstance(value, Iterable)
        ):
            return False
        return len(value) == len(entries) and all(
            not kinds or any(kind.accepts(one) for kind in kinds)
            for kinds, one in zip(entries, value, strict=True)
        )

    return _Kind(
        accepts, f"{len(parts)} entries" + (f", each {words.pop()}" if len(words) == 1 and all(words) else "")
    )


def _is_number(value: Any) -> bool:
    if hasattr(value, "dtype"):  # of NumPy, JAX, also traced
        return not np.ndim(value)
    return isinstance(value, SupportsFloat)


def _shape_of_numbers(value: Any) -> tuple[int, ...] | None:
    """Shape of nested lists of numbers; None where an entry is no number, or the lists differ in length."""
    if hasattr(value, "dtype") or hasattr(value, "__array__"):
        return np.shape(value)
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Sequence):
        return () if isinstance(value, SupportsFloat) else None
    if len(value) > _LONGEST or not len(value):
        return (len(value),)
    shapes = {_shape_of_numbers(one) for one in value}
    inner = shapes.pop()
    return None if shapes or inner is None else (len(value), *inner)


_OF_NUMBERS = {jax.Array, np.ndarray, np.bool, np.number, bool, int, float, complex, Sequence[Any]}
_NUMBERS = _Kind(lambda value: _shape_of_numbers(value) is not None, "made of real numbers")
_A_COUNT = _Kind(_is_number, "a whole number")
_KINDS = {
    NoneType: _Kind(lambda value: value is None, "None"),
    bool: _Kind(lambda value: _is_number(value) and value in (0, 1), "True or False"),
    int: _Kind(lambda value: isinstance(value, SupportsIndex), "a whole number"),
    float: _Kind(_is_number, "a number"),
    str: _Kind(lambda value: isinstance(value, str), "a text"),
    np.ndarray: _Kind(lambda value: isinstance(value, np.ndarray), "an array"),
}
_HOMES = {"vijax": "vx.", "xarray": "xarray.", "matplotlib": "matplotlib.axes."}
