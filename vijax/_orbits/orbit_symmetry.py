"""Symmetries of periodic orbits, and their mirror images.

A symmetry of the machine maps an orbit to an orbit, see `_system/symmetry.py`: to itself, shifted in time, or to another one.
"""

import numpy as np

from .._jax.concrete import is_traced
from .._system.symmetry import Symmetry
from .._system.system import machine_of
from .._trajectory.simulate import simulate_all
from .orbit import PeriodicOrbit
from .periodic_orbit import periodic_orbit

# share: distance of two states, relative to the motion, below which they are the same.
_SAME = 1e-7


def symmetries_of_orbit(orbit: PeriodicOrbit) -> tuple[Symmetry, ...]:
    """Symmetries of the machine that an orbit has, see `PeriodicOrbit.symmetries`."""
    return tuple(one for one in _symmetries_of_machine(orbit) if _has(orbit, one))


def image_of_orbit(orbit: PeriodicOrbit, symmetry: Symmetry | None) -> PeriodicOrbit:
    """Image of an orbit, see `PeriodicOrbit.mirrored`."""
    if symmetry is None:
        known = _symmetries_of_machine(orbit)
        if not known:
            raise ValueError(
                "The machine has no symmetry, so its orbits have no mirror images: see `orbit.system.symmetries()`."
            )
        symmetry = next((one for one in known if not _has(orbit, one)), known[0])
    elif not isinstance(symmetry, Symmetry):
        raise ValueError(
            f"Argument `symmetry` must be one of `orbit.system.symmetries()`, but is {symmetry!r}."
        )
    (state,) = _states(orbit, [float(symmetry.shift) if orbit.num_periods else 0.0])
    x, v = np.split(state, 2)
    return periodic_orbit(
        orbit.system,
        *symmetry.image(x, v),
        orbit.num_periods or 1,
        phase=orbit.phase,
        args=orbit.args,
        flow=orbit.flow,
        max_events=max(orbit.events.t.shape[-1], 1),
    )


def _symmetries_of_machine(orbit: PeriodicOrbit) -> tuple[Symmetry, ...]:
    if is_traced(orbit) or orbit.period.ndim:
        raise ValueError("Symmetries are those of one orbit, outside of `jax.jit` and `jax.vmap`.")
    if not orbit.is_admissible:
        raise ValueError("The machine does not follow this orbit, which has no motion to mirror.")
    return machine_of(orbit.system).symmetries(args=orbit.args)


def _has(orbit: PeriodicOrbit, symmetry: Symmetry) -> bool:
    """True if a symmetry maps an orbit to itself, shifted in time."""
    n = orbit.num_periods
    # Without forcing the shift is a part of the period: a symmetry of order m has returned after m of them.
    later = np.arange(n) if n else np.arange(symmetry.order) / symmetry.order
    first, *others = _states(orbit, [float(symmetry.shift) if n else 0.0, *map(float, later)])
    x, v = np.split(first, 2)
    image = np.concatenate(symmetry.image(x, v))
    size = np.abs(others).reshape(-1, 2, len(x)).max(axis=(0, 2)).repeat(len(x))
    return any(np.all(np.abs(image - other) <= _SAME * size) for other in others)


def _states(orbit: PeriodicOrbit, shares: list[float]) -> np.ndarray:
    """States at times after the start, in forcing periods or, without forcing, in periods of the orbit, (times, 2 n)."""
    unit = float(orbit.period) / (orbit.num_periods or 1)
    t0 = float(orbit.phase / orbit.system.forcing.frequency) if orbit.num_periods else 0.0
    ts, back = np.unique(t0 + unit * np.asarray(shares), return_inverse=True)
    if ts[-1] == t0:
        states = np.concatenate([np.asarray(orbit.x0), np.asarray(orbit.v0)])[None]
        return states[back]
    sol = simulate_all(
        orbit.system,
        t0,
        ts[-1],
        orbit.x0,
        orbit.v0,
        ts=ts,
        args=orbit.args,
        flow=orbit.flow,
        max_events=max(orbit.events.t.shape[-1], 1),
        throw=False,
    )
    return np.concatenate([np.asarray(sol.xs), np.asarray(sol.vs)], axis=1)[back]
