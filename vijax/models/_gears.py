"""Gears with backlash."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .._system.checks import check_shape
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.system import ImpactSystem


@evaluate_eagerly
def gear_pair(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    torque: ArrayLike = 1.0,
    position: ArrayLike = 0.05,
    restitution: ArrayLike = 0.8,
    inertias: Numbers = (1.0, 1.0),
    radii: Numbers = (1.0, 1.0),
    damping: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a gear that drives another with backlash: |R1 x1 - R2 x2| <= position.

    The angles x1 and x2 are deviations from uniform rotation. The driving gear feels the torque
    M + A cos(W t + phase), the driven one the load -M R2 / R1 that keeps the mean speed. With m = J / R^2 the teeth
    press with (M + A m2 cos(W t + phase) / (m1 + m2)) / R1, if there is no drag: they stay in contact while
    A m2 <= M (m1 + m2), and hammer beyond.

    No torque depends on the common angle of both gears: a motion rotated by a constant is also a motion.
    `vx.periodic_orbit` finds the orbit with the angle of the guess, with a multiplier 1, so `is_stable` is False:
    judge stability by the other multipliers.

    Args:
        frequency: angular frequency W of the varying torque.
        amplitude: A, a torque.
        phase: radians.
        torque: M, the mean torque; 0 for gears that carry no load and rattle.
        position: half the backlash, a length along the line of action. Contact 0 keeps R1 x1 - R2 x2 below it, the
            driving flanks; contact 1 is on the other flanks. Positive.
        restitution: r of both flanks.
        inertias: J, the moments of inertia, (2,).
        radii: R of the base circles, (2,).
        damping: drag on either shaft, torque per angular velocity.

    Returns:
        The machine; mass 0 is the driving gear, mass 1 the driven one.

    Raises:
        ValueError: unless there are two inertias and two radii.

    Example:
        ```python
        import vijax as vx
        system = vx.models.gear_pair(1.0, amplitude=3.0, damping=0.1)
        sol = vx.simulate(system, 0.0, 100.0, x0=[0.05, 0.0])  # the driving flanks closed
        ```

    References:
        K. Karagiannis and F. Pfeiffer, "Theoretical and experimental investigations of gear-rattling", Nonlinear
        Dynamics 2 (1991) 367-387.
    """
    inertia, radius = as_float(inertias), as_float(radii)
    for name, value in (("inertias", inertia), ("radii", radius)):
        check_shape(name, value, (2,))
    load = jnp.stack([as_float(torque), -as_float(torque) * radius[1] / radius[0]])
    varying = Harmonic([amplitude, 0.0], frequency, [phase, 0.0], load)
    flanks = [Contact({0: sign * radius[0], 1: -sign * radius[1]}, position, restitution) for sign in (1, -1)]
    return ImpactSystem(inertia, as_float(damping) * jnp.eye(2), jnp.zeros((2, 2)), varying, flanks)
