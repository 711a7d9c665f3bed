"""Concrete or traced: the one place that asks JAX whether a value is known while a program is traced."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import jax
import jax.core
import numpy as np
from jaxtyping import Array

try:
    from jax.extend.core import get_opaque_trace_state
except ImportError:  # no release guarantees it
    get_opaque_trace_state = None

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

# Errors of JAX where a program needs a number that is traced.
ERRORS_OF_TRACERS = (
    jax.errors.ConcretizationTypeError,
    jax.errors.TracerArrayConversionError,
    jax.errors.TracerIntegerConversionError,
    jax.errors.NonConcreteBooleanIndexError,
)


def concrete(value: Any) -> np.ndarray | None:
    """Return the value as a NumPy array, or None while it is traced."""
    return None if is_tracer(value) else np.asarray(value)


def is_tracer(value: Any) -> bool:
    """True where a value is traced."""
    found = _are_tracers.get(type(value))
    if found is None:
        found = _are_tracers[type(value)] = isinstance(value, jax.core.Tracer)
    return found


# Whether values of a type are traced: to ask JAX takes longer than all else that is done with a leaf of a call.
_are_tracers: dict[type, bool] = {}


def has_tracer(tree: Any) -> bool:
    """True where a leaf of the tree is traced."""
    return any(map(is_tracer, jax.tree.leaves(tree)))


def is_traced(tree: Any) -> bool:
    """True where a leaf of the tree is traced, or the current computation is staged: under `jit`, `vmap`, `grad`."""
    return is_staged() or has_tracer(tree)


def is_staged() -> bool:
    """True where the current computation joins a larger program: under `jit`, not under `vmap` or `grad` alone."""
    state = None if get_opaque_trace_state is None else get_opaque_trace_state()
    if state is None or state != _unstaged.get("state"):
        if is_tracer(_same(np.float32(0))):
            return True
        _unstaged["state"] = state
    return False


# Trace state of the last eager call, cached because a call of `_same` takes as long as all other checks.
_unstaged: dict[str, Any] = {}


@jax.jit
def _same(number: Array) -> Array:
    return number


def evaluate_eagerly(function: Callable[P, R]) -> Callable[P, R]:
    """Evaluate a function of arrays eagerly where its arguments are concrete, even while `jit` traces.

    Concrete arguments, a stiffness for instance, then give concrete results for checks and static choices.
    """

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        if has_tracer((args, kwargs)):
            return function(*args, **kwargs)
        with concrete_evaluation():
            return function(*args, **kwargs)

    return wrapped


def concrete_evaluation() -> AbstractContextManager:
    """Context in which results of concrete values are concrete, even while `jit` traces."""
    # Unnecessary outside of `jit`, where JAX would trace and compile all programs once more.
    return jax.ensure_compile_time_eval() if is_staged() else nullcontext()


def stop_gradients(tree: T) -> T:
    """Stop the derivatives of JAX arrays; NumPy arrays stay as they are."""
    return jax.tree.map(lambda a: jax.lax.stop_gradient(a) if isinstance(a, jax.Array) else a, tree)


def check_values(tree: T) -> T:
    """Values for checks: no derivatives, NumPy where concrete. Compiles nothing where `grad` alone traces them."""
    # `stop_gradients` of a concrete array would be staged under `jit`.
    still = jax.tree.map(lambda a: stop_gradients(a) if is_tracer(a) else a, tree)
    return jax.tree.map(lambda a: a if callable(a) or (known := concrete(a)) is None else known, still)
