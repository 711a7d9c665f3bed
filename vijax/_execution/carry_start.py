"""Start of a point of a carried sweep: the end of the point before it."""

from jaxtyping import Bool, Float

from .._jax.arrays import Reals, add_up, array_namespace, matvec
from .._machine.kinds import RIGID
from .._machine.numbers import MachineNumbers
from .records import Column


def carried_start(
    numbers: MachineNumbers,
    end: tuple[Float[Column, "n points"], Float[Column, "n points"]],
    held: Bool[Column, "stops points"],
    otherwise: tuple[Reals, Reals],
) -> tuple[Float[Column, "n points"], Float[Column, "n points"]]:
    """Positions and velocities at which points start, pushed back by stops that moved in.

    A mass held by a moving stop starts with that stop's position and velocity, however the stop now moves.

    Args:
        numbers: machines of the points.
        end: final positions and velocities, in space, of the points before them.
        held: flags of the stops that held their mass there.
        otherwise: starts of points before which a motion did not stay finite, (n, points) or shared, (n, 1).
    """
    x, v = end
    library = array_namespace(x)
    place, speed = _stops_at_start(numbers)
    laws = numbers.laws
    # Compliant contacts may be passed, and friction has no place.
    rigid = [j for j in range(len(held)) if laws is None or laws.kinds[j] == RIGID]
    for j in rigid:
        goes_with = held[j] & (numbers.travel is not None)
        along = add_up(numbers.rows[j] * x)
        x = _put(numbers, j, x, place[j], goes_with | (along > place[j]))
        v = _put(numbers, j, v, speed[j], goes_with)
    is_finite = library.isfinite(x).all(axis=0) & library.isfinite(v).all(axis=0)
    return library.where(is_finite, x, otherwise[0]), library.where(is_finite, v, otherwise[1])


def _stops_at_start(numbers: MachineNumbers) -> tuple[Reals, Reals]:
    """Positions and velocities of stops along their rows at phase 0, (stops, points)."""
    if numbers.travel is None:
        return numbers.limit, 0 * numbers.limit
    moved, rate = numbers.travel.at_angle(0.0), numbers.frequency * numbers.travel.slope_at_angle(0.0)
    if numbers.signs is None:  # the motion of masses
        moved, rate = matvec(numbers.rows, moved), matvec(numbers.rows, rate)
    return numbers.limit + moved, rate


def _put(numbers: MachineNumbers, j: int, of_masses: Reals, along: Reals, which: Reals) -> Reals:
    """Positions or velocities, corrected where `which` is true so that their value along row j is `along`."""
    library, row = array_namespace(of_masses), numbers.rows[j]
    # Exact for a stop, whose row is 1 or -1 at one mass.
    assigned = library.where(row != 0, row * along, of_masses)
    if numbers.signs is not None:
        lack = along - add_up(row * of_masses)
        nearest = of_masses + row * lack / add_up(row * row)
        assigned = library.where(numbers.signs[j] != 0, assigned, nearest)
    return library.where(which, assigned, of_masses)
