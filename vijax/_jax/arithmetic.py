"""Functions that are arithmetic alone, and so fit into a kernel of `in_one_kernel`, by their jaxpr."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
from jax.extend.core import Literal
from jaxtyping import PyTree

from .traced import CACHE_SIZE

# A list of what is allowed: a kernel with anything else ends the process. Matrix products become calls of a library,
# like sorting and linear algebra.
_ELEMENTWISE = (
    "abs acos acosh add add_any and asin asinh atan atan2 atanh cbrt ceil clamp convert_element_type copy copy_p cos cosh "
    "div eq erf erf_inv erfc exp exp2 expm1 floor ge gt integer_pow is_finite le le_to log log1p logistic lt lt_to max min mul ne neg "
    "nextafter not or polynomial pow reduce_precision rem round rsqrt select_n sign sin sinh sqrt square stop_gradient sub tan tanh "
    "xor"
)
_SHAPES = (
    "broadcast_in_dim concatenate dynamic_slice expand_dims gather iota pad reshape rev slice split "
    "squeeze stack transpose unstack"
)
_SUMS = "argmax argmin cummax cummin cumprod cumsum reduce_and reduce_max reduce_min reduce_or reduce_prod reduce_sum"
# Calls, choices and loops of such functions.
_CONTROL = (
    "checkpoint closed_call cond core_call custom_jvp_call custom_vjp_call jit pjit remat remat2 scan while"
)
# Elements written at one place that is known.
_SCATTERS = ("scatter", "scatter-add")
_ARITHMETIC = frozenset(" ".join((_ELEMENTWISE, _SHAPES, _SUMS, _CONTROL)).split())


def is_arithmetic(function: Callable, *args: PyTree) -> bool:
    """True if a function consists of arithmetic, comparisons, selections and loops of them.

    Args:
        function: a pytree; its arrays are arguments too, so that functions that differ in numbers alone are traced once.
        args: arrays, or their shapes.
    """
    arrays, static = eqx.partition((function, args), lambda a: eqx.is_array(a) or _is_shape(a))
    leaves, structure = jax.tree.flatten(arrays)
    kinds = tuple((a.shape, a.dtype) for a in leaves)
    others, of_others = jax.tree.flatten(static)
    whole = tuple(others), of_others, structure, kinds
    try:
        return _is_arithmetic(*whole)
    except TypeError:  # a static part has no hash
        return _is_arithmetic.__wrapped__(*whole)


def _is_shape(a: Any) -> bool:
    return isinstance(a, jax.ShapeDtypeStruct)


@lru_cache(CACHE_SIZE)
def _is_arithmetic(static: tuple, of_static: Any, of_arrays: Any, kinds: tuple) -> bool:
    def called(leaves: list) -> Any:
        whole = eqx.combine(jax.tree.unflatten(of_arrays, leaves), jax.tree.unflatten(of_static, static))
        function, args = whole
        return function(*args)

    program = jax.make_jaxpr(called)([jax.ShapeDtypeStruct(*kind) for kind in kinds])
    return _consists_of_arithmetic(program.jaxpr)


def _consists_of_arithmetic(program: Any) -> bool:
    # Variables made of literals alone, which are places of elements in `x.at[0].set(y)`.
    literals: set = set()
    for equation in program.eqns:
        if equation.primitive.name in _SCATTERS:
            indices = equation.invars[1]
            if indices not in literals or indices.aval.shape[:-1] != ():
                return False  # more than one place, or an unknown one: a scatter for the compiler too
        elif equation.primitive.name not in _ARITHMETIC:
            return False
        if all(isinstance(a, Literal) or a in literals for a in equation.invars):
            literals.update(equation.outvars)
        parts = [part for a in equation.params.values() for part in _programs_in(a)]
        if not all(map(_consists_of_arithmetic, parts)):
            return False
    return True


def _programs_in(param: Any) -> list:
    """Programs in a parameter of an equation, which may be closed ones, or several."""
    if isinstance(param, tuple | list):
        return [part for one in param for part in _programs_in(one)]
    program = getattr(param, "jaxpr", param)
    return [program] if hasattr(program, "eqns") else []
