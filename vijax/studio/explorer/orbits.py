"""The orbit near a motion, and the branch through it."""

import time

import numpy as np
import xarray as xr

from ..._branches.branch import Branch
from ..._branches.continuation import continuation
from ..._jax.arrays import is_single_precision
from ..._orbits.orbit import ORBIT_RESULTS, PeriodicOrbit
from ..._orbits.periodic_orbit import periodic_orbit
from ..._sections.classify import MOTIONS
from ..._system.parameters import get_parameter
from .motion import EVENTS_OF_CYCLE, PointMotion, flow_of, simulated

# Most forcing periods of an orbit that is searched, and most guesses of each number of them.
_MOST_PERIODS, _GUESSES = 4, 3
# Most points of a branch in each direction, and most seconds that it takes.
_POINTS, _SECONDS = 250, 60.0


def orbit_near(motion: PointMotion) -> PointMotion:
    """The periodic orbit of a motion; of one that does not repeat, the first that its close returns lead to.

    Where a motion returns closest after n forcing periods an orbit of n periods is near, stable or not
    (Auerbach et al., Phys. Rev. Lett. 58, 1987).

    Raises:
        RuntimeError: if none of 1 to 4 periods is found.
    """
    if is_single_precision(motion.system):
        raise RuntimeError("Orbits need 64-bit numbers.")
    if motion.orbit is not None:
        return motion
    sol, period = motion.solution, float(motion.system.forcing.period)
    count = int(float(sol.known_until) / period + 1e-9)
    x, v = (np.asarray(a) for a in sol.evaluate(np.arange(count + 1) * period))
    states = np.concatenate([x, v], axis=1)
    for n in range(1, min(_MOST_PERIODS, count) + 1):
        away = np.linalg.norm(states[n:] - states[:-n], axis=1)
        for k in np.argsort(away)[:_GUESSES]:
            found = periodic_orbit(
                motion.system,
                x[k],
                v[k],
                n,
                flow=flow_of(motion.system),
                max_events=EVENTS_OF_CYCLE,
                throw=False,
            )
            if found.result == ORBIT_RESULTS.successful:
                return _shown(found)
    raise RuntimeError(f"No periodic orbit of 1 to {_MOST_PERIODS} periods was found near this motion.")


def _shown(orbit: PeriodicOrbit) -> PointMotion:
    """A periodic orbit as a motion."""
    period = float(orbit.period)
    sol = simulated(orbit.system, period, np.asarray(orbit.x0), np.asarray(orbit.v0))
    counts = np.asarray(orbit.num_impacts)
    motion = MOTIONS.index("periodic" if counts.any() else "non_impacting")
    kind = xr.Dataset({"motion": motion, "num_periods": orbit.num_periods, "num_impacts": ("stop", counts)})
    return PointMotion(orbit.system, sol, (0.0, period), kind, orbit)


def branch_through(orbit: PeriodicOrbit, path: str, bounds: tuple[float, float], quantity: str) -> Branch:
    """The branch of an orbit along a swept quantity, with a column of another quantity if that is not empty.

    Raises:
        ValueError: if the orbit or the path allow none.
    """
    value = float(np.asarray(get_parameter(orbit.system, path)).ravel()[0])
    low, high = min(bounds[0], value), max(bounds[1], value)
    quantities = [quantity] if quantity else []
    end = time.monotonic() + _SECONDS

    def is_late(_: Branch) -> bool:
        return time.monotonic() > end

    return continuation(
        orbit,
        path,
        (low, high),
        max_points=_POINTS,
        quantities=quantities,
        stop={"time": is_late},
        progress=False,
    )


def bounds_of(ds: xr.Dataset, path: str) -> tuple[float, float]:
    """Lowest and highest swept value."""
    return float(ds[path].min()), float(ds[path].max())
