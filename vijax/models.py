"""Ready-made machines, each with its reference."""

from jaxtyping import ArrayLike

from ._system.forcing import Harmonic
from ._system.stop import Stop
from ._system.system import ImpactSystem, chain


def wagg_bishop_a(frequency: ArrayLike, amplitude: ArrayLike = 0.3) -> ImpactSystem:
    """Two equal masses in a chain, an upper stop at 0.3 for each: case (a) of the paper.

    m = k = 1, c = 0.1, r = 0.7, the first mass driven. The captions and Table 2 fit the
    amplitude 0.3; Sec. 4.2 prints 0.5.

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
    """Two equal masses in a chain, stops on opposite sides: case (b) of the paper.

    As case (a), but with a lower stop at -0.3 for the first mass and an upper stop at 0.1 for the
    second.

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


def _two_masses(frequency: ArrayLike, amplitude: ArrayLike, stops: list[Stop]) -> ImpactSystem:
    forcing = Harmonic([amplitude, 0.0], frequency)
    return chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], forcing, stops)
