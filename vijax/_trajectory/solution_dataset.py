"""Dataset of a trajectory."""

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import lazy_loader
import numpy as np

from .._dataset_attributes import flags, variable_attributes, versions
from .._hybrid.limits import EVENT_NAMES
from .._jax.xla import padding_allowed
from .results import RESULTS

if TYPE_CHECKING:
    import xarray as xr
else:  # with pandas it takes as long to import as everything else of a trajectory
    xr = lazy_loader.load("xarray")


@padding_allowed
def dataset_of(solution: Any) -> "xr.Dataset":
    """Dataset of a `Solution`: of one trajectory, or of a batch with lanes first."""
    log, grazing = solution.events, solution.grazing
    longest = int(jnp.max(solution.num_events, initial=0))
    names = ["stop", "kind", "velocity_minus", "velocity_plus", "impulse"]
    names += [] if log.friction_impulse is None else ["friction_impulse"]
    events = {"event_time": log.t} | {f"event_{name}": getattr(log, name) for name in names}
    columns: dict[str, tuple[tuple[str, ...], Any]] = {
        "x": (("time", "mass"), solution.xs),
        "v": (("time", "mass"), solution.vs),
        **{name: (("event",), a[..., :longest]) for name, a in events.items()},
        "x1": (("mass",), solution.x1),
        "v1": (("mass",), solution.v1),
        "stuck1": (("stop",), solution.stuck1),
        **({"sticking1": (("friction",), solution.sticking1)} if solution.sticking1.shape[-1] else {}),
        **({"sliders1": (("hysteresis",), solution.sliders1)} if solution.num_sliders else {}),
        "result": ((), solution.result._value),
        **{
            name: ((), getattr(solution, name))
            for name in ("num_events", "num_steps", "num_rejected", "t0", "t1")
        },
        **{f"grazing_{f}": ((), getattr(grazing, f)) for f in ("impact_speed", "clearance", "is_near")},
    }
    lanes = ("lane",) * solution.t1.ndim
    variables = {name: ((*lanes, *dims), np.asarray(a)) for name, (dims, a) in columns.items()}
    ts, of_time = np.asarray(solution.ts), (*lanes, "time")
    if lanes and (ts == ts[:1]).all():  # one time axis for all lanes, for selection by time
        ts, of_time = ts[0], ("time",)
    ds = xr.Dataset(variables, {"time": (of_time, ts)}, versions() | {"dtype": str(solution.t1.dtype)})
    for name, variable in ds.variables.items():
        variable.attrs = variable_attributes(str(name))
    for name, meanings in (("event_kind", EVENT_NAMES), ("result", tuple(RESULTS._name_to_item))):
        ds[name] = ds[name].astype(np.int8)
        ds[name].attrs |= flags(meanings)
    return ds
