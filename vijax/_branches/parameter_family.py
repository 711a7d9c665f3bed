"""Cycles of a machine whose parameter varies: their scaled coordinates and their equations."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals
from .._machine.machine import Machine
from .._machine.numbers import numbers_of
from .._orbits.condensation import Pencil
from .._orbits.cycle import Problem, Unknowns, prepared
from .._orbits.floquet import floquet_multipliers
from .._orbits.rigid_modes import all_shifts
from .._orbits.sequence import Sequence, num_erased
from .._system.parameters import machine_at, set_parameter
from .._system.system import AnySystem, ImpactSystem, machine_of


class ExtendedCycle(NamedTuple):
    """A cycle and its parameter, or a direction in their space, scaled.

    Attributes:
        z: positions and velocities at the start, relative to the stops, (2 n,).
        flights: durations in forcing periods, (events,).
        p: the parameter, (); of a family of two, (2,).
    """

    z: Reals
    flights: Reals
    p: Reals

    def moved(self, direction: "ExtendedCycle", by: Reals) -> "ExtendedCycle":
        """The cycle moved by a length in a direction."""
        return ExtendedCycle(*(a + by * d for a, d in zip(self, direction, strict=True)))

    def turned(self) -> "ExtendedCycle":
        """The opposite direction."""
        return ExtendedCycle(*(-a for a in self))

    def along(self, direction: "ExtendedCycle") -> Reals:
        """Inner product with a direction."""
        return sum((a * d).sum() for a, d in zip(self, direction, strict=True))

    def distance(self, other: "ExtendedCycle") -> float:
        """Distance from another cycle, both concrete."""
        away = self.moved(other, -1.0)
        return float(np.sqrt(away.along(away)))

    def distance_of_starts(self, other: "ExtendedCycle") -> float:
        """Distance of start and parameter from those of another cycle, which may have other events; both concrete."""
        return float(np.linalg.norm(np.append(self.z - other.z, self.p - other.p)))


class ParameterFamily(eqx.Module):
    """Machines at all values of one parameter or two, and the equations of their cycles.

    Attributes:
        system: one of the machines, its force bound to its `args`; or the family of the user that has the parameters.
        flow: motion between events.
        num_periods: n.
        phase: start of a cycle, in forcing periods.
        scale: sizes of positions and velocities, (2 n,).
        span: size of the parameter, (); of two, (2,).
        tolerance: size of a Newton step, relative to the cycle, below which the corrector stops; 0 for rounding.
        shifts: projection onto the shifts that no spring and no contact feels, see `rigid_modes.py`, (n, n).
        drift: projection onto those that friction alone feels; None without friction.
        path: path of the parameter.
        second: path of the second parameter, or None.
        is_autonomous: true where no load sets the period, see `Problem`; the unit of time is the period of the first orbit.
    """

    system: AnySystem
    flow: AbstractFlow
    num_periods: Reals
    phase: Reals
    scale: Reals
    span: Reals
    tolerance: Reals
    shifts: Reals
    drift: Any
    path: str = eqx.field(static=True)
    second: str | None = eqx.field(static=True, default=None)
    is_autonomous: bool = eqx.field(static=True, default=False)

    def system_at(self, p: Reals) -> ImpactSystem:
        """The machine at a value of the scaled parameter, or of both parameters."""
        if self.second is None:
            return machine_at(self.system, self.path, p * self.span)
        first, second = p * self.span
        return machine_at(set_parameter(self.system, self.path, first), self.second, second)

    @property
    def has_tied_friction(self) -> bool:
        """True if there is friction of contacts."""
        return any(element.is_tied for element in machine_of(self.system).friction)

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements."""
        return len(machine_of(self.system).hysteresis)

    @property
    def last_phase(self) -> float:
        """Forcing periods at which a cycle ends, where events pass to its start; none do where no load sets the period."""
        return np.inf if self.is_autonomous else float(self.num_periods)

    @property
    def all_shifts(self) -> Reals:
        """The projection onto all shifts whose multiplier is 1."""
        return jnp.asarray(all_shifts(self.shifts, self.drift))

    def multipliers(self, pencil: Pencil, sequence: Sequence) -> Complex[Array, " state"]:
        """Floquet multipliers of a cycle from the pencil of its neighbours."""
        erased = num_erased(sequence, self.num_sliders)
        return floquet_multipliers(pencil, erased, self.all_shifts)

    def problem(self, sequence: Sequence, p: Reals) -> Problem:
        """Equations of a sequence at a parameter."""
        machine, flow = prepared(numbers_of(self.system_at(p)), self.flow, jnp.asarray(self.num_periods))
        return self._asked(machine, flow, sequence)

    def linear_problem(self, sequence: Sequence, p: Reals) -> tuple[Problem, Any]:
        """`problem`, and the derivative of the machine and its flow by the parameter, or by the first of two."""
        machine_at = lambda p: prepared(numbers_of(self.system_at(p)), self.flow, self.num_periods)  # noqa: E731
        along = (jnp.arange(jnp.size(p)) == 0).astype(jnp.result_type(p)).reshape(jnp.shape(p))
        (machine, flow), change = eqx.filter_jvp(machine_at, (p,), (along,))
        return self._asked(machine, flow, sequence), change

    def _asked(self, machine: Machine, flow: AbstractFlow, sequence: Sequence) -> Problem:
        """Equations of a cycle of one of the machines."""
        num_periods, phase, shifts = map(jnp.asarray, (self.num_periods, self.phase, self.shifts))
        drift = None if self.drift is None else jnp.asarray(self.drift)
        return Problem(machine, flow, sequence, num_periods, phase, shifts, drift, self.is_autonomous)

    def unknowns(self, place: ExtendedCycle) -> Unknowns:
        """Unknowns of a cycle, `z` without its scale."""
        return Unknowns(place.z * self.scale, place.flights)
