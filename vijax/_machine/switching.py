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
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Reals, append_axes, matrix_product
from .._system.restitution import Restitution
from .._system.system import ImpactSystem
from .._system.waves import Waves, phase_rate
from .contacts import Contacts, Hold
from .small_matrices import inverse_among
from .state import SATURATED, Mode, State

RIGID, COMPLIANT, FRICTION, JENKINS = 0, 1, 2, 3


class Laws(eqx.Module):
    """Force laws of all elements, (contacts,) each; zero where a number is not of the kind of an element.

    Attributes:
        kinds: kind of every element.
        stiffness: k of compliant contacts and Jenkins elements.
        damping: c of compliant contacts.
        preload: F0 of compliant contacts.
        force: F of friction.
        grip: Fs of friction.
        velocity: velocity of the surface under friction.
        reach: largest stretch of Jenkins elements, F / k; None if there are none.
    """

    kinds: tuple[int, ...] = eqx.field(static=True)
    stiffness: Reals
    damping: Reals
    preload: Reals
    force: Reals
    grip: Reals
    velocity: Reals
    reach: Reals | None = None

    @property
    def num_stops(self) -> int:
        """Number of contacts, rigid and compliant, which come before friction."""
        return sum(kind < FRICTION for kind in self.kinds)

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements, which come last."""
        return sum(kind == JENKINS for kind in self.kinds)

    @property
    def has_no_gap(self) -> np.ndarray:
        """Flags of friction and Jenkins elements, which resist velocities."""
        return np.array(self.kinds) >= FRICTION


def laws_of(system: ImpactSystem, of_contacts) -> Laws | None:
    """Laws of the elements of a machine, None if all its contacts are rigid; `of_contacts` makes an array of a list."""
    if not system.is_switching:
        return None
    kinds = [COMPLIANT if stop.is_compliant else RIGID for stop in system.stops]
    kinds += [FRICTION] * len(system.friction) + [JENKINS] * len(system.hysteresis)
    elements = [*system.stops, *system.friction, *system.hysteresis]

    def of(name: str, *own: int) -> Reals:
        pairs = zip(kinds, elements, strict=True)
        return of_contacts([getattr(element, name) if kind in own else 0.0 for kind, element in pairs])

    return Laws(
        kinds=tuple(kinds),
        stiffness=of("stiffness", COMPLIANT, JENKINS),
        **{name: of(name, COMPLIANT) for name in ("damping", "preload")},
        **{name: of(name, FRICTION) for name in ("force", "grip", "velocity")},
        reach=of("reach", JENKINS) if system.hysteresis else None,
    )


class SwitchingContacts(Contacts):
    """Contacts and friction elements of a machine whose forces switch, lanes last."""

    is_switching: ClassVar[bool] = True

    laws: Laws

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
        self.laws = laws

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

    def speeds(self, v: Float[Array, "n ..."], phase_rate: Array) -> Float[Array, "contacts ..."]:
        """Speeds of approach to contacts, and sliding velocities of friction."""
        return self.towards(v, phase_rate) - self.laws.velocity

    def gaps(self, x: Float[Array, "n ..."], phase: Float[Array, "2 harmonics ..."]) -> Array:
        """Gaps of contacts; 1 for elements without, which are never closed."""
        return jnp.where(self.has_no_gap, 1, self.limit - self.towards(x, phase))

    def gap_after(self, gap: Array, held: Array, displacement: Array, change: Array) -> Array:
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
        way = self._by(inverse_among(self.compliance, at_place), lack)
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
        way = self._by(inverse_among(self.compliance, at_place), lack)
        v = v - self.inverse_mass_times(jnp.sum(damping * way[None], axis=1))
        lack = jnp.where(held, self.speeds(v, rate), 0)
        return x + way, v - self._by(inverse_among(self.compliance, held), lack)

    def without_speeds(
        self, v: Float[Array, "n ..."], flags: Bool[Array, "contacts ..."], phase: Array
    ) -> Float[Array, "n ..."]:
        """Velocities without approach or sliding of flagged elements, nearest to v in the metric of M."""
        lack = jnp.where(flags, self.speeds(v, phase_rate(phase, self.frequency)), 0)
        return v - self._by(inverse_among(self.compliance, flags), lack)

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
        return self.back(spring - self._rubbing(mode))

    def _rubbing(self, mode: Mode) -> Float[Array, "contacts ..."]:
        """Forces T of friction that does not hold: of slip, and at the bound of the grip where others keep it at rest."""
        return jnp.sign(mode.direction) * jnp.where(
            jnp.abs(mode.direction) == SATURATED, self.laws.grip, self.laws.force
        )

    def matrices_of(self, closed: Bool[Array, "contacts ..."]) -> tuple[Array, Array]:
        """Stiffness and damping that closed compliant contacts add, (n, n) each."""
        back = jnp.swapaxes(self.rows, 0, 1)
        weights = (jnp.where(closed, a, 0) for a in (self.laws.stiffness, self.laws.damping))
        stiffness, damping = (matrix_product(back, a[:, None] * self.rows) for a in weights)
        return stiffness, damping

    def sticking_rows(self, direction: Int[Array, "contacts ..."]) -> Bool[Array, "n ..."]:
        """Flags of coordinates, without those of the stretches of Jenkins elements that slip."""
        num, n = self.num_sliders, self.rows.shape[1]
        sticks = direction[self.num - num :] == 0
        return jnp.concatenate([jnp.ones((n - num, *sticks.shape[1:]), bool), sticks])

    def held_and_closed(
        self, hold: Hold, closed: Bool[Array, "contacts ..."]
    ) -> tuple[Bool[Array, "n ..."], Bool[Array, "contacts ..."]]:
        """Flags of masses at rest, where rows name one mass each, and of closed contacts on all other masses."""
        acts_on = self.rows != 0
        held = jnp.any(acts_on & hold.held[:, None], axis=0)
        return held, closed & ~jnp.any(acts_on & held[None], axis=1)
