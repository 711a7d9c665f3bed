"""The smallest shock that throws a motion off its attractor.

Rays of shocks from the attractor are searched on a grid of sizes for the first that leads elsewhere. Those brackets
that may hold the smallest are divided until they are as narrow as wanted. Where all states may be shocked, the best ray is
then turned, by smaller and smaller angles, as long as the shock becomes smaller.
"""

import numpy as np
import xarray as xr

from .._dataset_attributes import with_words
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_numpy_float, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles, tqdm
from .shocks import Shocks, shocks_of

# Parts into which a bracket is divided at once.
_PARTS = 64
# A ray is turned until the angle is this small: the size then changes by its square.
_SMALLEST_TURN = 5e-4
# Nearest part of a ray that is searched again when it is turned, relative to its size.
_SEARCHED = 0.1


@says_what_compiles
@padding_allowed
def critical_shock(
    found: xr.Dataset,
    attractor: Count = 0,
    *,
    direction: str | Numbers | None = None,
    largest: float | None = None,
    period: Count = 0,
    rays: Count = 64,
    steps: Count = 64,
    tolerance: float = 1e-6,
    flow: AbstractFlow | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Find the smallest shock from an attractor after which the motion goes elsewhere, and to where.

    A shock changes the state at an instant at phase 0 of the load: by dv, dx, or both. Its size is the norm of (W dx, dv),
    a speed, W the frequency of the load. Jenkins elements keep their forces. For a shock at another phase, find the
    attractors of the machine with that phase added to `forcing.phase`, and to those of moving stops. Parts of other basins that are thinner than
    `largest / steps`, or pass between two rays, are missed: where the boundary is fractal thin layers of other basins may lie
    below the size that is found, by more than `size_error`.

    Args:
        found: result of `vx.attractors` or `vx.basins`; its transients and records are used again.
        attractor: index of the attractor.
        direction: None for shocks of all positions and velocities; the path of one, "v0[0]", both ways; or the direction
            (dx, dv), (2 n,).
        largest: the largest size that is tried; if left out, twice the largest |W x| and |v| of all attractors.
        period: of a cycle of several periods, the number of the one at whose begin the shock comes.
        rays: number of directions, without a given one.
        steps: number of sizes along each.
        tolerance: width of the bracket of the size at the end, relative to `largest`.
        flow: as for `vx.attractors`.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `vx.sweep`.

    Returns:
        `size`, the smallest that leads elsewhere, and `size_error`, the width of its bracket: a shock smaller by that leads
        back; `kick_x` and `kick_v` (mass), the shock; `x0` and `v0`, the state after it; `goes_to`, the attractor to
        which it leads, -1 if none of those found. NaN and -1 if no shock up to `largest` leads elsewhere.

    Raises:
        ValueError: if there is no such attractor, or no direction; if `largest` or `tolerance` is not positive.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        found = vx.attractors(vx.models.two_sided_oscillator(3.0, damping_ratio=0.025), 100)
        shock = vx.critical_shock(found, 0, direction="v0[0]")
        ```

    References:
        J. M. T. Thompson, Proc. R. Soc. Lond. A 421 (1989) 195; C. Mitra, J. Kurths & R. V. Donner, An integrative
        quantifier of multistability, Sci. Rep. 5 (2015) 16196.
    """
    shocks = shocks_of("critical_shock", found, attractor, period, flow, executor, settings)
    refuse_single_precision("critical_shock", shocks.machines.system)
    if largest is None:
        largest = 2 * max(motion.size for motion in shocks.motions)
    for name, value in (("largest", largest), ("tolerance", tolerance)):
        if not value > 0:
            raise ValueError(f"Argument `{name}` must be positive, but is {value}.")
    count = whole_number("rays", rays, 2)
    units = _directions(shocks, direction, count)
    parts = whole_number("steps", steps, 1)
    sizes = largest * np.arange(1, parts + 1) / parts
    with tqdm(unit="run", disable=not progress) as bar:
        search = _Search(shocks, tolerance * largest, bar)
        best = search.smallest(units, np.concatenate([[0.0], sizes]))
        if direction is None and best is not None:
            best = search.turned(*best, 2 * np.pi / count)
    return _dataset(shocks, best)


class _Search:
    """The search for the smallest shock."""

    def __init__(self, shocks: Shocks, width: float, bar: tqdm):
        self.shocks, self.width, self.bar = shocks, width, bar

    def smallest(self, units: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, float, float, int] | None:
        """The direction with the smallest shock that leads elsewhere, its bracket, and its label.

        Args:
            units: directions (W x, v), (rays, 2 n).
            sizes: sizes in increasing order; the first leads back.
        """
        low, high, label = self._first(units, np.broadcast_to(sizes, (len(units), len(sizes))))
        while np.isfinite(high).any():
            is_open = (low < high.min()) & np.isfinite(high)
            which = np.flatnonzero(is_open & (high - low > self.width))
            if not which.size:
                k = int(np.where(is_open, high, np.inf).argmin())
                return units[k], float(low[k]), float(high[k]), int(label[k])
            parts = low[which, None] + (high - low)[which, None] * np.arange(_PARTS + 1) / _PARTS
            low[which], high[which], label[which] = self._first(
                units[which], parts, high[which], label[which]
            )
        return None

    def turned(
        self, unit: np.ndarray, low: float, high: float, label: int, angle: float
    ) -> tuple[np.ndarray, float, float, int]:
        """Turn a direction as long as the shock becomes smaller."""
        best = unit, low, high, label
        while angle > _SMALLEST_TURN:
            unit, _, high, _ = best
            tangents = np.linalg.svd(unit[None])[2][1:]
            units = np.concatenate([np.cos(angle) * unit + s * np.sin(angle) * tangents for s in (1, -1)])
            sizes = high * np.concatenate([[0], np.linspace(1 - _SEARCHED, 1, _PARTS)])
            found = self.smallest(units, sizes)
            if found is None or found[2] >= high - self.width:
                angle /= 2
            else:
                best = found
        return best

    def _first(
        self,
        units: np.ndarray,
        sizes: np.ndarray,
        known: np.ndarray | None = None,
        known_label: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bracket of the first size along each ray that leads elsewhere, and its label; infinite if there is none.

        The first of `sizes`, (rays, sizes), leads back. The last is known to lead to `known_label` if `known` is given.
        """
        inner = sizes[:, 1:] if known is None else sizes[:, 1:-1]
        kicks = inner[:, :, None] * units[:, None]
        kicks = self.shocks.of_masses(kicks.reshape(-1, units.shape[1]))
        label = self.shocks.labels(kicks).reshape(inner.shape)
        self.bar.update(label.size)
        if known_label is not None:
            label = np.concatenate([label, known_label[:, None]], axis=1)
        is_away = label != self.shocks.number
        first, each = is_away.argmax(axis=1), np.arange(len(sizes))
        is_any = is_away.any(axis=1)
        high = np.where(is_any, sizes[each, first + 1], np.inf)
        return sizes[each, first].copy(), high, np.where(is_any, label[each, first], -1)


def _directions(shocks: Shocks, direction: str | Numbers | None, count: int) -> np.ndarray:
    """Unit vectors (W x, v) of the masses, (rays, 2 n)."""
    size = len(shocks.scale)
    n = size // 2
    if direction is None:
        if n == 1:
            angle = 2 * np.pi * np.arange(count) / count
            return np.stack([np.cos(angle), np.sin(angle)], axis=1)
        axes = np.concatenate([np.eye(size), -np.eye(size)])
        drawn = np.random.default_rng(0).normal(size=(max(count - len(axes), 0), size))
        return np.concatenate([axes, drawn / np.linalg.norm(drawn, axis=1, keepdims=True)])
    if isinstance(direction, str):
        paths = [f"{name}0[{i}]" for name in "xv" for i in range(n)]
        if direction not in paths:
            raise ValueError(f"Argument `direction` must be one of {', '.join(paths)}, but is {direction!r}.")
        unit = np.eye(size)[paths.index(direction)]
        return np.stack([unit, -unit])
    given = as_numpy_float(direction)
    if given.shape != (size,) or not np.isfinite(given).all() or not given.any():
        raise ValueError(f"Argument `direction` must be (dx, dv), ({size},) and not zero, but is {given}.")
    unit = given * shocks.scale
    return (unit / np.linalg.norm(unit))[None]


def _dataset(shocks: Shocks, best: tuple[np.ndarray, float, float, int] | None) -> xr.Dataset:
    n = len(shocks.state) // 2
    nothing = np.full(len(shocks.scale), np.nan), np.nan, np.nan, -1
    unit, low, high, label = nothing if best is None else best
    kick, scale = shocks.of_masses(high * unit), shocks.machines.scale(np.zeros(1, int))[0]
    kick, state = kick / scale, (shocks.state + kick) / scale
    columns = {
        "size": ((), high, "size of the smallest shock that leads elsewhere"),
        "size_error": ((), high - low, "width of the bracket of the size"),
        "kick_x": ("mass", kick[:n], "change of the position"),
        "kick_v": ("mass", kick[n:], "change of the velocity"),
        "x0": ("mass", state[:n], "position after the shock"),
        "v0": ("mass", state[n:], "velocity after the shock"),
        "goes_to": ((), label, "number of the attractor to which it leads"),
    }
    return xr.Dataset(with_words(columns))
