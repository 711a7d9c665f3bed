"""Errors that depend on numbers, raised whichever part of a result is used.

Concrete numbers are checked at once. Under `jax.jit` numbers are traced, and XLA drops whatever the output does not
depend on: a check whose result nothing reads and, in a derivative, even a check that changes only values. Every
returned array is therefore multiplied by the number 1 that the check computes. All derivatives, forward and reverse,
then have it as a factor as well.

`equinox.error_if` puts the check into values alone, and its message under `jax.jit` ends in a paragraph about
equinox. Here the last line is the message.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import unvmap_max
from jaxtyping import Array, ArrayLike, Int, PyTree

from .arrays import Scalar
from .concrete import concrete
from .users_line import users_place


class SimulationError(RuntimeError):
    """Error of a simulation that cannot give the requested result; the message says what to do."""


SimulationError.__module__ = "vijax"  # the name that users see


def checked(tree: PyTree, number: Int[ArrayLike, ""], sentences: Sequence[str]) -> PyTree:
    """Return a tree whose every array depends on a check that raises if something is wrong.

    Args:
        tree: the result for the user.
        number: 0 if all is well, else the index of the message to raise.
        sentences: messages; the first, of index 0, is unused. In a batch the largest index counts.

    Raises:
        SimulationError: at once, or when the compiled program runs.
    """
    if concrete(number) is not None:
        _refuse(number, sentences)
        return tree
    one = checked_one(number, sentences)
    if concrete(one) is not None:
        return tree

    def locked(a: Array) -> Array:
        return (
            a * one.astype(a.dtype) if eqx.is_inexact_array(a) else jnp.where(one > 0, a, jnp.zeros_like(a))
        )

    return jax.tree.map(lambda a: locked(a) if eqx.is_array(a) else a, tree)


def warn_when_run(number: Int[ArrayLike, ""], sentences: Sequence[str]) -> None:
    """Warn with a sentence where the arguments of `checked` would raise it: at once, or when the compiled program runs."""
    number = unvmap_max(jax.lax.stop_gradient(jnp.asarray(number)))
    where = users_place()  # remembered: when the program runs, nothing of the user's is on the stack

    def warn(number: Any) -> None:
        if int(number):
            warnings.warn_explicit(sentences[int(number)], UserWarning, *where)

    known = concrete(number)
    if known is None:
        jax.lax.cond(number > 0, lambda: jax.debug.callback(warn, number), lambda: None)
    else:
        warn(known)


def number_of_doubts(
    doubts: Sequence[tuple[Any, str]], number: Any = 0, sentences: Sequence[str] = ("",)
) -> tuple[Any, list[str]]:
    """Arguments of `checked` that raise the first true doubt, or else what `number` and `sentences` raise already.

    Doubts are pairs of a flag, true where something is wrong, and its message.
    """
    sentences = list(sentences)
    for is_wrong, sentence in doubts[::-1]:
        number = jnp.where(is_wrong, len(sentences), number)
        sentences.append(sentence)
    return number, sentences


def none_true(doubts: Sequence[tuple[Any, str]]) -> Any:
    """True where no doubt is true, see `number_of_doubts`."""
    if not doubts:
        return np.asarray(True)
    return ~jnp.any(jnp.stack([is_wrong for is_wrong, _ in doubts]))


def checked_one(number: Int[ArrayLike, ""], sentences: Sequence[str]) -> Scalar:
    """The number 1, computed by a check that raises if something is wrong, see `checked`."""
    if concrete(number) is None:
        number = unvmap_max(jax.lax.stop_gradient(jnp.asarray(number)))  # concrete if only `vmap` traced it
    one = jnp.ones(())
    if concrete(number) is not None:
        _refuse(number, sentences)
        return one

    def refuse(number: Any) -> ArrayLike:
        _refuse(number, sentences)
        return np.ones(shape.shape, shape.dtype)

    shape = jax.ShapeDtypeStruct(one.shape, one.dtype)
    return jax.lax.cond(
        jnp.asarray(number) > 0, lambda: jax.pure_callback(refuse, shape, number), lambda: one
    )


def _refuse(number: Any, sentences: Sequence[str]) -> None:
    """Raise the message of the largest index in a batch, unless all are 0."""
    worst = int(np.max(number, initial=0))
    if worst:
        raise SimulationError(sentences[worst])
