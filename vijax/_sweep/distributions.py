"""Distributions of quantities of a machine: their samples, their means and covariances."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import numpy as np
from scipy.stats import norm, qmc

from .._jax.arrays import Count, Numbers, as_numpy_float, whole_number
from .._system.parameters import get_parameter
from .short_names import without_names

# Sobol points are multiples of 2^-30. At the middles of these cells no quantile is infinite.
_HALF_CELL = 2.0**-31
# Rounding of a matrix that is symmetric, with ones along its diagonal.
_ROUNDING = 1e-12


@runtime_checkable
class Distribution(Protocol):
    """A distribution of one number, as those of `scipy.stats` with their parameters given."""

    def ppf(self, q: Any) -> Any:
        """Quantiles at probabilities."""

    def mean(self) -> Any:
        """Mean."""

    def std(self) -> Any:
        """Standard deviation."""


# For type checkers. At run time `uncertain` refuses anything else, with a clear message.
if TYPE_CHECKING:
    Distributions = Mapping[str, Distribution | tuple[str, Distribution]]
else:
    Distributions = Mapping


class Uncertain(NamedTuple):
    """Uncertain quantities: their distributions by path, their short names, their correlation (quantities, quantities)."""

    by_path: dict[str, Distribution]
    names: dict[str, str]
    correlation: np.ndarray


def uncertain(given: Distributions, whole: eqx.Module, correlation: Numbers | None) -> Uncertain:
    """The uncertain quantities of a machine, or of a module that holds it beside its start, checked."""
    if not isinstance(given, Mapping) or not given:
        raise ValueError(
            "Argument `distributions` must give the distribution of each quantity by its path, as "
            f'{{"stops[*].restitution": scipy.stats.uniform(0.6, 0.2)}}, but is {given!r}.'
        )
    # Names are checked without the distributions, which stand where a sweep has numbers.
    entries = {name: a if isinstance(a, tuple) and a else (None, a) for name, a in given.items()}
    numbers = {name: 0.0 if a[0] is None else (a[0], *[0.0] * (len(a) - 1)) for name, a in entries.items()}
    paths, names = without_names(numbers, whole)
    by_path = {path: a[-1] for path, a in zip(paths, entries.values(), strict=True)}
    for path, distribution in by_path.items():
        if not isinstance(distribution, Distribution):
            raise ValueError(
                f"The distribution of `{path}` must have `ppf`, `mean` and `std`, as `scipy.stats.norm(0.7, 0.02)` has, "
                f"but is {distribution!r}."
            )
        if get_parameter(whole, path).ndim > ("*" in path):
            raise ValueError(f"The path `{path}` names an array: name its uncertain entries one by one.")
    return Uncertain(by_path, names, _correlation(correlation, len(by_path)))


def drawn(uncertain: Uncertain, samples: Count, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Quasi-random values of all quantities at once, (samples,) each."""
    count = whole_number("samples", samples, 1)
    # SciPy has renamed `seed`, which it still takes, to `rng`.
    sobol: Any = qmc.Sobol
    points = sobol(len(uncertain.by_path), seed=rng).random_base2(max(count - 1, 0).bit_length())[:count]
    points = points + _HALF_CELL
    if not np.array_equal(uncertain.correlation, np.eye(len(uncertain.correlation))):
        points = norm.cdf(norm.ppf(points) @ np.linalg.cholesky(uncertain.correlation).T)
    found = {}
    for (path, distribution), u in zip(uncertain.by_path.items(), points.T, strict=True):
        found[path] = as_numpy_float(distribution.ppf(u))
        if found[path].shape != (count,) or not np.isfinite(found[path]).all():
            raise ValueError(f"The distribution of `{path}` must give one finite number a sample.")
    return found


def moments(uncertain: Uncertain) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations, (quantities,) each."""
    mean, std = (
        np.array([getattr(a, name)() for a in uncertain.by_path.values()], as_numpy_float(0.0).dtype)
        for name in ("mean", "std")
    )
    for path, *known in zip(uncertain.by_path, mean, std, strict=True):
        if not np.isfinite(known).all():
            raise ValueError(f"The distribution of `{path}` must have a finite mean and standard deviation.")
    return mean, std


def _correlation(given: Numbers | None, count: int) -> np.ndarray:
    """The correlation matrix, checked."""
    if given is None:
        return np.eye(count)
    matrix = as_numpy_float(given)
    if (
        matrix.shape != (count, count)
        or not np.allclose(matrix, matrix.T, rtol=0, atol=_ROUNDING)
        or not np.allclose(np.diag(matrix), 1, rtol=0, atol=_ROUNDING)
        or not (np.linalg.eigvalsh(matrix) > 0).all()
    ):
        raise ValueError(
            f"Argument `correlation` must be a symmetric positive definite matrix, ({count}, {count}), with ones along its "
            f"diagonal, but is {matrix.tolist()}."
        )
    return matrix
