"""Stops of single masses, at rest in the frame of the machine: contacts at less cost.

Their rows are e_i or -e_i, so that holding one means that its mass rests, and no matrix is needed. In sweeps, where
every operation counts, rows are NumPy arrays, concrete while the loop is traced, and no zero of theirs is multiplied.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import UNROLLED, Reals, append_axes, array_namespace, matvec, stack
from .._system.restitution import Restitution
from .contacts import Contacts, Held


class Stops(Contacts):
    """Stops, each of one mass and at rest. A mass has at most one stop on each side.

    Attributes:
        acts_on: flags of the masses that each contact acts on, (contacts, n).
        places: where the stops are among the masses; None if they are few, which loops over them serve.
    """

    is_coupled: ClassVar[bool] = False
    # Not needed by stops that stand still and share no inertia.
    walls: ClassVar[None] = None
    frequency: ClassVar[None] = None
    compliance: ClassVar[None] = None

    acts_on: Reals
    places: "Places | None"

    def __init__(self, rows: Reals, limit: Array, restitution: Restitution, inverse_mass: Array):
        self.rows, self.limit, self.restitution, self.inverse_mass = rows, limit, restitution, inverse_mass
        self.acts_on, self.signs = rows != 0, rows.sum(axis=1)
        self.places = places_of(rows)

    @property
    def effective_mass(self) -> Float[Array, "contacts ..."]:
        """From |A| M^-1, without G."""
        return 1 / self.size(self.inverse_mass)

    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Without a product where rows are concrete or many, see `_applied`."""
        if self.places is not None:
            return self.places.along(of_masses)
        return _applied(self.rows, of_masses)

    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Without a product where rows are concrete or many."""
        if self.places is not None:
            return self.places.sizes(of_masses)
        return _applied(abs(self.rows), of_masses)

    def signed(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Without a case for contacts between masses."""
        return self.signs * towards

    def gap_after(self, gap: Array, held: Array | bool, displacement: Array, change: Array) -> Array:
        """Without a case for held gaps: their masses do not move; nor for the phase: stops stand still."""
        del held, change
        return gap - self.along(displacement)

    def masses_of(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "n ..."]:
        """Flags of the masses on which a flagged contact acts, (n, ...)."""
        found = jnp.zeros((self.acts_on.shape[1], *flags.shape[1:]), bool)
        if self.places is not None:
            return self.places.assigned(found, flags, flags)
        for j in range(self.num):
            found = found | (flags[j] & self.acts_on[j])
        return found

    def sharing_mass(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """Flags of contacts with a mass of a flagged contact: their gaps are recomputed."""
        masses = self.masses_of(flags)
        return jnp.any(self.acts_on & masses[None], axis=1) if self.num else flags

    def gap_placed(
        self, gap: Array, closed: Array, held: Array, displacement: Array, x: Array, phase: Array
    ) -> Array:
        """Gaps of the stops that share a mass with a closed one are recomputed: counted on, they would keep the displacement."""
        del held
        counted_on = gap - self.along(displacement)
        return jnp.where(closed, 0, jnp.where(self.sharing_mass(closed), self.gaps(x, phase), counted_on))

    def hold(self, held: Bool[Array, "contacts ..."]) -> Held:
        """Flags of the masses at rest, (n, ...)."""
        return self.masses_of(held)

    def accelerations(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "n ..."]:
        """Zero for held masses."""
        del phase
        return jnp.where(hold, 0, self.inverse_mass) * force

    def contact_force(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Force on the mass of each stop, held or not."""
        del hold, phase
        return self.along(force)

    def pull(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """From the force on the mass alone."""
        del hold, phase
        return self.along(self.inverse_mass * force)

    def contact_force_remainder(
        self, force_rest: Float[Array, "n ..."], hold: Held
    ) -> Float[Array, "contacts ..."]:
        """From the force on the mass alone."""
        del hold
        return self.size(force_rest)

    def with_closed_gaps(
        self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase: Array
    ) -> Float[Array, "n ..."]:
        """Gaps exactly zero: the position is assigned."""
        del phase
        if self.places is not None:
            return self.places.assigned(x, flags, self.signed(self.limit))
        for j in range(self.num):
            x = jnp.where(flags[j] & self.acts_on[j], self.rows[j] * self.limit[j], x)
        return x

    def reflected(
        self,
        v: Float[Array, "n ..."],
        hit: Bool[Array, "contacts ..."],
        kept: Bool[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocity of each hit mass multiplied by -r; other masses do not change."""
        del kept, phase_rate
        restitution = self.restitution_at(self.along(v))
        if self.places is not None:
            return self.places.assigned(v, hit, -restitution * self.size(v))
        for j in range(self.num):
            v = jnp.where(hit[j] & self.acts_on[j], -restitution[j] * v, v)
        return v

    def with_approach(
        self,
        v: Float[Array, "n ..."],
        flags: Bool[Array, "contacts ..."],
        approach: Float[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities of the masses of flagged contacts assigned; other masses do not change."""
        del phase_rate
        if self.places is not None:
            return self.places.assigned(v, flags, self.signed(approach))
        for j in range(self.num):
            v = jnp.where(flags[j] & self.acts_on[j], self.rows[j] * approach[j], v)
        return v

    def gain_with_hold(self, gain: Float[Array, "n ..."], hold: Held) -> Float[Array, "n ..."]:
        """Zero for held masses."""
        return jnp.where(hold, 0, gain)

    def free_accelerations(
        self, force: Float[Array, "n ..."], hold: Held, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "n ..."], None]:
        """Accelerations with no mass held; those of held masses are their pulls."""
        del hold, phase
        return self.inverse_mass_times(force), None

    def integrated_pull(
        self, gain: Float[Array, "n ..."], pushes: Float[Array, "contacts ..."] | None
    ) -> Array:
        """Gain of velocity of the mass, as if it were released."""
        del pushes
        return self.along(gain)

    def impulses(self, loss: Float[Array, "n ..."]) -> None:
        """None: impulses follow from the velocities."""
        del loss

    def inverse_mass_times(self, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """From the diagonal of M^-1."""
        return self.inverse_mass * force

    def with_zero_approach(
        self, v: Float[Array, "n ..."], held: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Zero for the masses of flagged contacts."""
        del phase_rate
        return jnp.where(self.masses_of(held), 0, v)


class Places(eqx.Module):
    """Places of many stops among the masses; arrays have a last axis of length one where others have lanes.

    Attributes:
        mass: mass of each stop, (contacts,).
        signs: entry of its row, (contacts,).
        stops: first and last stop of each mass, (2, n): a mass has one on each side at most.
        exists: flags of masses that have them, (n,).
    """

    mass: Reals
    signs: Reals
    stops: Reals
    exists: Reals

    def sizes(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Entries of the masses of the stops."""
        return of_masses[self.mass.reshape(len(self.mass))]

    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """The same along the directions of the stops."""
        return append_axes(self.signs, of_masses) * self.sizes(of_masses)

    def assigned(self, of_masses: Array, flags: Bool[Array, "contacts ..."], values: Array) -> Array:
        """Values of the flagged stops in the entries of their masses; the others do not change."""
        values = jnp.broadcast_to(append_axes(values, flags), flags.shape)
        for stop in self.stops.reshape(2, -1):
            is_flagged = flags[stop] & append_axes(self.exists, flags)
            of_masses = jnp.where(is_flagged, values[stop], of_masses)
        return of_masses


def places_of(rows: Reals) -> Places | None:
    """Places of stops that are many, if all lanes have the same."""
    if len(rows) <= UNROLLED or (rows.ndim > 2 and rows.shape[-1] > 1):
        return None
    is_there = rows != 0
    first, last = is_there.argmax(axis=0), len(rows) - 1 - is_there[::-1].argmax(axis=0)
    stops = array_namespace(rows).stack([first, last])
    return Places(is_there.argmax(axis=1), rows.sum(axis=1), stops, is_there.any(axis=0))


def _applied(rows: Reals, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
    """Product of rows and masses; with concrete rows, a choice of entries and signs."""
    if not len(rows):
        return of_masses[:0]
    if not isinstance(rows, np.ndarray):
        return matvec(rows, of_masses)
    entries = rows.reshape(*rows.shape[:2])  # no lanes, or a single one
    masses, signs = np.abs(entries).argmax(axis=1), entries.sum(axis=1)
    return stack([of_masses[i] if sign > 0 else -of_masses[i] for i, sign in zip(masses, signs, strict=True)])
