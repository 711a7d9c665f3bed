"""Numbers of a machine, in arrays whose shapes depend on the counts of masses, contacts and harmonics alone.

So a program compiled for one machine serves every other of that size: the mass and the side of a contact are numbers
too. Arrays of concrete values are made by NumPy, which compiles nothing.
"""

import equinox as eqx
import jax
import numpy as np

from .._jax.arithmetic import is_arithmetic
from .._jax.arrays import Reals, add_up, array_namespace, stack
from .._system.contact import AbstractRigidLimit
from .._system.force import BoundForce, force_of
from .._system.forcing import Harmonic
from .._system.hysteresis import ForceBesideSliders, coupled, with_more_rows
from .._system.load import is_constant
from .._system.restitution import Restitution, restitution_of_contacts
from .._system.system import ImpactSystem
from .._system.waves import Tones, Waves
from .kinds import RIGID
from .laws import Laws, laws_of
from .state import ModeLayout
from .table_numbers import TableNumbers, tables_of
from .tables import KnotsLayout


class BaseLoad(eqx.Module):
    """Inertia force of the masses on a base that moves, a part of the load.

    Attributes:
        waves: its harmonics, (harmonics, n).
        tables: flags of the loads by tables that are parts of it.
    """

    waves: Waves
    tables: tuple[bool, ...] = eqx.field(static=True)


class MachineNumbers(eqx.Module):
    """`ImpactSystem` as arrays, lanes last.

    Attributes:
        mass: diagonal of M, (n,), or M, (n, n).
        damping: C, (n, n).
        stiffness: K, (n, n).
        mean: mean of the load, (n,).
        waves: harmonics of the load, (harmonics, n), padded with zero amplitudes, see `num_harmonics`.
        frequency: W, by which periods are counted, ().
        highest: the highest harmonic of the load and of the motions of the stops, (); with `tones` that of each, (tones,).
        rows: A, what each contact bears on, (contacts, n): 1 for the mass of an upper stop, -1 for that of a lower one.
        limit: s, in the mean where it moves, (contacts,).
        restitution: the law r(u), (contacts,).
        signs: of a stop the entry of its row, of any other contact 0, (contacts,); None if none is coupled.
        travel: the motions of the stops, but for their means, as their masses follow them, (harmonics, n), or for
            coupled contacts that of each along its row, (harmonics, contacts); None where all stand still.
        force: what else acts on the masses, bound to its `args`; None for a linear machine.
        laws: of friction, Jenkins elements and compliant contacts; None if all contacts are rigid. Friction and then Jenkins
            elements have rows behind those of the contacts, and everything over contacts has entries for them.
        num_states: number of last coordinates whose positions stay 0, the stretches of Jenkins elements among them.
        tables: loads by tables; None if there are none.
        base: the part of the load that a moving base makes; None where nothing depends on it.
        tones: frequencies of the rows of `waves` where they have several, the first of them W; None where all have W.
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
    restitution: Restitution
    signs: Reals | None
    travel: Waves | None
    force: BoundForce | ForceBesideSliders | None
    laws: Laws | None = None
    num_states: int = eqx.field(static=True, default=0)
    tables: tuple[TableNumbers, ...] | None = None
    base: BaseLoad | None = None
    tones: Tones | None = None

    @property
    def num_columns(self) -> int:
        """Number of columns of the phase of the load: of harmonics, and of loads by tables."""
        layout = self.knots_layout
        return self.waves.num_harmonics if layout is None else len(layout.anew)

    @property
    def knots_layout(self) -> KnotsLayout | None:
        """Layout of the places in the tables of the load; None if there are none."""
        if self.tables is None:
            return None
        _, orders, n = self.tables[0].rows.shape[:3]
        in_step = tuple(table.is_in_step for table in self.tables)
        return KnotsLayout.of(in_step, self.waves.num_harmonics, orders // 2 * n)

    @property
    def mode_layout(self) -> ModeLayout | None:
        """Layout of the mode of a state; None if all contacts are rigid."""
        return None if self.laws is None else ModeLayout(self.laws.is_tied)

    @property
    def is_switching(self) -> bool:
        """True if forces switch between linear laws, as `ImpactSystem.is_switching`."""
        return self.laws is not None

    @property
    def kinds(self) -> tuple[int, ...]:
        """Kinds of the elements, (contacts,)."""
        return (RIGID,) * self.rows.shape[-2] if self.laws is None else self.laws.kinds

    @property
    def num_stops(self) -> int:
        """Number of contacts without friction and Jenkins elements."""
        return len(self.rows) if self.laws is None else self.laws.num_stops

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements."""
        return 0 if self.laws is None else self.laws.num_sliders

    @property
    def has_tied_friction(self) -> bool:
        """True if there is friction of contacts."""
        return self.laws is not None and self.laws.is_tied

    @property
    def has_arithmetic_force(self) -> bool:
        """True where the force, if there is one, is arithmetic alone, see `is_arithmetic`."""
        if self.force is None:
            return True
        has_lanes = self.mean.ndim > 1
        of_one = lambda a: jax.ShapeDtypeStruct(a.shape[:-1] if has_lanes and a.ndim else a.shape, a.dtype)  # noqa: E731
        force, mean = jax.tree.map(of_one, (self.force, self.mean))
        return is_arithmetic(force, jax.ShapeDtypeStruct((), mean.dtype), mean, mean)


def numbers_of(system: ImpactSystem) -> MachineNumbers:
    """Numbers of a machine, its force bound to its `args`; leaves may have lanes as last axis."""
    size, stops, is_coupled = num_harmonics(system), system.stops, system.is_coupled
    zero = 0 * system.stiffness[0, 0]

    def of_contacts(values: list) -> Reals:
        return stack([value + zero for value in values]) if values else np.zeros((0, *zero.shape), zero.dtype)

    more = len(system.hysteresis)
    mass, damping, stiffness = coupled(system.hysteresis, system.mass, system.damping, system.stiffness)
    mean, waves = _with_more_coordinates(*harmonic_load_of(system), more)
    none, one = [0.0] * (len(system.friction) + more), np.ones((), zero.dtype)
    restitutions = [stop.restitution if isinstance(stop, AbstractRigidLimit) else one for stop in stops]
    return MachineNumbers(
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        mean=mean,
        waves=waves,
        frequency=system.forcing.clock,
        highest=_highest_of_load(system, zero),
        rows=_rows(system),
        limit=of_contacts([stop.sign * stop.centre for stop in stops] + none),
        restitution=restitution_of_contacts(restitutions + [one for _ in none], zero),
        signs=of_contacts([stop.sign if stop.slot else 0 for stop in stops] + none) if is_coupled else None,
        travel=(_travel_of_contacts if is_coupled else _travel_of_masses)(system, size),
        force=_force(system, more),
        laws=laws_of(system, of_contacts),
        num_states=system.num_states + more,
        tables=_tables(system, more),
        tones=tones_of(system),
    )


def _with_more_coordinates(mean: Reals, waves: Waves, count: int) -> tuple[Reals, Waves]:
    """Load that is zero on some more coordinates."""
    if not count:
        return mean, waves
    return with_more_rows(mean, count, 0), jax.tree.map(lambda a: with_more_rows(a, count, 1), waves)


def _force(system: ImpactSystem, more: int) -> BoundForce | ForceBesideSliders | None:
    """Force that is bound to its `args`, with some more coordinates."""
    if not isinstance(system.force, BoundForce):
        return None
    force = force_of(system)
    return ForceBesideSliders(force, more) if more else force


def _tables(system: ImpactSystem, more: int) -> tuple[TableNumbers, ...] | None:
    """Loads by tables, with some more coordinates."""
    tables = tables_of(system)
    if tables is None or not more:
        return tables
    return tuple(
        eqx.tree_at(lambda a: a.rows, table, with_more_rows(table.rows, more, 2)) for table in tables
    )


def with_base(numbers: MachineNumbers, system: ImpactSystem) -> MachineNumbers:
    """Numbers of a machine with the part of the load that a moving base makes, zero on the stretches of Jenkins elements."""
    base = base_of(system)
    _, waves = _with_more_coordinates(numbers.mean, base.waves, len(system.hysteresis))
    base = eqx.tree_at(lambda one: one.waves, base, waves)
    return eqx.tree_at(lambda n: n.base, numbers, base, is_leaf=lambda leaf: leaf is None)


def base_of(system: ImpactSystem) -> BaseLoad:
    """Part of a load that a moving base makes, its harmonics in the rows of those of the load."""
    tables = tuple(load.from_base for load in system.forcing.loads if not isinstance(load, Harmonic))
    return BaseLoad(_waves_of(system, of_base=True), tables)


def harmonic_load_of(system: ImpactSystem) -> tuple[Reals, Waves]:
    """Mean of the load, and its harmonics, padded."""
    lane_axes, forcing = system.stiffness.ndim - 2, system.forcing
    if isinstance(forcing, Harmonic):
        return forcing.mean, forcing.waves(lane_axes).padded(num_harmonics(system))
    means: list[Reals] = [np.zeros((system.stiffness.shape[0], *[1] * lane_axes), system.stiffness.dtype)]
    for load in forcing.loads:
        if isinstance(load, Harmonic):
            means.append(load.mean)
            if is_constant(load):
                means.append(add_up(load.waves(lane_axes).cosine))
    return add_up(means), _waves_of(system)


def _waves_of(system: ImpactSystem, *, of_base: bool = False) -> Waves:
    """Harmonics of a load, padded; of the part of it that a moving base makes."""
    lane_axes = system.stiffness.ndim - 2
    none = np.zeros((1, system.stiffness.shape[0], *[1] * lane_axes), system.stiffness.dtype)
    loads, counts = _turning(system), _counts(system)
    if len(counts) == 1:
        counts = counts * len(loads)
    rows = [
        (Waves(none, none) if of_base and not load.from_base else load.waves(lane_axes)).padded(count)
        for load, count in zip(loads, counts, strict=True)
    ]
    if tones_of(system) is None:
        start = Waves(none, none).padded(num_harmonics(system))
        return jax.tree.map(lambda *parts: add_up(parts), start, *rows)
    return jax.tree.map(_one_behind_another, *rows)


def _one_behind_another(*waves: Reals) -> Reals:
    library = array_namespace(*waves)
    lanes = np.broadcast_shapes(*(a.shape[2:] for a in waves))
    return library.concatenate([library.broadcast_to(a, (*a.shape[:2], *lanes)) for a in waves])


def _turning(system: ImpactSystem) -> list[Harmonic]:
    """Harmonics of a load that are not constant; those of one load whatever it is."""
    loads = system.forcing.loads
    if len(loads) == 1:
        return [load for load in loads if isinstance(load, Harmonic)]
    return [load for load in loads if isinstance(load, Harmonic) and not is_constant(load)]


def tones_of(system: ImpactSystem) -> Tones | None:
    """Frequencies of the harmonics of a load where each has its own, the first that of the machine; None elsewhere."""
    loads = _turning(system)
    if len(loads) < 2 or not system.forcing.why_not_periodic:
        return None
    return Tones(stack([load.frequency for load in loads]), _counts(system))


def _counts(system: ImpactSystem) -> tuple[int, ...]:
    """Numbers of harmonics of each frequency after padding: the next power of two."""
    return tuple(1 << (highest - 1).bit_length() for highest in _highest(system))


def num_harmonics(system: ImpactSystem) -> int:
    """Number of harmonics of all frequencies after padding; lanes may stand last."""
    return sum(_counts(system))


def _highest(system: ImpactSystem) -> list[int]:
    """Highest harmonic of each frequency."""
    lane_axes = system.stiffness.ndim - 2
    turning = _turning(system)
    if len(turning) > 1 and system.forcing.why_not_periodic:
        return [load.num_harmonics(lane_axes) for load in turning]
    loads = [load for load in system.forcing.loads if isinstance(load, Harmonic)]
    moving = [*loads, *(stop.motion for stop in system.stops if stop.motion is not None)]
    return [max((harmonic.num_harmonics(lane_axes) for harmonic in moving), default=1)]


def _highest_of_load(system: ImpactSystem, like: Reals) -> Reals:
    highest, lanes = _highest(system), [1] * (system.stiffness.ndim - 2)
    if len(highest) == 1:
        return np.full(lanes, highest[0], like.dtype)
    return np.array(highest, like.dtype).reshape(-1, *lanes)


def _rows(system: ImpactSystem) -> Reals:
    """Matrix A; concrete for stops alone."""
    n, zero = system.num_coordinates, np.zeros([1] * (system.stiffness.ndim - 2), system.stiffness.dtype)
    rows = [
        stack([stop.coefficients.get(i, 0) + zero for i in range(n)])
        for stop in (*system.stops, *system.friction, *system.hysteresis)
    ]
    return stack(rows) if rows else np.zeros((0, n, *zero.shape), zero.dtype)


def _travel_of_contacts(system: ImpactSystem, size: int) -> Waves | None:
    """Motion of every contact along its row; None if all stand still."""
    if all(stop.motion is None for stop in system.stops):
        return None
    num_lane_axes = system.stiffness.ndim - 2
    still = np.zeros((size, *[1] * (num_lane_axes + 1)), system.stiffness.dtype)
    waves = [
        Waves(still, still)
        if stop.motion is None
        else jax.tree.map(lambda a, sign=stop.sign: sign * a, stop.motion.waves(num_lane_axes).padded(size))
        for stop in system.stops
    ]
    waves += [Waves(still, still) for _ in (*system.friction, *system.hysteresis)]
    return jax.tree.map(_side_by_side, *waves)


def _side_by_side(*waves: Reals) -> Reals:
    library = array_namespace(*waves)
    return library.concatenate(library.broadcast_arrays(*waves), axis=1)


def _travel_of_masses(system: ImpactSystem, size: int) -> Waves | None:
    """Motion of the stops of every mass; None if all stand still."""
    moving = [(stop.slot[0], stop.motion) for stop in system.stops if stop.slot and stop.motion is not None]
    if not moving:
        return None
    num_lane_axes = system.mass.ndim - 1
    still = np.zeros((size, *[1] * (num_lane_axes + 1)), system.mass.dtype)

    def waves_of(mass: int) -> Waves:
        waves = [motion.waves(num_lane_axes).padded(size) for i, motion in moving if i == mass]
        if not waves:
            return Waves(still, still)
        # Two stops of one mass move alike: their mean gives each half of a derivative.
        return jax.tree.map(lambda *own: add_up(own) / len(waves), *waves)

    return jax.tree.map(_side_by_side, *map(waves_of, range(len(system.mass))))
