"""Sampling test of the period of a force: is it that of the load?

A force is a function. One whose program does not read the time has any period; others can only be sampled: at some times,
and a forcing period later. One state is not enough, as a force of the wrong period may vanish there: x cos(w t) does at
rest. So the force is sampled at several states, of more than one magnitude that suits the machine, since a force may also
vanish where all values are small, or large.
"""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jax.arrays import Numbers, as_float, over_lanes
from .._jax.concrete import concrete, concrete_evaluation
from .force import BoundForce, force_of, reads_time
from .system import AnySystem, ImpactSystem

# Fractions of a period. None is simple, so that no wave of a likely frequency vanishes at all of them.
_TIMES = (0.1234, 0.5678, 0.8341)
# Smaller relative changes count as the rounding of large times in single precision.
_CHANGE = 1e-4
_OFF_PERIOD = (
    "The force does not have the period of the load, 2 pi / `forcing.frequency`{where}: {who}, which counts "
    "forcing periods, needs one that has, or that does not depend on t. `vx.simulate` takes any."
)


def refuse_off_period(
    system: ImpactSystem, x: np.ndarray | Array, v: np.ndarray | Array, *, who: str, where: str = ""
) -> None:
    """Reject a force that does not have the period of the load.

    Args:
        system: the machines, the force bound to its `args`; leaves have lanes, or a single one, last.
        x: positions at the start, (n, lanes), or (n, 1).
        v: velocities, likewise.
        who: the function that needs that period, for the message.
        where: the machines that need it, for the message.
    """
    one = jax.tree.map(lambda a: a[..., 0], system.force)
    if isinstance(one, BoundForce) and reads_time(one, system.num_masses) and is_off_period(system, x, v):
        raise ValueError(_OFF_PERIOD.format(where=where, who=who))


def refuse_without_period(system: AnySystem) -> None:
    """Reject a load that never repeats: a table in time, or different frequencies."""
    if system.forcing.why_not_periodic:
        raise ValueError(system.forcing.why_not_periodic)


def check_period(system: ImpactSystem, x0: Numbers, v0: Numbers) -> None:
    """Reject a load without a period, and a force, bound to its `args`, of another period, where their numbers are concrete."""
    refuse_without_period(system)
    frequency = concrete(system.forcing.frequency)
    if frequency is not None and not frequency > 0:
        raise ValueError("The load has no frequency, so there is no forcing period: use `vx.simulate`.")
    if frequency is None or not isinstance(system.force, BoundForce):
        return
    if any(concrete(leaf) is None for leaf in jax.tree.leaves(system)):
        return
    # A differentiated start is traced and replaced by zeros: its place among the stops hardly matters.
    starts = (concrete(as_float(a)) for a in (x0, v0))
    x, v = (np.zeros(system.num_masses) if a is None else a for a in starts)
    one_lane = lambda a: np.asarray(a)[..., None]  # noqa: E731
    with concrete_evaluation():
        refuse_off_period(jax.tree.map(one_lane, system), x[:, None], v[:, None], who="the stroboscopic map")


def is_off_period(system: ImpactSystem, x: np.ndarray | Array, v: np.ndarray | Array) -> bool:
    """Test whether a force differs after a forcing period, in any lane; arguments as in `refuse_off_period`."""
    lanes = max(np.shape(leaf)[-1] for leaf in jax.tree.leaves((system, x, v)))
    period, n = 2 * np.pi / np.asarray(system.forcing.frequency), system.num_masses
    x, v = x[:n], v[:n]  # the force knows nothing of Jenkins elements
    filled = lambda a: np.broadcast_to(a, (len(x), lanes)).astype(period.dtype)  # noqa: E731
    xs, vs = (np.stack([filled(a) for a in states]) for states in _probes(system, x, v))
    changes = concrete(_changes(force_of(system), period, xs, vs))
    return changes is not None and bool((changes > _CHANGE).any())  # None: the force closes over tracers


def _probes(
    system: ImpactSystem, x: np.ndarray | Array, v: np.ndarray | Array
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """States at which a force is sampled: the start, and states of all signs; none is beyond a stop."""
    x, v = np.asarray(x), np.asarray(v)
    w = np.asarray(system.forcing.frequency)
    order = np.arange(len(x))[:, None]
    xs, vs = [x], [v]
    for size, (k, signs) in product(_sizes(system, x, v), enumerate(product((1, -1), repeat=2))):
        # No two masses or states are alike, lest differences vanish.
        xs.append(_inside(system, signs[0] * size * (0.7 + 0.3 * np.cos(2.4 * k + 1.7 * order))))
        vs.append(signs[1] * w * size * (0.7 + 0.3 * np.sin(1.1 * k + 2.9 * order)))
    return xs, vs


def _sizes(system: ImpactSystem, x: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    """Magnitudes of positions, from stops and start, and from the load, (lanes,) or (1,) each; 1 where zero."""
    w, mass = np.asarray(system.forcing.frequency), np.asarray(system.mass)
    reach = [np.abs(np.asarray(stop.reach(0.0))) for stop in system.stops]
    of_start = np.maximum(np.abs(x), np.abs(v) / w).max(axis=0)
    if system.has_full_mass:
        mass = np.linalg.eigvalsh(np.moveaxis(mass, -1, 0)).T[:1].repeat(len(mass), axis=0)
    by_load = (np.asarray(system.forcing.size()) / (mass * w**2)).max(axis=0)
    both = np.max(np.broadcast_arrays(of_start, *reach), axis=0), by_load
    return [np.where(size > 0, size, 1.0) for size in both]


def _inside(system: ImpactSystem, x: np.ndarray) -> np.ndarray:
    """Positions, those beyond a stop moved onto it: a force is never sampled beyond a stop."""
    for stop in system.stops:
        beyond = np.maximum(np.asarray(stop.along(x)) - stop.sign * np.asarray(stop.centre), 0)
        square = sum(np.asarray(a) ** 2 for a in stop.coefficients.values())
        x = np.array(np.broadcast_to(x, (len(x), beyond.shape[-1])))
        for i, a in stop.coefficients.items():
            x[i] = x[i] - np.asarray(a) * beyond / square
    return x


@jax.jit
def _changes(force: BoundForce, period: Array, xs: Array, vs: Array) -> Array:
    """Relative change of a force over a period, (probes, lanes); one probe after another, to save memory."""
    return jax.lax.map(lambda probe: over_lanes(_change, probe[0], force, period, *probe), (xs, vs))


def _change(
    force: BoundForce, period: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"]
) -> Float[Array, ""]:
    times = period * jnp.asarray(_TIMES, period.dtype)
    now, later = (jax.vmap(lambda t: force(t, x, v))(t) for t in (times, times + period))
    # Samples that are not finite are left out: a force of a body may diverge near another.
    is_known = jnp.isfinite(now) & jnp.isfinite(later)
    change = jnp.where(is_known, jnp.abs(later - now), 0)
    size = jnp.where(is_known, jnp.abs(now), 0)
    return jnp.max(change) / jnp.maximum(jnp.max(size), jnp.finfo(x.dtype).tiny)
