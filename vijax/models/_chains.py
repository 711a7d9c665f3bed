"""Chains of masses: the two machines of the paper, and longer ones."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import as_float, whole_number
from .._jax.concrete import evaluate_eagerly
from .._system.chain import chain
from .._system.forcing import Harmonic
from .._system.stop import Stop
from .._system.system import ImpactSystem


def wagg_bishop_a(frequency: ArrayLike, amplitude: ArrayLike = 0.3) -> ImpactSystem:
    """Build a chain of two equal masses with an upper stop at 0.3 for each: case (a) of the paper.

    m = k = 1, c = 0.1, r = 0.7; the first mass is driven. Captions and Table 2 fit amplitude 0.3; Sec. 4.2 prints
    0.5.

    Args:
        frequency: angular frequency of the load.
        amplitude: amplitude of the load on the first mass.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 80.0)
        ```

    References:
        Wagg & Bishop (2004), Sec. 4.4, Fig. 2a.
    """
    stops = [Stop(0, 0.3, "upper", 0.7), Stop(1, 0.3, "upper", 0.7)]
    return _two_masses(frequency, amplitude, stops)


def wagg_bishop_b(frequency: ArrayLike, amplitude: ArrayLike = 0.5) -> ImpactSystem:
    """Build a chain of two equal masses with stops on opposite sides: case (b) of the paper.

    As case (a), but with a lower stop at -0.3 for the first mass and an upper stop at 0.1 for the second.

    Args:
        frequency: angular frequency of the load.
        amplitude: amplitude of the load on the first mass.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
        ```

    References:
        Wagg & Bishop (2004), Sec. 4.5, Fig. 2b.
    """
    stops = [Stop(0, -0.3, "lower", 0.7), Stop(1, 0.1, "upper", 0.7)]
    return _two_masses(frequency, amplitude, stops)


@evaluate_eagerly
def uniform_chain(
    frequency: ArrayLike,
    amplitude: ArrayLike = 0.3,
    *,
    num_masses: int = 10,
    position: ArrayLike = 0.3,
    restitution: ArrayLike = 0.7,
    mass: ArrayLike = 1.0,
    damping: ArrayLike = 0.1,
    stiffness: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build a chain of equal masses with an upper stop each for the first and the last mass.

    The paper's chain of N masses (Fig. 1), driven at the first mass; with two masses it is `wagg_bishop_a`. The first
    spring is fixed to the wall, the last mass is free on its far side. Without contact the natural frequencies are
    2 sqrt(k / m) sin((2 j - 1) pi / (4 n + 2)), j = 1 ... n.

    Args:
        frequency: angular frequency of the load.
        amplitude: amplitude of the load on the first mass.
        num_masses: n, two or more.
        position: of both stops.
        restitution: r of both stops.
        mass: m of every mass.
        damping: c of every damper.
        stiffness: k of every spring.

    Returns:
        The machine; stop 0 limits the first mass, stop 1 the last.

    Raises:
        ValueError: for fewer than two masses.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.uniform_chain(0.8, 1.0), 0.0, 80.0)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2, Fig. 1. J. P. Cusumano and B.-Y. Bai, "Period-infinity periodic
        motions, chaos and spatial coherence in a 10 degree of freedom impact oscillator", Chaos, Solitons
        and Fractals 3 (1993) 515-536, study another machine of ten masses.
    """
    num_masses = whole_number("num_masses", num_masses, 2)
    load = Harmonic(jnp.zeros(num_masses).at[0].set(as_float(amplitude)), frequency)
    stops = [Stop(i, position, "upper", restitution) for i in (0, num_masses - 1)]
    m, c, k = (jnp.full(num_masses, as_float(a)) for a in (mass, damping, stiffness))
    return chain(m, c, k, load, stops)


def _two_masses(frequency: ArrayLike, amplitude: ArrayLike, stops: list[Stop]) -> ImpactSystem:
    forcing = Harmonic([amplitude, 0.0], frequency)
    return chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], forcing, stops)
