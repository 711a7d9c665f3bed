"""Gears with backlash."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .._system.checks import check_shape
from .._system.compliant import CompliantStop
from .._system.contact import Contact
from .._system.forcing import Harmonic
from .._system.system import ImpactSystem
from .._system.tabulated import Waveform


@evaluate_eagerly
def gear_pair(
    frequency: ArrayLike,
    amplitude: ArrayLike,
    *,
    phase: ArrayLike = 0.0,
    torque: ArrayLike = 1.0,
    position: ArrayLike = 0.05,
    restitution: ArrayLike = 0.8,
    inertias: Numbers = (1.0, 1.0),
    radii: Numbers = (1.0, 1.0),
    damping: ArrayLike = 0.0,
) -> ImpactSystem:
    """Build a gear that drives another with backlash: |R1 x1 - R2 x2| <= position.

    The angles x1 and x2 are deviations from uniform rotation. The driving gear feels the torque
    M + A cos(W t + phase), the driven one the load -M R2 / R1 that keeps the mean speed. With m = J / R^2 the teeth
    press with (M + A m2 cos(W t + phase) / (m1 + m2)) / R1, if there is no drag: they stay in contact while
    A m2 <= M (m1 + m2), and hammer beyond.

    No torque depends on the common angle of both gears: a motion rotated by a constant is also a motion.
    `vx.periodic_orbit` finds the orbit with the angle of the guess, with a multiplier 1, so `is_stable` is False:
    judge stability by the other multipliers.

    Args:
        frequency: angular frequency W of the varying torque.
        amplitude: A, a torque.
        phase: radians.
        torque: M, the mean torque; 0 for gears that carry no load and rattle.
        position: half the backlash, a length along the line of action. Contact 0 keeps R1 x1 - R2 x2 below it, the
            driving flanks; contact 1 is on the other flanks. Positive.
        restitution: r of both flanks.
        inertias: J, the moments of inertia, (2,).
        radii: R of the base circles, (2,).
        damping: drag on either shaft, torque per angular velocity.

    Returns:
        The machine; mass 0 is the driving gear, mass 1 the driven one.

    Raises:
        ValueError: unless there are two inertias and two radii.

    Example:
        ```python
        import vijax as vx
        system = vx.models.gear_pair(1.0, amplitude=3.0, damping=0.1)
        sol = vx.simulate(system, 0.0, 100.0, x0=[0.05, 0.0])  # the driving flanks closed
        ```

    References:
        K. Karagiannis and F. Pfeiffer, "Theoretical and experimental investigations of gear-rattling", Nonlinear
        Dynamics 2 (1991) 367-387.
    """
    inertia, radius = as_float(inertias), as_float(radii)
    for name, value in (("inertias", inertia), ("radii", radius)):
        check_shape(name, value, (2,))
    load = jnp.stack([as_float(torque), -as_float(torque) * radius[1] / radius[0]])
    varying = Harmonic([amplitude, 0.0], frequency, [phase, 0.0], load)
    flanks = [Contact({0: sign * radius[0], 1: -sign * radius[1]}, position, restitution) for sign in (1, -1)]
    return ImpactSystem(inertia, as_float(damping) * jnp.eye(2), jnp.zeros((2, 2)), varying, flanks)


@evaluate_eagerly
def gear_mesh(
    frequency: ArrayLike,
    phases: Numbers,
    values: Numbers,
    *,
    kind: str = "linear",
    mean: ArrayLike = 0.1,
    backlash: ArrayLike = 2.0,
    stiffness: ArrayLike = 1.0,
    damping_ratio: ArrayLike = 0.05,
) -> ImpactSystem:
    """Build a gear pair with elastic teeth and backlash under a wave of mesh load.

    The position x is the transmission error along the line of action, of unit mass: x'' + 2 zeta sqrt(k) x' + g(x) = F + w(W t).
    Teeth in mesh push with the spring k beyond half the backlash b, g = k (x - b / 2) for x > b / 2, k (x + b / 2) for
    x < -b / 2, and leave each other between. F is the mean load, w the wave that a pair of teeth makes as it comes and
    goes, once a mesh period. While the driving flanks touch, the gear is a linear oscillator about b / 2 + F / k: they stay in
    contact if its response to the wave is smaller than F / k.

    Args:
        frequency: W, of the mesh: number of teeth times angular speed.
        phases: of the wave, rising in [0, 2 pi), (knots,).
        values: w at these phases, forces, (knots,).
        kind: of the wave between its knots, see `vx.Waveform`.
        mean: F, the mean load.
        backlash: b, a length along the line of action.
        stiffness: k of the mesh.
        damping_ratio: zeta, of the whole.

    Returns:
        The machine; compliant stop 0 has the driving flanks, stop 1 the others.

    Example:
        ```python
        import numpy as np, vijax as vx
        system = vx.models.gear_mesh(0.5, [0.0, np.pi], [0.2, -0.2], kind="previous")
        sol = vx.simulate(system, 0.0, 100.0, x0=[1.1])  # the driving flanks in mesh
        ```

    References:
        A. Kahraman and R. Singh, "Non-linear dynamics of a spur gear pair", J. Sound and Vibration 142 (1990) 49-75.
    """
    k, half = as_float(stiffness), as_float(backlash) / 2
    load = Waveform(phases, values, frequency, kind) + Harmonic([0.0], 0.0, mean=as_float(mean)[None])
    damping = 2 * as_float(damping_ratio) * jnp.sqrt(k)
    flanks = [CompliantStop(0, half, "upper", k), CompliantStop(0, -half, "lower", k)]
    return ImpactSystem(jnp.ones(1), damping.reshape(1, 1), jnp.zeros((1, 1)), load, flanks)
