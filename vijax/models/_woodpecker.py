"""The woodpecker toy."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import as_float
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.friction import Friction
from .._system.system import ImpactSystem


def woodpecker(
    *,
    coefficient: ArrayLike = 0.3,
    restitution: ArrayLike = 0.5,
    sleeve_restitution: ArrayLike = 0.0,
    stiffness: ArrayLike = 5.6e-3,
    gravity: ArrayLike = 9.81,
    sleeve_mass: ArrayLike = 3e-4,
    sleeve_inertia: ArrayLike = 5e-9,
    mass: ArrayLike = 4.5e-3,
    inertia: ArrayLike = 7e-7,
    pole_radius: ArrayLike = 2.5e-3,
    sleeve_radius: ArrayLike = 3.1e-3,
    sleeve_height: ArrayLike = 5.8e-3,
    to_spring: ArrayLike = 0.01,
    to_bird: ArrayLike = 0.015,
    beak_height: ArrayLike = 0.02,
    beak_length: ArrayLike = 0.0201,
) -> ImpactSystem:
    """Build the toy of a woodpecker that hacks its way down a pole, in SI units.

    A sleeve on the pole carries the bird on a spring. Coordinates are the height y of the sleeve, its angle phi_M and the angle
    phi_S of the bird, both small. Stop 0 is the beak on the pole, stops 1 and 2 are the upper and the lower edge of the sleeve; friction 0 to 2
    acts there along the pole. The bird swings, the sleeve jams and lets go twice a cycle, and the toy falls by some 19 mm.

    Args:
        coefficient: of friction of all contacts.
        restitution: of the beak.
        sleeve_restitution: of the sleeve.
        stiffness: c of the spring between the angles, N m.
        gravity: g.
        sleeve_mass: m_M.
        sleeve_inertia: J_M.
        mass: m_S of the bird.
        inertia: J_S of the bird.
        pole_radius: r_0.
        sleeve_radius: r_M, inner radius of the sleeve.
        sleeve_height: h_M, half of it.
        to_spring: l_M, from the pole to the spring.
        to_bird: l_G, from the spring to the centre of the bird.
        beak_height: h_S, height of the beak above the spring.
        beak_length: l_S, from the beak to the centre of the bird.

    Returns:
        The machine. It falls: y goes on and on.

    Example:
        ```python
        import vijax as vx
        toy = vx.models.woodpecker()
        sol = vx.simulate(toy, 0.0, 1.0, [0.0, -0.1034, -0.2788], [-0.3411, 0.0, -7.4583])
        ```

    References:
        C. Glocker, Dynamik von Starrkoerpersystemen mit Reibung und Stoessen, VDI (1995); R. I. Leine, C. Glocker & D. H. van Campen,
        Nonlinear dynamics of the woodpecker toy, DETC2001/VIB-21608 (2001).
    """
    m_sleeve, m, c, g = (as_float(a) for a in (sleeve_mass, mass, stiffness, gravity))
    l_m, l_g, h_m, r_m = (as_float(a) for a in (to_spring, to_bird, sleeve_height, sleeve_radius))
    zero = 0.0 * m
    inertia_matrix = jnp.array(
        [
            [m + m_sleeve, m * l_m, m * l_g],
            [m * l_m, sleeve_inertia + m * l_m**2, m * l_m * l_g],
            [m * l_g, m * l_m * l_g, inertia + m * l_g**2],
        ]
    )
    spring = c * jnp.array([[0.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]])
    weight = jnp.stack([-(m + m_sleeve) * g, -m * g * l_m, -m * g * l_g])
    clearance = r_m - pole_radius
    beak = l_m + l_g - as_float(beak_length) - pole_radius
    stops = [
        Contact({2: beak_height}, beak, restitution),
        Contact({1: -h_m}, clearance, sleeve_restitution),
        Contact({1: h_m}, clearance, sleeve_restitution),
    ]
    tangents = [{0: 1.0, 1: l_m, 2: l_g - as_float(beak_length)}, {0: 1.0, 1: r_m}, {0: 1.0, 1: r_m}]
    return ImpactSystem(
        inertia_matrix,
        jnp.zeros((3, 3)) + zero,
        spring,
        Harmonic(jnp.zeros(3), 0.0, mean=weight),
        stops,
        friction=[Friction(row, coefficient=coefficient, contact=k) for k, row in enumerate(tangents)],
    )
