"""How a sweep was made, as attributes of its dataset, and the machine built again from them."""

import json
import math
from collections.abc import Hashable, Sequence
from functools import lru_cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._dataset_attributes import versions
from .._execution.points import Point, with_values
from .._execution.runner import Counts
from .._flow.interface import AbstractFlow
from .._system.description import build, describe
from .._system.parameters import axis_names, force_parameters, is_parameter
from .._system.system import ImpactSystem, bound, unbound


def origin(
    base: Point, counts: Counts, *, flow: str, carry: str | None, goes_on: bool
) -> dict[str, str | int]:
    """Attributes of a dataset: everything beside the swept values that determines the results.

    Args:
        base: the machine and start that hold where nothing is swept.
        counts: what is asked of every point.
        flow: the name of the motion between events.
        carry: as in `sweep`.
        goes_on: whether it starts from the end states of an earlier sweep.
    """
    of_force = {} if base.system.force is None else {"force_parameters": json.dumps(force_parameters(base))}
    return of_force | {
        "system": json.dumps(describe(base.system)),
        "x0": json.dumps(np.asarray(base.x0).tolist()),
        "v0": json.dumps(np.asarray(base.v0).tolist()),
        "transient": int(counts.transient),
        "record": int(counts.record),
        "lyapunov": int(counts.lyapunov),
        "carry": carry or "none",
        "carry_from": "an earlier sweep" if goes_on else "none",
        "max_impacts": int(counts.max_impacts),
        "max_steps": "default" if counts.max_steps is None else int(counts.max_steps),
        "flow": flow,
        "dtype": str(base.system.mass.dtype),
        "device": jax.default_backend(),
        **versions(),
    }


def name_of_flow(motion: AbstractFlow, wanted: AbstractFlow | None) -> str:
    """What attributes tell of the motion between events: the kind that was chosen, or all of the one that was asked for."""
    return type(motion).__name__ if wanted is None else eqx.tree_pformat(wanted, width=10**6)


def system_of(ds: xr.Dataset) -> ImpactSystem:
    """Build the machine of a sweep again, from its dataset alone, in memory or from a file.

    Args:
        ds: what `vx.sweep` returned, or a part of it. Quantities of which one value is selected have
            it; those that still have several keep the value of the machine that was swept.

    Returns:
        The machine, bit for bit. A `force` is imported from where it was, and has the `args` of the sweep.

    Raises:
        ValueError: if the attributes hold no machine, or one with a `force` that cannot be imported: a `lambda`, or a
            function of a notebook or of the main program.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        point = ds.sel({"forcing.frequency": 0.8}, method="nearest")
        sol = vx.simulate(vx.system_of(point), 0.0, 80.0)
        ```
    """
    return unbound(jax.tree.map(lambda a: jnp.asarray(a[..., 0]), machines_of(ds)))


def machines_of(
    ds: xr.Dataset, dims: Sequence[Hashable] = (), which: np.ndarray | None = None
) -> ImpactSystem:
    """Build the machines of many points of a sweep, from its dataset alone.

    Args:
        ds: what `vx.sweep` returned, or a part of it, its dimensions in any order.
        dims: the dimensions of the points; none for a single point. Quantities that vary along others keep
            the value of the machine that was swept.
        which: the points that are wanted, counted through `dims`; all of them if left out.

    Returns:
        The machines as arrays of NumPy, lanes last, their forces bound; leaves that are the same everywhere have a
        single one.

    Raises:
        ValueError: if the attributes hold no machine, or one with a `force` that cannot be imported, or if nothing tells
            what varies along one of `dims`.
    """
    if "system" not in ds.attrs:
        raise ValueError("Argument `ds` must carry the attributes of `vx.sweep`, but has no `system`.")
    system = _built(ds.attrs["system"], ds.attrs["dtype"])
    start = np.zeros(system.num_masses, ds.attrs["dtype"])
    base, sizes = Point(system, start, start), [ds.sizes[dim] for dim in dims]
    which = np.arange(math.prod(sizes)) if which is None else which
    places = dict(zip(dims, np.unravel_index(which, sizes), strict=True)) if dims else {}
    swept: dict[str, np.ndarray] = {}
    known: set[Hashable] = {"direction"}
    for path, (along, values) in _swept_values(ds, base, set(dims)).items():
        lanes = values.values[tuple(places[dim] for dim in along)]
        swept[path] = np.asarray(lanes if along else lanes[None], start.dtype)
        known.update(along)
    if not known.issuperset(dims):
        unknown = ", ".join(f"`{dim}`" for dim in dims if dim not in known)
        raise ValueError(f"Argument `ds` must have swept quantities as coordinates along {unknown}.")
    # The sweep has checked the values, with a start that is not known here.
    return with_values(base, swept).system


def _built(description: str, dtype: str) -> ImpactSystem:
    """The machine that was swept, its force bound; one without a force, which cannot change, is built once."""
    told = json.loads(description)
    if told.get("force") is None:
        return _linear(description, dtype, bool(jax.config.read("jax_enable_x64")))
    return bound(build(told, dtype))


@lru_cache(maxsize=16)
def _linear(description: str, dtype: str, x64: bool) -> ImpactSystem:
    del x64  # the precision that it is built in
    return build(json.loads(description), dtype)


def _swept_values(
    ds: xr.Dataset, base: Point, dims: set[Hashable]
) -> dict[str, tuple[list[Hashable], xr.DataArray]]:
    """For every path that varies along `dims` alone, those dimensions and the values, with them first."""
    found = {}
    for name, values in ds.coords.items():
        path = str(name).removesuffix(".values")
        own = [dim for dim in axis_names(path, values.ndim) if dim in values.dims]
        along = [dim for dim in values.dims if dim not in own]
        is_counter = name == path and f"{path}.values" in ds.coords  # numbers the arrays that stand beside it
        # Names given to a parameter's own dimension, `mass` for instance, are no values.
        if dims.issuperset(along) and not is_counter and name not in own:
            found[path] = along, values.transpose(*along, *own)
    return {path: values for path, values in found.items() if is_parameter(base, path)}
