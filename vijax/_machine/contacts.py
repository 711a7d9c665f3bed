"""Contacts as the engine sees them: rows that limit the motion.

A contact keeps its gap, `s - a . x`, from falling below zero: a is a row over the masses, s its limit. A stop of
mass i has the row e_i (an upper one) or -e_i (a lower one). What follows from rows stands here and in
`_contact/law.py`, and nowhere else: gaps, speeds of approach, which masses a contact bears on,
what holding does to a motion. The rest of the engine knows contacts by their number alone.

Rows of single masses are kept as static numbers, so that all of this is made of a few elementwise
operations over lanes, and no mass is multiplied by zeros.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._types import lift, stack


class Contacts(eqx.Module):
    """All contacts of a machine, lanes last.

    Attributes:
        limit: s, (contacts,).
        restitution: r, (contacts,).
        inverse_mass: the diagonal of M^-1, (n,).
        masses: the mass that each contact bears on.
        signs: the entry of its row there, 1 or -1.
    """

    limit: Float[Array, "contacts ..."]
    restitution: Float[Array, "contacts ..."]
    inverse_mass: Float[Array, "n ..."]
    masses: tuple[int, ...] = eqx.field(static=True)
    signs: tuple[int, ...] = eqx.field(static=True)

    @property
    def num(self) -> int:
        """How many there are."""
        return len(self.masses)

    @property
    def position(self) -> Float[Array, "contacts ..."]:
        """Where a stop stands, as it was given."""
        return self.told(self.limit)

    @property
    def effective_mass(self) -> Float[Array, "contacts ..."]:
        """The mass that is met along the row, 1 / (a M^-1 a)."""
        return 1 / self.size(self.inverse_mass)

    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """A . y: a velocity or a force, counted towards each contact."""
        return self.told(self.size(of_masses))

    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """|A| . y: bounds of quantities of the masses, carried to each contact."""
        return stack([of_masses[i] for i in self.masses]) if self.num else of_masses[:0]

    def told(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Change between quantities counted towards each contact and signed quantities of its mass."""
        return lift(jnp.asarray(self.signs, self.limit.dtype), towards) * towards

    def gaps(self, x: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """S - a . x, positive while free."""
        return self.limit - self.along(x)

    def masses_of(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "n ..."]:
        """The masses that any of the flagged contacts bears on."""
        rows = [jnp.zeros(flags.shape[1:], bool)] * self.inverse_mass.shape[0]
        for j, i in enumerate(self.masses):
            rows[i] = rows[i] | flags[j]
        return jnp.stack(rows)

    def sharing(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """Contacts whose gap changes when the masses of a flagged contact move."""
        masses = self.masses_of(flags)
        return stack([masses[i] for i in self.masses]) if self.num else flags

    def placed(self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."]) -> Float[Array, "n ..."]:
        """Positions with the gaps of the flagged contacts exactly zero."""
        rows, position = list(x), self.position
        for j, i in enumerate(self.masses):
            rows[i] = jnp.where(flags[j], position[j], rows[i])
        return stack(rows)

    def reflected(
        self, v: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."]
    ) -> Float[Array, "n ..."]:
        """Velocities with the approach to the flagged contacts turned round and multiplied by r."""
        rows = list(v)
        for j, i in enumerate(self.masses):
            rows[i] = jnp.where(flags[j], -self.restitution[j] * rows[i], rows[i])
        return stack(rows)

    def held_still(
        self, of_masses: Float[Array, "n ..."], held: Bool[Array, "contacts ..."]
    ) -> Float[Array, "n ..."]:
        """Velocities or accelerations as the flagged contacts allow them, which hold their masses."""
        return jnp.where(self.masses_of(held), 0, of_masses)
