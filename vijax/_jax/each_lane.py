"""A loop over the few lanes for which there is something to do."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

R = TypeVar("R")

# Flags in a word of `for_each`.
_BITS = 32


def for_each(flags: Bool[Array, " places"], step: Callable[[Array, R], R], carry: R) -> R:
    """Apply `step(place, carry)` for each flag that is set, one after another: few are.

    The flags are the bits of words, of which the lowest one set is found in three operations.
    """
    size, bits = flags.size, jnp.arange(_BITS, dtype=jnp.uint32)
    padded = jnp.concatenate([flags, jnp.zeros(-size % _BITS, bool)]).reshape(-1, _BITS)
    words = jnp.sum(jnp.where(padded, jnp.uint32(1) << bits, jnp.uint32(0)), axis=1, dtype=jnp.uint32)

    def next_word(number: Array, word: Array) -> tuple[Array, Array]:
        """The given word if it has a bit, else the next one that has; its number is beyond all if there is none."""
        is_empty = lambda now: (now[1] == 0) & (now[0] < len(words))  # noqa: E731
        following = lambda now: (now[0] + 1, words[jnp.minimum(now[0] + 1, len(words) - 1)])  # noqa: E731
        return jax.lax.while_loop(is_empty, following, (number, word))

    def one(now: tuple[R, Array, Array]) -> tuple[R, Array, Array]:
        carry, number, word = now
        place = number * _BITS + jax.lax.population_count(~word & (word - 1)).astype(jnp.int32)
        return step(place, carry), *next_word(number, word & (word - 1))

    first = next_word(jnp.int32(0), words[0])
    return jax.lax.while_loop(lambda now: now[1] < len(words), one, (carry, *first))[0]
