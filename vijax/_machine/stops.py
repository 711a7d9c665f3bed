"""Stops, each of one mass with an inertia of its own, which stand still in the frame of the machine: contacts at less cost.

Their rows are e_i or -e_i. So holding one means that its mass rests, and nothing needs a matrix. In sweeps, where every
operation counts, rows are NumPy arrays, known while the loop is traced, and nothing is multiplied by their zeros.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Reals, matvec, stack
from .._system.restitution import Restitution
from .contacts import Contacts, Held


class Stops(Contacts):
    """Stops, each of one mass; nothing moves them, and no mass is shared by two but for one on each side.

    Attributes:
        bears: whether a contact acts on a mass, (contacts, n).
    """

    is_coupled: ClassVar[bool] = False
    # Stops that stand still and share no inertia need none of these.
    walls: ClassVar[None] = None
    frequency: ClassVar[None] = None
    compliance: ClassVar[None] = None

    bears: Reals

    def __init__(self, rows: Reals, limit: Array, restitution: Restitution, inverse_mass: Array):
        self.rows, self.limit, self.restitution, self.inverse_mass = rows, limit, restitution, inverse_mass
        self.bears, self.signs = rows != 0, rows.sum(axis=1)

    @property
    def effective_mass(self) -> Float[Array, "contacts ..."]:
        """The mass that is met along the row, 1 / (a M^-1 a)."""
        return 1 / self.size(self.inverse_mass)

    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """A . y: a velocity or a force, counted towards each contact."""
        return _applied(self.rows, of_masses)

    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """|A| . y: bounds of quantities of the masses, carried to each contact."""
        return _applied(abs(self.rows), of_masses)

    def told(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Change between quantities counted towards each contact and signed quantities of its mass."""
        return self.signs * towards

    def gap_after(self, gap: Array, held: Array, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement of the masses."""
        del held, change
        return gap - self.along(displacement)

    def masses_of(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "n ..."]:
        """The masses that any of the flagged contacts bears on."""
        found = jnp.zeros((self.bears.shape[1], *flags.shape[1:]), bool)
        for j in range(self.num):
            found = found | (flags[j] & self.bears[j])
        return found

    def sharing(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """Contacts whose gap changes when the masses of a flagged contact move."""
        masses = self.masses_of(flags)
        return jnp.any(self.bears & masses[None], axis=1) if self.num else flags

    def hold(self, held: Bool[Array, "contacts ..."]) -> Held:
        """The masses that rest."""
        return self.masses_of(held)

    def accelerations(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "n ..."]:
        """Accelerations by a force; none of masses that are held."""
        del phase
        return jnp.where(hold, 0, self.inverse_mass) * force

    def pressing(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """The force on the mass of each."""
        del hold, phase
        return self.along(force)

    def pull(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration of each mass towards its stop, as if it were not held."""
        del hold, phase
        return self.along(self.inverse_mass * force)

    def pressing_rest(self, force_rest: Float[Array, "n ..."], hold: Held) -> Float[Array, "contacts ..."]:
        """Bound a third derivative by 6 of the contact forces by that of the force."""
        del hold
        return self.size(force_rest)

    def placed(
        self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase: Array
    ) -> Float[Array, "n ..."]:
        """Positions with the gaps of the flagged contacts exactly zero."""
        del phase
        for j in range(self.num):
            x = jnp.where(flags[j] & self.bears[j], self.rows[j] * self.limit[j], x)
        return x

    def reflected(
        self,
        v: Float[Array, "n ..."],
        hit: Bool[Array, "contacts ..."],
        kept: Bool[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities with the approach to the flagged contacts turned round and multiplied by r."""
        del kept, phase_rate
        restitution = self.restitution_at(self.along(v))
        for j in range(self.num):
            v = jnp.where(hit[j] & self.bears[j], -restitution[j] * v, v)
        return v

    def brought(
        self,
        v: Float[Array, "n ..."],
        flags: Bool[Array, "contacts ..."],
        approach: Float[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities with those of the masses of the flagged contacts replaced."""
        del phase_rate
        for j in range(self.num):
            v = jnp.where(flags[j] & self.bears[j], self.rows[j] * approach[j], v)
        return v

    def gained(self, gain: Float[Array, "n ..."], hold: Held) -> Float[Array, "n ..."]:
        """None of masses that are held."""
        return jnp.where(hold, 0, gain)

    def free_accelerations(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "n ..."], None]:
        """Accelerations as if no mass were held; those of held masses are their pulls."""
        del hold, phase
        return self.freed(force), None

    def pushed(self, gain: Float[Array, "n ..."], pushes: Float[Array, "contacts ..."] | None) -> Array:
        """The gain of velocity of the mass, if it were let go."""
        del pushes
        return self.along(gain)

    def impulses(self, loss: Float[Array, "n ..."]) -> None:
        """None: they follow from the velocities."""
        del loss

    def freed(self, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """M^-1 . y: accelerations by forces, if no mass were held."""
        return self.inverse_mass * force

    def held_still(
        self, v: Float[Array, "n ..."], held: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities with the masses at rest that the flagged contacts hold."""
        del phase_rate
        return jnp.where(self.masses_of(held), 0, v)


def _applied(rows: Reals, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
    """The product; with known rows it is a choice of entries and signs."""
    if not len(rows):
        return of_masses[:0]
    if not isinstance(rows, np.ndarray):
        return matvec(rows, of_masses)
    entries = rows.reshape(*rows.shape[:2])  # no lanes, or a single one
    masses, signs = np.abs(entries).argmax(axis=1), entries.sum(axis=1)
    return stack([of_masses[i] if sign > 0 else -of_masses[i] for i, sign in zip(masses, signs, strict=True)])
