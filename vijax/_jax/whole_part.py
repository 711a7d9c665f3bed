"""A part of a program that JAX leaves whole, as a kernel must be.

JAX removes what nothing reads from the calls of a program, when it divides the program for its derivatives above all,
and with it the only reader of an argument: of kernels the code generator then fails, see `unread_argument.py`. The
primitive `part` is opaque to JAX. Its derivative is a part too, which computes what both share once, and hands over the
numbers that the linear map of tangents needs; a batch of it is one part of all lanes.
"""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
from jax.core import ShapedArray, eval_jaxpr
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

from .jaxprs import reached_outputs

# Of JAX, or their stand-ins while a function is traced; releases of JAX hand over lists or tuples.
Arrays = Sequence[Any]

part = Primitive("part")
part.multiple_results = True


def whole_part(function: Callable[..., Sequence[Array]], arrays: Arrays, call: Callable) -> Arrays:
    """Return `function(*arrays)`, called by `call(function, *arrays)` in the program: it encloses no traced arrays."""
    return bound_part(jax.make_jaxpr(function)(*arrays), arrays, call)


def bound_part(program: Any, arrays: Arrays, call: Callable) -> Arrays:
    """`whole_part` of a closed program."""
    return part.bind(*arrays, program=program, call=call)


def _evaluate(*arrays: Any, program: Any, call: Callable) -> Arrays:
    """The results; the call hands back its arguments, some of which it may not read."""

    def function(*arrays: Any) -> tuple[Arrays, Arrays]:
        return eval_jaxpr(program.jaxpr, program.consts, *arrays), arrays

    return call(function, *arrays)[0]


def _shapes(*_: Any, program: Any, call: Callable) -> list[ShapedArray]:
    del call
    return [ShapedArray(a.shape, a.dtype) for a in program.out_avals]


def _differentiate(arrays: Arrays, changes: Sequence, *, program: Any, call: Callable) -> tuple[Arrays, list]:
    """Results, and their tangents by a linear map outside of the part."""
    moves = [type(t) is not ad.Zero for t in changes]
    structure: list[Any] = []

    def linearized(*arrays: Array) -> Arrays:
        moving = [a if m else None for a, m in zip(arrays, moves, strict=True)]

        def of_moving(moving: list) -> tuple:
            found = eval_jaxpr(program.jaxpr, program.consts, *eqx.combine(moving, list(arrays)))
            return eqx.partition(found, eqx.is_inexact_array)

        found, push, others = jax.linearize(of_moving, moving, has_aux=True)
        leaves, tree = jax.tree.flatten((eqx.combine(found, others), push))
        dynamic, static = eqx.partition(leaves, eqx.is_array)
        structure[:] = tree, static
        return [a for a in dynamic if a is not None]

    some = iter(whole_part(linearized, arrays, call))
    tree, static = structure
    found, push = jax.tree.unflatten(tree, [next(some) if a is None else a for a in static])
    change = push([t if m else None for t, m in zip(changes, moves, strict=True)])
    nothing = [ad.Zero(jax.typeof(a).to_tangent_aval()) for a in found]
    return found, [z if t is None else t for t, z in zip(change, nothing, strict=True)]


def _batch(arrays: Arrays, axes: list, *, program: Any, call: Callable) -> tuple[Arrays, list]:
    """A part of all lanes; what no lane differs in is computed once."""
    reached = reached_outputs(program.jaxpr, [axis is not None for axis in axes])
    of_all = [0 if is_so else None for is_so in reached]
    one = lambda *arrays: eval_jaxpr(program.jaxpr, program.consts, *arrays)  # noqa: E731
    return whole_part(jax.vmap(one, tuple(axes), of_all), arrays, call), of_all


part.def_impl(_evaluate)
part.def_abstract_eval(_shapes)
mlir.register_lowering(part, mlir.lower_fun(_evaluate, multiple_results=True))
ad.primitive_jvps[part] = _differentiate
batching.primitive_batchers[part] = _batch
