"""Attributes of a dataset that describe how its sweep was made, and the machine rebuilt from them."""

import json
import math
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._dataset_attributes import versions
from .._dataset_checks import check_is_dataset
from .._execution.points import LaneInput, lanes_with_values, with_values
from .._execution.runner import Counts
from .._flow.force_flow import ForceFlow
from .._flow.interface import AbstractFlow
from .._flow.taylor import TaylorFlow
from .._system.description import build_from
from .._system.family import Family
from .._system.family_description import attributes_of_system, system_from
from .._system.force import NamedForce, users_force
from .._system.force_description import NAMED_FORCE
from .._system.forces_by_path import Allowed
from .._system.parameters import axis_names, force_parameters, is_of_force, is_parameter
from .._system.system import AnySystem, ImpactSystem, bound, machine_of, unbound
from .short_names import path_of


def origin(
    base: LaneInput, counts: Counts, *, flow: str, carry: str | None, goes_on: bool
) -> dict[str, str | int | float]:
    """Attributes of a dataset: everything besides the swept values that determines the results.

    `base` is the machine and start where nothing is swept, `flow` the name of the flow between events. `goes_on` is
    True where the sweep starts from the end states of an earlier one.
    """
    own = machine_of(base.system)
    of_force = {} if own.force is None else {"force_parameters": json.dumps(force_parameters(bound(own)))}
    observed = {"observed": ", ".join(counts.observed)} if counts.observed else {}
    periods = {"transient": int(counts.transient), "record": int(counts.record)}
    return (
        of_force
        | observed
        | (periods if counts.times is None else {"duration": counts.times[-1]})
        | {
            **attributes_of_system(base.system),
            "x0": json.dumps(np.asarray(base.x0).tolist()),
            "v0": json.dumps(np.asarray(base.v0).tolist()),
            "lyapunov": int(counts.lyapunov),
            "carry": carry or "none",
            "carry_from": "an earlier sweep" if goes_on else "none",
            "max_impacts": int(counts.max_impacts),
            "max_steps": "default" if counts.max_steps is None else int(counts.max_steps),
            "flow": flow,
            "dtype": str(own.mass.dtype),
            "device": jax.default_backend(),
            **versions(),
        }
    )


def name_of_flow(motion: AbstractFlow, wanted: AbstractFlow | None) -> str:
    """Name of the flow in the attributes: the class if it was chosen, all fields that count if it was requested."""
    if isinstance(motion, TaylorFlow | ForceFlow) and isinstance(wanted, TaylorFlow | None):
        of_force = isinstance(motion, ForceFlow) and wanted is not None
        return (
            f"TaylorFlow(order={motion.order}, tolerance={motion.tolerance})"
            if of_force
            else ("TaylorFlow" if wanted is None else "TaylorFlow()")
        )
    return type(motion).__name__ if wanted is None else eqx.tree_pformat(wanted, width=10**6)


def system_of(
    ds: xr.Dataset,
    *,
    allow_forces: Allowed = False,
    force: Callable | None = None,
    family: Callable | Family | None = None,
) -> ImpactSystem | Family:
    """Build the machine of a sweep again, from its dataset alone, in memory or from a file.

    A dataset may come from anywhere, and the import of a `force` runs its module. Only three kinds are imported: the
    forces of `vijax.models`, those that this process has itself swept or saved, and those that are allowed here.
    `vx.periodic_orbits`, `vx.branches`, `vx.explore` and others accept the latter from then on, too.

    Args:
        ds: dataset of `vx.sweep`, or a part of it. A quantity of which one value is selected has that value; one that
            still has several keeps the value of the machine that was swept.
        allow_forces: names of modules from which a force may be imported, as for `vx.load`, or True for any.
        force: the force of the machine, where it cannot be imported, or must not be: a `lambda`, a function of a
            notebook or of the main program. It is taken as it is, and has the swept values and `args` of the dataset.
        family: the function of the family, or a `vx.Family` of it, where it cannot be imported, likewise.

    Returns:
        The machine, bit for bit. A `force` is imported from its original module, and has the `args` of the sweep. Of the
        sweep of a family, the family, with the values of the dataset; its function counts as a force where it is imported.

    Raises:
        ValueError: if the attributes hold no machine, or one with a `force` that may not be imported, or cannot.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        point = ds.sel({"forcing.frequency": 0.8}, method="nearest")
        sol = vx.simulate(vx.system_of(point), 0.0, 80.0)
        ```
    """
    check_is_dataset(ds, "ds", "`vx.sweep`")
    base, swept = _at_points(ds, (), None, allow_forces, force, family)
    found = lanes_with_values(base, swept).system
    return unbound(jax.tree.map(lambda a: jnp.asarray(a[..., 0]), found))


def machines_of(
    ds: xr.Dataset,
    dims: Sequence[Hashable] = (),
    which: np.ndarray | None = None,
    *,
    allow_forces: Allowed = False,
    force: Callable | None = None,
) -> ImpactSystem:
    """Build the machines of many points of a sweep, those of a family too, from its dataset alone.

    Args:
        ds: dataset of `vx.sweep`, or a part of it, its dimensions in any order.
        dims: dimensions of the points; none for a single point. Quantities that vary along other dimensions keep the
            value of the machine that was swept.
        which: indices of the points, counted through `dims`; all of them if left out.
        allow_forces: as for `system_of`.
        force: as for `system_of`; with `NAMED_FORCE` the machines have all but their force.

    Returns:
        The machines as NumPy arrays, lanes last, their forces bound; leaves that are the same everywhere have a
        single lane.

    Raises:
        ValueError: if the attributes hold no machine, or one with a `force` that may not be imported, or cannot, or
            if no swept quantity varies along one of `dims`.
    """
    # The sweep has checked the values, with a start that is not available here.
    return with_values(*_at_points(ds, dims, which, allow_forces, force)).system


def varied_of(ds: xr.Dataset, dims: Sequence[Hashable], which: np.ndarray | None = None) -> AnySystem:
    """As `machines_of`; of a family its values in lanes, as a family."""
    return lanes_with_values(*_at_points(ds, dims, which)).system


def _at_points(
    ds: xr.Dataset,
    dims: Sequence[Hashable],
    which: np.ndarray | None,
    allow_forces: Allowed = False,
    force: Callable | None = None,
    family: Callable | Family | None = None,
) -> tuple[LaneInput, dict[str, np.ndarray]]:
    """Machines of the points without the swept values, and these by their paths, (points, ...); see `machines_of`."""
    if "system" not in ds.attrs:
        raise ValueError("Argument `ds` must carry the attributes of `vx.sweep`, but has no `system`.")
    is_named = isinstance(force, NamedForce)
    if family is not None or ("family" in ds.attrs and (dims or not is_named)):
        system = system_from(
            ds.attrs, allow_forces=allow_forces, force=None if is_named else force, family=family
        )
    else:
        system = _built(ds.attrs, allow_forces, force)
    start = np.zeros(system.num_masses, ds.attrs["dtype"])
    base, sizes = LaneInput(system, start, start), [ds.sizes[dim] for dim in dims]
    which = np.arange(math.prod(sizes)) if which is None else which
    places = dict(zip(dims, np.unravel_index(which, sizes), strict=True)) if dims else {}
    swept: dict[str, np.ndarray] = {}
    known: set[Hashable] = {"direction"}
    for path, (along, values) in _swept_values(ds, base, set(dims)).items():
        lanes = values.values[tuple(places[dim] for dim in along)]
        known.update(along)
        if is_parameter(base, path):
            swept[path] = np.asarray(lanes if along else lanes[None], start.dtype)
    if not known.issuperset(dims):
        unknown = ", ".join(f"`{dim}`" for dim in dims if dim not in known)
        raise ValueError(f"Argument `ds` must have swept quantities as coordinates along {unknown}.")
    return base, swept


def _built(attributes: dict[Any, Any], allow_forces: Allowed, force: Callable | None) -> ImpactSystem:
    """The machine that was swept, its force bound; a machine without a force, which cannot change, is built once."""
    if force is None or isinstance(force, NamedForce):
        text, dtype = str(attributes["system"]), str(attributes.get("dtype"))
        system = _without_force(text, dtype, bool(jax.config.read("jax_enable_x64")))
        if system.force is None or force is not None:
            return system
    return bound(build_from(attributes, allow_forces=allow_forces, force=force))


@lru_cache(maxsize=16)
def _without_force(text: str, dtype: str, x64: bool) -> ImpactSystem:
    """The machine with the name of its force only."""
    del x64  # the precision in which it is built
    return build_from({"system": text, "dtype": dtype}, force=NAMED_FORCE)


def _swept_values(
    ds: xr.Dataset, base: LaneInput, dims: set[Hashable]
) -> dict[str, tuple[list[Hashable], xr.DataArray]]:
    """Dimensions and values of every path that varies along `dims` alone; the values have these dimensions first."""
    found = {}
    for name, values in ds.coords.items():
        path = path_of(ds, name)
        own = [dim for dim in axis_names(path, values.ndim) if dim in values.dims]
        along = [dim for dim in values.dims if dim not in own]
        is_counter = f"{name}.values" in ds.coords  # indices of the arrays in `NAME.values`
        # Labels of a parameter's own dimension, `mass` for instance, are not values.
        if dims.issuperset(along) and not is_counter and name not in own:
            found[path] = along, values.transpose(*along, *own)
    has_named_force = isinstance(
        users_force(base.system.force), NamedForce
    )  # its numbers are not leaves of the machine
    return {
        path: values
        for path, values in found.items()
        if is_parameter(base, path) or (has_named_force and is_of_force(path))
    }
