"""The edge state between two attractors, by bisection.

Between two starts that lead to different attractors lies a start on the boundary of their basins. A bracket of it, divided until it
is narrow, is carried on by a forcing period, divided again, and so on: it stays at the boundary, and on it approaches the motion
that attracts there, the edge state. That is the saddle over which a shock must push the machine, a cycle or chaos.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from .._dataset_attributes import with_words
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_numpy_float, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._orbits.find_many import all_coordinates
from .._orbits.maps import stroboscopic_map
from .._progress import says_what_compiles, tqdm
from .shocks import Shocks, shocks_of

# Parts into which a bracket is divided at once.
_PARTS = 64
# Most forcing periods of a cycle that is recognised.
_MOST_PERIODS = 8
# Distance after n periods, in widths of the bracket, below which the edge state is a cycle.
_AGAIN = 4.0


@says_what_compiles
@padding_allowed
def edge_state(
    found: xr.Dataset,
    start_a: Count | tuple[Numbers, Numbers] = 0,
    start_b: Count | tuple[Numbers, Numbers] = 1,
    *,
    tolerance: float = 1e-8,
    max_periods: Count = 200,
    flow: AbstractFlow | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Find the edge state between two attractors, the saddle on the boundary of their basins.

    The segment between two starts is bisected for the boundary, and the boundary is followed until the motion on it repeats.
    Where other basins lie between the starts, the boundary is that of the first start's basin. A fractal boundary has
    several edge states, and the starts decide which one is found.

    Args:
        found: result of `vx.attractors` or `vx.basins`.
        start_a: a start (x0, v0) at phase 0, or the number of an attractor.
        start_b: a start that leads to another attractor, likewise.
        tolerance: width of the bracket of the boundary, relative to the size of the attractors.
        max_periods: forcing periods for which the boundary is followed at most.
        flow: as for `vx.attractors`.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `vx.sweep`.

    Returns:
        `x0` and `v0` (mass), a state at phase 0 in the middle of the bracket; `num_periods`, the forcing periods after which it
        repeats, 0 if it does not within `max_periods`, as where the edge is chaotic; `size_error`, the width of the bracket,
        and `recurrence_error`, the distance after `num_periods`, both in (W x, v), the largest entry; `goes_to` (side), the attractors on both
        sides. `vx.periodic_orbit` finds the saddle itself from there, to all digits.

    Raises:
        ValueError: if both starts lead to the same attractor, or one to none of those found; for an argument that is not
            positive; in single precision.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.two_sided_oscillator(3.0, damping_ratio=0.1)
        edge = vx.edge_state(vx.attractors(system, 100))
        saddle = vx.periodic_orbit(system, edge.x0.values, edge.v0.values, int(edge.num_periods))
        ```

    References:
        J. D. Skufca, J. A. Yorke & B. Eckhardt, Phys. Rev. Lett. 96 (2006) 174101.
    """
    shocks = replace(shocks_of("edge_state", found, 0, 0, flow, executor, settings), number=-1)
    refuse_single_precision("edge_state", shocks.machines.system)
    if not tolerance > 0:
        raise ValueError(f"Argument `tolerance` must be positive, but is {tolerance}.")
    most = whole_number("max_periods", max_periods, 1)
    ends = np.stack([_state(shocks, name, one) for name, one in (("start_a", start_a), ("start_b", start_b))])
    shocks = replace(shocks, state=0 * ends[0])
    width = tolerance * max(motion.size for motion in shocks.motions)
    with tqdm(unit="period", disable=not progress) as bar:
        tracking = _Tracking(shocks, width, *_checked_labels(shocks, ends), _map_of(shocks, flow))
        return tracking.run(ends, most, bar)


def _state(shocks: Shocks, name: str, given: Count | tuple[Numbers, Numbers]) -> np.ndarray:
    """State (W x, v) of a start, or on an attractor."""
    system = shocks.machines.system
    if not isinstance(given, tuple | list):
        number = whole_number(name, given)
        if number >= len(shocks.motions):
            raise ValueError(
                f"Argument `{name}` must be less than {len(shocks.motions)}, the number of attractors, but is {number}."
            )
        return shocks.motions[number].points[0]
    parts = [as_numpy_float(a) for a in given]
    sizes = (system.num_masses,), (system.num_coordinates,)
    if (
        len(parts) != 2
        or parts[0].shape != parts[1].shape
        or parts[0].shape not in sizes
        or not np.isfinite(parts).all()
    ):
        raise ValueError(
            f"Argument `{name}` must be positions and velocities, ({system.num_masses},) each, but is {given}."
        )
    state = all_coordinates(system, np.concatenate(parts)[None])[0]
    return state * shocks.machines.scale(np.zeros(1, int))[0]


def _checked_labels(shocks: Shocks, ends: np.ndarray) -> tuple[int, int]:
    """Attractors to which two starts lead, which must differ."""
    beyond = shocks.is_beyond(ends)
    if beyond.any():
        raise ValueError(f"Argument `{('start_a', 'start_b')[int(beyond.argmax())]}` lies beyond a stop.")
    a, b = (int(label) for label in shocks.labels(ends))
    for name, label in (("start_a", a), ("start_b", b)):
        if label < 0:
            raise ValueError(
                f"Argument `{name}` leads to none of the attractors found: take another start, or search with more starts."
            )
    if a == b:
        raise ValueError(
            f"Both starts lead to attractor {a}: between them no boundary need lie. Take starts that lead to different ones."
        )
    return a, b


def _map_of(shocks: Shocks, flow: AbstractFlow | None) -> Callable[[Array], Array]:
    """Map of states (W x, v), (points, 2 n), over a forcing period."""
    system, scale = shocks.machines.system, shocks.machines.scale(np.zeros(1, int))[0]

    def of_one(z: Array) -> Array:
        x, v = jnp.split(z / scale, 2)
        return jnp.concatenate(stroboscopic_map(system, x, v, flow=flow)) * scale

    return jax.jit(jax.vmap(of_one))


@dataclass
class _Tracking:
    """The bracket of the boundary, carried along.

    Attributes:
        shocks: the machine and its attractors, the state shocked being zero.
        width: width below which the bracket is not divided.
        first: attractor to which its first end leads.
        last: likewise of its last end.
        map: the stroboscopic map of states (W x, v).
    """

    shocks: Shocks
    width: float
    first: int
    last: int
    map: Callable[[Array], Array]

    def run(self, ends: np.ndarray, most: int, bar: tqdm) -> xr.Dataset:
        """Follow the boundary from the segment between two states."""
        ends = self.narrowed(ends)
        middles, num_periods, error = [ends.mean(axis=0)], 0, np.nan
        for _ in range(most):
            ends = self.narrowed(np.asarray(self.map(jnp.asarray(ends))))
            middles.append(ends.mean(axis=0))
            bar.update()
            away = np.abs(np.array(middles[-2 : -2 - _MOST_PERIODS : -1]) - middles[-1]).max(axis=1)
            near = np.flatnonzero(away < _AGAIN * self.width)
            if near.size:
                num_periods, error = int(near[0]) + 1, float(away[near[0]])
                break
        return self.dataset(ends, num_periods, error)

    def narrowed(self, ends: np.ndarray) -> np.ndarray:
        """The first part of a bracket at whose ends the label changes, divided until it is narrow."""
        while np.abs(ends[1] - ends[0]).max() > self.width:
            share = np.arange(1, _PARTS)[:, None] / _PARTS
            inner = ends[0] + share * (ends[1] - ends[0])
            label = np.append(self.shocks.labels(inner), self.last)
            k = int((label != self.first).argmax())
            states = np.concatenate([ends[:1], inner, ends[1:]])
            ends, self.last = states[k : k + 2], int(label[k])
        return ends

    def dataset(self, ends: np.ndarray, num_periods: int, error: float) -> xr.Dataset:
        scale = self.shocks.machines.scale(np.zeros(1, int))[0]
        x, v = np.split(ends.mean(axis=0) / scale, 2)
        width, sides = float(np.abs(ends[1] - ends[0]).max()), np.array([self.first, self.last])
        columns = {
            "x0": ("mass", x, "position on the boundary"),
            "v0": ("mass", v, "velocity on the boundary"),
            "num_periods": ((), num_periods, "forcing periods after which the edge state repeats"),
            "size_error": ((), width, "width of the bracket"),
            "recurrence_error": ((), error, "distance after these periods"),
            "goes_to": ("side", sides, "attractors on both sides"),
        }
        return xr.Dataset(with_words(columns))
