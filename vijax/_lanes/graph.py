"""Graph of scalars: operations on elements of arrays, without repetition, with known numbers folded.

An element is a known number (a NumPy scalar) or a `Node`, one number of every lane. What depends on numbers alone that
all lanes share is itself shared, and later computed once instead of once per lane.
"""

import abc
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive

from .folding import EXACT, simplified


class Node:
    """Element that is not known: a primitive of elements, a result of a block, or a leaf.

    Attributes:
        primitive: what it computes; None for leaves and results of blocks.
        args: elements that it is computed from.
        params: parameters of the primitive.
        dtype: type of the number.
        is_shared: True where all lanes have the same number.
        block: block that it is a result of, and its place among the results.
    """

    __slots__ = "args", "block", "dtype", "is_shared", "params", "primitive"

    def __init__(
        self,
        primitive: Any,
        args: tuple,
        params: dict[str, Any],
        dtype: Any,
        is_shared: bool,
        block: Any = None,
    ):
        self.primitive, self.args, self.params, self.dtype = primitive, args, params, np.dtype(dtype)
        self.is_shared, self.block = is_shared, block


Element = Any


class Block(abc.ABC):
    """A loop, or a choice that is the same for all lanes, emitted as `while_loop` or `cond` instead of being unrolled."""

    @abc.abstractmethod
    def inputs(self, used: Collection[int]) -> list[Node]:
        """Nodes that its results at the places `used` need."""

    @abc.abstractmethod
    def emit(self, read: Callable[[Element], Any], used: list[int], emit: Callable[..., list]) -> list:
        """Values of its results at the places `used`.

        Args:
            read: gives the value of an element outside of the block.
            used: places of the results.
            emit: gives values of the elements inside, from the values of its leaves.
        """


class AnyLane:
    """Operation that is true where a flag is set in any lane."""

    name = "any_lane"

    @staticmethod
    def bind(flag: Any) -> Any:
        """Reduce over the lanes."""
        return jnp.any(flag)


def is_known(element: Element) -> bool:
    """True for numbers that are known."""
    return not isinstance(element, Node)


def is_shared(element: Element) -> bool:
    """True for elements that are the same in all lanes."""
    return is_known(element) or element.is_shared


def leaf_like(element: Node, shared: bool | None = None) -> Node:
    """Leaf with the type of an element."""
    return Node(None, (), {}, element.dtype, element.is_shared if shared is None else shared)


def ordered(outs: Iterable[Any], needs: Callable[[Any], list]) -> list:
    """All that `outs` need, each after what it needs itself."""
    done: dict[Any, None] = {}
    stack = [(v, False) for v in reversed(list(outs))]
    while stack:
        vertex, is_ready = stack.pop()
        if vertex in done:
            continue
        if is_ready:
            done[vertex] = None
        else:
            stack.append((vertex, True))
            stack.extend((v, False) for v in needs(vertex) if v not in done)
    return list(done)


PRIMITIVES = {p.name: p for p in vars(lax).values() if isinstance(p, Primitive)}
_COMMUTATIVE = frozenset({"add", "mul", "max", "min", "and", "or", "xor", "eq", "ne"})


class Graph:
    """Nodes that are made so far, each of them once."""

    def __init__(self):
        self._nodes: dict[Any, Node] = {}

    def make(
        self,
        name: str,
        args: Sequence[Element],
        dtype: Any,
        params: dict[str, Any] | None = None,
        primitive: Any = None,
    ) -> Element:
        """Element computed from elements by an elementwise primitive."""
        args, params = tuple(args), params or {}
        primitive = primitive or PRIMITIVES[name]
        if all(map(is_known, args)):
            return _evaluated(name, args, dtype, params, primitive)
        short = simplified(self.make, name, args, np.dtype(dtype), params)
        if short is not None:
            return short
        keys = [a.tobytes() + a.dtype.char.encode() if is_known(a) else id(a) for a in args]
        keys = frozenset(keys) if name in _COMMUTATIVE and len({*keys}) > 1 else tuple(keys)
        key = name, keys, np.dtype(dtype), repr(params)
        if key not in self._nodes:
            self._nodes[key] = Node(primitive, args, params, dtype, all(map(is_shared, args)))
        return self._nodes[key]

    def any_lane(self, flag: Element) -> Element:
        """Flag that is set where `flag` is in any lane."""
        if is_shared(flag):
            return flag
        key = AnyLane.name, id(flag)
        if key not in self._nodes:
            self._nodes[key] = Node(AnyLane, (flag,), {}, bool, True)
        return self._nodes[key]


def _evaluated(name: str, args: tuple, dtype: Any, params: dict[str, Any], primitive: Any) -> Element:
    """Known result. Only exact operations are NumPy's: of others XLA's rounding differs."""
    if name in EXACT:
        with np.errstate(all="ignore"):
            found = EXACT[name](*args)
        if found is not NotImplemented:
            return np.dtype(dtype).type(found)
    with jax.ensure_compile_time_eval():
        return np.asarray(primitive.bind(*(jnp.asarray(a, a.dtype) for a in args), **params))[()]
