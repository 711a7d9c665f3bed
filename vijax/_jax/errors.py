"""Errors that depend on numbers, raised whichever part of a result is asked for.

Known numbers are checked at once. Under `jax.jit` numbers are not known, and XLA leaves out whatever the
output does not depend on: a check whose result nobody reads, and in a derivative even one that changes
only values. So every array that is returned is multiplied by the number 1 that the check makes; all
derivatives, forward and reverse, then have it as a factor as well.

`equinox.error_if` puts the check into values alone, and its message under `jax.jit` ends in a paragraph
about equinox; here the last line is the sentence.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import unvmap_max
from jaxtyping import Array, ArrayLike, Int, PyTree

from .arrays import Scalar, concrete


class SimulationError(RuntimeError):
    """A simulation that cannot give what was asked for; the message says what to do."""


SimulationError.__module__ = "vijax"  # the name that users see


def checked(tree: PyTree, number: Int[ArrayLike, ""], sentences: Sequence[str]) -> PyTree:
    """Return a tree whose every array depends on a check, which raises if something is wrong.

    Args:
        tree: what is returned to the user.
        number: 0 if all is well, else that of the sentence that is raised.
        sentences: the first, of number 0, is not used. In a batch the last that is wrong counts.

    Raises:
        SimulationError: at once, or when what is compiled runs.
    """
    if concrete(number) is not None:
        _refuse(number, sentences)
        return tree
    one = lock(number, sentences)
    if concrete(one) is not None:
        return tree

    def locked(a: Array) -> Array:
        return (
            a * one.astype(a.dtype) if eqx.is_inexact_array(a) else jnp.where(one > 0, a, jnp.zeros_like(a))
        )

    return jax.tree.map(lambda a: locked(a) if eqx.is_array(a) else a, tree)


def numbered(
    doubts: Sequence[tuple[Any, str]], number: Any = 0, sentences: Sequence[str] = ("",)
) -> tuple[Any, list[str]]:
    """Arguments of `checked` that raise the first of the doubts that is true, and else what they raise already.

    Args:
        doubts: verdicts, true where something is wrong, and their sentences.
        number: see `checked`.
        sentences: likewise.
    """
    sentences = list(sentences)
    for is_wrong, sentence in doubts[::-1]:
        number = jnp.where(is_wrong, len(sentences), number)
        sentences.append(sentence)
    return number, sentences


def are_unfounded(doubts: Sequence[tuple[Any, str]]) -> Any:
    """Whether none of some doubts, see `numbered`, is true."""
    if not doubts:
        return np.asarray(True)
    return ~jnp.any(jnp.stack([is_wrong for is_wrong, _ in doubts]))


def lock(number: Int[ArrayLike, ""], sentences: Sequence[str]) -> Scalar:
    """The number 1, computed by a check that raises if something is wrong, see `checked`."""
    if concrete(number) is None:
        number = unvmap_max(jax.lax.stop_gradient(jnp.asarray(number)))  # known, if only a batch hid it
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
    """Raise the last of the sentences that a batch of numbers names, unless all are 0."""
    worst = int(np.max(number, initial=0))
    if worst:
        raise SimulationError(sentences[worst])
