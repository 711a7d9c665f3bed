"""Machines that run backwards in time, and the stroboscopic map of many states, forwards and backwards.

With t to -t and v to -v, M x'' + C x' + K x = f(t) becomes the same machine with damping -C and the load f(-t), and an impact
u+ = -r u- becomes one with restitution 1/r. No stop may have these numbers, so the checks of its constructor are avoided; the
engine follows it all the same: a chatter whose bounces grow is never completed. Newton's method on the map forwards was the
alternative: it needs a guess near every preimage, and fails where the map has corners.

There is no inverse where r = 0, and where a mass sticks: many motions become one. Backwards the machine does not find them, but
finds some other motion, or bounces ever faster. So every state before is checked by the map forwards.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from .._flow.interface import AbstractFlow
from .._jax.xla import compile_lightly
from .._orbits.maps import monodromy_matrix, stroboscopic_map
from .._orbits.orbit import PeriodicOrbit
from .._system.compliant import AbstractCompliantLimit
from .._system.contact import AbstractRigidLimit
from .._system.force import BoundForce, force_of
from .._system.forcing import Harmonic
from .._system.restitution import AbstractRestitution
from .._system.system import AnySystem, ImpactSystem, machine_of

# Bound on the steps of a forcing period, forwards and backwards, where impacts may accumulate without end.
_STEPS = {1: 100_000, -1: 1000}
# States are computed so many at once, so that one program serves all calls.
BATCH = 128


class ReversedForce(eqx.Module):
    """A force as it acts while the machine runs backwards."""

    force: Callable

    def __call__(self, t: Array, x: Array, v: Array, args: PyTree) -> Array:
        return self.force(-t, x, -v, args)


def no_inverse(system: AnySystem) -> str:
    """Reason why the motion of a machine cannot be reversed; empty if it can, but for motions that stick."""
    if not isinstance(system.forcing, Harmonic):
        return "its load is not a single `vx.Harmonic`, of which alone the reversed one is known"
    if system.friction:
        return "friction brings many motions to rest alike"
    if system.hysteresis:
        return "Jenkins elements that slip forget where they began"
    for j, stop in enumerate(system.stops):
        law = stop.restitution if isinstance(stop, AbstractRigidLimit) else 1.0
        if isinstance(law, AbstractRestitution):
            return f"the restitution of `stops[{j}]` depends on the speed of impact, and is reversed only where it is a number"
        if not np.all(np.asarray(law) > 0):
            return f"an impact on `stops[{j}]`, of restitution 0, ends alike whatever its speed"
        if isinstance(stop, AbstractCompliantLimit) and np.any(np.asarray(stop.damping) > 0):
            return f"the damper of `stops[{j}]` lets go before the stop is left, and meets it at once when it is hit"
    return ""


def reversed_machine(system: ImpactSystem) -> ImpactSystem:
    """The machine backwards in time, with velocities and phases of the opposite sign."""
    stops = [j for j, stop in enumerate(system.stops) if isinstance(stop, AbstractRigidLimit)]
    cushions = [j for j, stop in enumerate(system.stops) if stop.is_compliant]
    moving = [j for j, stop in enumerate(system.stops) if stop.motion is not None]

    def places(s: ImpactSystem) -> list[Any]:
        signed = [s.damping, s.forcing.phase]
        signed += [s.stops[j].damping for j in cushions] + [s.stops[j].motion.phase for j in moving]  # pyright: ignore
        return signed + [s.stops[j].restitution for j in stops]  # pyright: ignore

    old = places(system)
    count = len(old) - len(stops)
    other = eqx.tree_at(places, system, [-a for a in old[:count]] + [1 / a for a in old[count:]])
    force = force_of(system)
    if force is None:
        return other
    new = (
        BoundForce(ReversedForce(force.force), force.args)
        if isinstance(force, BoundForce)
        else ReversedForce(force)
    )
    return eqx.tree_at(lambda s: s.force, other, new)


class StateMap(NamedTuple):
    """Stroboscopic map of many states (W x, v) of one machine over one forcing period, or its inverse.

    Attributes:
        system: the machine, or the reversed one.
        sign: 1 forwards, -1 backwards.
        phase: phase of the load at the states, in radians.
        scale: factors that turn states (x, v) into (W x, v), (2 n,).
        flow: as for `simulate`.
        args: likewise.
    """

    system: ImpactSystem
    sign: int
    phase: Float[Array, ""]
    scale: np.ndarray
    flow: AbstractFlow | None
    args: object

    @classmethod
    def of_orbit(cls, orbit: PeriodicOrbit, sign: int) -> "StateMap":
        """The map at the phase of an orbit."""
        own = machine_of(orbit.system)
        system = own if sign > 0 else reversed_machine(own)
        rate = np.asarray(system.forcing.frequency)
        scale = np.repeat(np.array([float(rate), 1.0]), system.num_coordinates)
        return cls(system, sign, sign * orbit.phase, scale, orbit.flow, orbit.args)

    def __call__(self, z: np.ndarray, num_periods: int) -> np.ndarray:
        """States a number of forcing periods later, or earlier, (points, 2 n); NaN where there are none."""
        factors = self.scale * np.repeat([1.0, self.sign], len(self.scale) // 2)
        most, count = jnp.asarray(_STEPS[self.sign]), jnp.asarray(num_periods)
        ends = []
        for part in np.split(z, range(BATCH, len(z), BATCH)) if len(z) else []:
            full = np.resize(part, (BATCH, z.shape[1])) / factors
            states = _many(self.system, full, count, self.phase, most, self.flow, self.args)
            ends.append(np.asarray(states)[: len(part)] * factors)
        return np.concatenate(ends) if ends else np.array(z, float)

    def derivative(self, z: np.ndarray, num_periods: int) -> np.ndarray:
        """Derivative of the map forwards over some forcing periods at a state, (2 n, 2 n)."""
        state = jnp.asarray(z / self.scale)
        matrix = _derivative(self.system, state, self.phase, self.flow, self.args, num_periods)
        return np.asarray(matrix) * self.scale[:, None] / self.scale


@compile_lightly
def _many(
    system: ImpactSystem,
    states: ArrayLike,
    num_periods: Array,
    phase: Array,
    most: Array,
    flow: AbstractFlow | None,
    args: object,
) -> Float[Array, "points state"]:
    """States (x, v) after some forcing periods; one period after another, so that no time grows."""

    def of_one(z: Float[Array, " state"]) -> Float[Array, " state"]:
        x, v = jnp.split(z, 2)
        ends = stroboscopic_map(system, x, v, phase=phase, flow=flow, args=args, max_steps=most, throw=False)
        return jnp.concatenate(ends)

    return jax.lax.fori_loop(0, num_periods, lambda _, z: jax.vmap(of_one)(z), jnp.asarray(states))


@compile_lightly
def _derivative(
    system: ImpactSystem,
    state: Float[Array, " state"],
    phase: Array,
    flow: AbstractFlow | None,
    args: object,
    num_periods: int,
) -> Float[Array, "state state"]:
    """Derivative of states (x, v) after some forcing periods."""
    x, v = jnp.split(state, 2)
    return monodromy_matrix(system, x, v, num_periods, phase=phase, flow=flow, args=args, throw=False)
