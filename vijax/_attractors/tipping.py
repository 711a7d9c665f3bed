"""The probability that a random shock throws a motion off its attractor."""

import numpy as np
import xarray as xr

from .._dataset_attributes import with_words
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_numpy_float, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles
from .._sweep.random_numbers import Rng, generator_of
from .shocks import Shocks, shocks_of
from .table import ATTRACTOR, share_statistics

# Number of times that shocks beyond stops are drawn again.
_TRIES = 200


@says_what_compiles
@padding_allowed
def tipping_probability(
    found: xr.Dataset,
    covariance: Numbers,
    attractor: Count = 0,
    *,
    samples: Count = 1000,
    rng: Rng | None = None,
    seed: Count | None = None,
    period: Count = 0,
    flow: AbstractFlow | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Estimate how probably a random shock throws a motion off its attractor, and to which others.

    Normal shocks with mean 0 come at phase 0 of the load. A mass cannot be thrown beyond a rigid stop: such shocks are drawn
    again, so that the distribution is that under the condition that the state exists. Jenkins elements keep their forces.

    Args:
        found: result of `vx.attractors` or `vx.basins`; its transients and records are used again.
        covariance: of the shocks (dx, dv), (2 n, 2 n), or of dv alone, (n, n).
        attractor: index of the attractor.
        samples: number of shocks.
        rng: of the shocks, as for `vx.attractors`.
        seed: likewise.
        period: of a cycle of several periods, the number of the one at whose begin the shocks come.
        flow: as for `vx.attractors`.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `vx.sweep`.

    Returns:
        `tipping`, the probability to leave the attractor, and `tipping_error`, its binomial standard error; along
        `attractor` the `probability` to end on each, with `probability_error`; `unknown`, the fraction that ends on none of
        those found, which counts as left.

    Raises:
        ValueError: if there is no such attractor, `covariance` is no covariance, or hardly any shock keeps the masses between
            the stops.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        found = vx.attractors(vx.models.two_sided_oscillator(3.0, damping_ratio=0.025), 100)
        vx.tipping_probability(found, [[0.1]]).tipping
        ```

    References:
        P. J. Menck, J. Heitzig, N. Marwan & J. Kurths, Nature Phys. 9 (2013) 89.
    """
    shocks = shocks_of("tipping_probability", found, attractor, period, flow, executor, settings)
    refuse_single_precision("tipping_probability", shocks.machines.system)
    count = whole_number("samples", samples, 1)
    kicks = _drawn(shocks, _root(covariance, len(shocks.scale)), count, generator_of(rng, seed))
    label = shocks.labels(kicks, progress=progress)
    _, share, error = share_statistics(label, len(shocks.motions), count)
    away = float((label != shocks.number).mean())
    columns = {
        "tipping": ((), away, "probability to leave the attractor"),
        "tipping_error": ((), np.sqrt(away * (1 - away) / count), "standard error"),
        "probability": (ATTRACTOR, share, "probability to end on the attractor"),
        "probability_error": (ATTRACTOR, error, "standard error"),
        "unknown": ((), float((label < 0).mean()), "fraction that ends on no known attractor"),
    }
    return xr.Dataset(with_words(columns))


def _root(covariance: Numbers, size: int) -> np.ndarray:
    """A matrix whose square is the covariance of (dx, dv), (2 n, 2 n)."""
    given = as_numpy_float(covariance)
    if given.shape == (size // 2, size // 2):
        whole = np.zeros((size, size), given.dtype)
        whole[size // 2 :, size // 2 :] = given
        given = whole
    is_symmetric = given.shape == (size, size) and np.allclose(given, given.T, rtol=1e-12, atol=0)
    values, vectors = np.linalg.eigh(given) if is_symmetric else (np.array([-1.0]), given)
    if values.min() < -1e-12 * max(values.max(), 0) or not values.max() > 0:
        raise ValueError(
            f"Argument `covariance` must be symmetric without negative eigenvalues and not zero, ({size}, {size}) or, of "
            f"velocities, ({size // 2}, {size // 2}), but is {given.tolist()}."
        )
    return vectors * np.sqrt(np.maximum(values, 0))


def _drawn(shocks: Shocks, root: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Shocks (W x, v), (samples, 2 n), none of them beyond a rigid stop."""
    kicks, left = np.empty((count, len(shocks.state))), np.arange(count)
    for _ in range(_TRIES):
        kicks[left] = shocks.of_masses(rng.normal(size=(len(left), len(root))) @ root.T * shocks.scale)
        left = left[shocks.is_beyond(kicks[left])]
        if not left.size:
            return kicks
    raise ValueError("Hardly any shock keeps the masses between the stops: give a smaller `covariance`.")
