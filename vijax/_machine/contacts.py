"""Contacts as the engine sees them: rows that limit the motion.

A contact keeps its gap, `s - a . x`, from falling below zero: a is a row over the masses, s its limit. A stop of
mass i has the row e_i (an upper one) or -e_i (a lower one). All consequences of rows stand here and in
`_contact/law.py`, and nowhere else: gaps, speeds of approach, the masses a contact bears on,
the effect of holding on a motion. The rest of the engine knows contacts by their number alone.

Rows are numbers, so a stop of another mass, or on another side, compiles nothing for one trajectory. In
sweeps, where every operation counts, rows are NumPy arrays, known while the loop is traced, and nothing is
multiplied by their zeros.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._types import Reals, matvec, stack


class Contacts(eqx.Module):
    """All contacts of a machine, lanes last.

    Attributes:
        rows: A, (contacts, n), each with one entry, 1 or -1.
        limit: s, (contacts,).
        restitution: r, (contacts,).
        inverse_mass: the diagonal of M^-1, (n,).
        bears: whether a contact bears on a mass, (contacts, n).
        signs: the entry of each row, (contacts,).
    """

    rows: Reals
    limit: Float[Array, "contacts ..."]
    restitution: Float[Array, "contacts ..."]
    inverse_mass: Float[Array, "n ..."]
    bears: Reals
    signs: Reals

    def __init__(self, rows: Reals, limit: Array, restitution: Array, inverse_mass: Array):
        self.rows, self.limit, self.restitution, self.inverse_mass = rows, limit, restitution, inverse_mass
        self.bears, self.signs = rows != 0, rows.sum(axis=1)

    @property
    def num(self) -> int:
        """How many there are."""
        return len(self.rows)

    @property
    def masses(self) -> tuple[int, ...]:
        """The mass of each, where it is known: without lanes, or for a batch of `jax.vmap`."""
        rows = np.asarray(self.rows)
        while rows.ndim > 2:
            rows = rows[0]
        return tuple(int(np.flatnonzero(row)[0]) for row in rows)

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
        return _applied(self.rows, of_masses)

    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """|A| . y: bounds of quantities of the masses, carried to each contact."""
        return _applied(abs(self.rows), of_masses)

    def told(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Change between quantities counted towards each contact and signed quantities of its mass."""
        return self.signs * towards

    def gaps(self, x: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """S - a . x, positive while free."""
        return self.limit - self.along(x)

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

    def placed(self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."]) -> Float[Array, "n ..."]:
        """Positions with the gaps of the flagged contacts exactly zero."""
        for j in range(self.num):
            x = jnp.where(flags[j] & self.bears[j], self.rows[j] * self.limit[j], x)
        return x

    def reflected(
        self, v: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."]
    ) -> Float[Array, "n ..."]:
        """Velocities with the approach to the flagged contacts turned round and multiplied by r."""
        for j in range(self.num):
            v = jnp.where(flags[j] & self.bears[j], -self.restitution[j] * v, v)
        return v

    def held_still(
        self, of_masses: Float[Array, "n ..."], held: Bool[Array, "contacts ..."]
    ) -> Float[Array, "n ..."]:
        """Velocities or accelerations as the flagged contacts allow them, which hold their masses."""
        return jnp.where(self.masses_of(held), 0, of_masses)


def _applied(rows: Reals, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
    """The product; with known rows it is a choice of entries and signs."""
    if not len(rows):
        return of_masses[:0]
    if not isinstance(rows, np.ndarray):
        return matvec(rows, of_masses)
    entries = rows.reshape(*rows.shape[:2])  # no lanes, or a single one
    masses, signs = np.abs(entries).argmax(axis=1), entries.sum(axis=1)
    return stack([of_masses[i] if sign > 0 else -of_masses[i] for i, sign in zip(masses, signs, strict=True)])
