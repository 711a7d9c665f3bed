"""Signatures of public functions and classes as `help` prints them: names of types without their modules, aliases by their names.

Annotations stay as they are. `Numbers` alone would else be 130 characters, `vx.attractors` 25 lines.
"""

import inspect
from types import FunctionType, NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from jaxtyping import AbstractArray

_ARRAY_LIKE = {"Array", "ndarray", "bool", "number", "int", "float", "complex"}
_NUMBERS = {"ArrayLike", "Sequence[Any]"}
# Public names of classes behind others.
_PUBLIC = {"AbstractFamily": "Family"}


class _Words:
    """An annotation that is printed as a text."""

    def __init__(self, text: str):
        self.text = text

    def __repr__(self) -> str:
        return self.text


def with_short_signature(public: Any) -> Any:
    """The same object; if it is a function or a class, `help` prints short names of its types."""
    if isinstance(public, FunctionType):
        _shorten(public)
    elif isinstance(public, type):
        # The signature of a class of equinox is that of its `__init__`, and cannot be set on the class.
        for name, method in vars(public).items():
            if isinstance(method, FunctionType) and (name == "__init__" or not name.startswith("_")):
                _shorten(method)
    return public


def _shorten(function: FunctionType) -> None:
    if "__signature__" not in vars(function):
        whole = inspect.signature(function)
        short = [one.replace(annotation=_short(one.annotation)) for one in whole.parameters.values()]
        vars(function)["__signature__"] = whole.replace(
            parameters=short, return_annotation=_short(whole.return_annotation)
        )


def _short(annotation: Any) -> Any:
    return annotation if annotation is inspect.Signature.empty else _Words(words_of(annotation))


def words_of(annotation: Any) -> str:
    """Short text of an annotation."""
    if annotation is None or annotation is NoneType:
        return "None"
    if annotation is Any or isinstance(annotation, str):
        return str(annotation).removeprefix("typing.")
    if isinstance(annotation, list):  # arguments of a callable
        return f"[{', '.join(map(words_of, annotation))}]"
    if isinstance(annotation, type) and issubclass(annotation, AbstractArray):
        return f"{annotation.dtype.__name__}[{words_of(annotation.array_type)}, {annotation.dim_str!r}]"
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:  # what stands for a type at run time
        return str(arguments[1])
    if origin in (Union, UnionType):
        return " | ".join(_without_parts([words_of(one) for one in arguments]))
    if not arguments:
        name = getattr(annotation, "__name__", repr(annotation)).rpartition(".")[
            2
        ]  # `Array` of JAX has a dotted name
        return _PUBLIC.get(name, name)
    name = getattr(origin, "__name__", repr(origin))
    if name == "Literal":
        return f"Literal[{', '.join(map(repr, arguments))}]"
    return f"{name}[{', '.join('...' if one is ... else words_of(one) for one in arguments)}]"


def _without_parts(names: list[str]) -> list[str]:
    """Names of a union, those of `ArrayLike` and `Numbers` by these names, None last."""
    for alias, parts in (("ArrayLike", _ARRAY_LIKE), ("Numbers", _NUMBERS)):
        if parts <= set(names):
            names = [alias, *(name for name in names if name not in parts)]
    return [name for name in dict.fromkeys(names) if name != "None"] + ["None"] * ("None" in names)
