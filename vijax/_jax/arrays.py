"""Names of axes, and small array helpers that every file shares.

Axes: n (masses), stops, harmonics, times, events, lanes (trajectories of a batch).

Inside the engine every array has its own axes first and the lanes, if any, last: `x` is (n,) for one trajectory and
(n, lanes) for a batch. The engine uses only elementwise operations, and indexing and sums over leading axes. Code for
one trajectory therefore runs on a batch too, with the lanes in the contiguous axis, where a CPU vectorises.
(`jax.vmap` with `in_axes=-1` was tried first: its rules for `stack` and `dot_general` move the lanes to the front,
and the loop then runs several times slower.)
"""

import operator
import reprlib
import warnings
from collections.abc import Callable, Sequence
from functools import cache, reduce
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, SupportsFloat, SupportsIndex, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .concrete import evaluate_eagerly, has_tracer
from .users_line import users_line

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
Numbers = ArrayLike | Sequence[Any]
# Integer, for type checkers. At run time `whole_number` refuses anything else, with a clear message.
if TYPE_CHECKING:
    Count = SupportsIndex | Array
else:
    Count = Annotated[Any, "int"]  # as `help` prints it
Scalar = Float[Array, "..."]
Flag = Bool[Array, "..."]
# JAX or NumPy array. Concrete values are computed by NumPy on the host, where no shape needs compilation.
Reals = Any


@cache
def _warn_about_float32() -> None:
    warnings.warn(
        "vijax works in float32 because 64-bit numbers are off: about 6 digits instead of 15. Call "
        "jax.config.update('jax_enable_x64', True) first to have them.",
        stacklevel=users_line(),
    )


@cache
def _warn_about_lost_digits() -> None:
    warnings.warn(
        "A machine, or a part of it, was built while 64-bit numbers were off: its numbers are rounded to 7 "
        "digits, and what is computed with them now is no better. Build it again after "
        "jax.config.update('jax_enable_x64', True).",
        stacklevel=users_line(),
    )


@evaluate_eagerly
def as_float(value: Numbers, name: str = "") -> Array:
    """Convert to a floating-point array of the precision that JAX is set to; an error names the argument `name`."""
    if has_tracer(value):
        array = jnp.asarray(value)
        wanted = _wanted(array)
        return array if array.dtype == wanted else array.astype(wanted)
    if isinstance(value, jax.Array) and value.dtype == _wanted(value) and not value.weak_type:
        return value
    return jax.device_put(as_numpy_float(value, name))


def as_numpy_float(value: Numbers, name: str = "") -> np.ndarray:
    """Convert as `as_float` does, but by NumPy, which compiles nothing."""
    if has_tracer(value):
        who = f"Argument `{name}` must" if name else "These numbers must"
        raise ValueError(f"{who} be known: call this outside of `jax.jit`, `jax.vmap` and derivatives.")
    try:
        array = np.asarray(value)
        if array.dtype == object and all(isinstance(a, SupportsFloat) for a in array.flat):
            array = array.astype(float)  # fractions, decimals
    except (ValueError, TypeError, OverflowError):  # ragged lists, numbers too large
        array = np.asarray(None)
    if array.dtype.kind not in "biufc" and not jnp.issubdtype(array.dtype, np.floating):
        who = (
            f"Argument `{name}` must be made of real numbers, but is"
            if name
            else "Expected real numbers, but got"
        )
        raise ValueError(f"{who} {reprlib.repr(value)}.")
    return np.array(array, _wanted(array))


def _wanted(array: Array | np.ndarray) -> jnp.dtype:
    """Dtype to which numbers are converted."""
    if array.dtype.kind == "c":
        raise ValueError("Expected real numbers, but got complex ones.")
    if array.dtype == np.float64 and jax.config.read("jax_enable_x64"):
        return array.dtype
    wanted = jnp.result_type(float)
    if wanted != jnp.float64:
        _warn_about_float32()
    return wanted


def in_full_precision(tree: T) -> T:
    """Convert a machine, or parts of one, to JAX's current precision; warn of numbers that lost digits earlier."""
    wanted = jnp.result_type(float)

    def is_other(a: Any) -> bool:
        is_float = isinstance(a, jax.Array | np.ndarray) and jnp.issubdtype(a.dtype, jnp.floating)
        return is_float and a.dtype != wanted

    if not any(map(is_other, jax.tree.leaves(tree))):
        return tree
    if wanted == jnp.float64:
        _warn_about_lost_digits()
    return jax.tree.map(lambda a: as_float(a) if is_other(a) else a, tree)


def is_single_precision(*given: Any) -> bool:
    """True where 64-bit numbers are off in JAX, or a floating-point leaf of `given` has fewer than 64 bits."""
    if jnp.result_type(float) != jnp.float64:
        return True
    dtypes = (getattr(leaf, "dtype", None) for leaf in jax.tree.leaves(given))
    return any(dtype is not None and dtype.kind == "f" and dtype.itemsize < 8 for dtype in dtypes)


def refuse_single_precision(who: str, *given: Any) -> None:
    """Raise ValueError where 7 digits give silently wrong results: for the matching of neighbours, for limits."""
    if is_single_precision(*given):
        raise ValueError(
            f'`{who}` needs 64-bit numbers, and the machine made of them: put `jax.config.update("jax_enable_x64", True)` at '
            "the top of the script."
        )


def check_type(name: str, value: Any, kinds: type | tuple[type, ...], words: str) -> None:
    """Reject an argument of another type; `words` say what it must be."""
    if not isinstance(value, kinds):
        raise ValueError(f"Argument `{name}` must be {words}, but is {a_kind_of(value)}.")


def a_kind_of(value: Any) -> str:
    """Type of a value with its article, as "an ImpactSystem"."""
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


def whole_number(name: str, value: Any, least: int = 0) -> int:
    """Convert an integer of Python or NumPy to `int`; refuse anything else.

    A float is refused even where it is integral: `10.0` indicates a quantity, not a count.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or isinstance(value, bool | np.bool_) or number < least:
        raise ValueError(f"Argument `{name}` must be a whole number, {least} or more, but is {value!r}.")
    return number


def real_number(name: str, value: Any) -> float:
    """Convert one real number to `float`; refuse anything else."""
    array = as_numpy_float(value, name)
    if array.ndim:
        raise ValueError(f"Argument `{name}` must be one number, but has shape {array.shape}.")
    return float(array)


def clip_to_zero(time: Array) -> Array:
    """Clip a time made negative by rounding to 0; the derivative is that of the time in any case."""
    return time - jax.lax.stop_gradient(jnp.minimum(time, 0))


@jax.custom_jvp
def with_derivative_of(value: Array, like: Array) -> Array:
    """The same value with the derivative of another that equals it to rounding."""
    return value


@with_derivative_of.defjvp
def _with_derivative_of_jvp(primals, tangents):
    return with_derivative_of(*primals), tangents[1]


def rounding_step(dtype: jnp.dtype) -> float:
    """Largest step, times the rate of the motion, whose cube is below rounding."""
    return float(jnp.finfo(dtype).eps) ** (1 / 3)


def array_namespace(*values: Reals) -> Any:
    """`jax.numpy` if any value is a JAX array, else `numpy`."""
    return jnp if any(isinstance(a, jax.Array) for a in values) else np


def stack(rows: Sequence[Reals]) -> Reals:
    """Stack along a new leading axis, after broadcasting the lanes."""
    library = array_namespace(*rows)
    return library.stack(library.broadcast_arrays(*rows))


# Largest number of rows that are added one by one. XLA fuses such sums with their surroundings and passes no part
# to a library, which a kernel of `in_one_kernel` cannot call.
UNROLLED = 16
# The same for a single trajectory: smaller, because its program is compiled for milliseconds of work.
UNROLLED_ALONE = 4


def add_up(rows: Sequence[Reals] | Reals) -> Reals:
    """Sum over the leading axis."""
    if 0 < len(rows) <= UNROLLED:
        return reduce(operator.add, rows)
    library = array_namespace(*rows) if isinstance(rows, list | tuple) else array_namespace(rows)
    return library.sum(library.asarray(rows), axis=0)


def smallest(rows: Sequence[Array] | Array) -> Array:
    """Minimum over the leading axis; infinite if it is empty."""
    if 0 < len(rows) <= UNROLLED:
        return reduce(jnp.minimum, rows)
    return jnp.min(jnp.asarray(rows), axis=0, initial=jnp.inf)


def matvec(matrix: Float[Array, "m n ..."], vector: Float[Array, "n ..."]) -> Float[Array, "m ..."]:
    """Multiply over the leading axes, term by term where that is little to compile."""
    m, n = matrix.shape[:2]
    if n > UNROLLED:
        return _large_matvec(matrix, vector)
    if vector.ndim == 1:  # stacked rows compile to a branch each
        products = matrix * vector[None]
        columns = [products[:, j] for j in range(n)]
        return add_up(columns) if 0 < n <= UNROLLED_ALONE else jnp.sum(products, axis=1)
    entries = [vector[j] for j in range(n)]
    if m * n <= 16:
        return stack([add_up([matrix[i, j] * entries[j] for j in range(n)]) for i in range(m)])
    return add_up([matrix[:, j] * entries[j] for j in range(n)])


def _large_matvec(matrix: Float[Array, "m n ..."], vector: Float[Array, "n ..."]) -> Float[Array, "m ..."]:
    """Multiply without an array of all products, which would not fit into the cache."""
    if matrix.ndim == 2 or matrix.shape[-1] == 1:  # one matrix for all lanes
        return matrix.reshape(matrix.shape[:2]) @ vector
    add = lambda j, total: total + matrix[:, j] * vector[j]  # noqa: E731
    zero = jnp.zeros((len(matrix), *np.broadcast_shapes(matrix.shape[2:], vector.shape[1:])), vector.dtype)
    return jax.lax.fori_loop(0, matrix.shape[1], add, zero)


def matrix_product(a: Float[Array, "i j ..."], b: Float[Array, "j k ..."]) -> Float[Array, "i k ..."]:
    """Multiply matrices, lanes last."""
    if a.ndim == b.ndim == 2:
        return jnp.sum(a[:, :, None] * b[None], axis=1) if a.shape[1] <= UNROLLED else a @ b
    if a.shape[1] <= UNROLLED:
        # In programs of the user a sum over an array of all products would be passed to a library.
        return add_up([a[:, j, None] * b[None, j] for j in range(a.shape[1])])
    a, b = jnp.broadcast_arrays(a[:, :, None], b[None])
    return jnp.einsum("ij...,jk...->ik...", a[:, :, 0], b[0])


def append_axes(vector: Reals, like: Reals) -> Reals:
    """Append axes of length one to `vector` until it broadcasts with the lanes of `like`."""
    return vector.reshape(vector.shape + (1,) * (like.ndim - vector.ndim))


def with_rows_last(tree: Any) -> Any:
    """Arrays with their first axis last, as kernels over lanes have it."""
    return jax.tree.map(lambda a: jnp.moveaxis(a, 0, -1), tree)


def with_rows_first(tree: Any) -> Any:
    """Arrays with their last axis first, see `with_rows_last`."""
    return jax.tree.map(lambda a: jnp.moveaxis(a, -1, 0), tree)


def shapes_of_row(tree: Any) -> Any:
    """Shapes and types of one row of arrays along their first axis."""
    return jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), tree)


def shapes_of_lane(tree: Any) -> Any:
    """Shapes and types of one lane of arrays with lanes last."""
    return jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[:-1], a.dtype), tree)


def over_lanes(function: Callable, like: Array, *trees: Any) -> Any:
    """Call a function written for one trajectory, for every lane if there are lanes.

    Args:
        function: function of unbatched arrays.
        like: array with one axis, and lanes last if there are any.
        trees: arguments; the last axis of each leaf holds the lanes, or has length one if all lanes share the leaf.
    """
    if like.ndim == 1:
        return function(*trees)
    leaves, axes, structure = vmap_axes(trees, like.shape[-1])
    call = lambda *leaves: function(*jax.tree.unflatten(structure, leaves))  # noqa: E731
    return jax.vmap(call, axes, out_axes=-1)(*leaves)


def vmap_axes(tree: Any, lanes: int) -> tuple[list, list[int | None], Any]:
    """Leaves as `jax.vmap` takes them, their axes, their structure. Last axes are lanes, or one for all lanes."""
    leaves, structure = jax.tree.flatten(tree)
    axes = [-1 if jnp.shape(a)[-1:] == (lanes,) else None for a in leaves]
    leaves = [a[..., 0] if jnp.ndim(a) and k is None else a for a, k in zip(leaves, axes, strict=True)]
    return leaves, axes, structure
