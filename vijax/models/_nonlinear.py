"""Nonlinear machines and their forces: examples for user-defined forces."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PyTree

from .._jax.arrays import as_float
from .._system.forcing import Harmonic
from .._system.stop import Stop
from .._system.system import ImpactSystem


class CubicSpring(eqx.Module):
    """A spring from every mass to the wall with the force -k3 x^3.

    Args:
        stiffness: k3, one number for all masses or one per mass, (n,): a force per cubed length. Positive hardens a
            linear spring in parallel, negative softens it.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic([0.5, 0.0], frequency=1.2)
        springs = vx.models.CubicSpring([0.5, 0.0])
        system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, [vx.Stop(1, 0.3)], springs)
        ```
    """

    stiffness: Float[Array, "..."] = eqx.field(converter=as_float)

    def __call__(
        self, t: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"], args: PyTree
    ) -> Float[Array, " n"]:
        """Return the forces on the masses at one instant."""
        return -self.stiffness * x**3


class PendulumWeight(eqx.Module):
    """The moment of a pendulum's weight about its pivot, -strength sin x.

    Args:
        strength: its moment when horizontal, m g l for a bob on a light rod; one number or one per pendulum, (n,).

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic([0.0], frequency=1.0)
        weight = vx.models.PendulumWeight(9.81)
        system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0)], weight)
        ```
    """

    strength: Float[Array, "..."] = eqx.field(converter=as_float)

    def __call__(
        self, t: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"], args: PyTree
    ) -> Float[Array, " n"]:
        """Return the moments on the pendulums at one instant."""
        return -self.strength * jnp.sin(x)


def duffing_oscillator(
    frequency: ArrayLike,
    amplitude: ArrayLike = 1.0,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 0.0,
    restitution: ArrayLike = 0.8,
    damping: ArrayLike = 0.0,
    stiffness: ArrayLike = 1.0,
    cubic_stiffness: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build Duffing's oscillator with a stop: x'' + c x' + k x + k3 x^3 = A cos(W t + phase), x <= position.

    The mass is 1. Without damping and load, released at rest at -a, it moves as -a cn(w t, m), with w^2 = k + k3 a^2
    and m = k3 a^2 / (2 w^2): it hits a stop at 0 after K(m) / w at the speed a sqrt(k + k3 a^2 / 2) and, if r = 1,
    again every 2 K(m) / w, K the complete elliptic integral.

    Args:
        frequency: angular frequency W of the load.
        amplitude: A, a force.
        phase: radians.
        position: of the stop; below 0 the springs press the mass against it.
        restitution: r.
        damping: c.
        stiffness: k, not negative.
        cubic_stiffness: k3; negative softens the spring, and beyond a = sqrt(-k / k3) there is no restoring force.

    Returns:
        The machine, its `force` a `CubicSpring`.

    Example:
        ```python
        import vijax as vx
        system = vx.models.duffing_oscillator(1.2, damping=0.1, cubic_stiffness=0.5)
        sol = vx.simulate(system, 0.0, 100.0)
        ```

    References:
        G. Yang, W. Xu, X. Gu and D. Huang, "Response analysis for a vibroimpact Duffing system with bilateral
        barriers under external and parametric Gaussian white noises", Chaos, Solitons and Fractals 87 (2016)
        125-135, who have two stops and noise in place of the load.
    """
    load, stops = Harmonic([amplitude], frequency, [phase]), [Stop(0, position, "upper", restitution)]
    return ImpactSystem([1.0], [[damping]], [[stiffness]], load, stops, CubicSpring(cubic_stiffness))


def impacting_pendulum(
    frequency: ArrayLike,
    amplitude: ArrayLike = 0.5,
    *,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 0.0,
    restitution: ArrayLike = 0.8,
    damping: ArrayLike = 0.0,
    natural_frequency: ArrayLike = 1.0,
) -> ImpactSystem:
    """Build a pendulum that swings against a wall: x'' + c x' + w^2 sin x = A cos(W t + phase), x <= position.

    x is the angle from the hanging equilibrium, w the angular frequency of small swings, sqrt(g / l) for a bob on a
    light rod; moments are divided by the moment of inertia. Undamped, undriven and released at rest at -b, it reaches
    the wall at w sqrt(2 (cos position - cos b)). A wall at 0 is hit after K(sin^2(b / 2)) / w, K the complete
    elliptic integral of the parameter m, and again after twice that time for the next b: every impact multiplies
    sin(b / 2) by r.

    Args:
        frequency: angular frequency W of the driving moment.
        amplitude: A, an angular acceleration.
        phase: radians.
        position: the angle of the wall, radians; below 0 the weight presses the pendulum against it.
        restitution: r.
        damping: c.
        natural_frequency: w.

    Returns:
        The machine, its `force` a `PendulumWeight`.

    Example:
        ```python
        import vijax as vx
        system = vx.models.impacting_pendulum(0.7, damping=0.1)
        sol = vx.simulate(system, 0.0, 100.0, x0=[-1.0])
        ```

    References:
        P. V. Bayly and L. N. Virgin, "An experimental study of an impacting pendulum", J. Sound and
        Vibration 164 (1993) 364-374.
    """
    load, stops = Harmonic([amplitude], frequency, [phase]), [Stop(0, position, "upper", restitution)]
    weight = PendulumWeight(as_float(natural_frequency) ** 2)
    return ImpactSystem([1.0], [[damping]], [[0.0]], load, stops, weight)
