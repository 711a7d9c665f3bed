"""Machines that work by blows: drills, energy harvesters."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .._system.base import base_excitation
from .._system.checks import check_shape
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.friction import Friction
from .._system.stop import Stop
from .._system.system import ImpactSystem
from .._system.tabulated import Tabulated


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


@evaluate_eagerly
def drop_hammer(
    pulse: ArrayLike = 30.0,
    duration: ArrayLike = 0.2,
    *,
    drop: ArrayLike = 1.0,
    masses: Numbers = (1.0, 20.0),
    stiffness: ArrayLike = 2000.0,
    damping_ratio: ArrayLike = 0.1,
    restitution: ArrayLike = 0.3,
    gravity: ArrayLike = 9.81,
) -> ImpactSystem:
    """Build a hammer whose ram is thrown down on an anvil by a pulse.

    Mass 0 is the ram, which falls under its weight and a constant force over the duration T of the pulse. Mass 1 is the
    anvil on the spring and the damper of its foundation. Positions point downwards, from the raised ram and from the anvil
    at rest under its own weight. The blow comes where x_0 - x_1 = drop. With the force P the ram has, after the time T,
    the velocity u = (P / m + g) T and the way u T / 2; the rest of the way it falls. A blow at the
    relative velocity v loses (1 - r^2) m_0 m_1 v^2 / (2 (m_0 + m_1)), the work on the piece.

    Args:
        pulse: P, a force on the ram.
        duration: T of the pulse, from time 0.
        drop: way of the ram to the anvil.
        masses: of ram and anvil, (2,).
        stiffness: k of the foundation.
        damping_ratio: zeta of the anvil on it.
        restitution: r of the blow; small for hot pieces.
        gravity: g, an acceleration.

    Returns:
        The machine, which starts at rest: `vx.simulate(system, 0.0, t1)`, `vx.sweep(..., duration=t1)`.

    Raises:
        ValueError: unless there are two masses.

    Example:
        ```python
        import vijax as vx
        system = vx.models.drop_hammer()
        values = {"stops[0].restitution": [0.2, 0.4, 0.6]}
        ds = vx.sweep(system, values, duration=3.0, quantities=["max_position"])
        ```

    References:
        D. D. Barkan, Dynamics of Bases and Foundations (1962), Ch. V.
    """
    mass, k = as_float(masses), as_float(stiffness)
    check_shape("masses", mass, (2,))
    push = jnp.stack([as_float(pulse), jnp.zeros(())])
    load = Tabulated(jnp.stack([jnp.zeros(()), as_float(duration)]), jnp.stack([push, push]), kind="previous")
    weight = Harmonic([0.0, 0.0], 0.0, mean=jnp.stack([mass[0] * as_float(gravity), jnp.zeros(())]))
    of_anvil = jnp.array([[0.0, 0.0], [0.0, 1.0]])
    damping = 2 * as_float(damping_ratio) * jnp.sqrt(k * mass[1])
    contact = Contact({0: 1.0, 1: -1.0}, drop, restitution)
    return ImpactSystem(mass, damping * of_anvil, k * of_anvil, load + weight, [contact])
