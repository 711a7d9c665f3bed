"""The bit of a drill string, which sticks, slips and bounces."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import as_float
from .._system.forcing import Harmonic
from .._system.friction import Friction
from .._system.stop import Stop
from .._system.system import ImpactSystem


def drill_bit(
    speed: ArrayLike,
    *,
    frequency: ArrayLike = 1.0,
    amplitude: ArrayLike = 0.0,
    weight: ArrayLike = 1.0,
    coefficient: ArrayLike = 0.5,
    static_coefficient: ArrayLike | None = 1.0,
    lever: ArrayLike = 1.0,
    mass: ArrayLike = 1.0,
    inertia: ArrayLike = 1.0,
    stiffness: ArrayLike = 1.0,
    damping: ArrayLike = 0.0,
    axial_stiffness: ArrayLike = 0.0,
    axial_damping: ArrayLike = 0.0,
    restitution: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a bit on a long drill string, which sticks to the rock, slips, and may bounce.

    Mass 0 is the place z of the bit along the hole, at most 0, the bottom. The weight on the bit and A cos(W t) press it down. Coordinate 1 is
    the angle of the bit less that of the rotary table, which turns at the given speed. Friction of the bottom, as strong as the bit is pressed, acts at
    the lever R: J phi'' + c phi' + k phi = -R T, |T| <= mu N. It is 2/3 of the radius of a flat bit. While the
    bit bounces it turns freely.

    Under a steady weight P and without damping, with D = (mu_s - mu) P R, the bit sticks for 2 D / (k W_0) and slips for 2 sqrt(J / k) (pi - atan(D / (W_0 sqrt(k J)))), W_0
    the speed of the table. It turns at most with W_0 + sqrt(W_0^2 + D^2 / (k J)).

    Args:
        speed: of the rotary table, radians per unit of time.
        frequency: angular frequency W of the load along the hole; three times the speed for a bit with three cones.
        amplitude: A, a force.
        weight: P on the bit, a force.
        coefficient: mu of friction while the bit slips.
        static_coefficient: mu_s of friction while it sticks; mu if None.
        lever: R, a length.
        mass: of the bit and the collars, along the hole.
        inertia: J of the bit and the collars.
        stiffness: k of the string in torsion.
        damping: c in torsion.
        axial_stiffness: of the string along the hole.
        axial_damping: along the hole.
        restitution: of the bit on the bottom.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        system = vx.models.drill_bit(0.3)
        sol = vx.simulate(system, 0.0, 60.0)
        ```

    References:
        A. Kyllingstad and G. W. Halsey, "A study of slip/stick motion of the bit", SPE Drilling Engineering 3 (1988) 369-373.
    """
    pressing, table = as_float(weight), as_float(speed)
    zero = jnp.zeros(())
    load = Harmonic(jnp.stack([as_float(amplitude), zero]), frequency, mean=jnp.stack([pressing, zero]))
    rubbing = Friction(
        {1: lever},
        coefficient=coefficient,
        static_coefficient=static_coefficient,
        contact=0,
        velocity=-as_float(lever) * table,
    )
    return ImpactSystem(
        jnp.stack([as_float(mass), as_float(inertia)]),
        jnp.diag(jnp.stack([as_float(axial_damping), as_float(damping)])),
        jnp.diag(jnp.stack([as_float(axial_stiffness), as_float(stiffness)])),
        load,
        [Stop(0, 0.0, "upper", restitution)],
        friction=[rubbing],
    )
