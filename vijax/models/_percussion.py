"""Machines that work by blows: drills, energy harvesters."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import as_float
from .._system.base import base_excitation
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.friction import Friction
from .._system.stop import Stop
from .._system.system import ImpactSystem


def percussive_drill(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    mass: ArrayLike = 1.0,
    thrust: ArrayLike = 0.3,
    resistance: ArrayLike = 1.0,
    clearance: ArrayLike = 0.1,
    restitution: ArrayLike = 0.6,
    stiffness: ArrayLike = 1.0,
    damping_ratio: ArrayLike = 0.05,
) -> ImpactSystem:
    """Build a hammer that drives a bit into rock.

    Mass 0 is the hammer, of mass 1, driven by A cos(W t + phase), on a spring of the given stiffness and a damper 2 zeta
    to the bit. It hits the bit where x_0 - x_1 = clearance. Mass 1 is the bit, pushed forward by the thrust P. The rock resists
    as dry friction R > P. So the bit advances by blows alone: one that leaves it with the velocity V drives it by
    m V^2 / (2 (R - P)), if the spring is soft.

    Args:
        frequency: angular frequency W of the drive.
        amplitude: A, a force.
        phase: radians.
        mass: m of the bit.
        thrust: P, the static force on the bit.
        resistance: R, the force of the rock.
        clearance: between hammer and bit at rest.
        restitution: of the blow.
        stiffness: of the spring between hammer and bit.
        damping_ratio: zeta.

    Returns:
        The machine. It drifts: its positions grow.

    Example:
        ```python
        import vijax as vx
        system = vx.models.percussive_drill(0.9, 0.8)
        sol = vx.simulate(system, 0.0, 50 * system.forcing.period)
        rate = sol.x1[1] / sol.t1  # of penetration
        ```

    References:
        E. Pavlovskaia, M. Wiercigroch and C. Grebogi, "Modeling of an impact system with a drift", Phys. Rev. E 64 (2001)
        056224, with a massless bit.
    """
    m, zero, one = as_float(mass), 0.0 * as_float(amplitude), jnp.ones_like(as_float(mass))
    between = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
    load = Harmonic([as_float(amplitude), zero], frequency, [phase, 0.0], [0.0, thrust])
    return ImpactSystem(
        jnp.stack([one, m]),
        2 * as_float(damping_ratio) * between,
        as_float(stiffness) * between,
        load,
        [Contact({0: 1.0, 1: -1.0}, clearance, restitution)],
        friction=[Friction(1, resistance)],
    )


def vibro_impact_harvester(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    mass: ArrayLike = 1.0,
    travel: ArrayLike = 2.0,
    restitution: ArrayLike = 0.5,
    inclination: ArrayLike = 0.0,
    gravity: ArrayLike = 9.81,
) -> ImpactSystem:
    """Build a ball in a shaken cylinder whose ends, membranes, turn its blows into electric energy.

    Relative to the cylinder, y(t) = a cos(W t + phase) along its axis: m x'' = -m y'' - m g sin(inclination),
    abs(x) <= travel / 2. A blow at the relative velocity u takes m (1 - r^2) u^2 / 2 out of the motion, the quantity
    "dissipated_energy" of a sweep. In a horizontal cylinder it is an `impact_pair`, whose docstring has the motion with a
    blow at each end.

    Args:
        frequency: angular frequency W of the cylinder.
        amplitude: a, a length.
        phase: radians.
        mass: m of the ball.
        travel: free path of the ball.
        restitution: r of both ends.
        inclination: of the axis against the horizontal, radians; the lower end is stop 1.
        gravity: g, an acceleration.

    Returns:
        The machine; x is relative to the middle of the cylinder.

    Example:
        ```python
        import vijax as vx
        system = vx.models.vibro_impact_harvester(5.0, 0.6, inclination=0.2)
        ds = vx.sweep(system, {"forcing.frequency": [5.0, 6.0]}, quantities=["dissipated_energy"], progress=False)
        ```

    References:
        D. Yurchenko, D. V. Val, Z. H. Lai, G. Gu and G. Thomson, "Energy harvesting from a DE-based dynamic vibro-impact
        system", Smart Materials and Structures 26 (2017) 105001.
    """
    m, half = as_float(mass), as_float(travel) / 2
    weight = -m * as_float(gravity) * jnp.sin(as_float(inclination))
    load = base_excitation(m[None], amplitude, frequency, phase, weight[None])
    stops = [Stop(0, half, "upper", restitution), Stop(0, -half, "lower", restitution)]
    return ImpactSystem(m[None], [[0.0]], [[0.0]], load, stops)
