"""Impact dampers: machines with a free mass inside another."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import as_float
from .._jax.concrete import evaluate_eagerly
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.system import ImpactSystem


@evaluate_eagerly
def impact_damper(
    frequency: ArrayLike,
    amplitude: ArrayLike = 1.0,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 1.0,
    restitution: ArrayLike = 0.6,
    damping_ratio: ArrayLike = 0.0,
    mass_ratio: ArrayLike = 0.1,
) -> ImpactSystem:
    """Build a driven oscillator with a free mass in a container on it: x'' + 2 zeta x' + x = A cos(W t + phase).

    The container keeps |z - x| <= position. The oscillator x has the mass and stiffness 1, the free mass z the mass
    mu. In the steady motion with one impact at each end in a period, half a period T apart, the free mass flies at a
    constant speed w and hits the ends where z = w T / 4; the oscillator is hit at v- = -w (1 - r + 2 mu) / (1 + r)
    and leaves with v+ = v- + 2 mu w.

    Args:
        frequency: angular frequency W of the load; the natural one of the oscillator is 1.
        amplitude: A, a force.
        phase: radians.
        position: half the clearance d: contact 0 keeps z - x <= d, contact 1 x - z <= d. Positive.
        restitution: r of both ends.
        damping_ratio: zeta of the oscillator, a fraction of its critical damping.
        mass_ratio: mu, the free mass.

    Returns:
        The machine; mass 0 is the oscillator, mass 1 the free one.

    Example:
        ```python
        import vijax as vx
        system = vx.models.impact_damper(1.0, 0.1, damping_ratio=0.01)
        sol = vx.simulate(system, 0.0, 200.0)
        ```

    References:
        S. F. Masri, "General motion of impact dampers", J. Acoustical Society of America 47 (1970) 229-237; C. N. Bapat
        and S. Sankar, "Single unit impact damper in free and forced vibration", J. Sound and Vibration 99 (1985) 85-94.
    """
    load = Harmonic([amplitude, 0.0], frequency, [phase, 0.0])
    ends = [
        Contact({1: 1.0, 0: -1.0}, position, restitution),
        Contact({0: 1.0, 1: -1.0}, position, restitution),
    ]
    damping, stiffness = (jnp.diag(jnp.array([a, 0.0])) for a in (2 * as_float(damping_ratio), 1.0))
    return ImpactSystem(jnp.array([1.0, as_float(mass_ratio)]), damping, stiffness, load, ends)
