"""Sweeps: a machine over a grid of parameter values, as a labelled dataset."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from .._execution.cluster import choose_runner
from .._execution.points import LaneInput
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._execution.store import describe_sweep, open_store
from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._hybrid.sticking import can_any_stick
from .._jax.arrays import Count, Numbers
from .._progress import interrupt_with_word_of, says_what_compiles, tqdm
from .._system.system import AnySystem, machine_of, varied
from .carry import lanes_of_chains, run_chains
from .counts import RECORD, TRANSIENT, counts_of
from .dataset import dataset, saved_times
from .grid import base_of, grid_points, values_of
from .literals import Carry, Quantity
from .outcomes import warn_of_endings
from .provenance import name_of_flow, origin
from .quantities import checked_quantities, observed_for
from .short_names import with_labels, with_names, without_names
from .unsettled import warn_of_unsettled_points
from .zarr_output import write_sweep


@says_what_compiles
def sweep(
    system: AnySystem,
    values: Mapping[str, Numbers | tuple[str, Numbers]],
    *,
    transient: Count = TRANSIENT,
    record: Count = RECORD,
    duration: Numbers | None = None,
    ts: Numbers | None = None,
    carry: Carry | None = None,
    carry_from: xr.Dataset | None = None,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    lyapunov: bool = False,
    quantities: Sequence[Quantity] = (),
    max_impacts: Count = 2048,
    max_steps: Count | None = None,
    store: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Run a machine from one start at every point of a grid of parameter values.

    The first `transient` forcing periods are discarded and the next `record` periods recorded: drawn over the first
    dimension that is a bifurcation diagram. Runs on all cores.

    Args:
        system: the machine, or a `vx.Family` of machines, whose names are then the paths.
        values: for each swept quantity, by its path, the values to visit: "forcing.frequency",
            "forcing.amplitude[0]", "stops[1].position", "stops[*].restitution" (all stops at once), "mass[0]",
            "x0[1]", ..., shape (points,); a whole array such as "damping" takes (points, n, n). Numbers of the force
            are named by its fields, "force.cubic", those of `args` by "args.cubic" or "args[0]". Several quantities
            make a product grid, a dimension each. A pair of path and values gives the quantity a short name,
            `{"A": ("forcing.amplitude[0]", values)}`: its dimension and coordinate are then `A`, as in `ds.A`.
        transient: forcing periods before recording.
        record: forcing periods that are recorded.
        duration: follow every motion from its start at time 0 for this time, in place of `transient` and `record`: under
            records and loads of different frequencies, without load, or to see how a motion begins. All of it is recorded.
        ts: with `duration`, times at which states are saved, in increasing order, (times,).
        carry: None runs every point from the same start. "up" lets every point start where the one before it along
            the first dimension ended, in the order given, "down" in the reverse order, and "both" up and then down
            again, with a dimension `direction` in front. The other dimensions are independent. Positions and
            velocities in space are carried, but a mass that a moving stop holds stays with its stop.
        carry_from: an earlier sweep of the same grid from which this one starts: point by point from its end states,
            or with `carry` from the last point that it visited.
        x0: positions at the start of every point, (n,); zero if left out.
        v0: velocities at the start of every point, (n,); zero if left out.
        flow: the motion between events. If left out, exact for a linear machine, and `vx.TaylorFlow()` for one with
            a `force`, which must depend on t with the period of the load, or not at all; with `duration` in any way.
        args: passed to the `force` of the machine.
        lyapunov: compute all Lyapunov exponents of each motion too, see `vx.lyapunov_exponents`; this takes two to
            three times as long. They are averaged over the recorded periods, of which there should then be many.
        quantities: names of more variables, to rounding, NaN where unknown. Of the motion in all recorded periods, between
            impacts and at them: "max_position", "min_position", their difference "peak_to_peak", "max_velocity",
            "min_velocity", "rms_position" and "rms_velocity" (..., mass); "max_acceleration", "min_acceleration" and
            "rms_acceleration" (..., mass), between impacts alone, and "max_absolute_acceleration" (..., mass), the largest size
            of the acceleration with that of the base, see `vx.base_excitation`; and "max_force" (..., stop), the largest
            contact force at a stop that holds its mass or is compliant, without impacts. A sweep with one of these takes
            two to three times as long, with all of them ten times. Of the record, at no cost: "section_position" and
            "section_velocity", which equal `section_x` and `section_v`; "impact_rate" (..., stop), recorded impacts per
            unit of time; "impulse" (..., period, stop), the sum of m |v+ - v-| over the impacts of a period, those of
            complete chatters included, NaN at compliant stops; "dissipated_energy", the energy that they lose in the frame of the
            stop, likewise, NaN too where friction of the stop takes part of it; "hysteresis_energy" (..., hysteresis), the energy that each Jenkins element dissipates in a
            period, in the mean; and "mean_velocity" (..., mass), from the end of the first recorded period to that of the last.
        max_impacts: room for the recorded impacts of one point.
        max_steps: bound on the steps of one point. If left out, every point has its own, far more than any sound
            motion takes: 100 000, 10 000 a forcing period, and 100 per unit of the time that is simulated * (highest
            frequency or decay rate). The attribute of that name is then "default".
        store: a folder in which to keep finished chunks of points. The same call with the same folder resumes where
            the previous one was stopped or killed, and gives the same results, bit for bit. Several processes may
            share the folder at once, on one machine or on several of one kind: they share the work, and each returns
            the whole. The folder may be deleted afterwards.
        out: a folder to which the results are written in Zarr's format as they come, and from which the returned
            dataset reads lazily: they need not fit into memory. The same call resumes where it was stopped, and
            several at once share the work, as with `store`; parts that were lost are run again. Only for points that
            carry nothing. Workers of an `executor` write there themselves. To read it later:
            `xr.open_zarr(out, consolidated=False)`.
        executor: runs chunks of points on other processes or machines: any `concurrent.futures.Executor`
            (`ProcessPoolExecutor` with `mp_context=multiprocessing.get_context("spawn")`,
            `mpi4py.futures.MPIPoolExecutor`), or a client of Dask. Each of its workers uses one core. The results are
            the same, bit for bit, on processors of one kind. Chunks of a lost worker are run again, for as long as
            the executor takes them. If left out, the cores of this process.
        progress: show a progress bar.
        settings: sizes of queues, lanes and chunks, which affect speed; results change by rounding only.

    Returns:
        A dataset with a dimension for every quantity, named by its short name or its path, and `stop`, `mass`, `impact`: `impact_velocity`
        (signed, before the impact; where stops move `impact_relative_velocity` too), `impact_time` (since the
        transient), `impact_phase` (W t mod 2 pi), `impact_stop`, all padded with NaN or -1 to the longest, and
        `impact_sticks`, whether a complete chatter ends there; `num_impacts` and `num_sticks` per stop, complete even
        if the room was not; `section_x` and `section_v`, the state at the end of each recorded `period`, and
        `held_time`, the time for which each stop held its mass in it; the end state `x`, `v`, `stuck`;
        `forcing_period`; with `ts` the states `xs` and `vs` along `time`; with `lyapunov` the `lyapunov_exponents` per unit of time, the largest first, and their
        standard errors `lyapunov_error`, along `exponent`; and `result`, the result code of each point; a warning
        counts those that are not `successful`. Its attributes describe how it was made, see also `vx.system_of`; it
        may be written to NetCDF and Zarr. Motions followed for a `duration` have neither phases nor periods: `impact_time`
        counts from the start, `held_time` is that of the whole motion, "impulse" and "dissipated_energy" are its sums, and
        `impact_phase`, `section_x`, `section_v` and `forcing_period` are absent.

    Raises:
        ValueError: for a path that names nothing, a short name that is no identifier or names something else, values
            that make no valid machine, quantities that are unknown or do not follow from the record, a start beyond a
            stop, a store of another sweep, or an executor that cannot run it.
        RuntimeError: if an executor takes no more tasks, or loses one again and again.
        KeyboardInterrupt: after Ctrl-C; the content of `store` or `out` is kept, and the same call resumes there.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        ```

    References:
        Wagg & Bishop (2004), Secs. 4.4-4.5.
    """
    if carry not in (None, "up", "down", "both"):
        raise ValueError(f'Argument `carry` must be None, "up", "down" or "both", but is {carry!r}.')
    base = base_of(varied(system, args), x0, v0)
    limits = {"max_impacts": max_impacts, "max_steps": max_steps}
    counts = counts_of(base.system, transient, record, duration, ts, lyapunov=lyapunov, **limits)
    if counts.times is not None and (carry is not None or carry_from is not None):
        raise ValueError(
            "Argument `duration` follows every motion from (x0, v0): leave out `carry` and `carry_from`."
        )
    by_path, names = without_names(values, base)
    axes = values_of(by_path)
    added = checked_quantities(quantities, machine_of(base.system), counts)
    counts = replace(counts, observed=observed_for(added))
    if out is not None:
        if store is not None or carry is not None or carry_from is not None:
            raise ValueError(
                "Argument `out` is for points that start by themselves: leave out `store`, `carry` and `carry_from`. Parts of a carried "
                "sweep may be run one by one, each with a `store`, and joined by `combine`."
            )
        with interrupt_with_word_of(out):
            return write_sweep(
                out, base, axes, names, added, counts, flow, executor, settings, progress=progress
            )
    points = grid_points(base, axes, twice=carry == "both", counts_periods=counts.times is None)
    shape = ((2,) if carry == "both" else ()) + tuple(len(axis) for axis in axes.values())
    chain = _chain(shape, carry)
    if carry_from is not None:
        points = _start_from(points, carry_from, chain, shape, carry)
    can_stick = carry is not None or can_any_stick(points.system, points.x0, points.v0)
    counts = replace(counts, can_stick=can_stick)
    motion = choose_flow(points.system, can_stick=can_stick, wanted=flow, for_many=True)
    if chain is not None:
        lanes = lanes_of_chains(settings, chain, counts.transient + counts.record)
        settings = replace(settings, lanes=lanes)
    attributes = origin(
        base, counts, flow=name_of_flow(motion, flow), carry=carry, goes_on=carry_from is not None
    )
    runner = choose_runner(motion, counts, settings, executor)
    if store is not None:
        manifest = describe_sweep(attributes, axes | saved_times(counts), points, flow, settings)
        sizes = settings if executor is None else replace(settings, cores=1)
        runner = open_store(store, manifest, runner, sizes, counts.work)
    all_points = np.arange(points.x0.shape[-1])
    with (
        interrupt_with_word_of(store),
        tqdm(total=len(all_points), unit="point", disable=not progress) as bar,
    ):
        if chain is None:
            found = runner.run(points, all_points, bar.update)
        else:
            found = run_chains(points, chain, runner, bar.update, settings)
    ds = with_names(dataset(points, axes, shape, counts, found, attributes, added), names)
    ds = with_labels(ds, base.system)
    warn_of_endings(ds, "max_impacts_reached", "max_steps_reached", "non_finite", "friction_paradox")
    warn_of_unsettled_points(ds)
    return ds


def _chain(shape: tuple[int, ...], carry: str | None) -> np.ndarray | None:
    """The points in the order of their visits, (visits, chains)."""
    if carry is None:
        return None
    numbers = np.arange(np.prod(shape))
    if carry == "both":
        up, down = numbers.reshape(2, shape[1], -1)
        return np.concatenate([up, down[::-1]])
    rows = numbers.reshape(shape[0], -1)
    return rows if carry == "up" else rows[::-1]


def _start_from(
    points: LaneInput, before: xr.Dataset, chain: np.ndarray | None, shape: tuple[int, ...], carry: str | None
) -> LaneInput:
    """Start where an earlier sweep ended: point by point, or a chain where the chain before it ended."""
    n = len(points.x0)
    x, v = (before[name].transpose("mass", ...).values for name in ("x", "v"))
    if "direction" in before.dims:
        x, v = x[:, 1], v[:, 1]
    others = shape[2:] if carry == "both" else shape[1:] if carry else shape
    if carry is not None:
        last = 0 if before.attrs.get("carry") in ("down", "both") else -1
        x, v = x[:, last], v[:, last]
    if x.shape != (n, *others):
        raise ValueError(
            f"The end states of `carry_from` have shape {x.shape[1:]} where {others} is needed: sweep the same grid."
        )
    x0, v0 = points.x0.copy(), points.v0.copy()
    which = np.arange(x0.shape[1]) if chain is None else chain[0]
    x0[:, which], v0[:, which] = x.reshape(n, -1), v.reshape(n, -1)
    return LaneInput(points.system, x0, v0)
