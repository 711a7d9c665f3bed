"""The coexisting attractors of one machine, and the starts that lead to each."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import xarray as xr

from .._dataset_attributes import variable_attributes
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_numpy_float, refuse_single_precision, whole_number
from .._jax.concrete import is_traced
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles
from .._sweep.outcomes import warn_of_endings, warn_of_starts_beyond, warn_of_unsettled
from .._sweep.random_numbers import Rng, generator_of
from .._sweep.recurrence import TOLERANCES
from .._sweep.short_names import with_names
from .._sweep.zipped import START
from .._system.periodicity import check_period
from .._system.system import AnySystem, machine_of, varied, with_args
from .coexisting import coexisting, lasting
from .ensemble import Machines
from .images import first_images, folded
from .starts import Starts, bounds_of, drawn_starts, grid_of_starts, is_beyond, listed_starts
from .table import ATTRACTOR, attractor_dataset, attributes_of, sorted_by_share


@says_what_compiles
@padding_allowed
def attractors(
    system: AnySystem,
    starts: Count | tuple[Numbers, Numbers] | Numbers | Mapping[str, Numbers | tuple[str, Numbers]],
    *,
    transient: Count = 100,
    record: Count = 20,
    bounds: Numbers | None = None,
    rng: Rng | None = None,
    seed: Count | None = None,
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
    """Find the coexisting attractors of one machine, and how many starts lead to each.

    All starts are run at once. Motions that settle are distinguished by their states and events, not by their numbers
    of impacts and periods: each cycle is polished into its periodic orbit, and motions that visit it some forcing
    periods apart are on one attractor. Motions that do not repeat are run on for long. Those that still do not repeat
    are on one attractor if the clouds of their section points mix, by a test of nearest neighbours
    (after Schilling 1986). A cycle of more than 64 periods counts as such a motion, and so does a quasi-periodic one.
    A cloud that some motions leave for a cycle is a chaotic transient, and all motions in it are run on, up to 630
    transients. Attractors that no start leads to are not found.

    Args:
        system: the machine.
        starts: states at phase 0: positions and velocities, a tuple of (starts, n) each, or both side by side,
            (starts, 2 n); a product grid, as `{"x0[0]": values, "v0[0]": values}`; or the number of random starts.
        transient: forcing periods before a motion is recorded.
        record: forcing periods that are recorded.
        bounds: lowest and highest of each position, then of each velocity, between which random starts are drawn,
            (2 n, 2). If left out, twice the motion from rest, up to the stops. None is drawn beyond a rigid stop. Stretches of
            Jenkins elements are drawn between their limits.
        rng: of the random starts: a whole number, or a `Generator`, `BitGenerator` or
            `SeedSequence` of NumPy, as in SPEC 7; 0 if left out, so that a call can be repeated.
        seed: older name of `rng` for a whole number.
        x0: positions that a grid does not name, (n,); zero if left out.
        v0: velocities, likewise.
        fold: count mirror images as one attractor, by `system.symmetries()`; the state of the one that most starts lead to
            is given. Of a grid that a symmetry without a shift in time maps to itself, only one start of each set of images is run.
        tolerance: largest distance of a motion from the cycle on which it settles, relative to its size; 1e-6 if left
            out.
        args: as for `simulate`.
        flow: likewise.
        max_steps: as for `sweep`.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `sweep`.

    Returns:
        Along `attractor`, those that most starts lead to first: `share` of the starts, with its binomial standard
        error `share_error`, and `num_starts`; `x0` and `v0` (..., mass), the state at phase 0, of a cycle that with
        the lowest x[0]; `motion`, `num_periods`, `num_impacts` (..., stop) and `held_time`, as of `vx.classify`;
        `multipliers` (..., multiplier), `is_stable` and `residual`, as of `vx.periodic_orbits`, NaN and False unless
        it is a polished cycle; `exponents` (..., exponent), the Lyapunov exponents, of cycles ln|multiplier| / (n T),
        of others averaged over 2000 periods, with their standard errors `exponents_error`: a motion that does not
        repeat is chaotic where the largest is far above its error, quasi-periodic where it is of the size of its
        error; `section_x`, `section_v` (..., section, mass), the states at phase 0 of a cycle, and many of others,
        padded with NaN.
        Along `start`, or the dimensions of the grid: `label`, the index of the attractor, -1 where the motion has not
        settled or failed, or a start of the grid lies beyond a stop, and `is_failed`. `num_not_settled` and `num_failed` count these; a warning reports the
        former, which a longer `transient` settles. With `fold`, `num_images` is the number of different images of each attractor, 1
        of a symmetric one. The result is reproducible.

    Raises:
        ValueError: if the load has no frequency, the starts are none of these, one lies beyond a stop, or 64-bit
            numbers are off.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        found = vx.attractors(vx.models.wagg_bishop_b(2.05), 200)
        print(found.share.values, found.num_impacts.values)
        ```

    References:
        G. Datseris & A. Wagemakers, Effortless estimation of basins of attraction, Chaos 32 (2022) 023104;
        M. F. Schilling, Multivariate two-sample tests based on nearest neighbors, J. Am. Stat. Assoc. 81 (1986) 799.
    """
    refuse_single_precision("attractors", system)
    machines = machines_of_one(
        "attractors", system, args, transient, record, tolerance, flow, max_steps, settings, executor
    )
    given = requested_starts(machines, starts, bounds, generator_of(rng, seed), x0, v0)
    return _found(machines, given, fold=fold, progress=progress)


def machines_of_one(
    who: str,
    system: AnySystem,
    args: object,
    transient: Count,
    record: Count,
    tolerance: float | None,
    flow: AbstractFlow | None,
    max_steps: Count | None,
    settings: ExecutionSettings,
    executor: object,
) -> Machines:
    """The single machine with the settings of its runs, checked; `who` is the function that asks, for messages."""
    transient, record = whole_number("transient", transient), whole_number("record", record, 2)
    if is_traced((system, args, flow)):
        raise ValueError(f"`{who}` needs known numbers: call it outside of `jax.jit` and `jax.vmap`.")
    zero = np.zeros(machine_of(system).num_coordinates, as_numpy_float(0.0).dtype)
    check_period(with_args(system, args), zero, zero)
    if tolerance is not None and not tolerance > 0:
        raise ValueError(f"Argument `tolerance` must be positive, but is {tolerance}.")
    own = as_numpy_float(system.forcing.frequency).reshape(1)
    return Machines(
        system=varied(system, args),
        values={},
        rate=own,
        transient=transient,
        record=record,
        tolerance=TOLERANCES[own.dtype.itemsize] if tolerance is None else tolerance,
        flow=flow,
        max_steps=None if max_steps is None else whole_number("max_steps", max_steps, 1),
        settings=settings,
        executor=executor,
        is_wide=False,
    )


def requested_starts(
    machines: Machines,
    starts: Count | tuple[Numbers, Numbers] | Numbers | Mapping[str, Numbers | tuple[str, Numbers]],
    bounds: Numbers | None,
    rng: np.random.Generator,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
) -> Starts:
    """The starts, given in any form."""
    if isinstance(starts, Mapping):
        return grid_of_starts(machines.system, starts, x0, v0)
    own = machine_of(machines.system)
    if isinstance(starts, tuple) or np.ndim(cast(Any, starts)):
        return listed_starts(own, cast(Any, starts))
    count = whole_number("starts", starts, 1)
    box = bounds_of(machines.for_sweep_of(count), bounds)
    return drawn_starts(own, count, box, rng)


def _found(machines: Machines, starts: Starts, *, fold: bool, progress: bool) -> xr.Dataset:
    """The attractors to which starts lead."""
    # Of a grid, starts beyond a stop are left out; a listed one is refused.
    is_in = np.ones(len(starts.states), bool)
    if START not in starts.axes:
        is_in = ~is_beyond(machine_of(machines.system), starts.states)
    if not is_in.any():
        raise ValueError("Every start of the grid lies beyond a stop: name values between the stops.")
    which = np.flatnonzero(is_in)
    first, image_of = first_images(machines, starts.states[which]) if fold else (slice(None), slice(None))
    own = starts.states[which][first]
    machines = machines.for_sweep_of(len(own))
    one = np.zeros(len(own), int)
    states = own * machines.scale(one)
    ds = machines.run(states, one, machines.transient, machines.record, progress=progress)
    warn_of_endings(ds, "max_steps_reached", "non_finite", "friction_paradox")
    ends = machines.ends(ds, one)
    found = coexisting(machines, ends)
    motions, number = lasting(found.motions)
    motions, labels = sorted_by_share(motions, number[found.label][image_of])
    if fold:
        motions, labels = sorted_by_share(*folded(machines, motions, labels))
    is_failed = ends.is_failed[image_of]
    table = attractor_dataset(machines, motions, labels, is_failed)
    if fold:
        numbers = np.array([motion.num_images for motion in motions], int)
        table["num_images"] = (ATTRACTOR, numbers, variable_attributes("num_images"))
    warn_of_unsettled(int(table["num_not_settled"]), len(labels), machines.transient)
    warn_of_starts_beyond(int(np.count_nonzero(~is_in)), len(is_in))
    shape, dims = tuple(len(a) for a in starts.axes.values()), tuple(starts.axes)
    columns = {}
    for name, a, unknown in (("label", labels, -1), ("is_failed", is_failed, False)):
        whole = np.full(len(is_in), unknown, a.dtype)
        whole[is_in] = a
        columns[name] = (dims, whole.reshape(shape), variable_attributes(name))
    table = table.assign(columns)
    coordinates = {path: (path, a) for path, a in starts.axes.items()} | {"stop_mass": ds["stop_mass"]}
    table = table.assign_coords(coordinates).assign_attrs(attributes_of(ds))
    return with_names(table, starts.names)
