"""Integrity of coexisting attractors: how far from each the motion may be thrown and still return."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from .._dataset_attributes import with_words
from .._dataset_checks import check_is_dataset
from .._jax.arrays import Count, whole_number
from .._sweep.provenance import machines_of
from .._sweep.short_names import path_of, with_paths
from .._system.force_description import NAMED_FORCE
from .integrity_measures import Window, ball_about, entropies, largest_ball, window_of
from .table import ATTRACTOR, share_statistics

# What a datasheet repeats of each attractor.
_KEPT = ("motion", "num_periods", "num_impacts", "is_stable", "multipliers")


def integrity(basins: xr.Dataset, *, scale: Mapping[str, float] | None = None, box: Count = 5) -> xr.Dataset:
    """Measure the integrity of attractors from their basins: by shares, by the largest balls, by entropies.

    The share of the window is the global integrity measure. The local one is the radius of the largest ball of the basin
    about the attractor: about the nearest to the boundary of its points at phase 0. The integrity factor is the
    radius of the largest ball in the basin anywhere: fractal parts of it do not count. Starts that lead elsewhere or
    to no known attractor bound a ball, and so does the edge of the window, except where a stop stands.

    The basin entropy is the mean over all boxes of `box` starts a side of -sum p log p, p the fractions of the
    starts in the box that lead to each attractor. The boundary basin entropy is the mean over those boxes with two
    attractors or more. If it exceeds log 2, the boundary is fractal.

    Args:
        basins: result of `vx.basins`.
        scale: for each start quantity, by its path or short name, the length that counts as 1 in radii; where it is left
            out, the width of the window.
        box: starts along each side of a box, 2 or more. Boxes begin at the lowest values; starts left over at the highest are left out.

    Returns:
        Along `attractor`: `share` with its binomial `share_error`; `local_integrity` and `integrity_factor` with the
        bounds `local_integrity_error` and `integrity_factor_error` on their errors, as far as the grid resolves the
        basins; `center` (attractor, quantity), that of the largest ball, in units of the machine; what `basins` has of its
        motion. The local integrity is NaN where the attractor leaves the window, or the window does not span all
        positions and velocities. `basin_entropy` and `boundary_basin_entropy`, NaN without a boundary.

    Raises:
        ValueError: if there is no `label` over a grid, `box` is larger than it, or `scale` names no quantity of it or is
            not positive.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        grid = {"x0[0]": np.linspace(-0.5, 0.5, 60), "v0[0]": np.linspace(-3, 3, 60)}
        found = vx.basins(vx.models.two_sided_oscillator(), grid)
        vx.integrity(found).local_integrity
        ```

    References:
        J. M. T. Thompson, Proc. R. Soc. Lond. A 421 (1989) 195; S. Lenci & G. Rega, Nonlinear Dyn. 33 (2003) 71;
        P. J. Menck, J. Heitzig, N. Marwan & J. Kurths, Nature Phys. 9 (2013) 89; A. Daza, A. Wagemakers,
        B. Georgeot, D. Guery-Odelin & M. A. F. Sanjuan, Sci. Rep. 6 (2016) 31416.
    """
    lengths = _checked(basins, scale or {}, whole_number("box", box, 2))
    known = with_paths(basins)
    dims = [str(dim) for dim in known["label"].dims]
    system = None
    if "system" in known.attrs:
        import jax

        system = jax.tree.map(lambda a: np.asarray(a)[..., 0], machines_of(known[[]], force=NAMED_FORCE))
    window, order = window_of({dim: known[dim].values for dim in dims}, lengths, system)
    label = known["label"].values[np.ix_(*order)]
    section = np.concatenate([known["section_x"].values, known["section_v"].values], axis=2)
    columns = integrity_columns(window, label, list(section), int(box))
    ds = xr.Dataset(columns, coords={"quantity": np.array([*basins["label"].dims], np.dtypes.StringDType())})
    return ds.assign(known[[name for name in _KEPT if name in known]])


def integrity_columns(
    window: Window, label: np.ndarray, sections: list[np.ndarray], box: int
) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]:
    """The variables of `integrity`, from labels on a grid and the section of each attractor, (points, 2 n)."""
    count = len(sections)
    _, share, share_error = share_statistics(label.reshape(-1), count, label.size)
    local, largest = np.full((count, 2), np.nan), np.zeros((count, 2))
    center = np.full((count, label.ndim), np.nan)
    for k, states in enumerate(sections):
        points = window.coordinates(states[~np.isnan(states).any(axis=1)])
        if points is not None:
            local[k] = ball_about(window, label, k, points)
        *largest[k], center[k] = largest_ball(window, label, k)
    basin, boundary = entropies(label, box)
    columns = {
        "share": (share, "fraction of the starts that lead to the attractor"),
        "share_error": (share_error, "binomial standard error of the share"),
        "local_integrity": (local[:, 0], "largest ball of the basin about the attractor"),
        "local_integrity_error": (local[:, 1], "bound on the error of the local integrity"),
        "integrity_factor": (largest[:, 0], "largest ball of the basin"),
        "integrity_factor_error": (largest[:, 1], "bound on the error of the integrity factor"),
    }
    columns = {name: ((ATTRACTOR,), a, words) for name, (a, words) in columns.items()} | {
        "center": ((ATTRACTOR, "quantity"), center, "centre of the largest ball"),
        "basin_entropy": ((), np.asarray(basin), "basin entropy"),
        "boundary_basin_entropy": ((), np.asarray(boundary), "boundary basin entropy"),
    }
    return with_words(columns)


def _checked(basins: xr.Dataset, scale: Mapping[str, float], box: int) -> dict[str, float]:
    """The lengths that count as 1, by path."""
    check_is_dataset(basins, "basins", "`vx.basins`")
    if "label" not in basins or not basins["label"].ndim:
        raise ValueError(
            "Argument `basins` must be what `vx.basins` returned, but has no `label` over a grid."
        )
    shape, dims = basins["label"].shape, {str(dim): path_of(basins, dim) for dim in basins["label"].dims}
    if box > min(shape):
        raise ValueError(
            f"Argument `box` must be at most {min(shape)}, the starts of the grid, but is {box}."
        )
    for name, length in scale.items():
        if name not in {*dims, *dims.values()} or not length > 0:
            raise ValueError(
                f"Argument `scale` must give a positive length for quantities of the grid, {', '.join(dims)}, but has "
                f"{length} for `{name}`."
            )
    return {dims.get(name, name): float(length) for name, length in scale.items()}
