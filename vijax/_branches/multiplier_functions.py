"""Functions of multipliers that change sign at the bifurcations of a cycle."""

from functools import cache
from typing import Any

import numpy as np

from .._jax.arrays import array_namespace
from .corrector import Corrected

Multipliers = Any


def _ratio(values: Any, of: Any) -> Any:
    """Product of values / (1 + |of|), which is finite where a multiplier is not."""
    xp = array_namespace(values, of)
    with np.errstate(invalid="ignore"):
        parts = values / (1 + xp.abs(of))
    is_finite = xp.isfinite(parts)
    if xp is not np or not is_finite.all():
        parts = xp.where(is_finite, parts, xp.sign(of.real))
    return xp.prod(parts, axis=-1).real


def of_doubling(mu: Multipliers) -> Any:
    """Function of multipliers that is zero where one is -1."""
    return _ratio(1 + mu, mu)


def of_meeting(mu: Multipliers) -> Any:
    """Function of multipliers that is zero where one is 1."""
    return _ratio(mu - 1, mu)


@cache
def _pairs(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the first and of the second member of all pairs."""
    first, second = np.triu_indices(size, 1)
    return first, second


def of_pairs(mu: Multipliers) -> Any:
    """Function of multipliers that is zero where the product of two is 1."""
    first, second = _pairs(mu.shape[-1])
    xp = array_namespace(mu)
    with np.errstate(invalid="ignore"):
        products = mu[..., first] * mu[..., second]
    return _ratio(products - 1, xp.where(xp.isnan(products), 0, products))


def of_neighbours(found: Corrected) -> Any:
    """Functions of a corrected cycle that vanish where other cycles are beside it, (4,).

    Zero at a fold, where a multiplier is -1, where one is 1, and where the product of two is 1.
    """
    mu = found.multipliers
    values = found.tangent.p, of_doubling(mu), of_meeting(mu), of_pairs(mu)
    return array_namespace(*values).stack(values)
