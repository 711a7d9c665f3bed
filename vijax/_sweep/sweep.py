"""Sweeps: a machine over a grid of parameter values, as a labelled dataset."""

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from tqdm.auto import tqdm

from .._motion.choose import choose_flow
from .._motion.flow import AbstractFlow
from .._simulate import can_any_stick
from .._solution import RESULTS
from .._system.system import ImpactSystem
from .._types import Numbers, as_float
from .lanes import run_lanes
from .paths import Point, points_of_lanes

# Neighbouring lanes do similar work, so a chunk wastes little on its slowest; fewer lanes than this
# leave the processor waiting for the overhead of the compiled loop.
_CHUNK = 128


def sweep(
    system: ImpactSystem,
    values: Mapping[str, Numbers],
    *,
    transient: int = 100,
    record: int = 20,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    flow: AbstractFlow | None = None,
    max_impacts: int = 2048,
    max_steps: int | None = None,
    progress: bool = True,
) -> xr.Dataset:
    """Run a machine from one start at every point of a grid of parameter values.

    The first `transient` forcing periods are discarded and the next `record` periods recorded:
    drawn over the first dimension that is a bifurcation diagram. Runs on all cores.

    Args:
        system: the machine.
        values: for each swept quantity, by its path, the values to visit: "forcing.frequency",
            "forcing.amplitude[0]", "stops[1].position", "stops[*].restitution" (all stops at once),
            "mass[0]", "x0[1]", ..., shape (points,); a whole array such as "damping" takes
            (points, n, n). Several quantities make a product grid, a dimension each.
        transient: forcing periods before recording.
        record: forcing periods that are recorded.
        x0: positions at the start of every point, (n,); zero if left out.
        v0: velocities, likewise.
        flow: the motion between events; exact for linear machines if left out.
        max_impacts: room for the recorded impacts of one point.
        max_steps: bound on the steps of one point; far more than any sound motion takes if left out.
        progress: show a progress bar.

    Returns:
        A dataset with a dimension for every path, named by it, and `stop`, `mass`, `impact`:
        `impact_velocity` (signed, before the impact), `impact_time` (since the transient),
        `impact_phase` (W t mod 2 pi), `impact_stop`, all padded with NaN or -1 to the longest;
        `num_impacts` and `num_sticks` per stop, complete even if the room was not; the end
        state `x`, `v`, `stuck`; and `result`, what became of each point.

    Raises:
        ValueError: for a path that names nothing, values that make no machine, or a start beyond
            a stop.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        ```

    References:
        Wagg & Bishop (2004), Secs. 4.4-4.5.
    """
    _check_counts(transient=transient, record=record, max_impacts=max_impacts)
    axes = {path: np.asarray(as_float(v)) for path, v in values.items()}
    for path, axis in axes.items():
        if axis.ndim == 0 or len(axis) == 0:
            raise ValueError(f"The values of `{path}` must have shape (points, ...), but have {axis.shape}.")
    grid = np.indices([len(axis) for axis in axes.values()]).reshape(len(axes), -1)
    n = system.num_masses
    base = Point(system, *(np.zeros(n) if a is None else np.asarray(as_float(a)) for a in (x0, v0)))
    for name in ("x0", "v0"):
        if getattr(base, name).shape != (n,):
            raise ValueError(
                f"Argument `{name}` must have shape ({n},), but has {getattr(base, name).shape}."
            )
    dtype = base.system.mass.dtype
    swept = {path: axis[i].astype(dtype) for (path, axis), i in zip(axes.items(), grid, strict=True)}
    points = jax.tree.map(lambda a: a.astype(dtype), points_of_lanes(base, swept))
    can_stick = can_any_stick(points.system, points.x0, points.v0)
    if flow is None:
        flow = choose_flow(points.system, can_stick=can_stick)
    run = _runner(transient, record, max_impacts, max_steps, can_stick=can_stick)
    lanes = _run_all(run, points, flow, grid.shape[1], progress)
    return _dataset(system, axes, lanes)


def _check_counts(**counts: int) -> None:
    for name, count in counts.items():
        if isinstance(count, bool) or count != int(count) or count < 0:
            raise ValueError(f"Argument `{name}` must be a whole number, 0 or more, but is {count!r}.")


def _runner(transient: int, record: int, max_impacts: int, max_steps: int | None, *, can_stick: bool):
    """A function from the lanes of one chunk to NumPy arrays, lanes first."""
    if max_steps is None:
        max_steps = 100_000 + 10_000 * (transient + record)
    bounds = jnp.asarray(transient), jnp.asarray(record), jnp.asarray(max_steps)

    def run(chunk: Point, flow: AbstractFlow) -> dict[str, np.ndarray]:
        # Lanes stand last, and a thread has settings of its own: what has none is broadcast to them.
        with jax.numpy_rank_promotion("allow"):
            state, log, steps, is_finite = run_lanes(
                flow,
                chunk.system,
                jnp.asarray(chunk.x0),
                jnp.asarray(chunk.v0),
                bounds,
                jnp.array(True),
                max_impacts=max_impacts,
                can_stick=can_stick,
            )
        is_done = np.asarray(state.periods) >= transient + record
        per_stop = np.asarray(log.num_impacts).T
        full = per_stop.sum(1) > max_impacts
        longest = min(int(per_stop.sum(1).max(initial=0)), max_impacts)
        code = np.where(full, _code("max_impacts_reached"), _code("successful"))
        code = np.where(is_done, code, _code("max_steps_reached"))
        code = np.where(np.asarray(is_finite), code, _code("non_finite"))
        return {
            "impacts": np.asarray(log.impacts[:, :longest]),
            "num_impacts": per_stop,
            "num_sticks": np.asarray(log.num_sticks).T,
            "x": np.asarray(state.x).T,
            "v": np.asarray(state.v).T,
            "stuck": np.asarray(state.held).T,
            "steps": np.asarray(steps),
            "result": code.astype(np.int8),
        }

    return run


def _code(name: str) -> int:
    return list(RESULTS._name_to_item).index(name)


def _run_all(run, points: Point, flow: AbstractFlow, num_lanes: int, progress: bool) -> dict[str, np.ndarray]:
    """Run all chunks, one thread a core: XLA lets go of Python while it works."""
    chunks = list(_chunks(points, flow, num_lanes))
    done: dict[int, dict[str, np.ndarray]] = {}
    workers = ThreadPoolExecutor(
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    )
    try:
        with tqdm(total=num_lanes, unit="point", disable=not progress) as bar:
            jobs = {
                workers.submit(run, chunk, flow): (i, size) for i, (chunk, flow, size) in enumerate(chunks)
            }
            for job in as_completed(jobs):
                i, size = jobs[job]
                done[i] = {name: a[:size] for name, a in job.result().items()}
                bar.update(size)
    finally:
        workers.shutdown(wait=True, cancel_futures=True)
    parts = [done[i] for i in range(len(chunks))]
    longest = max(part["impacts"].shape[1] for part in parts)
    for part in parts:
        room = ((0, 0), (0, longest - part["impacts"].shape[1]), (0, 0))
        part["impacts"] = np.pad(part["impacts"], room, constant_values=np.nan)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _chunks(points: Point, flow: AbstractFlow, num_lanes: int) -> Iterator[tuple[Point, AbstractFlow, int]]:
    """Cut into chunks of one size, the last filled up with its last lane: one shape, one compilation."""
    size = min(_CHUNK, num_lanes)
    for first in range(0, num_lanes, size):
        lanes = np.minimum(np.arange(first, first + size), num_lanes - 1)
        cut = lambda a, lanes=lanes: a if a.shape[-1] == 1 else a[..., lanes]  # noqa: E731
        chunk, motion = jax.tree.map(cut, (points, flow))
        x0, v0 = (np.broadcast_to(a, (*a.shape[:-1], size)) for a in (chunk.x0, chunk.v0))
        yield Point(chunk.system, np.array(x0), np.array(v0)), motion, min(size, num_lanes - first)


def _dataset(system: ImpactSystem, axes: dict[str, np.ndarray], lanes: dict[str, np.ndarray]) -> xr.Dataset:
    shape = tuple(len(axis) for axis in axes.values())
    time, velocity, stop = np.moveaxis(lanes.pop("impacts"), -1, 0)
    lanes |= {
        "impact_time": time,
        "impact_velocity": velocity,
        "impact_stop": np.where(np.isnan(stop), -1, stop).astype(int),
    }
    last = {"num_impacts": "stop", "num_sticks": "stop", "stuck": "stop", "x": "mass", "v": "mass"}
    last |= dict.fromkeys(("impact_time", "impact_velocity", "impact_stop"), "impact")
    variables = {
        name: ((*axes, last[name]) if name in last else tuple(axes), a.reshape(*shape, *a.shape[1:]))
        for name, a in lanes.items()
    }
    coordinates = {path: axis if axis.ndim == 1 else np.arange(len(axis)) for path, axis in axes.items()}
    ds = xr.Dataset(variables, coords=coordinates)
    frequency = ds["forcing.frequency"] if "forcing.frequency" in ds else float(system.forcing.frequency)
    ds["impact_phase"] = np.mod(frequency * ds.impact_time, 2 * np.pi).transpose(*ds.impact_time.dims)
    names = list(RESULTS._name_to_item)
    ds["result"].attrs = {
        "flag_values": np.arange(len(names), dtype=np.int8),
        "flag_meanings": " ".join(names),
    }
    return ds
