"""Balls that bounce under their weight."""

import math

import numpy as np
from jaxtyping import ArrayLike

from .._system.forcing import Harmonic
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
    return _ball(Stop(0, 0.0, "lower", restitution), mass, gravity, frequency)


def ball_on_table(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = -math.pi / 2,
    restitution: ArrayLike = 0.5,
    gravity: ArrayLike = 9.81,
    mass: ArrayLike = 1.0,
) -> ImpactSystem:
    """Let a ball bounce on a table that moves up and down: m x'' = -m g, x >= a cos(W t + phase).

    No approximation of high bounces. With s = (1 - r) / (1 + r), the ball hits the table once in n periods T
    of it, always at the velocity -g n T / 2, when a W^2 sin(W t + phase) = -pi n s g. Of the two such instants in
    a period that with y'' < 0, y the height of the table, can be stable, and is while -y'' < (1 + s^2) g at the
    impact. A ball that lies on the table is thrown off when y'' falls below -g.

    Args:
        frequency: angular frequency W of the table.
        amplitude: a, a length; `stops[0].motion.amplitude[0]` to a sweep.
        phase: radians. If left out the table rises through its middle at time 0.
        restitution: r.
        gravity: g, an acceleration.
        mass: m; it scales impulses and contact forces, and changes no motion.

    Returns:
        The machine; x is the height of the ball in space.

    Raises:
        ValueError: for an amplitude or phase that is no number.

    Example:
        ```python
        import vijax as vx
        system = vx.models.ball_on_table(frequency=60.0, amplitude=0.004)
        sol = vx.simulate(system, 0.0, 5.0, v0=[0.5])
        ```

    References:
        P. J. Holmes, "The dynamics of repeated impacts with a sinusoidally vibrating table", J. Sound
        and Vibration 84 (1982) 173-189, who neglects a against the height of the bounces.
    """
    for name, value in (("amplitude", amplitude), ("phase", phase)):
        if np.ndim(value):
            raise ValueError(f"Argument `{name}` must be a number, but has shape {np.shape(value)}.")
    motion = Harmonic(as_float(amplitude)[None], frequency, as_float(phase)[None])
    return _ball(Stop(0, 0.0, "lower", restitution, motion), mass, gravity, frequency)


def _ball(floor: Stop, mass: ArrayLike, gravity: ArrayLike, frequency: ArrayLike) -> ImpactSystem:
    """A ball on which only its weight and the floor act."""
    masses = as_float(mass)[None]
    load = Harmonic([0.0], frequency, mean=-masses * gravity)
    return ImpactSystem(masses, [[0.0]], [[0.0]], load, [floor])
