"""Machines whose load turns or shakes with its frequency, as families: one value moves frequency and amplitude of the load."""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from .._system.base import base_excitation
from .._system.family import Family
from .._system.forcing import Harmonic
from .._system.load import AbstractLoad
from .._system.stop import Stop
from .._system.system import ImpactSystem


def unbalanced_rotor(
    frequency: ArrayLike = 0.8,
    *,
    eccentricity: ArrayLike = 0.01,
    clearance: ArrayLike = 0.02,
    damping_ratio: ArrayLike = 0.05,
    restitution: ArrayLike = 0.7,
) -> Family:
    """Build a rotor with unbalance beside a stop, as a family.

    A shaft of unit mass and stiffness turns with the speed W. Its centre of mass is off by e, so in one direction
    x'' + 2 zeta x' + x = e W^2 cos(W t), x <= clearance. Without impacts the amplitude is
    e W^2 / sqrt((1 - W^2)^2 + (2 zeta W)^2): it is e far above the resonance, where that of a constant load would vanish.

    Args:
        frequency: W, the speed of the shaft by its natural frequency.
        eccentricity: e, a length.
        clearance: from the shaft at rest to the stop.
        damping_ratio: zeta.
        restitution: of the stop.

    Returns:
        The family, whose parameters are these names.

    Example:
        ```python
        import numpy as np, vijax as vx
        rotor = vx.models.unbalanced_rotor(0.8, clearance=0.03)
        ds = vx.sweep(rotor, {"frequency": np.linspace(0.3, 2.0, 100)})
        ```

    References:
        F. F. Ehrich, "Observations of subcritical superharmonic and chaotic response in rotordynamics", J. Vibration and
        Acoustics 114 (1992) 93-100.
    """
    return Family(
        _rotor,
        frequency=frequency,
        eccentricity=eccentricity,
        clearance=clearance,
        damping_ratio=damping_ratio,
        restitution=restitution,
    )


def shaken_oscillator(
    frequency: ArrayLike = 0.8,
    *,
    displacement: ArrayLike = 0.1,
    clearance: ArrayLike = 0.2,
    damping_ratio: ArrayLike = 0.05,
    restitution: ArrayLike = 0.7,
) -> Family:
    """Build an oscillator beside a stop on a base that keeps its displacement, as a family.

    The base moves by a cos(W t) at every frequency W, and carries spring, damper and stop:
    x'' + 2 zeta x' + x = a W^2 cos(W t), x <= clearance, with x relative to the base. The mass moves in space with the
    amplitude a sqrt((1 + (2 zeta W)^2) / ((1 - W^2)^2 + (2 zeta W)^2)) as long as it does not hit the stop.

    Args:
        frequency: W, by the natural frequency.
        displacement: a, the amplitude of the base.
        clearance: from the mass at rest to the stop.
        damping_ratio: zeta.
        restitution: of the stop.

    Returns:
        The family, whose parameters are these names.

    Example:
        ```python
        import numpy as np, vijax as vx
        shaken = vx.models.shaken_oscillator(0.8)
        values = {"frequency": np.linspace(0.3, 2.0, 100)}
        ds = vx.sweep(shaken, values, quantities=["max_absolute_acceleration"])
        ```

    References:
        J. P. Den Hartog, Mechanical Vibrations (4th ed., 1956), Sec. 2.11.
    """
    return Family(
        _shaken,
        frequency=frequency,
        displacement=displacement,
        clearance=clearance,
        damping_ratio=damping_ratio,
        restitution=restitution,
    )


def _rotor(
    frequency: Array, eccentricity: Array, clearance: Array, damping_ratio: Array, restitution: Array
) -> ImpactSystem:
    amplitude = eccentricity * frequency**2
    return _oscillator(Harmonic(amplitude[None], frequency), clearance, damping_ratio, restitution)


def _shaken(
    frequency: Array, displacement: Array, clearance: Array, damping_ratio: Array, restitution: Array
) -> ImpactSystem:
    load = base_excitation([1.0], displacement, frequency)
    return _oscillator(load, clearance, damping_ratio, restitution)


def _oscillator(
    load: AbstractLoad, clearance: Array, damping_ratio: Array, restitution: Array
) -> ImpactSystem:
    damping = (2 * damping_ratio).reshape(1, 1)
    stop = Stop(0, clearance, "upper", restitution)
    return ImpactSystem(jnp.ones(1), damping, jnp.ones((1, 1)), load, [stop])
