"""Contacts in the engine: rows that limit the motion; contacts may share inertia and may move independently.

A contact keeps its gap `s - a . x` from falling below zero: a is a row over the masses, s its limit. Only this file,
`stops.py` and `_hybrid/` compute with rows: gaps, speeds of approach, the masses a contact acts on, the effect of
holding on a motion. The rest of the engine uses contacts by index only. Rows are numbers, so another row compiles
nothing for one trajectory.

With G = A M^-1 A^T, the contact forces of held contacts H keep their gaps closed,

    lambda = G_H^-1 (A_H M^-1 f - s_H''),    x'' = M^-1 (f - A_H^T lambda),

where f is the sum of all other forces. Both are linear in f and in the phase of the load, which moves the contacts. So
the same two lines give forces and accelerations, their rates, and coefficients of their series.

A row that depends on earlier ones, such as a duplicate, gets no force: the earlier ones carry it.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Reals, Scalar, matrix_product, matvec, with_derivative_of
from .._jax.concrete import stop_gradients
from .._jax.xla import is_any
from .._system.restitution import Restitution, coefficient, light_coefficient
from .._system.waves import Waves, phase_rate
from .kinds import RIGID
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


class Contacts(eqx.Module):
    """All contacts of a machine, with any rows, lanes last.

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

    def free_pull(
        self, force: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact with no contact held."""
        return self.accelerated_towards(self.inverse_mass_times(force), phase)

    def accelerated_towards(self, acceleration: Array, phase: Array) -> Float[Array, "contacts ..."]:
        """Accelerations along the rows, relative to those of the contacts."""
        along = self.along(acceleration)
        return along if self.walls is None else along - self._accelerated().at(phase)

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
