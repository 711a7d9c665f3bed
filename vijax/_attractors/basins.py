"""Basins of attraction over a grid of starts, and the uncertainty that their boundary causes."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from .._dataset_checks import check_is_dataset
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, refuse_single_precision
from .._progress import says_what_compiles
from .._system.system import AnySystem
from .attractors import attractors

# `_LEAST_DISTANCES`: distances to neighbours that a slope and its error need.
# `_FARTHEST`: the size of the grid divided by the largest distance.
_LEAST_DISTANCES, _FARTHEST = 3, 8


@says_what_compiles
def basins(
    system: AnySystem,
    grid: Mapping[str, Numbers | tuple[str, Numbers]],
    *,
    transient: Count = 100,
    record: Count = 20,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    fold: bool = False,
    tolerance: float | None = None,
    args: object = None,
    flow: AbstractFlow | None = None,
    max_steps: Count | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Find the basins of attraction over a grid of starts: which attractor each start leads to.

    As `vx.attractors`, for a grid of two start quantities or more. Memory grows with the grid times `record`; impacts
    are not kept.

    Args:
        system: the machine.
        grid: the values of each start quantity by its path, as `{"x0[0]": values, "v0[0]": values}`; with short
            names, as for `vx.sweep`, `{"x": ("x0[0]", values), "v": ("v0[0]", values)}`.
        transient: forcing periods before a motion is recorded.
        record: forcing periods that are recorded.
        x0: positions that the grid does not name, (n,); zero if left out.
        v0: velocities, likewise.
        fold: count mirror images as one, as for `attractors`.
        tolerance: as for `attractors`.
        args: as for `simulate`.
        flow: likewise.
        max_steps: as for `sweep`.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `sweep`.

    Returns:
        The dataset of `vx.attractors`, with `label`, the index of the attractor, over the grid.

    Raises:
        ValueError: if the grid has fewer than two quantities, or names one that is not of the start; and as
            `attractors`.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        grid = {"x0[0]": np.linspace(-0.3, 0.3, 60), "v0[0]": np.linspace(-1, 1, 60)}
        found = vx.basins(vx.models.wagg_bishop_b(2.05), grid)
        ax = vx.plot.basins(found)
        ```

    References:
        G. Datseris & A. Wagemakers, Effortless estimation of basins of attraction, Chaos 32 (2022) 023104.
    """
    refuse_single_precision("basins", system)
    if not isinstance(grid, Mapping) or len(grid) < 2:
        raise ValueError(
            'Argument `grid` must name two start quantities or more, as {"x0[0]": values, "v0[0]": values}; '
            "for other starts use `attractors`."
        )
    return attractors(
        system,
        grid,
        transient=transient,
        record=record,
        x0=x0,
        v0=v0,
        fold=fold,
        tolerance=tolerance,
        args=args,
        flow=flow,
        max_steps=max_steps,
        executor=executor,
        progress=progress,
        settings=settings,
    )


def uncertainty_exponent(basins: xr.Dataset) -> xr.Dataset:
    """Measure how an error of the start makes the attractor uncertain.

    A start is uncertain at the distance e if a start farther by e along an axis, either way, leads to another
    attractor. The fraction of such starts falls as e^alpha: alpha is 1 for a smooth boundary of the basins, and less
    for a fractal one, whose dimension is D - alpha in a grid of D dimensions. To halve the fraction, the start must be
    known 2^(1 / alpha) times as accurately.

    Args:
        basins: result of `vx.basins`. Starts whose attractor is unknown, and their neighbours, do not count.

    Returns:
        `exponent`, alpha, by least squares of the logarithms, with its standard error `exponent_error`; `dimension`,
        D - alpha, of the boundary; and along `distance`, in steps of the grid, the `fraction` of uncertain starts.

    Raises:
        ValueError: if there is no `label` over a grid, the grid is too small, or no boundary is in it.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        grid = {"x0[0]": np.linspace(-0.3, 0.3, 100), "v0[0]": np.linspace(-1, 1, 100)}
        found = vx.basins(vx.models.wagg_bishop_b(2.05), grid)
        vx.uncertainty_exponent(found).exponent
        ```

    References:
        C. Grebogi, S. W. McDonald, E. Ott & J. A. Yorke, Final state sensitivity: an obstruction to predictability,
        Phys. Lett. A 99 (1983) 415.
    """
    check_is_dataset(basins, "basins", "`vx.basins`")
    if "label" not in basins or not basins["label"].ndim:
        raise ValueError(
            "Argument `basins` must be what `vx.basins` returned, but has no `label` over a grid."
        )
    label = basins["label"].values
    farthest = min(label.shape) // _FARTHEST
    steps = np.unique(np.rint(2 ** (np.arange(0, 1 + 2 * np.log2(max(farthest, 1))) / 2)).astype(int))
    if len(steps) < _LEAST_DISTANCES:
        raise ValueError(
            f"The grid has {' x '.join(map(str, label.shape))} starts: {4 * _FARTHEST} along each axis are needed at "
            "least, and some hundreds to see a power law."
        )
    fraction = np.array([_uncertain(label, step, farthest) for step in steps.tolist()])
    if not (fraction > 0).all():
        raise ValueError("No boundary of basins passes through the grid: its starts lead to one attractor.")
    (exponent, _), covariance = np.polyfit(np.log(steps), np.log(fraction), 1, cov=True)
    return xr.Dataset(
        {
            "exponent": ((), exponent, {"long_name": "uncertainty exponent"}),
            "exponent_error": ((), np.sqrt(covariance[0, 0])),
            "dimension": ((), label.ndim - exponent, {"long_name": "dimension of the boundary"}),
            "fraction": (("distance",), fraction, {"long_name": "fraction of uncertain starts"}),
        },
        coords={"distance": ("distance", steps, {"long_name": "distance in steps of the grid"})},
    )


def _uncertain(label: np.ndarray, step: int, farthest: int) -> float:
    """Fraction of starts with another label `step` away, among those with neighbours at all distances."""
    inner = tuple(slice(farthest, -farthest) for _ in label.shape)
    here, is_known, is_other = label[inner], label[inner] >= 0, np.zeros(label[inner].shape, bool)
    for axis in range(label.ndim):
        for shift in (-step, step):
            there = np.roll(label, shift, axis=axis)[inner]
            is_known, is_other = is_known & (there >= 0), is_other | (there != here)
    return float(is_other[is_known].mean()) if is_known.any() else 0.0
