"""Contacts of machines whose forces switch: rigid and compliant contacts, dry friction and Jenkins elements, in one numbering.

Each element has a row: a contact rigid or compliant keeps or resists `a . x <= s`, friction resists the sliding velocity
`w = a . v - velocity`, a Jenkins element the velocity a . v. Stops come first in the order of the user, then friction, then
Jenkins elements. So an element is one entry of
every array over contacts, and what holds is a `Hold` for all: a rigid contact holds at its position, friction at its
velocity, a preloaded compliant stop at d = 0. Their accelerations along the row vanish alike.

Between events the forces of the elements that do not hold are linear in the state (`Laws`): a closed compliant contact
adds a k a^T to the stiffness and a c a^T to the damping, slip adds a constant load, and that of a Jenkins element leaves its
stretch constant, see `_system/hysteresis.py`. `Machine.in_mode` returns the machine with
them, so that no flow needs to know of elements.

Friction may be tied to a contact. While it slips, its force is a share of that of the contact, T = mu N s: `drag` is the
matrix S of the forces S N of all elements that the forces N of contacts bring along. Then a contact pushes along the row
of S^T A: G = A M^-1 A^T S, which is not symmetric, and a closed compliant contact adds k (a + mu s g)^T a.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Reals, Scalar, append_axes, matrix_product, matvec, with_derivative_of
from .._system.restitution import Restitution
from .._system.waves import Waves, phase_rate
from .contacts import Contacts, Hold, after_loss
from .kinds import FRICTION, JENKINS, RIGID
from .laws import Laws
from .small_matrices import diagonal, inverse_of_block, slack_of
from .state import SATURATED, Mode, State


class SwitchingContacts(Contacts):
    """Contacts and friction elements of a machine whose forces switch, lanes last.

    `drag` is S of the head of this file in the mode of a state; None outside of one, and without friction of contacts.
    """

    is_switching: ClassVar[bool] = True

    laws: Laws
    drag: Float[Array, "contacts contacts ..."] | None

    def __init__(
        self,
        rows: Reals,
        limit: Array,
        restitution: Restitution,
        inverse_mass: Array,
        signs: Array,
        walls: Waves | None,
        frequency: Array,
        laws: Laws,
    ):
        Contacts.__init__(self, rows, limit, restitution, inverse_mass, signs, walls, frequency)
        self.laws, self.drag = laws, None

    @property
    def kinds(self) -> tuple[int, ...]:
        """Kind of every element."""
        return self.laws.kinds

    @property
    def num_stops(self) -> int:
        """Number of contacts, rigid and compliant, which come before friction."""
        return self.laws.num_stops

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements, which come last."""
        return self.laws.num_sliders

    def are(self, kind: int) -> Bool[Array, "contacts ..."]:
        """Flags of the elements of a kind."""
        return append_axes(jnp.asarray(np.array(self.laws.kinds) == kind), self.limit)

    @property
    def has_no_gap(self) -> Bool[Array, "contacts ..."]:
        """Flags of friction and Jenkins elements, which resist velocities."""
        return append_axes(jnp.asarray(self.laws.has_no_gap), self.limit)

    @property
    def has_gap(self) -> Bool[Array, "contacts ..."]:
        """Flags of contacts, rigid and compliant."""
        return ~self.has_no_gap

    def stretches(self, v: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Stretches of Jenkins elements, the last velocities; 0 for all others."""
        first = len(v) - self.num_sliders
        return jnp.concatenate([jnp.zeros((self.num - len(v[first:]), *v.shape[1:]), v.dtype), v[first:]])

    def with_stretches(
        self, v: Float[Array, "n ..."], direction: Int[Array, "contacts ..."]
    ) -> Float[Array, "n ..."]:
        """Velocities with the stretches of Jenkins elements that slip at their limit."""
        num = self.num_sliders
        if not num:
            return v
        assert self.laws.reach is not None
        slips, at_limit = direction[-num:] != 0, direction[-num:] * self.laws.reach[-num:]
        return jnp.concatenate([v[:-num], jnp.where(slips, at_limit, v[-num:])])

    def sliders(self, x: Float[Array, "n ..."], v: Float[Array, "n ..."]) -> Float[Array, "sliders ..."]:
        """Sliders of Jenkins elements."""
        num = self.num_sliders
        return self.along(x)[self.num - num :] - v[len(v) - num :]

    @property
    def is_rigid(self) -> Bool[Array, "contacts ..."]:
        """Flags of rigid contacts."""
        return self.are(RIGID)

    def gap_moved(self, gap: Array, closed: Array, displacement: Array) -> Array:
        """Gaps after a displacement at one instant, without those of friction."""
        return jnp.where(self.has_no_gap & ~closed, gap, super().gap_moved(gap, closed, displacement))

    def gap_placed(
        self, gap: Array, closed: Array, held: Array, displacement: Array, x: Array, phase: Array
    ) -> Array:
        """Gaps after a displacement, those of contacts that hold closed; 1 for elements without."""
        del x, phase
        moved = self.gap_moved(gap, closed, displacement)
        return jnp.where(held & self.has_gap, 0, jnp.where(self.has_gap, moved, 1))

    def speeds(self, v: Float[Array, "n ..."], phase_rate: Array) -> Float[Array, "contacts ..."]:
        """Speeds of approach to contacts, and sliding velocities of friction."""
        return self.towards(v, phase_rate) - self.laws.velocity

    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """Gaps of contacts; 1 for elements without, which are never closed."""
        return jnp.where(self.has_no_gap, 1, self.limit - self.towards(x, phase))

    def gap_after(self, gap: Array, held: Array | bool, displacement: Array, change: Array) -> Array:
        """Gaps after a displacement, without those of friction."""
        return jnp.where(held | self.has_no_gap, gap, gap - self.towards(displacement, change))

    def kept(
        self,
        x: Float[Array, "n ..."],
        displacement: Float[Array, "n ..."],
        v: Float[Array, "n ..."],
        hold: Hold,
        phase: Array,
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Displacement and velocities corrected: contacts neither open nor close, friction does not creep."""
        at_place = hold.held & ~self.are(FRICTION)
        lack = jnp.where(at_place, self.gaps(x + displacement, phase), 0)
        way = self._by(self.inertia_among(at_place), lack)
        speeds = jnp.where(hold.held, self.speeds(v, phase_rate(phase, self.frequency)), 0)
        return displacement + way, v - self._by(hold.inertia, speeds)

    def brought_to_rest(
        self,
        x: Float[Array, "n ..."],
        v: Float[Array, "n ..."],
        held: Bool[Array, "contacts ..."],
        phase: Array,
        damping: Float[Array, "n n ..."],
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Positions with closed gaps and velocities without approach or sliding, with the impulse of dampers."""
        at_place, rate = held & ~self.are(FRICTION), phase_rate(phase, self.frequency)
        lack = jnp.where(at_place, self.gaps(x, phase), 0)
        way = self._by(self.inertia_among(at_place), lack)
        v = v - self.inverse_mass_times(jnp.sum(damping * way[None], axis=1))
        lack = jnp.where(held, self.speeds(v, rate), 0)
        return x + way, self._after_loss_of(v, held, lack)

    def without_speeds(
        self, v: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase_rate: Array
    ) -> Float[Array, "n ..."]:
        """Velocities without approach or sliding of flagged elements, nearest to v in the metric of M."""
        lack = jnp.where(flags, self.speeds(v, phase_rate), 0)
        return self._after_loss_of(v, flags, lack)

    def _after_loss_of(self, v: Array, members: Array, lack: Array) -> Float[Array, "n ..."]:
        """Velocities after the impulses of the members that take away their speeds `lack`."""
        inertia, rows = self._inertia_held(members), jnp.abs(jnp.swapaxes(self.rows, 0, 1))
        sizes = self.sizes_dragged(matvec(jnp.abs(inertia), jnp.abs(lack)))
        return after_loss(v, self._by(inertia, lack), self.inverse_mass_size(matvec(rows, sizes)))

    def third_rest(self, of_masses: Float[Array, "n ..."]) -> Float[Array, "contacts ..."]:
        """Bound of the third Taylor coefficient of the gaps, from that of the positions."""
        rest = self.size(of_masses)
        return rest if self.walls is None else rest + self.frequency**3 / 6 * self.walls.bound(3)

    def spring_force(
        self, gap: Float[Array, "contacts ..."], speed: Float[Array, "contacts ..."]
    ) -> Float[Array, "contacts ..."]:
        """F0 + k d + c d' of compliant contacts, negative where they would have to pull."""
        return self.laws.preload - self.laws.stiffness * gap + self.laws.damping * speed

    def forces_of(self, state: State) -> Float[Array, "contacts ..."]:
        """Forces N and T of elements that do not hold, in the mode of a state."""
        mode = state.mode
        assert mode is not None
        speed = self.speeds(state.v, phase_rate(state.phase, self.frequency))
        pushing = self.spring_force(self.gaps(state.x, state.phase), speed)
        forces = jnp.where(mode.closed, pushing, self._rubbing(mode))
        if JENKINS not in self.laws.kinds:
            return forces
        return jnp.where(self.are(JENKINS), self.laws.stiffness * self.stretches(state.v), forces)

    def load_of(self, mode: Mode) -> Float[Array, "n ..."]:
        """Constant part of the forces of the elements on the masses, in a mode."""
        laws = self.laws
        spring = jnp.where(mode.closed, laws.stiffness * self.limit - laws.preload, 0)
        return self.back(self.dragged(spring) - self._rubbing(mode))

    def size_of_load(self, mode: Mode) -> Float[Array, "n ..."]:
        """Sizes of the terms of `load_of`."""
        laws = self.laws
        spring = jnp.where(mode.closed, laws.stiffness * jnp.abs(self.limit) + laws.preload, 0)
        pushes = self.sizes_dragged(spring + jnp.abs(self._rubbing(mode)))
        return matvec(jnp.abs(jnp.swapaxes(self.rows, 0, 1)), pushes)

    def _rubbing(self, mode: Mode) -> Float[Array, "contacts ..."]:
        """Forces T of friction that does not hold: of slip, and at the bound of the grip where others keep it at rest."""
        return jnp.sign(mode.direction) * jnp.where(
            jnp.abs(mode.direction) == SATURATED, self.laws.grip, self.laws.force
        )

    def matrices_of(self, closed: Bool[Array, "contacts ..."]) -> tuple[Array, Array]:
        """Stiffness and damping that closed compliant contacts add, (n, n) each."""
        back = jnp.swapaxes(self.rows, 0, 1)
        weights = (jnp.where(closed, a, 0) for a in (self.laws.stiffness, self.laws.damping))
        back = back if self.drag is None else matrix_product(back, self.drag)
        stiffness, damping = (matrix_product(back, a[:, None] * self.rows) for a in weights)
        return stiffness, damping

    def sticking_rows(self, direction: Int[Array, "contacts ..."]) -> Bool[Array, "n ..."]:
        """Flags of coordinates, without those of the stretches of Jenkins elements that slip."""
        num, n = self.num_sliders, self.rows.shape[1]
        sticks = direction[self.num - num :] == 0
        return jnp.concatenate([jnp.ones((n - num, *sticks.shape[1:]), bool), sticks])

    @property
    def are_tied(self) -> Bool[Array, "contacts ..."]:
        """Flags of friction elements that the force of a contact presses."""
        normal = np.array(self.laws.normal or [-1] * self.num)
        return append_axes(jnp.asarray(normal >= 0), self.limit)

    @property
    def presses_friction(self) -> Bool[Array, "contacts ..."]:
        """Flags of contacts whose force presses friction."""
        normal = set(self.laws.normal or ())
        return append_axes(jnp.asarray([j in normal for j in range(self.num)]), self.limit)

    def at_normal(self, of_contacts: Array) -> Array:
        """For each friction element what its contact has; for all other elements their own."""
        normal = self.laws.normal
        assert normal is not None
        return jnp.stack([of_contacts[k if i < 0 else i] for k, i in enumerate(normal)])

    def of_friction_at(self, of_friction: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """For each contact the sum of what its friction elements have."""
        normal = self.laws.normal
        assert normal is not None
        zero = jnp.zeros_like(of_friction[0])
        pressed = [[k for k, i in enumerate(normal) if i == j] for j in range(self.num)]
        return jnp.stack([sum((of_friction[k] for k in each), zero) for each in pressed])

    def directed(self, direction: Int[Array, "contacts ..."]) -> "SwitchingContacts":
        """Contacts whose forces bring along those of friction that slips, in the directions of a `Mode`."""
        laws = self.laws
        if laws.normal is None:
            return self
        size = len(laws.normal)
        presses = np.array(laws.normal)[:, None] == np.arange(size)[None]
        presses, unit = (
            jnp.asarray(a.reshape(size, size, *[1] * (self.limit.ndim - 1)), self.limit.dtype)
            for a in (presses, np.eye(size))
        )
        is_at_bound = jnp.abs(direction) == SATURATED
        share = jnp.sign(direction) * jnp.where(is_at_bound, laws.static_coefficient, laws.coefficient)
        drag = unit + share[:, None] * presses
        return eqx.tree_at(lambda c: c.drag, self, drag, is_leaf=lambda leaf: leaf is None)

    def dragged(self, of_contacts: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Forces or impulses of all elements, from those of the elements without friction of contacts that slips."""
        return of_contacts if self.drag is None else matvec(self.drag, of_contacts)

    def sizes_dragged(self, of_contacts: Float[Array, "contacts ..."]) -> Float[Array, "contacts ..."]:
        """Bounds of `dragged`, from bounds."""
        return of_contacts if self.drag is None else matvec(jnp.abs(self.drag), of_contacts)

    def _without_rounding(
        self, found: Array, first: Array, second: Array, added: Array | float = 0.0
    ) -> Float[Array, "rows columns ..."]:
        """A product of matrices, and a matrix added, with zeros for entries that are rounding errors of their terms.

        No force reaches a contact or a mass that others shield from it.
        """
        terms = jnp.abs(added) + matrix_product(jnp.abs(first), jnp.abs(second))
        is_zero = jnp.abs(found) <= slack_of(self.compliance) * terms
        return with_derivative_of(jnp.where(is_zero, 0, found), found)

    def inertia_among(self, members: Bool[Array, "contacts ..."]) -> Float[Array, "contacts contacts ..."]:
        """G_H^-1 of the members, with the friction that they bring along."""
        if self.drag is None:
            return Contacts.inertia_among(self, members)
        return inverse_of_block(self._along(), members, diagonal(self.compliance))

    def _along(self) -> Float[Array, "contacts contacts ..."]:
        """Accelerations along the rows by unit forces of the elements and of the friction that they bring along."""
        return self.compliance if self.drag is None else matrix_product(self.compliance, self.drag)

    def _inertia_held(self, held: Bool[Array, "contacts ..."]) -> Float[Array, "contacts contacts ..."]:
        """`inertia_among` of what holds, without rounding errors: no element reaches another that does not press on it."""
        inertia = self.inertia_among(held)
        # Errors of a matrix change its inverse by the inverse times them times the inverse. Rows that are nearly dependent, as of masses
        # of very different size, have a large one: the bound is less than that by which dependent rows are told.
        errors = matrix_product(jnp.abs(self._along()), jnp.abs(inertia)) / 16
        return self._without_rounding(inertia, inertia, errors)

    def is_redundant(self, hold: Hold) -> Bool[Array, "contacts ..."]:
        """Flags of contacts that hold but whose row depends on other held ones."""
        if self.drag is None:
            return Contacts.is_redundant(self, hold)
        return hold.held & jnp.all(hold.inertia == 0, axis=1)

    def depend_on(
        self, members: Bool[Array, "contacts ..."], inertia: Array | None = None
    ) -> Bool[Array, "contacts ..."]:
        """Flags of contacts whose rows and motions depend on those of `members`."""
        return Contacts.depend_on(self, members, inertia if self.drag is None else None)

    def obliqueness(self, held: Bool[Array, "contacts ..."]) -> Scalar:
        """Bound of the factor by which holding may increase forces: the norm of 1 - W^T G_H^-1 A for unit masses.

        Without friction of contacts it is a perpendicular projection, of norm 1. The singular values of any projection that are not
        zero are at least 1, and their squares have the sum below.
        """
        assert self.drag is not None
        inertia = self.inertia_among(held)
        pushing = matrix_product(jnp.swapaxes(self.drag, 0, 1), matrix_product(self.compliance, self.drag))
        terms = matrix_product(pushing, matrix_product(inertia, self.compliance)) * inertia
        rank = jnp.sum(diagonal(matrix_product(inertia, matrix_product(self.compliance, self.drag))), axis=0)
        return jnp.sqrt(jnp.maximum(jnp.sum(terms, axis=(0, 1)) - jnp.maximum(rank - 1, 0), 1))

    def _pushes(self, weighted: Float[Array, "contacts n ..."]) -> Float[Array, "n contacts ..."]:
        """Accelerations by contact forces."""
        pushes = jnp.swapaxes(weighted, 0, 1)
        return pushes if self.drag is None else matrix_product(pushes, self.drag)

    def _pushed_by(self, inertia: Array, reaction: Array) -> Float[Array, "n contacts ..."]:
        """Accelerations of the masses that hold contacts on walls that accelerate."""
        if self.drag is None:
            return Contacts._pushed_by(self, inertia, reaction)
        return matrix_product(self._pushes(self._weighted()), inertia)

    def _by(self, inertia: Array, lack: Array) -> Float[Array, "n ..."]:
        """Change of positions or velocities of the masses that makes A of it equal to `lack`."""
        return self.inverse_mass_times(self.back(self.dragged(matvec(inertia, lack))))

    def held_and_closed(
        self, hold: Hold, closed: Bool[Array, "contacts ..."]
    ) -> tuple[Bool[Array, "n ..."], Bool[Array, "contacts ..."]]:
        """Flags of masses at rest, where rows name one mass each, and of closed contacts on all other masses."""
        acts_on = self.rows != 0
        held = jnp.any(acts_on & hold.held[:, None], axis=0)
        return held, closed & ~jnp.any(acts_on & held[None], axis=1)
