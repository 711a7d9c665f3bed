"""Balls that bounce under their weight."""

from jaxtyping import ArrayLike

from .._system.base import base_excitation
from .._system.stop import Stop
from .._system.system import ImpactSystem
from .._types import as_float


def bouncing_ball(
    restitution: ArrayLike = 0.5,
    *,
    gravity: ArrayLike = 9.81,
    mass: ArrayLike = 1.0,
    frequency: ArrayLike = 1.0,
) -> ImpactSystem:
    """Let a ball fall on a floor: m x'' = -m g, x >= 0.

    It hits the floor at speed v, leaves it at r v and is back after 2 r v / g. Bounces without number,
    each r times as long as the last, end at 2 r v / (g (1 - r)) after that impact; then the ball
    lies still.

    Args:
        restitution: r.
        gravity: g, an acceleration.
        mass: m; it scales impulses and contact forces, and changes no motion.
        frequency: angular frequency of a load without amplitude. It moves nothing, but sweeps
            and stroboscopic maps count its periods.

    Returns:
        The machine; x is the height of the ball.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.bouncing_ball(0.8), 0.0, 5.0, x0=[1.0])
        ```

    References:
        A. D. Bernstein, "Listening to the coefficient of restitution", American J. Physics 45 (1977) 41-44.
    """
    return ball_on_table(frequency, 0.0, restitution=restitution, gravity=gravity, mass=mass)


def ball_on_table(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    restitution: ArrayLike = 0.5,
    gravity: ArrayLike = 9.81,
    mass: ArrayLike = 1.0,
) -> ImpactSystem:
    """Let a ball bounce on a table that shakes up and down by y(t) = a cos(W t + phase).

    Seen from the table: m x'' = -m g - m y'', x >= 0, no approximation of high bounces. With
    s = (1 - r) / (1 + r), the ball hits the table once in n periods T of it, always at g n T / (1 + r)
    relative to it, when a W^2 sin(W t + phase) = -pi n s g. Of the two such instants in a period
    that with y'' < 0 can be stable, and is while -y'' < (1 + s^2) g at the impact.

    Args:
        frequency: angular frequency W of the table.
        amplitude: a, a length.
        phase: radians.
        restitution: r.
        gravity: g, an acceleration.
        mass: m; it scales impulses and contact forces, and changes no motion.

    Returns:
        The machine; x is the height of the ball above the table.

    Example:
        ```python
        import vijax as vx
        system = vx.models.ball_on_table(frequency=60.0, amplitude=0.004)
        sol = vx.simulate(system, 0.0, 5.0, v0=[0.34])
        ```

    References:
        P. J. Holmes, "The dynamics of repeated impacts with a sinusoidally vibrating table", J. Sound
        and Vibration 84 (1982) 173-189, who neglects a against the height of the bounces.
    """
    masses = as_float(mass)[None]
    load = base_excitation(masses, amplitude, frequency, phase, mean=-masses * gravity)
    return ImpactSystem(masses, [[0.0]], [[0.0]], load, [Stop(0, 0.0, "lower", restitution)])
