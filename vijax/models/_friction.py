"""Machines with dry friction or compliant stops."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import as_float
from .._system.base import base_excitation
from .._system.compliant import CompliantContact, CompliantStop
from .._system.forcing import Harmonic
from .._system.friction import Friction
from .._system.system import ImpactSystem


def friction_oscillator(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    force: ArrayLike = 1.0,
    static: ArrayLike | None = None,
    velocity: ArrayLike = 0.0,
    damping_ratio: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a driven mass on a spring that rubs: x'' + 2 zeta x' + x = A cos(W t + phase) - F sgn(x' - velocity).

    Mass and stiffness are 1. With a belt (`velocity`) it is the model of stick-slip. On the ground, without damping,
    motions without sticks have the amplitude sqrt((A V)^2 - (F U)^2), V = 1 / (1 - W^2),
    U = sin(pi/W) / (W (1 + cos(pi/W))).

    Args:
        frequency: angular frequency W of the load; the natural one is 1.
        amplitude: A, a force.
        phase: radians.
        force: F, the friction force while the mass slips.
        static: largest friction force while it sticks; F if left out.
        velocity: of the belt; 0 for the ground.
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
        (1986) 305-325.
    """
    load = Harmonic([amplitude], frequency, [phase])
    rubbing = Friction(0, force, static, velocity)
    return ImpactSystem([1.0], [[2 * as_float(damping_ratio)]], [[1.0]], load, friction=[rubbing])


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
