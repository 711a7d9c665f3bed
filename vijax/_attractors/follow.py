"""Attractors and the shares of their basins along a parameter."""

from dataclasses import replace

import numpy as np
import xarray as xr

from .._dataset_attributes import check_column
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_float, as_numpy_float, refuse_single_precision
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles
from .._sweep.outcomes import warn_of_endings, warn_of_unsettled
from .._sweep.random_numbers import Rng, generator_of
from .._sweep.short_names import with_labels
from .._system.parameters import find_parameter, set_parameter
from .._system.system import AnySystem
from .attractor_matching import branch_numbers, seeded
from .attractors import machines_of_one, requested_starts
from .coexisting import coexisting, lasting
from .ensemble import frequencies_at
from .erosion import check_grid, erosion_columns
from .table import attributes_of, table_along


@says_what_compiles
@padding_allowed
def follow_attractors(
    system: AnySystem,
    path: str,
    values: Numbers,
    starts: Count | tuple[Numbers, Numbers] | Numbers = 100,
    *,
    transient: Count = 100,
    record: Count = 20,
    bounds: Numbers | None = None,
    rng: Rng | None = None,
    seed: Count | None = None,
    threshold: float = 0.2,
    integrity: bool = False,
    tolerance: float | None = None,
    args: object = None,
    flow: AbstractFlow | None = None,
    max_steps: Count | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Follow the attractors of a machine along a parameter, with the shares of starts that lead to each.

    At every value the attractors are found as by `vx.attractors`, from the same starts, and from the attractors at the
    value before. The latter do not count in the shares; they keep an attractor whose basin has become small. An
    attractor continues as the nearest one at the next value. Pairs with the same impacts at each stop in a forcing
    period come first; then the distance of their sections decides: the mean distance of the points of one from the
    nearest of the other, relative to their size. An attractor without a partner nearer than `threshold` ends or
    begins.

    Args:
        system: the machine.
        path: path of the parameter, a number, as "forcing.frequency".
        values: (values,), in the order in which they are visited.
        starts: as for `attractors`; random ones are drawn for the first value.
        transient: as for `attractors`.
        record: likewise.
        bounds: likewise.
        rng: likewise.
        seed: likewise.
        threshold: the largest distance of an attractor from its continuation, relative to their size.
        integrity: measure how the basins are eroded, too. The starts must then be a grid, as for `vx.basins`.
        tolerance: as for `attractors`.
        args: as for `simulate`.
        flow: likewise.
        max_steps: as for `sweep`.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `sweep`.

    Returns:
        Over the path and `attractor`, in the order in which they begin: `is_found`, `share`, `share_error`, and the
        variables of `vx.attractors` for each, NaN, False and 0 where it is not found. Along `attractor`: `birth`, the
        first value at which it is found, NaN if it is there from the first value on; `death`, the first value at which
        it is no longer found, NaN if it is there to the last; `successor`, the attractor on which its motion then
        ends, -1 if that is unknown. Along the path `num_not_settled` and `num_failed`. With `integrity` the measures of
        `vx.integrity` too, radii in widths of the grid: `local_integrity`, `integrity_factor` and their errors, NaN where
        the attractor is not found, and along the path `basin_entropy` and `boundary_basin_entropy`.

    Raises:
        ValueError: if the path names no number of the machine, or the starts are no grid with `integrity`; and as
            `attractors`.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        found = vx.follow_attractors(vx.models.wagg_bishop_b(2.0), "forcing.frequency", np.linspace(1.9, 2.1, 5), 50)
        print(found.share.values, found.birth.values, found.death.values)
        ```

    References:
        G. Datseris, K. L. Rossi & A. Wagemakers, Framework for global stability analysis of dynamical systems,
        Chaos 33 (2023) 073151; M.-P. Dubuisson & A. K. Jain, A modified Hausdorff distance for object matching,
        Proc. ICPR (1994) 566.
    """
    refuse_single_precision("follow_attractors", system)
    if not threshold > 0:
        raise ValueError(f"Argument `threshold` must be positive, but is {threshold}.")
    one = machines_of_one(
        "follow_attractors", system, args, transient, record, tolerance, flow, max_steps, settings, executor
    )
    along, rate = _values(one.system, path, values)
    first = replace(one, system=set_parameter(one.system, path, as_float(along[0])), rate=rate[:1])
    given = requested_starts(first, starts, bounds, generator_of(rng, seed))
    if integrity:
        check_grid(given)
    states = given.states
    machines = replace(one, values={path: along}, rate=rate).for_sweep_of(len(along) * len(states))
    machine = np.repeat(np.arange(len(along)), len(states))
    states = np.tile(states, (len(along), 1)) * machines.scale(machine)
    ds = machines.run(states, machine, machines.transient, machines.record, progress=progress)
    warn_of_endings(ds, "max_steps_reached", "non_finite", "friction_paradox")
    ends = machines.ends(ds, machine)
    found = coexisting(machines, ends)
    motions, goes_to = seeded(machines, found)
    motions, number = lasting(motions)
    goes_to = {int(number[k]): int(number[j]) for k, j in goes_to.items() if number[k] >= 0}
    begun = branch_numbers(motions, len(along), threshold)
    labels = number[found.label]
    table = table_along(machines, motions, begun, goes_to, labels, ends)
    if integrity:
        table = table.assign(erosion_columns(machines, motions, begun, labels, given))
    warn_of_unsettled(int(table["num_not_settled"].sum()), len(states), machines.transient)
    coordinates = {path: (path, along), "stop_mass": ds["stop_mass"]}
    return with_labels(table.assign_coords(coordinates).assign_attrs(attributes_of(ds)), one.system)


def _values(system: AnySystem, path: str, values: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """Values of the parameter, and W for each."""
    along = as_numpy_float(values)
    if along.ndim != 1 or not along.size:
        raise ValueError(f"Argument `values` must have shape (values,), but has {along.shape}.")
    find_parameter(system, path)
    check_column(path)
    return along, frequencies_at(system, {path: along}, len(along))
