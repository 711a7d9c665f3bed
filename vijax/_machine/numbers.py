"""All numbers of a machine, in arrays whose shapes tell its numbers of masses, contacts and harmonics alone.

So a program compiled for one machine serves every other of that size: the mass and the side of a contact are
numbers like any other. Arrays of known values are made by NumPy, which compiles nothing.
"""

import equinox as eqx
import jax
import numpy as np

from .._system.force import BoundForce
from .._system.system import ImpactSystem
from .._system.waves import Waves
from .._types import Reals, add_up, library_of, stack


class Numbers(eqx.Module):
    """An `ImpactSystem` as arrays, lanes last.

    Attributes:
        mass: the diagonal of M, (n,).
        damping: C, (n, n).
        stiffness: K, (n, n).
        mean: mean of the load, (n,).
        waves: the rest of it, (harmonics, n); harmonics without amplitude fill it up, see `num_harmonics`.
        frequency: W, ().
        highest: the highest harmonic of the load and of the motions of the stops, ().
        rows: A, what each contact bears on, (contacts, n): 1 for the mass of an upper stop, -1 for that of a lower one.
        limit: s, in the mean where it moves, (contacts,).
        restitution: r, (contacts,).
        travel: the motions of the stops, but for their means, as their masses follow them, (harmonics, n); None
            where all stand still.
        force: what else acts on the masses, bound to its `args`; None for a linear machine.
    """

    mass: Reals
    damping: Reals
    stiffness: Reals
    mean: Reals
    waves: Waves
    frequency: Reals
    highest: Reals
    rows: Reals
    limit: Reals
    restitution: Reals
    travel: Waves | None
    force: BoundForce | None


def numbers_of(system: ImpactSystem) -> Numbers:
    """The numbers of a machine, its force bound to its `args`; leaves may carry lanes as a last axis."""
    num_lane_axes, size = system.mass.ndim - 1, num_harmonics(system)
    forcing, stops, n = system.forcing, system.stops, len(system.mass)
    zero = 0 * system.mass[0]

    def of_contacts(values: list) -> Reals:
        return stack([value + zero for value in values]) if values else np.zeros((0, *zero.shape), zero.dtype)

    rows = np.zeros((len(stops), n, *[1] * num_lane_axes), zero.dtype)
    for j, stop in enumerate(stops):
        rows[j, stop.mass] = stop.sign
    return Numbers(
        mass=system.mass,
        damping=system.damping,
        stiffness=system.stiffness,
        mean=forcing.mean,
        waves=forcing.waves(num_lane_axes).padded(size),
        frequency=forcing.frequency,
        highest=np.full([1] * num_lane_axes, _highest(system), zero.dtype),
        rows=rows,
        limit=of_contacts([stop.sign * stop.centre for stop in stops]),
        restitution=of_contacts([stop.restitution for stop in stops]),
        travel=_travel(system, size),
        force=system.force if isinstance(system.force, BoundForce) else None,
    )


def num_harmonics(system: ImpactSystem) -> int:
    """Harmonics for which there is room: the next power of two; lanes may stand last."""
    return 1 << (_highest(system) - 1).bit_length()


def _highest(system: ImpactSystem) -> int:
    moving = [system.forcing, *(stop.motion for stop in system.stops if stop.motion is not None)]
    return max(harmonic.num_harmonics(system.mass.ndim - 1) for harmonic in moving)


def _travel(system: ImpactSystem, size: int) -> Waves | None:
    """The motion of the stops of every mass, if any of them moves."""
    moving = [(stop.mass, stop.motion) for stop in system.stops if stop.motion is not None]
    if not moving:
        return None
    num_lane_axes = system.mass.ndim - 1
    still = np.zeros((size, *[1] * (num_lane_axes + 1)), system.mass.dtype)

    def waves_of(mass: int) -> Waves:
        waves = [motion.waves(num_lane_axes).padded(size) for i, motion in moving if i == mass]
        if not waves:
            return Waves(still, still)
        # Two stops of one mass move alike: the mean of both gives each its half of a derivative.
        return jax.tree.map(lambda *own: add_up(own) / len(waves), *waves)

    def in_rows(*waves: Reals) -> Reals:
        library = library_of(*waves)
        return library.concatenate(library.broadcast_arrays(*waves), axis=1)

    return jax.tree.map(in_rows, *map(waves_of, range(len(system.mass))))
