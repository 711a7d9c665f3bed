"""Directives to the compiler.

None is needed for correct results. `VIJAX_PLAIN=1` in the environment, read once, turns all of them off; a release of
JAX that lacks them has the same effect.
"""

import abc
import os
import threading
from collections.abc import Callable
from functools import lru_cache, partial, wraps
from operator import attrgetter
from types import FunctionType
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import unvmap_any
from jax.core import ShapedArray
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array, Bool, PyTree

from .compiler_options import (
    FOR_LANES,
    FOR_LARGE_LANES,
    FOR_SUMS,
    LIGHTLY,
    OF_LARGE_PARTS,
    OF_PARTS,
    QUICKLY,
    knows,
)
from .concrete import is_staged, is_traced
from .jaxprs import without_arguments
from .plain_derivatives import plainly_differentiable
from .programs import Programs
from .traced import CACHE_SIZE
from .whole_part import bound_part

try:
    from jax.experimental.xla_metadata import set_xla_metadata
except ImportError:
    set_xla_metadata = None
try:
    from .differentiable import with_derivatives
except (ImportError, AttributeError):  # it uses internals of JAX that may change
    with_derivatives = None

PLAIN = os.environ.get("VIJAX_PLAIN", "0") not in ("", "0")

P = ParamSpec("P")
R = TypeVar("R")


_ARE_NANS_ERRORS = attrgetter("jax_debug_nans", "jax_debug_infs")


def padding_allowed(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function return NaN and infinity where JAX is set to stop at them, by `jax_debug_nans` for instance.

    Logs are padded with them, and steps that are not needed overflow unseen. Inside the user's own `jit` JAX checks
    the results of that function at its end, and nothing can be done here.
    """

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        if not any(_ARE_NANS_ERRORS(jax.config)):
            return function(*args, **kwargs)
        with jax.debug_nans(False), jax.debug_infs(False):  # not in the key of cached compilations
            return function(*args, **kwargs)

    return wrapped


def compile_lightly(function: Callable[P, R]) -> Callable[P, R]:
    """`eqx.filter_jit` for programs that run no longer than they take to compile, with little overhead per call.

    Non-array leaves are static, including Python numbers. The static leaves determine the structure of the result. As
    part of a larger program, under `jax.jit` or derivatives, the function does not affect how that is compiled.
    Programs are stored for later processes, see `program_store.py`.
    """
    return _compiled(function, LIGHTLY)


def compile_quickly(function: Callable[P, R]) -> Callable[P, R]:
    """`compile_lightly` in half the time, for programs that run for far less time than they take to compile."""
    return _compiled(function, QUICKLY)


def _compiled(function: Callable[P, R], options: dict) -> Callable[P, R]:
    part = eqx.filter_jit(function)
    programs = Programs(function, partial(_known_of, options))

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        is_part = is_traced((args, kwargs))
        return part(*args, **kwargs) if is_part else programs(*args, **kwargs)

    return wrapped


def compile_derivatives_lightly(function: Callable[P, R]) -> Callable[P, R]:
    """`compile_quickly` for functions whose derivatives, outside of `jax.jit`, are compiled lightly.

    They are differentiable forwards and in reverse. No rule may call them with tangents: JAX transposes them as
    nonlinear functions.
    """
    compiled, plain = compile_quickly(function), cast("Callable[..., Any]", function)
    of_arguments = lambda both: plain(*both[0], **both[1])  # noqa: E731

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        if PLAIN or with_derivatives is None or is_staged() or not is_traced((args, kwargs)):
            return compiled(*args, **kwargs)
        return differentiable(of_arguments, (args, kwargs), has_reverse=True)

    return wrapped


def options_for_lanes() -> dict | None:
    """Compiler options of a loop over lanes: its kernel uses the widest vectors, what is around it compiles lightly."""
    return _known_of(FOR_LANES)


def are_sums_in_kernels() -> bool:
    """True where kernels may have sums of any length in programs that are compiled by this file's options."""
    return _known_of(FOR_SUMS) == FOR_SUMS


def _known_of(options: dict) -> dict | None:
    """Those options that the backend has, if it is a CPU."""
    if PLAIN or jax.default_backend() != "cpu":
        return None
    return {name: value for name, value in options.items() if knows(name, value)}


def compute_once(function: Callable, *args):
    """Call `function` so that XLA computes what its results share once, not once per result.

    On a CPU XLA fuses every result of a loop body separately and repeats in each whatever they share. No fusion
    crosses a call, but calls are inlined unless marked otherwise. Under `in_parts` the call is a kernel.
    """
    if _parts.are_kernels:
        return _own_kernel(function, args)
    return _call(function, args, inlineable="false")


class _Parts(threading.local):
    """Flag of the outermost calls of `compute_once` and `as_part` being kernels now."""

    are_kernels = False


_parts = _Parts()


def in_parts(function: Callable, *args):
    """Call `function` with each outermost call of `compute_once` or `as_part` in it as a kernel of its own.

    XLA makes one function of a kernel, and LLVM's passes over its loops take more than twice as long for one twice as
    large: a loop over lanes of a machine whose forces switch compiles in a third of the time, and takes little longer.
    Numbers are the same to the bit.
    """
    before, _parts.are_kernels = _parts.are_kernels, not PLAIN
    try:
        return function(*args)
    finally:
        _parts.are_kernels = before


def as_part(function: Callable, *args):
    """Call `function`; under `in_parts` as a kernel of its own, otherwise with what is around it."""
    return _own_kernel(function, args) if _parts.are_kernels else function(*args)


def of_parts(function: Callable, *args):
    """`compute_once`; under `in_parts` the function as it stands, whose own calls of `compute_once` are the kernels."""
    return function(*args) if _parts.are_kernels else compute_once(function, *args)


def _own_kernel(function: Callable, args: tuple):
    """Call `function` as a kernel of the arrays that it reads; results that are arguments are not among its own."""
    is_array = lambda a: isinstance(a, jax.Array)  # noqa: E731
    arrays, static = eqx.partition(args, is_array)
    leaves, structure = jax.tree.flatten(arrays)
    others: list[Any] = []

    def of_leaves(leaves: list) -> list:
        results = function(*eqx.combine(jax.tree.unflatten(structure, leaves), static))
        own, rest = eqx.partition(results, is_array)
        own, tree = jax.tree.flatten(own)
        others[:] = tree, rest
        return own

    before, _parts.are_kernels = _parts.are_kernels, False
    try:
        closed = jax.make_jaxpr(of_leaves)(leaves)
    finally:
        _parts.are_kernels = before
    values = [*closed.consts, *leaves]
    is_passed = [isinstance(a, jax.Array) for a in values]
    program, read, given = without_arguments(closed, is_passed)
    few = [values[k] for k in read]
    is_whole = few and program.out_avals
    found = iter(bound_part(program, few, in_one_kernel) if is_whole else jaxpr_as_fun(program)(*few))
    results = [next(found) if k is None else values[k] for k in given]
    tree, rest = others
    return eqx.combine(jax.tree.unflatten(tree, results), rest)


def in_one_kernel(function: Callable, *args):
    """Call `function` as a single compiled kernel; otherwise XLA on a CPU runs every fusion as a kernel.

    A kernel takes 50 ns to start, as long as its computation for a hundred lanes. Calls marked as small, as XLA
    itself marks its small loops, are compiled whole. Scatter, sort and custom calls are impossible in them. Arguments
    that nothing reads are impossible too: the function must read all of each, or return it.
    """
    return _call(function, args, inlineable="false", xla_cpu_small_call="true")


def not_constant(tree: PyTree) -> PyTree:
    """The same numbers, hidden from the compiler if they are constants: constants cannot be passed to a kernel."""
    is_so = jax.lax.linalg.cholesky(jnp.ones((1, 1)))[0, 0] > 0  # the compiler does not look into LAPACK
    is_array = lambda a: isinstance(a, jax.Array | np.ndarray)  # noqa: E731
    # Between two equal constants, of zeros for instance, the compiler would not have to choose.
    hidden = lambda a: jnp.where(is_so, a, (a == 0).astype(a.dtype))  # noqa: E731
    return jax.tree.map(lambda a: hidden(a) if is_array(a) else a, tree)


def _call(function: Callable, args: tuple, **attributes: str):
    """Call `function` by an HLO call with `attributes`; the operations inside carry none."""
    if PLAIN or set_xla_metadata is None or jax.default_backend() != "cpu":
        return function(*args)
    # XLA removes arrays without elements, and the call would have an argument that nothing reads.
    arrays, rest = eqx.partition(args, lambda a: isinstance(a, jax.Array) and a.size > 0)
    leaves, structure = jax.tree.flatten(rest)
    known = [jax.typeof(a) if isinstance(a, jax.Array) else a for a in leaves]
    # What a function encloses, tracers for instance, must not be kept.
    is_plain = isinstance(function, FunctionType) and function.__closure__ is None
    # Key by (type, value): 1 == True would collide.
    given = function, structure, tuple((type(a), a) for a in known), tuple(attributes)
    try:
        called = _called(*given) if is_plain else _called.__wrapped__(*given)
    except TypeError:  # an argument has no hash
        called = _called.__wrapped__(*given)
    with _annotated(**attributes):
        return _not_whole(called(arrays))


def _annotated(**attributes: str | None) -> Any:
    assert set_xla_metadata is not None
    return set_xla_metadata(**attributes)


@lru_cache(CACHE_SIZE)
def _called(function: Callable, structure: Any, leaves: tuple, attributes: tuple[str, ...]) -> Callable:
    """Function of the arrays among its arguments, traced once where it is called several times."""

    def called(arrays: tuple) -> Any:
        with _annotated(**dict.fromkeys(attributes)):
            rest = [jnp.zeros(a.shape, a.dtype) if kind is ShapedArray else a for kind, a in leaves]
            return function(*eqx.combine(arrays, jax.tree.unflatten(structure, rest)))

    return jax.jit(called)


def _not_whole(results: PyTree) -> PyTree:
    """Results of a call behind a barrier, which is gone before anything is fused.

    Two faults of the compiler end the process, or give wrong numbers, without it:

    - XLA cannot see a call whose results are all that a loop carries as a call: it becomes the root of the loop's body,
      and its arguments are taken for results. One that is carried at the same place as it is read counts as unchanged,
      and the call is moved out of the loop (`GetInvariantGTEsForWhileBody`, JAX 0.10).
    - Since 0.11 JAX removes results that nothing reads from the function that is called, even those that only hand an
      argument back. Then nothing reads this argument, and the code generator fails (`All or none of the slices should
      have an explicit index`); `unread_argument.py` shows it in plain JAX.

    Flags and counts have a barrier of their own: behind one that numbers with derivatives share, JAX gives them
    derivatives too, and what they decide, such as `is_any`, has none.
    """
    arrays, rest = eqx.partition(results, lambda a: isinstance(a, jax.Array))
    parts = eqx.partition(arrays, eqx.is_inexact_array)
    return eqx.combine(*map(_behind_barrier, parts), rest)


def _behind_barrier(tree: PyTree) -> PyTree:
    return jax.lax.optimization_barrier(tree) if jax.tree.leaves(tree) else tree


def is_any(flags: Bool[Array, "..."]) -> Bool[Array, ""]:
    """True where a flag is set in any lane, those of a `vmap` included. Work is skipped only if no lane needs it."""
    return unvmap_any(flags)


def in_lanes_of(like: Array, tree: PyTree) -> PyTree:
    """The same tree, each array of which differs between the lanes of a `vmap` if `like` does.

    `vmap` traces a loop's body again after it has found an array that lanes come to differ in, though they began alike.
    """
    is_so = jnp.ravel(like)[0] == 0
    return jax.tree.map(lambda a: jnp.where(is_so, a, a), tree)


class AbstractTask(eqx.Module):
    """Body of `while_any` and all that it depends on."""

    @abc.abstractmethod
    def is_live(self, carry) -> Bool[Array, "..."]:
        """Lanes with work left."""

    @abc.abstractmethod
    def step(self, carry):
        """The next carry, unchanged in every lane that is not live."""


def while_any(task: AbstractTask, carry: Any) -> Any:
    """Step while any lane is live, lanes of a `vmap` included.

    A plain `while_loop` under `vmap` copies the whole carry, logs and all, in every step to leave the finished lanes
    unchanged. Here `step` itself leaves them unchanged, at less cost.
    """
    return jax.lax.while_loop(lambda c: is_any(task.is_live(c)), lambda c: task.step(c), carry)


def differentiable(
    function: Callable, tree: Any, *, has_parts: bool = False, is_large: bool = False, **derivatives: Any
) -> Any:
    """Return `function(tree)`, with `derivatives` as `with_derivatives` takes them.

    Outside of a larger program it is compiled lightly, see `compile_lightly`; `has_parts` if it calls `in_parts`. A batch that
    `is_large` too takes LLVM's first level: 1.3 to 1.6 times sooner, and it runs 1.1 to 1.2 times longer.
    """
    # NumPy arrays would be compiled into the program.
    tree = jax.tree.map(lambda a: jnp.asarray(a) if isinstance(a, np.ndarray | np.generic) else a, tree)
    if PLAIN or with_derivatives is None:
        return plainly_differentiable(function, derivatives.get("smooth"), tree)
    if jax.default_backend() != "cpu":
        derivatives = derivatives | {"many": None, "smooth_many": None}
    # The same object in every call, as it is part of what programs are known by.
    compiled = _jit_of_parts if has_parts else jit_lightly
    many = _jit_of_many_parts if has_parts and is_large else compiled
    return with_derivatives(function, tree, compiled=compiled, compiled_many=many, **derivatives)


def _jit(function: Callable, options: dict, name: Any = None) -> Callable:
    run = Programs(function, partial(_known_of, options), name=name, static_numbers=False)
    return wraps(function)(run)


def jit_lightly(function: Callable, name: Any = None) -> Callable:
    """`compile_lightly` for functions that are never part of a larger program.

    Args:
        function: the function.
        name: names all that a local function depends on, so that its programs can be stored, see `Programs`.
    """
    return _jit(function, LIGHTLY, name)


# `jit_lightly` for functions that call `in_parts`, and the same for batches of large programs.
_jit_of_parts = partial(_jit, options=OF_PARTS)
_jit_of_many_parts = partial(_jit, options=OF_LARGE_PARTS)


def jit_quickly(function: Callable, name: Any = None) -> Callable:
    """`compile_quickly` for functions that are never part of a larger program, see `jit_lightly`."""
    return _jit(function, QUICKLY, name)


def jit_for_lanes(function: Callable, name: Any = None) -> Callable:
    """`jit_lightly` for functions whose arrays have lanes last, with the widest vectors, and that are large.

    LLVM's first level of optimisation compiles them in a third of the time of the second, and they run a tenth longer.
    """
    return _jit(function, FOR_LARGE_LANES, name)
