"""Region S of the phase space in which stops hold masses, and its exit boundary dS.

With some masses held, the motion continues in the reduced phase space of the others. There the contact force of each
holding stop p is linear,

    lam_p = a_p . x + b_p . v - c_p(phase),

so S = {every lam_p > 0} is an intersection of half spaces that the load shifts. Only the exit boundary
dS = {lam_p = 0, lam_p' < 0} has a formula; the point of entry depends on the chatter before. With lam_p = 0 and
lam_p' > 0 a motion enters S, as from a start at rest on the stop.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Numbers, as_float
from .._machine.derivatives import derivatives
from .._machine.first_state import state_before_contact
from .._machine.machine import Machine
from .._machine.numbers import numbers_of
from .._machine.preparation import prepare
from .._system.forcing import Harmonic
from .._system.system import AnySystem, machine_of, with_args
from .._system.waves import phase_at
from .sticking import is_pressed

_NOT_LINEAR = (
    "The sticking region is known for linear machines alone, but this one has a `force` or parametric terms: look "
    "for its releases in the log of `vx.simulate` instead."
)


class StickingRegion(eqx.Module):
    """Region S of the phase space of the free masses, while stops hold the others.

    Its functions take the phase W t of the forcing in radians, any shape, and positions and velocities of the free
    masses, in the order of `free`, as last axis: (..., free). They broadcast.

    Attributes:
        held: the stops that hold their masses.
        held_masses: those masses.
        free: the masses that no stop holds, in ascending order.

    References:
        Wagg & Bishop (2004), Secs. 2.3 and 4.6.2.
    """

    machine: Machine
    held: tuple[int, ...] = eqx.field(static=True)
    held_masses: tuple[int, ...] = eqx.field(static=True)
    free: tuple[int, ...] = eqx.field(static=True)

    def __init__(self, machine: Machine, held: tuple[int, ...], held_masses: tuple[int, ...] | None = None):
        if machine.extra is not None:
            raise ValueError(_NOT_LINEAR)
        self.machine, self.held = machine, held
        # Not available from a traced machine, so passed in.
        self.held_masses = held_masses or tuple(machine.contacts.masses[j] for j in held)
        self.free = tuple(i for i in range(machine.num_masses) if i not in self.held_masses)

    @property
    def x_normal(self) -> Float[Array, "held free"]:
        """Derivatives a of the contact forces by the positions of the free masses, (held, free)."""
        return self._normal(self.machine.stiffness)

    @property
    def v_normal(self) -> Float[Array, "held free"]:
        """Derivatives b of the contact forces by the velocities of the free masses, (held, free)."""
        return self._normal(self.machine.damping)

    def level(self, phase: Numbers) -> Float[Array, "... held"]:
        """Bounds c of the half spaces a . x + b . v >= c: minus the contact force with x = v = 0.

        Args:
            phase: W t in radians, any shape.

        Returns:
            c, the shape of `phase` and then (held,).
        """
        origin = jnp.zeros(len(self.free), self.machine.contacts.position.dtype)
        return -self.contact_force(phase, origin, origin)

    def contact_force(self, phase: Numbers, x: Numbers, v: Numbers) -> Float[Array, "... held"]:
        """Force with which each held mass is pressed onto its stop; negative outside S.

        Args:
            phase: W t in radians.
            x: positions of the free masses, (..., free).
            v: velocities of the free masses, likewise.

        Returns:
            lam, (..., held).

        Example:
            ```python
            import vijax as vx
            region = vx.sticking_region(vx.models.wagg_bishop_b(0.2), held=1)
            force = region.contact_force(0.0, [0.2], [0.5])  # 0.2 + 0.1 * 0.5 - 0.1
            ```

        References:
            Wagg & Bishop (2004), Eqs. 19-20.
        """
        return self._derivatives(phase, x, v)[0]

    def contact_force_rate(self, phase: Numbers, x: Numbers, v: Numbers) -> Float[Array, "... held"]:
        """Time derivative of `contact_force` along the motion of the free masses.

        Where the force is zero, its sign shows that the mass leaves (-) or is pressed again (+).

        Args:
            phase: W t in radians.
            x: positions of the free masses, (..., free).
            v: velocities of the free masses, likewise.

        Returns:
            lam', (..., held).

        References:
            Wagg & Bishop (2004), Eqs. 18-20.
        """
        return self._derivatives(phase, x, v)[1]

    def contains(self, phase: Numbers, x: Numbers, v: Numbers) -> Bool[Array, "..."]:
        """Test whether all held masses stay held: where a force is exactly zero, its derivatives decide.

        Args:
            phase: W t in radians.
            x: positions of the free masses, (..., free).
            v: velocities of the free masses, likewise.

        Returns:
            True in S, False outside and on its exit boundary.
        """
        force, *later = self._derivatives(phase, x, v)
        return jnp.all(is_pressed(force, tuple(later)), axis=-1)

    def _derivatives(self, phase: Numbers, x: Numbers, v: Numbers) -> tuple[Array, Array, Array]:
        """Contact forces and their first two derivatives, (..., held) each."""
        phase, x, v = as_float(phase), as_float(x), as_float(v)
        for name, value in (("x", x), ("v", v)):
            if value.ndim == 0 or value.shape[-1] != len(self.free):
                raise ValueError(
                    f"Argument `{name}` must have shape (..., {len(self.free)}), one value for each of the "
                    f"free masses {self.free}, but has shape {value.shape}."
                )
        batch = jnp.broadcast_shapes(phase.shape, x.shape[:-1], v.shape[:-1])
        x, v = (jnp.broadcast_to(a, (*batch, len(self.free))) for a in (x, v))
        phase = jnp.broadcast_to(phase, batch)
        return self._compiled(phase, x, v)

    @eqx.filter_jit
    def _compiled(self, phase: Array, x: Array, v: Array) -> tuple[Array, Array, Array]:
        signature = "(),(free),(free)->(held),(held),(held)"
        return jnp.vectorize(self._derivatives_of_one, signature=signature)(phase, x, v)

    def _derivatives_of_one(
        self, phase: Float[Array, ""], x: Float[Array, " free"], v: Float[Array, " free"]
    ) -> tuple[Array, Array, Array]:
        """Contact forces and their derivatives at one point, (held,) each."""
        machine, waves = self.machine, phase_at(phase, self.machine.waves.num_harmonics)
        held, free = (jnp.asarray(i, int) for i in (self.held_masses, self.free))
        origin = jnp.zeros_like(machine.mean)
        whole_x, whole_v = machine.relative_to_stops(waves, origin.at[free].set(x), origin.at[free].set(v))
        whole_x = whole_x.at[held].set(machine.contacts.position[jnp.asarray(self.held)])
        whole_v = whole_v.at[held].set(0)
        is_held = jnp.zeros(origin.shape, bool).at[held].set(True)
        open_contacts = jnp.zeros(machine.contacts.num, bool)
        state = state_before_contact(machine, waves, whole_x, whole_v, open_contacts)
        now = derivatives(machine, state, is_held)
        force, rate, curvature = map(self._towards_stops, (now.force, now.force_rate, now.force_curvature))
        return force, rate, curvature

    def _normal(self, matrix: Float[Array, "n n"]) -> Float[Array, "held free"]:
        """Contact forces at the holding stops from unit motions of the free masses, by `matrix`."""
        return jax.vmap(self._towards_stops, 1, 1)(-matrix[:, jnp.asarray(self.free, int)])

    def _towards_stops(self, of_masses: Float[Array, " n"]) -> Float[Array, " held"]:
        """Entries of a vector over masses at the holding stops, positive towards them."""
        return self.machine.contacts.along(of_masses)[jnp.asarray(self.held)]


def sticking_region(system: AnySystem, held: int | Sequence[int]) -> StickingRegion:
    """Build the sticking region S, in which stops hold masses while the others move.

    The masses at the stops `held` are at rest. S is the set of positions x and velocities v of the free masses at which
    every contact force is positive, a . x + b . v > c(phase). A motion leaves S on its exit boundary dS, where a
    contact force falls through zero.

    Args:
        system: the machine, a linear one.
        held: index of the stop that holds its mass, or indices of several stops, each with a mass of its own.

    Returns:
        The region; see `vx.StickingRegion`.

    Raises:
        ValueError: if `held` names no stop, one that does not exist, or two of the same mass, or if the
            machine has a `force`, parametric terms, or elements or contacts that couple what is held with the rest.

    Example:
        ```python
        import vijax as vx
        region = vx.sticking_region(vx.models.wagg_bishop_b(0.2), held=1)
        a, b, c = region.x_normal, region.v_normal, region.level(0.0)
        # dS: a x + b v = c, which is v = -10 x + 1
        ```

    References:
        Wagg & Bishop (2004), Eqs. 18-20, Sec. 4.6.2, Fig. 12.
    """
    system = machine_of(system)
    if system.force is not None:
        raise ValueError(_NOT_LINEAR)
    stops = (held,) if isinstance(held, int | np.integer) else tuple(held)
    if not stops:
        raise ValueError("Argument `held` is empty: name the stops that hold their masses.")
    for j in stops:
        if not 0 <= j < system.num_stops:
            raise ValueError(
                f"Argument `held` names stop {j}, but the machine has {system.num_stops} stops, counted from 0."
            )
    if system.is_coupled:
        raise ValueError(
            "The sticking region lies in the phase space of masses that stay free while others rest on their stops. In "
            "this machine, with contacts, friction, Jenkins elements, compliant stops, a full mass matrix, or two stops of one mass "
            "that move differently, what is held may be a combination of masses, all of which go on moving, and forces "
            "depend on more than positions and velocities. `Solution.contact_force` has them along any motion."
        )
    masses = [slot[0] for slot in (system.stops[j].slot for j in stops) if slot]
    if len(set(masses)) < len(masses):
        raise ValueError(
            f"Argument `held` must name one stop of a mass, but stops {list(stops)} are of masses {masses}."
        )
    if not isinstance(system.forcing, Harmonic):
        raise ValueError(
            "The sticking region is that of a load by one `vx.Harmonic`: `Solution.contact_force` has the forces along a motion "
            "under any load."
        )
    system = with_args(system, None)
    one, rest = jnp.ones((), system.mass.dtype), jnp.zeros(system.num_masses, system.mass.dtype)
    machine = prepare(numbers_of(system), one, (0 * one, rest, rest), can_stick=True)
    return StickingRegion(machine, tuple(int(j) for j in stops), tuple(masses))
