"""Contacts along any rows, which may share inertia and move each for itself.

With G = A M^-1 A^T, held contacts H press with the forces that keep their gaps closed,

    lambda = G_H^-1 (A_H M^-1 f - s_H''),    x'' = M^-1 (f - A_H^T lambda),

f all other forces. Both are linear in f and in the phase of the load, which moves the contacts. So the same two
lines give forces and accelerations, their rates, and coefficients of their series.

Rows that depend on others, as two that say the same, get no force: it stands with the first of them.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._system.waves import Waves
from .._types import Reals, Scalar, matvec
from .contacts import AbstractContacts


class Hold(eqx.Module):
    """Contacts that hold, and what that does to the motion.

    Attributes:
        held: which, (contacts,).
        inertia: G_H^-1, zero where none holds, (contacts, contacts).
        reaction: G_H^-1 A M^-1: contact forces by the force on the masses, (contacts, n).
    """

    held: Bool[Array, "contacts ..."]
    inertia: Float[Array, "contacts contacts ..."]
    reaction: Float[Array, "contacts n ..."]


class Rows(AbstractContacts):
    """Contacts along any rows, lanes last.

    Attributes:
        rows: A, (contacts, n).
        limit: s in the mean, (contacts,).
        restitution: r, (contacts,).
        inverse_mass: M^-1, (n, n), or its diagonal, (n,).
        signs: of a stop the entry of its row, of any other contact 0, (contacts,).
        walls: the motions of the contacts, s less its mean; None if all stand still.
        frequency: W.
        compliance: G = A M^-1 A^T, (contacts, contacts).
    """

    is_coupled: ClassVar[bool] = True

    rows: Reals
    limit: Float[Array, "contacts ..."]
    restitution: Float[Array, "contacts ..."]
    inverse_mass: Float[Array, "..."]
    signs: Float[Array, "contacts ..."]
    walls: Waves | None
    frequency: Scalar
    compliance: Float[Array, "contacts contacts ..."]

    def __init__(
        self,
        rows: Reals,
        limit: Array,
        restitution: Array,
        inverse_mass: Array,
        signs: Array,
        walls: Waves | None,
        frequency: Array,
    ):
        self.rows, self.limit, self.restitution, self.inverse_mass = rows, limit, restitution, inverse_mass
        self.signs, self.walls, self.frequency = signs, walls, frequency
        self.compliance = jnp.sum(self._weighted()[:, None] * rows[None], axis=2)

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
        return 1 / _diagonal(self.compliance)

    def rounded(self, t: Scalar | float) -> tuple[Array, Array]:
        """Magnitudes of the terms of positions and velocities of the contacts, which set their rounding errors."""
        if self.walls is None:
            return jnp.abs(self.limit), jnp.zeros_like(self.limit)
        angle = self.frequency * t
        speed = self.frequency * self.walls.rounded(angle, order=1)
        return jnp.abs(self.limit) + self.walls.rounded(angle), speed

    def wall_speed(self) -> Float[Array, "contacts ..."]:
        """Bound the speeds of the contacts."""
        return jnp.zeros_like(self.limit) if self.walls is None else self.frequency * self.walls.bound(1)

    @property
    def sign_of_impulse(self) -> Float[Array, "contacts ..."]:
        """1 for contacts, whose impulse opens the gap; of a stop the impulse is that on its mass."""
        return jnp.where(self.signs == 0, 1, -self.signs)

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
        """Positions, or any derivative of them, relative to those of the contacts."""
        along = self.along(of_masses)
        return along if self.walls is None else along - self.walls.at(phase)

    def own_velocity(self, phase_rate: Float[Array, "2 harmonics ..."]) -> Array | None:
        """Velocities of stops, with the signs users know; 0 for contacts between masses, None if all stand still."""
        return None if self.walls is None else self.signs * self.walls.at(phase_rate)

    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """S - a . x, positive while free."""
        return self.limit - self.towards(x, phase)

    def gap_after(self, gap: Array, held: Array, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement of the masses, in which the phase changed; closed where contacts hold."""
        return jnp.where(held, gap, gap - self.towards(displacement, change))

    def rest(self, x_rest: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Bound a fourth derivative by 24 of the gaps by that of the positions."""
        rest = self.size(x_rest)
        return rest if self.walls is None else rest + self.frequency**4 / 24 * self.walls.bound(4)

    def sharing(self, flags: Bool[Array, "contacts ..."]) -> Bool[Array, "contacts ..."]:
        """None: gaps are never measured afresh, but counted on."""
        return jnp.zeros_like(flags)

    def hold(self, held: Bool[Array, "contacts ..."]) -> Hold:
        """The inverse of G among the held contacts."""
        inertia = inverse_among(self.compliance, held)
        return Hold(held, inertia, jnp.sum(inertia[:, :, None] * self._weighted()[None], axis=1))

    def accelerations(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "n ..."]:
        """Accelerations by a force, with the forces of the contacts that hold."""
        return self.freed(force - self.back(self.pressing(force, hold, phase)))

    def pressing(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """The contact forces, zero where none holds."""
        pressing = matvec(hold.reaction, force)
        if self.walls is None:
            return pressing
        return pressing - matvec(hold.inertia, self._accelerated().at(phase))

    def pull(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> Float[Array, "contacts ..."]:
        """Acceleration towards each contact, as if it alone did not hold."""
        pressing = self.pressing(force, hold, phase)
        free = self.along(self.freed(force - self.back(pressing)))
        if self.walls is not None:
            free = free - self._accelerated().at(phase)
        inertia = _diagonal(hold.inertia)
        return jnp.where(hold.held, pressing / jnp.where(inertia > 0, inertia, 1), free)

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

    def held_still(
        self, v: Float[Array, "n ..."], held: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities with no approach to the flagged contacts, after plastic impacts with them."""
        return v - self._by(inverse_among(self.compliance, held), self.towards(v, phase_rate))

    def reflected(
        self,
        v: Float[Array, "n ..."],
        hit: Bool[Array, "contacts ..."],
        kept: Bool[Array, "contacts ..."],
        phase_rate: Array,
    ) -> Float[Array, "n ..."]:
        """Velocities after impacts with one set of contacts, while another keeps closed."""
        lack = jnp.where(hit, -(1 + self.restitution) * self.towards(v, phase_rate), 0)
        return v + self._by(inverse_among(self.compliance, hit | kept), lack)

    def gained(self, gain: Float[Array, "n ..."], hold: Hold) -> Float[Array, "n ..."]:
        """All of it."""
        del hold
        return gain

    def free_accelerations(
        self, force: Float[Array, "n ..."], hold: Hold, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "n ..."], Float[Array, "contacts ..."]]:
        """Accelerations with the contact forces, and the pulls."""
        return self.accelerations(force, hold, phase), self.pull(force, hold, phase)

    def pushed(self, gain: Float[Array, "n ..."], pushes: Float[Array, "contacts ..."] | None) -> Array:
        """The integral of the pulls."""
        del gain
        assert pushes is not None
        return pushes

    def impulses(self, loss: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
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
        return jnp.sum(self.rows[:, :, None] * self.inverse_mass[None], axis=1)

    @property
    def _has_full_mass(self) -> bool:
        return self.inverse_mass.ndim == self.rows.ndim

    def _accelerated(self) -> Waves:
        """The accelerations of the contacts."""
        assert self.walls is not None
        order = np.arange(1, self.walls.num_harmonics + 1).reshape(-1, *[1] * (self.walls.cosine.ndim - 1))
        rate = -((order * self.frequency) ** 2)
        return Waves(rate * self.walls.cosine, rate * self.walls.sine)


def inverse_among(
    matrix: Float[Array, "contacts contacts ..."], members: Bool[Array, "contacts ..."]
) -> Float[Array, "contacts contacts ..."]:
    """The inverse of the part of a symmetric matrix that belongs to the members; zero elsewhere.

    By sweeps, one for each member. A member whose row depends on those before it, to rounding, is left out.

    References:
        J. H. Goodnight, A tutorial on the sweep operator, Am. Stat. 33 (1979).
    """
    size, a = len(matrix), matrix + jnp.zeros_like(members, matrix.dtype)[None]
    slack, swept = 64 * size * jnp.finfo(matrix.dtype).eps, []
    for k in range(size):
        is_member = members[k] & (a[k, k] > slack * matrix[k, k])
        pivot = jnp.where(is_member, a[k, k], 1)
        row, column = a[k] / pivot, a[:, k]
        here = (np.arange(size) == k).reshape(-1, *[1] * (row.ndim - 1))
        rest = a - column[:, None] * row[None]
        rest = jnp.where(here[:, None], row[None], jnp.where(here[None], (-column / pivot)[:, None], rest))
        rest = jnp.where(here[:, None] & here[None], 1 / pivot, rest)
        a = jnp.where(is_member, rest, a)
        swept.append(is_member)
    inside = jnp.stack(swept) if size else members
    return jnp.where(inside[:, None] & inside[None], a, 0)


def _diagonal(matrix: Float[Array, "contacts contacts ..."]) -> Float[Array, "contacts ..."]:
    return jnp.stack([matrix[j, j] for j in range(len(matrix))]) if len(matrix) else matrix[:, 0]
