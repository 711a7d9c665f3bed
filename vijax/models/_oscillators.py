"""One mass, with or without a spring, with stops on one or both sides."""

from jaxtyping import ArrayLike

from .._jax.arrays import as_float
from .._system.base import base_excitation
from .._system.forcing import Harmonic
from .._system.stop import Stop
from .._system.system import ImpactSystem


def impact_oscillator(
    frequency: ArrayLike,
    amplitude: ArrayLike = 1.0,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 0.0,
    restitution: ArrayLike = 0.8,
    damping_ratio: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a driven mass on a spring with a stop: x'' + 2 zeta x' + x = A cos(W t + phase), x <= position.

    Mass and stiffness are 1. The steady motion grazes the stop when A = position |1 - W^2 + 2 i zeta W|. On an orbit
    of period T that hits the stop m times, the product of the two Floquet multipliers is r^(2 m) exp(-2 zeta T).

    Args:
        frequency: angular frequency W of the load; the natural one is 1.
        amplitude: A, a force.
        phase: radians.
        position: of the stop; below 0 the spring presses the mass against it.
        restitution: r.
        damping_ratio: zeta, a fraction of the critical damping.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        system = vx.models.impact_oscillator(2.8)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        S. W. Shaw and P. J. Holmes, "A periodically forced piecewise linear oscillator", J. Sound and
        Vibration 90 (1983) 129-155, the limit of impacts; A. B. Nordmark, "Non-periodic motion caused by
        grazing incidence in an impact oscillator", J. Sound and Vibration 145 (1991) 279-297; C. Budd and
        F. Dux, "Chattering and related behaviour in impact oscillators", Phil. Trans. R. Soc. Lond. A 347
        (1994) 365-389.
    """
    stops = [Stop(0, position, "upper", restitution)]
    return _on_a_spring(frequency, amplitude, phase, damping_ratio, stops)


def two_sided_oscillator(
    frequency: ArrayLike,
    amplitude: ArrayLike = 1.0,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 0.5,
    restitution: ArrayLike = 0.8,
    damping_ratio: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a driven mass on a spring between two stops: as `impact_oscillator`, with |x| <= position.

    Args:
        frequency: angular frequency W of the load; the natural one is 1.
        amplitude: A, a force.
        phase: radians.
        position: half the clearance: the upper stop, 0, is there, the lower one, 1, at -position. Positive.
        restitution: r of both stops.
        damping_ratio: zeta, a fraction of the critical damping.

    Returns:
        The machine.

    Example:
        ```python
        import vijax as vx
        system = vx.models.two_sided_oscillator(0.8, damping_ratio=0.05)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        S. W. Shaw, "The dynamics of a harmonically excited system having rigid amplitude constraints",
        Parts 1 and 2, J. Applied Mechanics 52 (1985) 453-464.
    """
    return _on_a_spring(frequency, amplitude, phase, damping_ratio, _both_sides(position, restitution))


def impact_pair(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 1.0,
    restitution: ArrayLike = 0.8,
    mass: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build a free mass that rattles in a box shaken by y(t) = a cos(W t + phase).

    Relative to the box: m x'' = -m y'', |x| <= position = d. Gears with backlash rattle in the same way. With
    q = pi (1 + r) / (2 (1 - r)), a motion with one impact at each wall in a period, half a period apart, exists while
    d <= a sqrt(1 + q^2); the mass hits the upper wall at an angle W t + phase = b with a (q sin b - cos b) = d.

    Args:
        frequency: angular frequency W of the box.
        amplitude: a, a length.
        phase: radians.
        position: half the clearance: the upper wall, stop 0, is there, the lower one, stop 1, at -position. Positive.
        restitution: r of both walls.
        mass: m; it scales impulses and contact forces, and changes no motion.

    Returns:
        The machine; x is relative to the middle of the box.

    Example:
        ```python
        import vijax as vx
        system = vx.models.impact_pair(1.0, amplitude=0.8, restitution=0.6)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        C. N. Bapat, N. Popplewell and K. McLachlan, "Stable periodic motions of an impact-pair", J. Sound
        and Vibration 87 (1983).
    """
    masses = as_float(mass)[None]
    load = base_excitation(masses, amplitude, frequency, phase)
    return ImpactSystem(masses, [[0.0]], [[0.0]], load, _both_sides(position, restitution))


def _on_a_spring(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    phase: ArrayLike,
    damping_ratio: ArrayLike,
    stops: list[Stop],
) -> ImpactSystem:
    load = Harmonic([amplitude], frequency, [phase])
    return ImpactSystem([1.0], [[2 * as_float(damping_ratio)]], [[1.0]], load, stops)


def _both_sides(position: ArrayLike, restitution: ArrayLike) -> list[Stop]:
    below = -as_float(position)
    return [Stop(0, position, "upper", restitution), Stop(0, below, "lower", restitution)]
