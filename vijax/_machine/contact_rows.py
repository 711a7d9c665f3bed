"""Rows of contacts: gaps, speeds of approach, accelerations along the rows, and the effects of forces and impulses along them.

A contact keeps its gap `s - a . x` from falling below zero: a is a row over the masses, s its limit, A all rows. `contacts.py`
tells what contacts do that hold or are hit. Rows are numbers, so another row compiles nothing for one trajectory.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Reals, Scalar, matrix_product, matvec
from .._system.restitution import Restitution, coefficient, light_coefficient
from .._system.waves import Waves
from .kinds import RIGID
from .small_matrices import diagonal


class ContactRows(eqx.Module):
    """Rows of all contacts of a machine, lanes last.

    A `phase` is that of the load, (2, harmonics). Functions that are linear in it, such as motions of contacts, take
    its derivative, Taylor coefficient or change to give their own derivative, coefficient or change.

    Attributes:
        is_coupled: True if contacts may share inertia.
        is_switching: True with friction or compliant contacts, see `SwitchingContacts`.
        rows: A, (contacts, n).
        limit: mean of s, (contacts,).
        restitution: law of impacts, r(speed of approach), (contacts,).
        inverse_mass: M^-1, (n, n), or its diagonal, (n,).
        signs: entry of the row of a stop, 0 for any other contact, (contacts,).
        walls: motions of the contacts, s without its mean; None if all stand still.
        frequency: W.
        compliance: G = A M^-1 A^T, (contacts, contacts).
    """

    is_coupled: ClassVar[bool] = True
    is_switching: ClassVar[bool] = False

    rows: Reals
    limit: Float[Array, "contacts ..."]
    restitution: Restitution
    inverse_mass: Float[Array, "..."]
    signs: Reals
    walls: Waves | None
    frequency: Scalar
    compliance: Float[Array, "contacts contacts ..."]

    @property
    def num(self) -> int:
        """Number of contacts."""
        return len(self.rows)

    @property
    def kinds(self) -> tuple[int, ...]:
        """Kind of every element: all are rigid."""
        return (RIGID,) * self.num

    @property
    def num_stops(self) -> int:
        """Number of contacts that limit positions: all but friction."""
        return self.num

    @property
    def masses(self) -> tuple[int, ...]:
        """Mass of each stop, -1 for any other contact. Rows must be concrete."""
        rows, signs = np.asarray(self.rows), np.asarray(self.signs)
        while rows.ndim > 2:
            rows, signs = rows[0], signs[0]
        return tuple(
            int(np.flatnonzero(row)[0]) if sign else -1 for row, sign in zip(rows, signs, strict=True)
        )

    @property
    def position(self) -> Float[Array, "contacts ..."]:
        """Mean position of each contact, as given by the user, without its motion."""
        return self.signed(self.limit)

    @property
    def effective_mass(self) -> Float[Array, "contacts ..."]:
        """Effective mass along the row, 1 / (a M^-1 a)."""
        return 1 / diagonal(self.compliance)

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements, which come last."""
        return 0

    def rounded(self, t: Scalar | float) -> tuple[Array, Array]:
        """Magnitudes of the terms of positions and velocities of the contacts; they set the rounding errors."""
        if self.walls is None:
            return jnp.abs(self.limit), jnp.zeros_like(self.limit)
        angle = self.frequency * t
        speed = self.frequency * self.walls.rounded(angle, order=1)
        return jnp.abs(self.limit) + self.walls.rounded(angle), speed

    def noise(self, v: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Rounding errors of the speeds of approach."""
        size = self.size(jnp.abs(v))
        size = size if self.walls is None else size + self.frequency * self.walls.bound(1)
        kind = jnp.finfo(size.dtype)
        # The floor stops speeds that fall by a factor at every impact before their squares underflow.
        return 16 * kind.eps * size + kind.tiny**0.5 / kind.eps

    def signed_impulse(self, along: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Impulse on the mass of a stop; for any other contact the impulse that opens its gap."""
        return jnp.where(self.signs == 0, 1, -self.signs) * along

    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """A . y: a velocity or a force, positive towards each contact."""
        return matvec(self.rows, of_masses)

    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """|A| . y: bounds at the contacts, from bounds for the masses."""
        return matvec(abs(self.rows), of_masses)

    def signed(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Convert quantities counted towards each contact to signed ones of public results, and back."""
        return jnp.where(self.signs == 0, 1, self.signs) * towards

    def towards(self, of_masses: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """Positions, or their derivatives, relative to those of the contacts, (contacts, ...)."""
        along = self.along(of_masses)
        return along if self.walls is None else along - self.walls.at(phase)

    def own_velocity(self, phase_rate: Float[Array, "2 harmonics ..."]) -> Array | None:
        """Velocities of stops, signed as in public results; 0 for contacts between masses, None if all stand still."""
        return None if self.walls is None else self.signs * self.walls.at(phase_rate)

    def restitution_at(self, speed: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Restitution coefficients at some speeds of approach."""
        return coefficient(self.restitution, speed)

    @property
    def light_restitution(self) -> Float[Array, "contacts ..."]:
        """Restitution coefficients of light impacts."""
        return light_coefficient(self.restitution)

    @property
    def is_plastic(self) -> Bool[Array, "contacts ..."]:
        """Flags of contacts with r = 0 for light impacts."""
        return self.light_restitution == 0

    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """Gaps s - a . x, positive while open, (contacts, ...)."""
        return self.limit - self.towards(x, phase)

    @property
    def is_rigid(self) -> Bool[Array, "contacts ..."] | bool:
        """Flags of rigid contacts, or True if all are."""
        return True

    @property
    def has_gap(self) -> Bool[Array, "contacts ..."] | bool:
        """Flags of elements with a gap, or True if all have one."""
        return True

    def speeds(self, v: Float[Array, "n ..."], phase_rate: Array) -> Float[Array, "contacts ..."]:
        """Speeds of approach."""
        return self.towards(v, phase_rate)

    def gap_moved(self, gap: Array, closed: Array, displacement: Array) -> Array:
        """Gaps after a displacement at one instant; those of closed contacts are zero."""
        return jnp.where(closed, 0, gap - self.along(displacement))

    def gap_after(self, gap: Array, held: Array | bool, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement and a change of phase, rounded relative to that change; held gaps stay closed."""
        return jnp.where(held, gap, gap - self.towards(displacement, change))

    def rest(self, x_rest: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Bound of the fourth derivative of the gaps over 24, from that of the positions."""
        rest = self.size(x_rest)
        return rest if self.walls is None else rest + self.frequency**4 / 24 * self.walls.bound(4)

    def gap_placed(
        self, gap: Array, closed: Array, held: Array, displacement: Array, x: Array, phase: Array
    ) -> Array:
        """Gaps after the displacement to `x` that closes some gaps at an event of a cycle, behind which others are held."""
        del held, x, phase
        return self.gap_moved(gap, closed, displacement)

    def free_pull(
        self, force: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact with no contact held."""
        return self.accelerated_towards(self.inverse_mass_times(force), phase)

    def accelerated_towards(self, acceleration: Array, phase: Array) -> Float[Array, "contacts ..."]:
        """Accelerations along the rows, relative to those of the contacts."""
        along = self.along(acceleration)
        return along if self.walls is None else along - self._accelerated().at(phase)

    def impulses(self, loss: Float[Array, "n ..."]) -> Float[Array, "contacts ..."] | None:
        """Impulse of each contact from the loss of velocities, as if it alone had been hit."""
        return self.along(loss) * self.effective_mass

    def inverse_mass_times(self, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """M^-1 . y: accelerations from forces with no contact held, or velocities from impulses."""
        return matvec(self.inverse_mass, force) if self._has_full_mass else self.inverse_mass * force

    def inverse_mass_size(self, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """|M^-1| . y: bounds of accelerations, from those of forces."""
        return matvec(jnp.abs(self.inverse_mass), force) if self._has_full_mass else self.inverse_mass * force

    def acceleration_bound(self, order: int = 0) -> Array | float:
        """Bound of the accelerations of the contacts, or of a derivative of them."""
        return 0.0 if self.walls is None else self.frequency ** (order + 2) * self.walls.bound(order + 2)

    def back(self, of_contacts: Float[Array, "contacts ..."]) -> Float[Array, "n ..."]:
        """A^T . y: forces or impulses on the masses from those of the contacts."""
        return matvec(jnp.swapaxes(self.rows, 0, 1), of_contacts)

    def unit_changes(self) -> Float[Array, "contacts n ..."]:
        """Velocities along M^-1 A^T for which the speed of approach to one contact is 1 if it shares no inertia with others."""
        return self._weighted() * self.effective_mass[:, None]

    def _weighted(self) -> Float[Array, "contacts n ..."]:
        """A M^-1."""
        if not self._has_full_mass:
            return self.rows * self.inverse_mass[None]
        return matrix_product(self.rows, self.inverse_mass)

    def _inverse(self) -> Array:
        """M^-1."""
        if self._has_full_mass:
            return self.inverse_mass
        unit = np.eye(len(self.inverse_mass), dtype=self.inverse_mass.dtype)
        return jnp.asarray(
            unit.reshape(*unit.shape, *[1] * (self.inverse_mass.ndim - 1)) * self.inverse_mass[None]
        )

    @property
    def _has_full_mass(self) -> bool:
        return self.inverse_mass.ndim == self.rows.ndim

    def _accelerated(self) -> Waves:
        """Accelerations of the contacts."""
        assert self.walls is not None
        order = np.arange(1, self.walls.num_harmonics + 1).reshape(-1, *[1] * (self.walls.cosine.ndim - 1))
        rate = -((order * self.frequency) ** 2)
        return Waves(rate * self.walls.cosine, rate * self.walls.sine)
