"""Machines that jump on pistons driven by a crankshaft."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.system import ImpactSystem


@evaluate_eagerly
def multi_piston(
    frequency: ArrayLike = 1.0,
    amplitudes: Numbers = (0.12, 0.24),
    *,
    phases: Numbers = (0.0, -0.2),
    positions: Numbers = (0.005, 0.005),
    mass_ratios: Numbers = (0.2, 0.2),
    restitution: ArrayLike = 0.5,
    gravity: ArrayLike = 0.13,
) -> ImpactSystem:
    """Build a casing that jumps on pistons: x >= position_i + a_i cos(W t + phase_i) for each piston i.

    The crankshaft of the casing drives the pistons. The casing falls by its weight and feels the inertia of its
    pistons, x'' = -g - W^2 sum_i lambda_i a_i cos(W t + phase_i). Each time the lowest piston strikes the ground the
    casing is thrown up, and comes down on another piston.

    Args:
        frequency: angular frequency W of the crankshaft.
        amplitudes: a, the amplitudes of the pistons, (pistons,).
        phases: radians, of their cranks, (pistons,).
        positions: heights of the casing at which a piston in its mean position touches the ground, (pistons,).
        mass_ratios: lambda, the masses of the pistons divided by the mass of the machine, (pistons,).
        restitution: r of all pistons.
        gravity: g, an acceleration.

    Returns:
        The machine of mass 1; x is the height of the casing, contact i piston i.

    Raises:
        ValueError: if the arguments give different numbers of pistons.

    Example:
        ```python
        import numpy as np, vijax as vx
        machine = vx.models.multi_piston(gravity=0.134)
        sol = vx.simulate(machine, 0.0, 400.0, x0=[0.3])
        ```

    References:
        L. A. Igumnov, V. S. Metrikin and I. V. Nikiforova, "The dynamics of eccentric vibration mechanism (Part 1)",
        J. Vibroengineering 19 (2017) 4854-4865.
    """
    travel = as_float(amplitudes)
    each = {
        "phases": as_float(phases),
        "positions": as_float(positions),
        "mass_ratios": as_float(mass_ratios),
    }
    for name, value in each.items():
        if travel.ndim != 1 or value.shape != travel.shape:
            raise ValueError(
                f"Argument `{name}` must give one number for each of `amplitudes`, which have shape {travel.shape}, but has "
                f"shape {value.shape}."
            )
    angle, place, share = each.values()
    w2 = as_float(frequency) ** 2
    cosine, sine = (-w2 * jnp.sum(share * travel * turned(angle)) for turned in (jnp.cos, jnp.sin))
    load = Harmonic([jnp.hypot(cosine, sine)], frequency, [jnp.arctan2(sine, cosine)], [-as_float(gravity)])
    pistons = [
        Contact({0: -1.0}, -place[i], restitution, Harmonic([-travel[i]], frequency, [angle[i]]))
        for i in range(len(travel))
    ]
    return ImpactSystem([1.0], [[0.0]], [[0.0]], load, pistons)
