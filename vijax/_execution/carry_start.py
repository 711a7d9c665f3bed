"""Start of a point of a carried sweep: the end of the point before it."""

from jaxtyping import Bool, Float

from .._jax.arrays import Reals, array_namespace
from .._system.contact import AbstractLimit
from .._system.system import ImpactSystem
from .records import Column


def carried_start(
    system: ImpactSystem,
    end: tuple[Float[Column, "n points"], Float[Column, "n points"]],
    held: Bool[Column, "stops points"],
    otherwise: tuple[Float[Column, "n points"], Float[Column, "n points"]],
) -> tuple[Float[Column, "n points"], Float[Column, "n points"]]:
    """Positions and velocities at which points start, pushed back by stops that moved in.

    A mass held by a moving stop starts with that stop's position and velocity, however the stop now moves.

    Args:
        system: machines of the points, lanes last.
        end: final positions and velocities, in space, of the points before them.
        held: flags of the stops that held their mass there.
        otherwise: starts of points before which a motion did not stay finite.
    """
    x, v = end
    library = array_namespace(x)
    for stop, is_held in zip(system.stops, held, strict=True):
        position = stop.sign * stop.at(0.0)
        speed = stop.sign * system.forcing.frequency * stop.slope_at(0.0)
        goes_with = is_held & (stop.motion is not None)
        x = _put(stop, x, position, goes_with | (stop.along(x) > position))
        v = _put(stop, v, speed, goes_with)
    is_finite = library.isfinite(x).all(axis=0) & library.isfinite(v).all(axis=0)
    return library.where(is_finite, x, otherwise[0]), library.where(is_finite, v, otherwise[1])


def _put(stop: AbstractLimit, of_masses: Reals, along: Reals, which: Reals) -> Reals:
    """Positions or velocities, corrected where `which` is true so that their value along the stop is `along`."""
    library, rows, coefficients = array_namespace(of_masses), list(of_masses), stop.coefficients
    lack, square = along - stop.along(of_masses), sum(a * a for a in coefficients.values())
    for i, a in coefficients.items():
        there = along / a if len(coefficients) == 1 else rows[i] + a * lack / square
        rows[i] = library.where(which, there, rows[i])
    return library.stack(rows)
