"""Contacts as the engine sees them: rows that limit the motion, which may share inertia and move each for itself.

A contact keeps its gap, `s - a . x`, from falling below zero: a is a row over the masses, s its limit. All consequences of
rows stand here, in `stops.py` and in `_hybrid/`, and nowhere else: gaps, speeds of approach, the masses a contact acts on,
the effect of holding on a motion. The rest of the engine knows contacts by their number alone. Rows are numbers, so another
row compiles nothing for one trajectory.

With G = A M^-1 A^T, held contacts H press with the forces that keep their gaps closed,

    lambda = G_H^-1 (A_H M^-1 f - s_H''),    x'' = M^-1 (f - A_H^T lambda),

f all other forces. Both are linear in f and in the phase of the load, which moves the contacts. So the same two
lines give forces and accelerations, their rates, and coefficients of their series.

Rows that depend on others, as two that say the same, get no force: it stands with the first of them.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Reals, Scalar, matvec, stop_gradients
from .._jax.xla import is_any
from .._system.restitution import Restitution, coefficient, light_coefficient
from .._system.waves import Waves, phase_rate
from .small_matrices import diagonal, inverse_among, product, slack_of

# Contacts that hold, and what that does to the motion: a `Hold`; for `Stops` the flags of the masses that rest, (n, ...).
Held = Any


class Hold(eqx.Module):
    """Contacts that hold, and what that does to the motion: x'' = mobility f + drive(phase).

    Attributes:
        held: which, (contacts,).
        inertia: G_H^-1, zero where none holds, (contacts, contacts).
        reaction: G_H^-1 A M^-1: contact forces by the force on the masses, (contacts, n).
        mobility: M^-1 (1 - A^T reaction), (n, n).
        drive: M^-1 A^T G_H^-1 s'', (harmonics, n); None if all contacts stand still.
    """

    held: Bool[Array, "contacts ..."]
    inertia: Float[Array, "contacts contacts ..."]
    reaction: Float[Array, "contacts n ..."]
    mobility: Float[Array, "n n ..."]
    drive: Waves | None


class Contacts(eqx.Module):
    """All contacts of a machine, along any rows, lanes last.

    A `phase` is that of the load, (2, harmonics). Quantities that are linear in it, as the motions of contacts are, take
    its derivative, Taylor coefficient or change where derivatives, coefficients or changes of theirs are asked for.

    Attributes:
        is_coupled: whether contacts may share inertia.
        rows: A, (contacts, n).
        limit: s in the mean, (contacts,).
        restitution: the law of impacts, r(speed of approach), (contacts,).
        inverse_mass: M^-1, (n, n), or its diagonal, (n,).
        signs: of a stop the entry of its row, of any other contact 0, (contacts,).
        walls: the motions of the contacts, s less its mean; None if all stand still.
        frequency: W.
        compliance: G = A M^-1 A^T, (contacts, contacts).
    """

    is_coupled: ClassVar[bool] = True

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
        # Contacts that share no inertia would seem to by rounding, and one that is hit would open others that hold.
        is_rounding = jnp.abs(compliance) <= slack_of(compliance) * size
        self.compliance = compliance - stop_gradients(jnp.where(is_rounding, compliance, 0))

    @property
    def num(self) -> int:
        """How many there are."""
        return len(self.rows)

    @property
    def masses(self) -> tuple[int, ...]:
        """The mass of each stop, -1 of any other contact, where it is known."""
        rows, signs = np.asarray(self.rows), np.asarray(self.signs)
        while rows.ndim > 2:
            rows, signs = rows[0], signs[0]
        return tuple(
            int(np.flatnonzero(row)[0]) if sign else -1 for row, sign in zip(rows, signs, strict=True)
        )

    @property
    def position(self) -> Float[Array, "contacts ..."]:
        """Where each stands, as it was given, its motion left out."""
        return self.told(self.limit)

    @property
    def effective_mass(self) -> Float[Array, "contacts ..."]:
        """The mass that is met along the row, 1 / (a M^-1 a)."""
        return 1 / diagonal(self.compliance)

    def rounded(self, t: Scalar | float) -> tuple[Array, Array]:
        """Magnitudes of the terms of positions and velocities of the contacts, which set their rounding errors."""
        if self.walls is None:
            return jnp.abs(self.limit), jnp.zeros_like(self.limit)
        angle = self.frequency * t
        speed = self.frequency * self.walls.rounded(angle, order=1)
        return jnp.abs(self.limit) + self.walls.rounded(angle), speed

    def noise(self, v: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Rounding errors of speeds of approach."""
        size = self.size(jnp.abs(v))
        size = size if self.walls is None else size + self.frequency * self.walls.bound(1)
        kind = jnp.finfo(size.dtype)
        # Speeds that fall by a factor at every blow end before their squares are no numbers any more.
        return 4 * kind.eps * size + kind.tiny**0.5 / kind.eps

    def signed_impulse(self, along: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Of a stop the impulse on its mass, of any other contact the one that opens its gap."""
        return jnp.where(self.signs == 0, 1, -self.signs) * along

    def along(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """A . y: a velocity or a force, counted towards each contact."""
        return matvec(self.rows, of_masses)

    def size(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """|A| . y: bounds of quantities of the masses, carried to each contact."""
        return matvec(abs(self.rows), of_masses)

    def told(self, towards: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Change between quantities counted towards each contact and signed ones, as users know them."""
        return jnp.where(self.signs == 0, 1, self.signs) * towards

    def towards(self, of_masses: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """Positions, or any derivative of them, relative to those of the contacts, (contacts, ...)."""
        along = self.along(of_masses)
        return along if self.walls is None else along - self.walls.at(phase)

    def own_velocity(self, phase_rate: Float[Array, "2 harmonics ..."]) -> Array | None:
        """Velocities of stops, with the signs users know; 0 for contacts between masses, None if all stand still."""
        return None if self.walls is None else self.signs * self.walls.at(phase_rate)

    def restitution_at(self, speed: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """The coefficients at some speeds of approach."""
        return coefficient(self.restitution, speed)

    @property
    def light_restitution(self) -> Float[Array, "contacts ..."]:
        """The coefficients of light impacts."""
        return light_coefficient(self.restitution)

    @property
    def is_plastic(self) -> Bool[Array, "contacts ..."]:
        """Contacts whose impacts leave no speed."""
        return self.light_restitution == 0

    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """S - a . x, positive while free, (contacts, ...)."""
        return self.limit - self.towards(x, phase)

    def gap_after(self, gap: Array, held: Array, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement of the masses, in which the phase changed; exact relative to the change, closed where held."""
        return jnp.where(held, gap, gap - self.towards(displacement, change))

    def rest(self, x_rest: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Bound a fourth derivative by 24 of the gaps by that of the positions."""
        rest = self.size(x_rest)
        return rest if self.walls is None else rest + self.frequency**4 / 24 * self.walls.bound(4)

    def sharing(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """None: gaps are never measured afresh, but counted on."""
        return jnp.zeros_like(flags)

    def hold(self, held: Bool[Array, "contacts ..."]) -> Hold:
        """What holding does; where nothing is held anywhere, without computing it."""
        hold = jax.eval_shape(self._hold, held)
        free = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), hold)
        free = eqx.tree_at(lambda h: (h.held, h.mobility), free, (held, free.mobility + self._inverse()))
        return jax.lax.cond(is_any(held), lambda: self._hold(held), lambda: free)

    def _hold(self, held: Bool[Array, "contacts ..."]) -> Hold:
        """By the inverse of G among the held contacts."""
        inertia, weighted = inverse_among(self.compliance, held), self._weighted()
        reaction = product(inertia, weighted)
        mobility = self._inverse() - product(jnp.swapaxes(weighted, 0, 1), reaction)
        if self.walls is None:
            return Hold(held, inertia, reaction, mobility, None)
        back, accelerated = jnp.swapaxes(reaction, 0, 1), self._accelerated()
        drive = jax.tree.map(lambda a: jnp.stack([matvec(back, row) for row in a]), accelerated)
        return Hold(held, inertia, reaction, mobility, drive)

    def accelerations(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "n ..."]:
        """Accelerations by a force, with the forces of contacts that hold; jerks by its rate, coefficients by coefficients."""
        moved = matvec(hold.mobility, force)
        return moved if hold.drive is None else moved + hold.drive.at(phase)

    def pressing(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """The contact forces, zero where none holds, by the force without them."""
        pressing = matvec(hold.reaction, force)
        if self.walls is None:
            return pressing
        return pressing - matvec(hold.inertia, self._accelerated().at(phase))

    def pull(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact, as if it alone did not hold."""
        free = self._accelerated_towards(self.accelerations(force, hold, phase), phase)
        inertia = diagonal(hold.inertia)
        pressing = self.pressing(force, hold, phase)
        return jnp.where(hold.held, pressing / jnp.where(inertia > 0, inertia, 1), free)

    def is_spare(self, hold: Hold) -> Bool[Array, "contacts ..."]:
        """Contacts that hold, but whose row depends on those of others that do."""
        return hold.held & (diagonal(hold.inertia) == 0)

    def depend_on(self, members: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """Contacts whose gaps cannot change while those of some others do not: rows and motions depend on theirs."""
        share = product(self.compliance, inverse_among(self.compliance, members))
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
        """G of the contacts that do not hold, while the others do."""
        share = product(self.compliance, hold.inertia)
        return self.compliance - product(share, self.compliance)

    def free_pull(
        self, force: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact, if none held."""
        return self._accelerated_towards(self.freed(force), phase)

    def _accelerated_towards(self, acceleration: Array, phase: Array) -> Float[Array, "contacts ..."]:
        along = self.along(acceleration)
        return along if self.walls is None else along - self._accelerated().at(phase)

    def pressing_rest(self, force_rest: Float[Array, "n ..."], hold: Hold) -> Float[Array, "contacts ..."]:
        """Bound a third derivative by 6 of the contact forces by that of the force."""
        rest = matvec(jnp.abs(hold.reaction), force_rest)
        if self.walls is None:
            return rest
        return rest + matvec(jnp.abs(hold.inertia), self.frequency**5 / 6 * self.walls.bound(5))

    def placed(
        self, x: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase: Array
    ) -> Float[Array, "n ..."]:
        """Positions with the gaps of the flagged contacts zero, the nearest in the metric of the masses."""
        return x + self._by(inverse_among(self.compliance, flags), self.gaps(x, phase))

    def settled(
        self,
        x: Float[Array, "n ..."],
        v: Float[Array, "n ..."],
        held: Bool[Array, "contacts ..."],
        phase: Array,
        damping: Float[Array, "n n ..."],
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Positions `placed` and velocities `held_still` at once.

        However short the time in which gaps close, dampers act along the way by an impulse of C times it.
        """
        inertia, rate = inverse_among(self.compliance, held), phase_rate(phase, self.frequency)
        way = self._by(inertia, self.gaps(x, phase))
        v = v - self.freed(matvec(damping, way))
        return x + way, v - self._by(inertia, self.towards(v, rate))

    def kept(
        self,
        x: Float[Array, "n ..."],
        displacement: Float[Array, "n ..."],
        v: Float[Array, "n ..."],
        hold: Hold,
        phase: Array,
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """A displacement from some positions, and velocities after it, by which no contact that holds opens or gives way.

        Else the rounding errors of every step would add up along rows that several masses bear on.
        """
        lack = jnp.where(hold.held, self.gaps(x + displacement, phase), 0)
        approach = jnp.where(hold.held, self.towards(v, phase_rate(phase, self.frequency)), 0)
        return displacement + self._by(hold.inertia, lack), v - self._by(hold.inertia, approach)

    def held_still(
        self, v: Float[Array, "n ..."], held: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities with no approach to the flagged contacts, after plastic impacts with them."""
        return self.brought(v, held, jnp.zeros_like(self.limit), phase_rate)

    def brought(
        self,
        v: Float[Array, "n ..."],
        flags: Bool[Array, "contacts ..."],
        approach: Float[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities changed by impulses of the flagged contacts, until these are approached at given speeds."""
        lack = approach - self.towards(v, phase_rate)
        return v + self._by(inverse_among(self.compliance, flags), lack)

    def reflected(
        self,
        v: Float[Array, "n ..."],
        hit: Bool[Array, "contacts ..."],
        kept: Bool[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities after impacts with one set of contacts, while another keeps closed."""
        approach = self.towards(v, phase_rate)
        lack = jnp.where(hit, -(1 + self.restitution_at(approach)) * approach, 0)
        return v + self._by(inverse_among(self.compliance, hit | kept), lack)

    def gained(self, gain: Float[Array, "n ..."], hold: Hold) -> Float[Array, "n ..."]:
        """The gain of velocities that `free_accelerations` make."""
        del hold
        return gain

    def free_accelerations(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "n ..."], Float[Array, "contacts ..."] | None]:
        """What a solver integrates beside velocities, from which `pushed` is known: accelerations and pulls."""
        return self.accelerations(force, hold, phase), self.pull(force, hold, phase)

    def pushed(self, gain: Float[Array, "n ..."], pushes: Float[Array, "contacts ..."] | None) -> Array:
        """The integral of `pull` where contacts hold, (contacts, ...), by the integrals of `free_accelerations`."""
        del gain
        assert pushes is not None
        return pushes

    def impulses(self, loss: Float[Array, "n ..."]) -> Float[Array, "contacts ..."] | None:
        """Impulses of single impacts by the loss of velocities: of each as if it alone had hit."""
        return self.along(loss) * self.effective_mass

    def freed(self, force: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """M^-1 . y: accelerations by forces, if no contact held; velocities by impulses."""
        return matvec(self.inverse_mass, force) if self._has_full_mass else self.inverse_mass * force

    def back(self, of_contacts: Float[Array, "contacts ..."]) -> Float[Array, "n ..."]:
        """A^T . y: what contact forces, or impulses, are on the masses."""
        return matvec(jnp.swapaxes(self.rows, 0, 1), of_contacts)

    def _by(self, inertia: Array, lack: Array) -> Float[Array, "n ..."]:
        """What has to be added to the masses where A of it shall be `lack`."""
        return self.freed(self.back(matvec(inertia, lack)))

    def _weighted(self) -> Float[Array, "contacts n ..."]:
        """A M^-1."""
        if not self._has_full_mass:
            return self.rows * self.inverse_mass[None]
        return product(self.rows, self.inverse_mass)

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
        """The accelerations of the contacts."""
        assert self.walls is not None
        order = np.arange(1, self.walls.num_harmonics + 1).reshape(-1, *[1] * (self.walls.cosine.ndim - 1))
        rate = -((order * self.frequency) ** 2)
        return Waves(rate * self.walls.cosine, rate * self.walls.sine)
