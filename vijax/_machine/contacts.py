"""Contacts in the engine: forces that keep rows closed, and impulses; contacts may share inertia and may move independently.

Only `contact_rows.py`, this file, `stops.py`, `switching.py` and `_hybrid/` compute with rows. The rest of the engine uses contacts by
index only.

With G = A M^-1 A^T, the contact forces of held contacts H keep their gaps closed,

    lambda = G_H^-1 (A_H M^-1 f - s_H''),    x'' = M^-1 (f - A_H^T lambda),

where f is the sum of all other forces. Both are linear in f and in the phase of the load, which moves the contacts. So
the same two lines give forces and accelerations, their rates, and coefficients of their series.

A row that depends on earlier ones, such as a duplicate, gets no force: the earlier ones carry it.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Reals, matrix_product, matvec, with_derivative_of
from .._jax.concrete import stop_gradients
from .._jax.xla import is_any
from .._system.restitution import Restitution
from .._system.waves import Waves, phase_rate
from .contact_rows import ContactRows
from .small_matrices import diagonal, inverse_among, slack_of

# Contacts that hold, and their effect on the motion: a `Hold`; for `Stops` the flags of the masses at rest, (n, ...).
Held = Any


class Hold(eqx.Module):
    """Contacts that hold, and their effect on the motion: x'' = mobility f + drive(phase).

    Attributes:
        held: flags of the contacts that hold, (contacts,).
        inertia: G_H^-1, zero outside H, (contacts, contacts).
        reaction: G_H^-1 A M^-1: contact forces from the force on the masses, (contacts, n).
        mobility: M^-1 (1 - A^T reaction), (n, n).
        drive: M^-1 A^T G_H^-1 s'', (harmonics, n); None if all contacts stand still.
    """

    held: Bool[Array, "contacts ..."]
    inertia: Float[Array, "contacts contacts ..."]
    reaction: Float[Array, "contacts n ..."]
    mobility: Float[Array, "n n ..."]
    drive: Waves | None


def after_loss(
    v: Float[Array, "n ..."], loss: Float[Array, "n ..."], size: Float[Array, "n ..."] | None = None
) -> Float[Array, "n ..."]:
    """Velocities after a loss, exactly zero where they lose all but rounding; `size` bounds the terms of the loss.

    What is left of a mass that comes to rest would be, where no force acts on it, a motion of its own, of any smallness.
    """
    left = v - loss
    most = jnp.abs(v) if size is None else jnp.abs(v) + size
    is_zero = jnp.abs(left) <= 16 * float(jnp.finfo(v.dtype).eps) * most
    return with_derivative_of(jnp.where(is_zero, 0, left), left)


class Contacts(ContactRows):
    """All contacts of a machine, with any rows, lanes last: what holds, and what is hit."""

    def __init__(
        self,
        rows: Reals,
        limit: Array,
        restitution: Restitution,
        inverse_mass: Array,
        signs: Array,
        walls: Waves | None,
        frequency: Array,
    ):
        self.rows, self.limit, self.restitution, self.inverse_mass = rows, limit, restitution, inverse_mass
        self.signs, self.walls, self.frequency = signs, walls, frequency
        terms = self._weighted()[:, None] * rows[None]
        compliance, size = jnp.sum(terms, axis=2), jnp.sum(jnp.abs(terms), axis=2)
        # Rounding would couple contacts that share no inertia, and an impact on one would open others that hold.
        is_rounding = jnp.abs(compliance) <= slack_of(compliance) * size
        self.compliance = compliance - stop_gradients(jnp.where(is_rounding, compliance, 0))

    def hold(self, held: Bool[Array, "contacts ..."]) -> Hold:
        """Effect of holding; not computed where no contact is held in any lane."""
        hold = jax.eval_shape(self._hold, held)
        free = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), hold)
        free = eqx.tree_at(lambda h: (h.held, h.mobility), free, (held, free.mobility + self._inverse()))
        return jax.lax.cond(is_any(held), lambda: self._hold(held), lambda: free)

    def _hold(self, held: Bool[Array, "contacts ..."]) -> Hold:
        """Effect of holding, from the inverse of G among the held contacts."""
        inertia, weighted = self._inertia_held(held), self._weighted()
        reaction = self._without_rounding(matrix_product(inertia, weighted), inertia, weighted)
        pushes, inverse = self._pushes(weighted), self._inverse()
        mobility = inverse - matrix_product(pushes, reaction)
        mobility = self._without_rounding(mobility, pushes, reaction, inverse)
        if self.walls is None:
            return Hold(held, inertia, reaction, mobility, None)
        back, accelerated = self._pushed_by(inertia, reaction), self._accelerated()
        drive = jax.tree.map(lambda a: jnp.stack([matvec(back, row) for row in a]), accelerated)
        return Hold(held, inertia, reaction, mobility, drive)

    def _inertia_held(self, held: Bool[Array, "contacts ..."]) -> Float[Array, "contacts contacts ..."]:
        """`inertia_among` of what holds, see `SwitchingContacts`."""
        return self.inertia_among(held)

    def _without_rounding(
        self, found: Array, first: Array, second: Array, added: Array | float = 0.0
    ) -> Float[Array, "rows columns ..."]:
        """A product of matrices as it is, see `SwitchingContacts`."""
        del first, second, added
        return found

    def accelerations(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "n ..."]:
        """Accelerations from a force, contact forces included; jerks from its rate, coefficients from coefficients."""
        moved = matvec(hold.mobility, force)
        return moved if hold.drive is None else moved + hold.drive.at(phase)

    def contact_force(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Contact forces from the force without them; zero where no contact holds."""
        pressing = matvec(hold.reaction, force)
        if self.walls is None:
            return pressing
        return pressing - matvec(hold.inertia, self._accelerated().at(phase))

    def pull(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact with only this contact released."""
        free = self.accelerated_towards(self.accelerations(force, hold, phase), phase)
        inertia = diagonal(hold.inertia)
        pressing = self.contact_force(force, hold, phase)
        return jnp.where(hold.held, pressing / jnp.where(inertia > 0, inertia, 1), free)

    def is_redundant(self, hold: Hold) -> Bool[Array, "contacts ..."]:
        """Flags of contacts that hold but whose row depends on other held ones."""
        return hold.held & (diagonal(hold.inertia) == 0)

    def depend_on(
        self, members: Bool[Array, "contacts ..."], inertia: Array | None = None
    ) -> Bool[Array, "contacts ..."]:
        """Flags of contacts whose rows and motions depend on those of `members`: they stay closed while these do.

        `inertia` is that of their `Hold`, if it is known.
        """
        inertia = inverse_among(self.compliance, members) if inertia is None else inertia
        share = matrix_product(self.compliance, inertia)
        whole = diagonal(self.compliance)
        slack = slack_of(self.compliance)
        rest = whole - jnp.sum(share * self.compliance, axis=1)
        is_dependent = rest <= slack * whole
        if self.walls is None:
            return is_dependent
        for row in (*self.walls.cosine, *self.walls.sine):
            size = jnp.abs(row) + matvec(jnp.abs(share), jnp.abs(row))
            is_dependent = is_dependent & (jnp.abs(row - matvec(share, row)) <= slack * size)
        return is_dependent

    def compliance_beside(self, hold: Hold) -> Float[Array, "contacts contacts ..."]:
        """G of the contacts that do not hold, with the held ones closed."""
        share = matrix_product(self.compliance, hold.inertia)
        return self.compliance - matrix_product(share, self.compliance)

    def contact_force_remainder(
        self, force_rest: Float[Array, "n ..."], hold: Hold
    ) -> Float[Array, "contacts ..."]:
        """Bound of the third derivative of the contact forces over 6, from that of the force."""
        rest = matvec(jnp.abs(hold.reaction), force_rest)
        if self.walls is None:
            return rest
        return rest + matvec(jnp.abs(hold.inertia), self.frequency**5 / 6 * self.walls.bound(5))

    def with_closed_gaps(
        self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase: Array
    ) -> Float[Array, "n ..."]:
        """Positions with zero gaps of the flagged contacts, nearest to x in the metric of M."""
        return x + self._by(self.inertia_among(flags), self.gaps(x, phase))

    def closed_and_stopped(
        self,
        x: Float[Array, "n ..."],
        v: Float[Array, "n ..."],
        held: Bool[Array, "contacts ..."],
        phase: Array,
        damping: Float[Array, "n n ..."],
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Positions `with_closed_gaps` and velocities `with_zero_approach`, with the impulse of dampers.

        Even if the gaps close in a very short time, dampers act with an impulse C times the displacement.
        """
        inertia, rate = inverse_among(self.compliance, held), phase_rate(phase, self.frequency)
        way = self._by(inertia, self.gaps(x, phase))
        v = v - self.inverse_mass_times(matvec(damping, way))
        return x + way, after_loss(v, self._by(inertia, self.towards(v, rate)))

    def kept(
        self,
        x: Float[Array, "n ..."],
        displacement: Float[Array, "n ..."],
        v: Float[Array, "n ..."],
        hold: Hold,
        phase: Array,
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Displacement and velocities corrected so that held contacts neither open nor close.

        Otherwise rounding errors of the steps add up along rows with several masses.
        """
        lack = jnp.where(hold.held, self.gaps(x + displacement, phase), 0)
        approach = jnp.where(hold.held, self.towards(v, phase_rate(phase, self.frequency)), 0)
        return displacement + self._by(hold.inertia, lack), v - self._by(hold.inertia, approach)

    def with_zero_approach(
        self, v: Float[Array, "n ..."], held: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities after plastic impacts on the flagged contacts, which are then not approached."""
        return self.with_approach(v, held, jnp.zeros_like(self.limit), phase_rate)

    def without_speeds(
        self, v: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities without those that the flagged elements stop."""
        return self.with_zero_approach(v, flags, phase_rate)

    def with_approach(
        self,
        v: Float[Array, "n ..."],
        flags: Bool[Array, "contacts ..."],
        approach: Float[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities after impulses of the flagged contacts that make their speeds of approach `approach`."""
        lack = approach - self.towards(v, phase_rate)
        return v + self._by(inverse_among(self.compliance, flags), lack)

    def reflected(
        self,
        v: Float[Array, "n ..."],
        hit: Bool[Array, "contacts ..."],
        kept: Bool[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities after impacts on the contacts `hit`, with the contacts `kept` staying closed."""
        approach = self.towards(v, phase_rate)
        lack = jnp.where(hit, -(1 + self.restitution_at(approach)) * approach, 0)
        return v + self._by(inverse_among(self.compliance, hit | kept), lack)

    def gain_with_hold(self, gain: Float[Array, "n ..."], hold: Hold) -> Float[Array, "n ..."]:
        """Gain of velocities, from the integral of `free_accelerations`."""
        del hold
        return gain

    def free_accelerations(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "n ..."], Float[Array, "contacts ..."] | None]:
        """Accelerations and pulls that a solver integrates besides velocities; their integrals give `integrated_pull`."""
        return self.accelerations(force, hold, phase), self.pull(force, hold, phase)

    def integrated_pull(
        self, gain: Float[Array, "n ..."], pushes: Float[Array, "contacts ..."] | None
    ) -> Array:
        """Integral of `pull` where contacts hold, (contacts, ...), from the integrals of `free_accelerations`."""
        del gain
        assert pushes is not None
        return pushes

    def dragged(self, of_contacts: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Forces of all elements: contact forces bring along no other, see `SwitchingContacts`."""
        return of_contacts

    def sizes_dragged(self, of_contacts: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Bounds of `dragged`, from bounds."""
        return of_contacts

    def inertia_among(self, members: Bool[Array, "contacts ..."]) -> Float[Array, "contacts contacts ..."]:
        """G_H^-1 of the members, zero elsewhere: contact forces from what the accelerations along the rows lack."""
        return inverse_among(self.compliance, members)

    def _pushes(self, weighted: Float[Array, "contacts n ..."]) -> Float[Array, "n contacts ..."]:
        """M^-1 A^T: accelerations by contact forces."""
        return jnp.swapaxes(weighted, 0, 1)

    def _pushed_by(self, inertia: Array, reaction: Array) -> Float[Array, "n contacts ..."]:
        """M^-1 A^T G_H^-1: accelerations of the masses that hold contacts on walls that accelerate."""
        del inertia
        return jnp.swapaxes(reaction, 0, 1)

    def _by(self, inertia: Array, lack: Array) -> Float[Array, "n ..."]:
        """Change of positions or velocities of the masses that makes A of it equal to `lack`."""
        return self.inverse_mass_times(self.back(matvec(inertia, lack)))
