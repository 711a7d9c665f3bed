"""Functions traced once.

`jax.jit` traces anew under every other transformation, and the trace of a step of a trajectory takes half a second.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
from jax.extend.core import jaxpr_as_fun
from jaxtyping import PyTree

from .concrete import is_staged

# Size of the caches of traces and compilations, in functions.
CACHE_SIZE = 256


def kind(a: Any) -> tuple[tuple[int, ...], Any]:
    """Shape and dtype of an array or its stand-in."""
    a = a if isinstance(a, jax.ShapeDtypeStruct) else jax.typeof(a)
    return a.shape, a.dtype


class Traced:
    """A function traced once for each kind of arguments; `jax.jit` traces anew under other transformations."""

    def __init__(self, function: Callable, compiled: Callable):
        self._traced = cache(partial(_traced, function, compiled))

    def __call__(self, *args: PyTree) -> PyTree:
        arrays, (run, run_alone, found) = self._look_up(args)
        return jax.tree.unflatten(jax.tree.structure(found), (run if is_staged() else run_alone)(*arrays))

    def shapes(self, *args: PyTree) -> PyTree:
        """Shapes of the results as from `jax.eval_shape`, without evaluating the trace again."""
        return self._look_up(args)[1][2]

    def _look_up(self, args: PyTree) -> tuple[list, tuple[Callable, Callable, PyTree]]:
        arrays, structure = jax.tree.flatten(args)
        return arrays, self._traced(structure, tuple(map(kind, arrays)))


def _traced(
    function: Callable, compiled: Callable, structure: Any, kinds: tuple
) -> tuple[Callable, Callable, PyTree]:
    """The trace as a function of arrays, the same compiled, and the shapes of its results."""
    shapes = [jax.ShapeDtypeStruct(*kind) for kind in kinds]
    jaxpr, found = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(structure, shapes))
    run = jaxpr_as_fun(jaxpr)
    return run, compiled(run), found
