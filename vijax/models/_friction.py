"""Machines with dry friction or compliant stops."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PyTree

from .._jax.arrays import as_float
from .._system.base import base_excitation
from .._system.compliant import CompliantContact, CompliantStop
from .._system.forcing import Harmonic
from .._system.friction import Friction
from .._system.system import ImpactSystem


class FrictionLoss(eqx.Module):
    """Constant friction less one that falls with the sliding velocity w: F d w / (1 + d |w|).

    Added to a `vx.Friction` of the force F, it makes the force F / (1 + d |w|). It vanishes while the mass sticks.

    Args:
        force: F.
        weakening: d, the inverse of a velocity.
        velocity: of the surface.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic([0.0], frequency=1.0)
        loss = vx.models.FrictionLoss(1.0, weakening=3.0, velocity=0.2)
        friction = [vx.Friction(0, 1.0, velocity=0.2)]
        system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [], loss, friction)
        ```
    """

    force: Float[Array, "..."] = eqx.field(converter=as_float)
    weakening: Float[Array, "..."] = eqx.field(converter=as_float)
    velocity: Float[Array, "..."] = eqx.field(converter=as_float)

    def __call__(
        self, t: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"], args: PyTree
    ) -> Float[Array, " n"]:
        """Return the forces on the masses at one instant."""
        sliding = self.weakening * (v - self.velocity)
        return self.force * sliding / (1 + jnp.abs(sliding))


def friction_oscillator(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    force: ArrayLike = 1.0,
    static: ArrayLike | None = None,
    velocity: ArrayLike = 0.0,
    weakening: ArrayLike | None = None,
    damping_ratio: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a driven mass on a spring that rubs: x'' + 2 zeta x' + x = A cos(W t + phase) - F sgn(x' - velocity).

    Mass and stiffness are 1. With a belt (`velocity`) it is the model of stick-slip. With `weakening` the friction falls
    with the sliding velocity w as F / (1 + d |w|), and the machine moves by `DiffraxFlow`. On the ground, without damping,
    motions without sticks have the amplitude sqrt((A V)^2 - (F U)^2), V = 1 / (1 - W^2),
    U = sin(pi/W) / (W (1 + cos(pi/W))).

    Args:
        frequency: angular frequency W of the load; the natural one is 1.
        amplitude: A, a force.
        phase: radians.
        force: F, the friction force while the mass slips.
        static: largest friction force while it sticks; F if left out.
        velocity: of the belt; 0 for the ground.
        weakening: d, the inverse of a velocity; a constant friction if left out. F and the velocity then stand in two
            places of the machine, `friction[0]` and `force`.
        damping_ratio: zeta, a fraction of the critical damping.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        system = vx.models.friction_oscillator(0.8, 1.5, damping_ratio=0.05)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        J. P. Den Hartog, "Forced vibrations with combined Coulomb and viscous friction", Trans. ASME APM-53-9 (1931)
        107-115; S. W. Shaw, "On the dynamic response of a system with dry friction", J. Sound and Vibration 108
        (1986) 305-325; with weakening: R. I. Leine, D. H. van Campen, A. de Kraker and L. van den Steen, "Stick-slip
        vibrations induced by alternate friction models", Nonlinear Dynamics 16 (1998) 41-54.
    """
    load = Harmonic([amplitude], frequency, [phase])
    rubbing = Friction(0, force, static, velocity)
    loss = None if weakening is None else FrictionLoss(force, weakening, velocity)
    return ImpactSystem([1.0], [[2 * as_float(damping_ratio)]], [[1.0]], load, [], loss, [rubbing])


def friction_damped_pair(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phases: tuple[ArrayLike, ArrayLike] = (0.0, math.pi),
    force: ArrayLike = 1.0,
    damping_ratio: ArrayLike = 0.0,
    tuning: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build two masses on springs with a friction damper between them, as under the platforms of turbine blades.

    x_i'' + 2 zeta x_i' + k_i x_i = A cos(W t + phase_i) -+ F sgn(x_0' - x_1'), with k_0 = 1 and k_1 = tuning. Equal masses
    driven in phase move as one and lose nothing. Driven in opposite phases, each rubs as on the ground with F: it is
    `friction_oscillator`.

    Args:
        frequency: angular frequency W of the loads; the natural one is 1.
        amplitude: A, a force.
        phases: of both loads, radians.
        force: F of the damper.
        damping_ratio: zeta, a fraction of the critical damping of mass 0.
        tuning: stiffness of the spring of mass 1.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        system = vx.models.friction_damped_pair(0.8, 1.5, damping_ratio=0.05)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        J. H. Griffin, "Friction damping of resonant stresses in gas turbine engine airfoils", ASME J. Engineering for
        Power 102 (1980) 329-333.
    """
    load = Harmonic([amplitude, amplitude], frequency, [*phases])
    springs = jnp.diag(jnp.stack([jnp.ones_like(as_float(tuning)), as_float(tuning)]))
    damping = 2 * as_float(damping_ratio) * jnp.eye(2)
    damper = Friction({0: 1.0, 1: -1.0}, force)
    return ImpactSystem([1.0, 1.0], damping, springs, load, friction=[damper])


def soft_impact_oscillator(
    frequency: ArrayLike,
    amplitude: ArrayLike = 0.7,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 1.26,
    stiffness: ArrayLike = 29.0,
    damping: ArrayLike = 0.0,
    preload: ArrayLike = 0.0,
    damping_ratio: ArrayLike = 0.01,
) -> ImpactSystem:
    """Build a mass on a spring, on a base that shakes by a cos(W t + phase), with a compliant stop.

    x'' + 2 zeta x' + x + N = a W^2 cos(W t + phase), N the force of the stop past x = position. Mass and stiffness are
    1. The steady motion grazes the stop when a W^2 = position |1 - W^2 + 2 i zeta W|.

    Args:
        frequency: angular frequency W of the base; the natural one is 1.
        amplitude: a, a length.
        phase: radians.
        position: of the stop.
        stiffness: of the stop, in stiffnesses of the spring.
        damping: of the stop.
        preload: of the stop.
        damping_ratio: zeta, a fraction of the critical damping.

    Returns:
        The machine; x is relative to the base.

    Example:
        ```python
        import vijax as vx
        system = vx.models.soft_impact_oscillator(0.85)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        J. Ing, E. Pavlovskaia, M. Wiercigroch and S. Banerjee, "Experimental study of impact oscillator with one-sided
        elastic constraint", Phil. Trans. R. Soc. A 366 (2008) 679-704.
    """
    load = base_excitation([1.0], amplitude, frequency, phase)
    stop = CompliantStop(0, position, "upper", stiffness, damping, preload)
    return ImpactSystem([1.0], [[2 * as_float(damping_ratio)]], [[1.0]], load, [stop])


def capsule_robot(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    mass: ArrayLike = 2.5,
    position: ArrayLike = 0.05,
    stiffness: ArrayLike = 15.0,
    friction: ArrayLike = 1.0,
    damping_ratio: ArrayLike = 0.05,
) -> ImpactSystem:
    """Build a capsule that moves over the ground because a mass inside of it vibrates and hits a plate.

    Mass 0, of mass 1, is driven by A cos(W t + phase) and hangs in the capsule on a spring of stiffness 1 and a damper
    2 zeta. Its plate is a compliant contact past x_0 - x_1 = position. Mass 1 is the capsule, which rubs on the ground.
    The load drives mass 0 alone, so the machine drifts: positions grow, and only their difference settles.

    Args:
        frequency: angular frequency W of the load.
        amplitude: A, a force.
        phase: radians.
        mass: mass of the capsule.
        position: gap between the mass and the plate.
        stiffness: of the plate.
        friction: friction force between the capsule and the ground.
        damping_ratio: zeta.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        system = vx.models.capsule_robot(1.05, 1.2, friction=0.6)
        sol = vx.simulate(system, 0.0, 50 * system.forcing.period)
        speed = sol.x1[1] / sol.t1
        ```

    References:
        Y. Liu, M. Wiercigroch, E. Pavlovskaia and H. Yu, "Modelling of a vibro-impact capsule system", Int. J. Mech.
        Sci. 66 (2013) 2-11.
    """
    spring = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
    load = Harmonic([as_float(amplitude), 0.0], frequency, [phase, 0.0])
    plate = CompliantContact({0: 1.0, 1: -1.0}, position, stiffness)
    ground = Friction(1, friction)
    return ImpactSystem(
        jnp.stack([jnp.ones_like(as_float(mass)), as_float(mass)]),
        2 * as_float(damping_ratio) * spring,
        spring,
        load,
        [plate],
        friction=[ground],
    )
