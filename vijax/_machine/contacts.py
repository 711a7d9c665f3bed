"""Contacts as the engine sees them: rows that limit the motion.

A contact keeps its gap, `s - a . x`, from falling below zero: a is a row over the masses, s its limit. All
consequences of rows stand here, in `rows.py` and in `_hybrid/`, and nowhere else: gaps, speeds of approach,
the masses a contact bears on, the effect of holding on a motion. The rest of the engine knows contacts by their
number alone.

There are two kinds. `Stops` have the row e_i or -e_i of a mass i with an inertia of its own, and stand still as
they are seen from the frame of the machine. So holding one means that its mass rests, and nothing needs a matrix.
`Rows` are any rows, which may share inertia and move each for itself.

Rows are numbers, so a stop of another mass, or on another side, compiles nothing for one trajectory. In
sweeps, where every operation counts, rows of stops are NumPy arrays, known while the loop is traced, and nothing is
multiplied by their zeros.
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Reals, matvec, stack

# Which contacts hold, and what that does to the motion: the flags of the masses that rest, (n, ...), for `Stops`; for
# `Rows` a `Hold`.
Held = Any


class AbstractContacts(eqx.Module):
    """All contacts of a machine, lanes last.

    A `phase` is that of the load, (2, harmonics). Quantities that are linear in it, as the motions of contacts are, take
    its derivative, Taylor coefficient or change where derivatives, coefficients or changes of theirs are asked for.

    Attributes:
        is_coupled: whether contacts may share inertia.
        rows: A, (contacts, n).
        limit: s in the mean, (contacts,).
        restitution: r, (contacts,).
        inverse_mass: M^-1, (n, n), or its diagonal, (n,).
    """

    is_coupled: eqx.AbstractClassVar[bool]
    rows: eqx.AbstractVar[Reals]
    limit: eqx.AbstractVar[Float[Array, "contacts ..."]]
    restitution: eqx.AbstractVar[Float[Array, "contacts ..."]]
    inverse_mass: eqx.AbstractVar[Float[Array, "..."]]

    @property
    def num(self) -> int:
        """How many there are."""
        return len(self.rows)

    @property
    @abc.abstractmethod
    def position(self) -> Float[Array, "contacts ..."]:
        """Where each stands, as it was given, its motion left out."""

    @property
    @abc.abstractmethod
    def masses(self) -> tuple[int, ...]:
        """The mass of each stop, -1 of any other contact, where it is known."""

    @property
    @abc.abstractmethod
    def effective_mass(self) -> Float[Array, "contacts ..."]:
        """The mass that is met along the row, 1 / (a M^-1 a)."""

    @abc.abstractmethod
    def impulses(self, loss: Float[Array, "n ..."]) -> Float[Array, "contacts ..."] | None:
        """Impulses of single impacts by the loss of velocities; None where logged velocities tell them."""

    def told_impulse(self, along: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Impulses along rows as users know them."""
        return along

    @abc.abstractmethod
    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """A . y: a velocity or a force, counted towards each contact."""

    @abc.abstractmethod
    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """|A| . y: bounds of quantities of the masses, carried to each contact."""

    @abc.abstractmethod
    def told(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Change between quantities counted towards each contact and signed ones, as users know them."""

    @abc.abstractmethod
    def towards(self, of_masses: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """Positions, or any derivative of them, relative to those of the contacts, (contacts, ...)."""

    @abc.abstractmethod
    def own_velocity(self, phase_rate: Float[Array, "2 harmonics ..."]) -> Array | None:
        """Velocities of stops, with the signs users know; 0 for contacts between masses, None if all stand still."""

    @abc.abstractmethod
    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """S - a . x, positive while free, (contacts, ...)."""

    @abc.abstractmethod
    def gap_after(self, gap: Array, held: Array, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement of the masses, in which the phase changed, exact relative to the change."""

    @abc.abstractmethod
    def rest(self, x_rest: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Bound a fourth derivative by 24 of the gaps by that of the positions."""

    @abc.abstractmethod
    def sharing(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """Contacts whose gap changes when a flagged contact is hit."""

    @abc.abstractmethod
    def hold(self, held: Bool[Array, "contacts ..."]) -> Held:
        """What it means for the motion that the flagged contacts hold."""

    @abc.abstractmethod
    def accelerations(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "n ..."]:
        """Accelerations by a force, or jerks by its rate, or coefficients by coefficients."""

    @abc.abstractmethod
    def pressing(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """The contact forces where contacts hold, by the force without them."""

    @abc.abstractmethod
    def pull(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact, as if it alone did not hold."""

    @abc.abstractmethod
    def pressing_rest(self, force_rest: Float[Array, "n ..."], hold: Held) -> Float[Array, "contacts ..."]:
        """Bound a third derivative by 6 of the contact forces by that of the force."""

    @abc.abstractmethod
    def placed(
        self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase: Array
    ) -> Float[Array, "n ..."]:
        """Positions with the gaps of the flagged contacts zero."""

    @abc.abstractmethod
    def reflected(
        self,
        v: Float[Array, "n ..."],
        hit: Bool[Array, "contacts ..."],
        kept: Bool[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities after impacts with one set of contacts, while another keeps closed."""

    @abc.abstractmethod
    def brought(
        self,
        v: Float[Array, "n ..."],
        flags: Bool[Array, "contacts ..."],
        approach: Float[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities changed by impulses of the flagged contacts, until these are approached at given speeds."""

    @abc.abstractmethod
    def gained(self, gain: Float[Array, "n ..."], hold: Held) -> Float[Array, "n ..."]:
        """The gain of velocities that `free_accelerations` make."""

    @abc.abstractmethod
    def free_accelerations(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "n ..."], Float[Array, "contacts ..."] | None]:
        """What a solver integrates beside velocities, from which `pushed` is known: accelerations and pulls."""

    @abc.abstractmethod
    def pushed(self, gain: Float[Array, "n ..."], pushes: Float[Array, "contacts ..."] | None) -> Array:
        """The integral of `pull` where contacts hold, (contacts, ...), by the integrals of `free_accelerations`."""

    @abc.abstractmethod
    def freed(self, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """M^-1 . y: accelerations by forces, if no contact held."""

    @abc.abstractmethod
    def held_still(
        self, v: Float[Array, "n ..."], held: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities as the flagged contacts allow them."""


class Stops(AbstractContacts):
    """Stops, each of one mass, in whose frame they stand still.

    Attributes:
        rows: A, (contacts, n), each with one entry, 1 or -1.
        limit: s, (contacts,).
        restitution: r, (contacts,).
        inverse_mass: the diagonal of M^-1, (n,).
        bears: whether a contact bears on a mass, (contacts, n).
        signs: the entry of each row, (contacts,).
    """

    is_coupled: ClassVar[bool] = False

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

    def towards(self, of_masses: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """As `along`: the stops stand still."""
        del phase
        return self.along(of_masses)

    def own_velocity(self, phase_rate: Float[Array, "2 harmonics ..."]) -> None:
        """None: they stand still."""
        del phase_rate

    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """S - a . x, positive while free."""
        del phase
        return self.limit - self.along(x)

    def gap_after(self, gap: Array, held: Array, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement of the masses."""
        del held, change
        return gap - self.along(displacement)

    def rest(self, x_rest: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Bound a fourth derivative by 24 of the gaps by that of the positions."""
        return self.size(x_rest)

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
        for j in range(self.num):
            v = jnp.where(hit[j] & self.bears[j], -self.restitution[j] * v, v)
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
