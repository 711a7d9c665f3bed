"""How a sweep was made, told by the attributes of its dataset, and the machine back from them."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._labels import versions
from .._system.description import build, describe
from .._system.system import ImpactSystem
from .paths import Point, force_parameters, only_paths, with_values
from .queues import Counts


def origin(
    base: Point, counts: Counts, *, flow: str, carry: str | None, goes_on: bool
) -> dict[str, str | int]:
    """The attributes of a dataset: all that decides what a sweep finds, beside the swept values.

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
        "carry": carry or "none",
        "carry_from": "an earlier sweep" if goes_on else "none",
        "max_impacts": int(counts.max_impacts),
        "max_steps": "default" if counts.max_steps is None else int(counts.max_steps),
        "flow": flow,
        "dtype": str(base.system.mass.dtype),
        "device": jax.default_backend(),
        **versions(),
    }


def system_of(ds: xr.Dataset) -> ImpactSystem:
    """Build the machine of a sweep again, from its dataset alone, in memory or from a file.

    Args:
        ds: what `vx.sweep` returned, or a part of it. Quantities of which one value is selected have
            it; those that still have several keep the value of the machine that was swept.

    Returns:
        The machine, bit for bit.

    Raises:
        ValueError: if the attributes hold no machine, or one with a `force`, a function.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_b(1.0), {"forcing.frequency": np.arange(0.3, 2.1, 0.01)})
        point = ds.sel({"forcing.frequency": 0.8}, method="nearest")
        sol = vx.simulate(vx.system_of(point), 0.0, 80.0)
        ```
    """
    if "system" not in ds.attrs:
        raise ValueError("Argument `ds` must carry the attributes of `vx.sweep`, but has no `system`.")
    system = build(json.loads(ds.attrs["system"]), ds.attrs["dtype"])
    start = np.zeros(system.num_masses, ds.attrs["dtype"])
    base, single = Point(system, start, start), {}
    for name, values in ds.coords.items():
        path = str(name).removesuffix(".values")
        if path not in ds.dims and (name != path or f"{path}.values" not in ds.coords):
            single[path] = values.values
    paths = only_paths(base, single)
    # The sweep has checked the values, with a start that is not known here.
    point = with_values(base, {path: np.asarray(single[path], start.dtype)[None] for path in paths})
    return jax.tree.map(lambda a: jnp.asarray(a[..., 0]), point.system)
