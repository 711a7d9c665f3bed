"""Balls that bounce under gravity, between walls, and on each other."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float, whole_number
from .._jax.concrete import evaluate_eagerly
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.stop import Stop
from .._system.system import ImpactSystem


def bouncing_ball(
    restitution: ArrayLike = 0.5,
    *,
    gravity: ArrayLike = 9.81,
    mass: ArrayLike = 1.0,
    frequency: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build a ball that falls on a fixed floor: m x'' = -m g, x >= 0.

    The ball hits the floor at speed v, leaves it at r v and returns after 2 r v / g. Each bounce lasts r times as
    long as the one before: infinitely many end at 2 r v / (g (1 - r)) after that impact. Then the ball lies still.

    Args:
        restitution: r.
        gravity: g, an acceleration.
        mass: m; it scales impulses and contact forces, and changes no motion.
        frequency: angular frequency of a load of zero amplitude, whose periods sweeps and stroboscopic maps count.

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
    """Build a ball that bounces on a table moving up and down: m x'' = -m g, x >= a cos(W t + phase).

    High bounces are not approximated. With s = (1 - r) / (1 + r), the ball hits the table once in n periods T of the
    table, always at the velocity -g n T / 2, when a W^2 sin(W t + phase) = -pi n s g. Of the two such instants in a
    period, only the one with y'' < 0, y the height of the table, can be stable; it is while -y'' < (1 + s^2) g at the
    impact. A ball that lies on the table is thrown off when y'' falls below -g.

    Args:
        frequency: angular frequency W of the table.
        amplitude: a, a length; its path in sweeps is `stops[0].motion.amplitude[0]`.
        phase: radians. By default the table rises through its middle at time 0.
        restitution: r.
        gravity: g, an acceleration.
        mass: m; it scales impulses and contact forces, and changes no motion.

    Returns:
        The machine; x is the height of the ball in space.

    Raises:
        ValueError: for an amplitude or phase that is not a number.

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
    floor = Stop(0, 0.0, "lower", restitution, _travel(amplitude, frequency, phase))
    return _ball(floor, mass, gravity, frequency)


def ball_between_walls(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 1.0,
    restitution: ArrayLike = 1.0,
    mass: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build a free ball between a moving and a fixed wall: a cos(W t + phase) <= x <= position.

    The model of Fermi and Ulam, with the displacement of the wall not neglected. With k = (1 - r^2) / (2 pi n r), the
    ball hits each wall once in n periods T, the moving one at an angle W t + phase = b with
    a (k cos b - sin b) = k d, d the position, while a sqrt(1 + k^2) >= k d; it leaves that wall at the speed
    (d - a cos b) (1 + 1 / r) / (n T). Without losses the energy of fast balls wanders.

    Args:
        frequency: angular frequency W of the wall.
        amplitude: a, a length; its path in sweeps is `stops[1].motion.amplitude[0]`.
        phase: radians.
        position: d, the position of the fixed wall, stop 0. The moving wall, stop 1, has its middle at 0.
        restitution: r of both walls.
        mass: m; it scales impulses, and changes no motion.

    Returns:
        The machine; x is the position of the ball in space.

    Raises:
        ValueError: for an amplitude or phase that is not a number.

    Example:
        ```python
        import vijax as vx
        system = vx.models.ball_between_walls(1.0, amplitude=0.05)
        sol = vx.simulate(system, 0.0, 100.0, x0=[0.5], v0=[1.0])
        ```

    References:
        S. M. Ulam, "On some statistical properties of dynamical systems", Proc. 4th Berkeley Symposium 3 (1961)
        315-320; M. A. Lieberman and A. J. Lichtenberg, "Stochastic and adiabatic behavior of particles accelerated by
        periodic forces", Physical Review A 5 (1972) 1852-1866.
    """
    motion = _travel(amplitude, frequency, phase)
    walls = [Stop(0, position, "upper", restitution), Stop(0, 0.0, "lower", restitution, motion)]
    return ImpactSystem(as_float(mass)[None], [[0.0]], [[0.0]], Harmonic([0.0], frequency), walls)


@evaluate_eagerly
def bead_column(
    frequency: ArrayLike = 1.0,
    amplitude: ArrayLike | None = None,
    *,
    num_beads: int = 3,
    phase: ArrayLike = -math.pi / 2,
    position: ArrayLike | None = None,
    diameter: ArrayLike = 0.0,
    restitution: ArrayLike = 0.9,
    gravity: ArrayLike = 9.81,
    mass: Numbers = 1.0,
) -> ImpactSystem:
    """Stack beads on a floor, which may be shaken: x_0 >= a cos(W t + phase), x_i - x_(i-1) >= diameter.

    With r = 1 equal beads exchange their velocities; without diameter their positions are then those of beads that
    pass through each other, in order. With r < 1 a column that is dropped comes to rest after infinitely many impacts
    in a finite time, and every contact carries the weight of all beads above it. Beads without weight cluster in the
    same way if r is low enough for their number: inelastic collapse.

    Args:
        frequency: angular frequency W of the floor; for a fixed floor, that of a load of zero amplitude.
        amplitude: a, the displacement of the floor, a length; its path in sweeps is `stops[0].motion.amplitude[0]`.
            The floor is fixed if it is left out.
        num_beads: one or more.
        phase: radians. By default the floor rises through its middle at time 0.
        position: of a ceiling, above the middle of the floor; no ceiling if it is left out.
        diameter: the least distance of neighbours, a length; heights are those of the lowest points of the beads.
        restitution: r of all contacts.
        gravity: g, an acceleration; 0 for beads on a horizontal line.
        mass: of every bead, or one for each, (num_beads,).

    Returns:
        The machine; x are the heights of the lowest points of the beads in space, from below. Stop 0 is the floor,
        contact i is between the beads i - 1 and i, and a ceiling is the last stop.

    Raises:
        ValueError: for less than one bead, or an amplitude or phase that is not a number.

    Example:
        ```python
        import vijax as vx
        column = vx.models.bead_column(diameter=0.1, restitution=0.5)
        sol = vx.simulate(column, 0.0, 2.0, x0=[0.5, 0.65, 0.8])
        ```

    References:
        S. Luding, E. Clement, A. Blumen, J. Rajchenbach and J. Duran, "Studies of columns of beads under external
        vibrations", Physical Review E 49 (1994) 1634-1646; S. McNamara and W. R. Young, "Inelastic collapse and
        clumping in a one-dimensional granular medium", Physics of Fluids A 4 (1992) 496-504.
    """
    num_beads = whole_number("num_beads", num_beads, 1)
    d = as_float(diameter)
    masses = jnp.broadcast_to(as_float(mass), (num_beads,))
    motion = None if amplitude is None else _travel(amplitude, frequency, phase)
    floor = Stop(0, 0.0, "lower", restitution, motion)
    between = [Contact({i - 1: 1.0, i: -1.0}, -d, restitution) for i in range(1, num_beads)]
    above = [] if position is None else [Stop(num_beads - 1, as_float(position) - d, "upper", restitution)]
    none = jnp.zeros((num_beads, num_beads))
    weight = Harmonic(jnp.zeros(num_beads), frequency, mean=-masses * as_float(gravity))
    return ImpactSystem(masses, none, none, weight, [floor, *between, *above])


def _travel(amplitude: ArrayLike, frequency: ArrayLike, phase: ArrayLike) -> Harmonic:
    """Motion of one wall."""
    for name, value in (("amplitude", amplitude), ("phase", phase)):
        if np.ndim(value):
            raise ValueError(f"Argument `{name}` must be a number, but has shape {np.shape(value)}.")
    return Harmonic(as_float(amplitude)[None], frequency, as_float(phase)[None])


def _ball(floor: Stop, mass: ArrayLike, gravity: ArrayLike, frequency: ArrayLike) -> ImpactSystem:
    """A ball with only its weight and the floor acting on it."""
    masses = as_float(mass)[None]
    load = Harmonic([0.0], frequency, mean=-masses * as_float(gravity))
    return ImpactSystem(masses, [[0.0]], [[0.0]], load, [floor])
