"""User-defined forces, in addition to the linear ones."""

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._jax.arrays import as_float
from .._jax.jaxprs import reached_outputs
from .parametric import Parametric, ParametricForce

# Forces whose shapes are remembered.
_KEPT = 256


def as_force(force: Any) -> Callable | None:
    """Turn a force into a pytree whose leaves are floating-point arrays.

    An `eqx.Module` whose leaves are all floating-point numbers keeps its class, so that its parameters have names. In
    all other forces, leaves that are not such numbers become static.
    """
    if force is None:
        return None
    if not callable(force):
        raise ValueError(f"Argument `force` must be a function force(t, x, v, args), but is {force!r}.")
    leaves = jax.tree.leaves(force)
    if all(_is_number(leaf) for leaf in leaves):
        return jax.tree.map(as_float, force)
    numbers, rest = eqx.partition(force, _is_number)
    return _Frozen(jax.tree.map(as_float, numbers), rest)


def _is_number(leaf: Any) -> bool:
    if isinstance(leaf, (float, np.floating)):
        return True
    return isinstance(leaf, (jax.Array, np.ndarray)) and jnp.issubdtype(leaf.dtype, jnp.floating)


class _Frozen(eqx.Module):
    """A callable with leaves that are not numbers: plain functions, activations of a network."""

    numbers: PyTree
    rest: Any = eqx.field(static=True)

    def __call__(self, t: Array, x: Array, v: Array, args: PyTree) -> Array:
        return eqx.combine(self.numbers, self.rest)(t, x, v, args)


def name_of_force(force: Callable) -> str:
    """Name of a force, with its structure but without its numbers."""
    if isinstance(force, NamedForce):
        return force.name
    if isinstance(force, ParametricForce):
        return "parametric terms" + ("" if force.force is None else f" and {name_of_force(force.force)}")
    if isinstance(force, BoundForce):
        args = "" if force.args is None else f" with args {eqx.tree_pformat(force.args, width=10**6)}"
        return name_of_force(force.force) + args
    return eqx.tree_pformat(whole_force(force), width=10**6)


def whole_force(force: Callable) -> Callable:
    """Force as the user gave it, with its numbers as arrays."""
    return eqx.combine(force.numbers, force.rest) if isinstance(force, _Frozen) else force


class NamedForce(eqx.Module):
    """Placeholder of a force, with its name only; a call raises ValueError."""

    name: str = eqx.field(static=True)

    def __call__(self, t: Array, x: Array, v: Array, args: PyTree) -> Array:
        raise ValueError(f"The force {self.name} was not imported, so nothing can be computed with it.")


class BoundForce(eqx.Module):
    """A force with its `args`, which are then parameters of the machine like any other."""

    force: Callable
    args: PyTree

    def __call__(self, t: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"]) -> Array:
        return jnp.asarray(self.force(t, x, v, self.args), x.dtype)


def with_parametric(force: Any, parametric: Parametric | None) -> Any:
    """Force, or a leaf in its place, with parametric terms beside it, in place of those that it has."""
    if isinstance(force, BoundForce):
        own = with_parametric(force.force, parametric)
        if own is force.force:
            return force
        return None if own is None else BoundForce(own, force.args)
    own = force.force if isinstance(force, ParametricForce) else force
    return own if parametric is None else ParametricForce(own, parametric)


def users_force(force: Any) -> Any:
    """Force without parametric terms; None if there is nothing else."""
    return with_parametric(force, None)


def parametric_of(force: Any) -> Parametric | None:
    """Parametric terms of a force, as they were given."""
    own = force.force if isinstance(force, BoundForce) else force
    return own.parametric if isinstance(own, ParametricForce) else None


def force_of(system: Any, frequency: Any = None) -> Any:
    """Force of a machine as it acts: parametric terms without a frequency have a given one, that of the load if left out."""
    force, terms = system.force, parametric_of(system.force)
    if terms is None or terms.frequency is not None:
        return force
    frequency, is_none = system.forcing.clock if frequency is None else frequency, lambda leaf: leaf is None
    return with_parametric(force, eqx.tree_at(lambda p: p.frequency, terms, frequency, is_leaf=is_none))


def force_numbers(force: Any) -> tuple[PyTree, PyTree]:
    """Numbers of a force, and of its bound `args`, in trees whose keys are the user's names."""
    force = users_force(force)
    own, args = (force.force, force.args) if isinstance(force, BoundForce) else (force, None)
    return own.numbers if isinstance(own, _Frozen) else own, args


def program_of(force: BoundForce, num_masses: int) -> tuple[str, list[np.ndarray]]:
    """Text of the jaxpr of a force without its numbers, and the arrays that it closes over."""
    numbers, rest = eqx.partition(force, eqx.is_array)
    x = jax.ShapeDtypeStruct((num_masses,), jnp.result_type(float))
    run = lambda numbers, *at: eqx.combine(numbers, rest)(*at)  # noqa: E731
    program = jax.make_jaxpr(run)(numbers, jax.ShapeDtypeStruct((), x.dtype), x, x)
    # Addresses of functions differ from run to run.
    return re.sub(r"0x[0-9a-f]+", "", str(program.jaxpr)), [np.asarray(a) for a in program.consts]


def bind_args(force: Callable | None, args: PyTree, num_masses: int) -> BoundForce | None:
    """Bind `args` to a force, and reject what is not a valid force.

    Args:
        force: of a machine, or None. A bound force keeps its `args` unless others are given.
        args: numbers and arrays in any nesting, or None.
        num_masses: n.
    """
    if isinstance(force, BoundForce):
        force, args = force.force, force.args if args is None else args
    if isinstance(force, ParametricForce):
        own = bind_args(force.force, args, num_masses)
        return BoundForce(force, None if own is None else own.args)
    if force is None:
        if args is not None:
            raise ValueError("Argument `args` is passed to `force`, but the machine has no `force`.")
        return None
    if not all(_is_number(leaf) or isinstance(leaf, int) for leaf in jax.tree.leaves(args)):
        raise ValueError(
            "Argument `args` must be made of real numbers and arrays of them: keep what else the force needs "
            "in the force itself, an `eqx.Module` or a function with a closure."
        )
    bound = BoundForce(force, jax.tree.map(as_float, args))
    try:
        shape = _shape_of(bound, num_masses)
    except Exception as error:
        raise ValueError(
            f"Argument `force` failed as force(t, x, v, args) with x and v of shape ({num_masses},) and "
            f"args = {args!r}. It must be written with `jax.numpy`, `jnp.where` instead of `if`, and return an array; "
            f"what it reads of `args` must be given. {type(error).__name__}: {error}"
        ) from error
    if shape != (num_masses,):
        raise ValueError(
            f"Argument `force` must return one force per mass, shape ({num_masses},), but returned {shape}."
        )
    return bound


def _shape_of(force: BoundForce, num_masses: int) -> tuple[int, ...]:
    """Shape of what a force returns."""
    return _traced(force, num_masses)[0]


def reads_time(force: BoundForce, num_masses: int) -> bool:
    """True if what a force returns may depend on t."""
    return _traced(force, num_masses)[1]


def _traced(force: BoundForce, num_masses: int) -> tuple[tuple[int, ...], bool]:
    """Shape of what a force returns, and whether it may depend on t.

    Tracing takes longer than many a run, so both are remembered.
    """
    numbers, rest = eqx.partition(force, lambda a: isinstance(a, jax.Array | np.ndarray))
    kinds = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype), numbers)
    key = *(_hashable(tree) for tree in (kinds, rest)), num_masses, jnp.result_type(float)
    try:
        return _traced_once(*key)
    except TypeError:  # the function has no hash
        return _traced_once.__wrapped__(*key)


def _hashable(tree: PyTree) -> tuple[tuple, Any]:
    leaves, structure = jax.tree.flatten(tree)
    return tuple(leaves), structure


@lru_cache(_KEPT)
def _traced_once(
    kinds: tuple[tuple, Any], rest: tuple[tuple, Any], num_masses: int, dtype: Any
) -> tuple[tuple[int, ...], bool]:
    numbers, others = (jax.tree.unflatten(structure, leaves) for leaves, structure in (kinds, rest))
    x = jax.ShapeDtypeStruct((num_masses,), dtype)
    run = lambda t, numbers, *at: eqx.combine(numbers, others)(t, *at)  # noqa: E731
    program, shape = jax.make_jaxpr(run, return_shape=True)(jax.ShapeDtypeStruct((), dtype), numbers, x, x)
    is_time = [k == 0 for k in range(len(program.jaxpr.invars))]
    return shape.shape, any(reached_outputs(program.jaxpr, is_time))
