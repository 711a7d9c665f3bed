"""Steps shortened until they are right."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from .._jax.arrays import Flag, Scalar

# Halvings of a step on which something has no bound.
MOST_HALVINGS = 60


def shortened(limit: Scalar, is_good: Callable[[Scalar], Flag], share: float, most: int) -> Scalar:
    """Longest step that is good, of `limit` times powers of a share of 1; after `most` of them whatever it is."""

    def cut(carry: tuple) -> tuple:
        limit, _, cuts = carry
        limit = limit * share
        return limit, is_good(limit), cuts + 1

    is_on = lambda carry: ~carry[1] & (carry[2] < most)  # noqa: E731
    # The first turn looks at the limit itself.
    begin = limit / share, jnp.zeros(limit.shape, bool), jnp.full(limit.shape, -1)
    return jax.lax.while_loop(is_on, cut, begin)[0]
