"""Beams of finite elements."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._jax.arrays import as_float, whole_number
from .._jax.concrete import evaluate_eagerly
from .._system.forcing import Harmonic
from .._system.stop import Stop
from .._system.system import ImpactSystem

# Lowest root b of cos(b) cosh(b) = -1.
_FIRST_ROOT = 1.8751040687119611
# Consistent mass matrix of an element of length 1, by deflection and slope at its ends.
_MASS = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) / 420
_STIFFNESS = np.array([[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])


@evaluate_eagerly
def cantilever(
    frequency: ArrayLike,
    amplitude: ArrayLike = 1.0,
    *,
    num_elements: int = 3,
    phase: ArrayLike = 0.0,
    position: ArrayLike = 0.1,
    restitution: ArrayLike = 0.8,
    length: ArrayLike = 1.0,
    bending_stiffness: ArrayLike = 1.0,
    mass_per_length: ArrayLike = 1.0,
    damping_ratio: ArrayLike = 0.01,
) -> ImpactSystem:
    """Build a clamped beam with a driven tip and a stop: Euler-Bernoulli elements, cubic shapes, consistent masses.

    The coordinates are the deflection and the slope at each node, (y_1, y_1', y_2, y_2', ...), without the clamped
    one. A force F at the tip bends the beam by exactly F L^3 / (3 E I) there, with any number of elements. The
    angular frequencies tend to (b / L)^2 sqrt(E I / m) from above, cos(b) cosh(b) = -1, the first b = 1.8751, with
    errors of the fourth order in the length of an element. The share of the beam's velocity that an impact reverses
    also depends on the elements: a rigid stop meets a mass that shrinks with their length.

    Args:
        frequency: angular frequency W of the load.
        amplitude: of the load, a force at the tip.
        num_elements: one or more, of equal length.
        phase: radians.
        position: of the stop, which limits the deflection of the tip from above.
        restitution: r.
        length: L.
        bending_stiffness: E I, force times length squared.
        mass_per_length: m.
        damping_ratio: of the first mode; for other modes it grows with their frequency, C being a multiple of K.

    Returns:
        The machine, with a full mass matrix; the deflection of the tip is `x[-2]`.

    Raises:
        ValueError: for less than one element.

    Example:
        ```python
        import vijax as vx
        system = vx.models.cantilever(3.0)
        sol = vx.simulate(system, 0.0, 20.0)
        tip = sol.evaluate(20.0)[0][-2]
        ```

    References:
        F. C. Moon and S. W. Shaw, "Chaotic vibrations of a beam with non-linear boundary conditions", Int. J.
        Non-Linear Mechanics 18 (1983) 465-477; J. S. Przemieniecki, Theory of Matrix Structural Analysis (1968), Ch.
        5 and 11.
    """
    num_elements = whole_number("num_elements", num_elements, 1)
    h, tip = as_float(length) / num_elements, 2 * num_elements - 2
    mass = _assembled(_MASS, h, num_elements) * as_float(mass_per_length) * h
    stiffness = _assembled(_STIFFNESS, h, num_elements) * as_float(bending_stiffness) / h**3
    first = (_FIRST_ROOT / length) ** 2 * jnp.sqrt(as_float(bending_stiffness) / mass_per_length)
    force, angle = (jnp.zeros(2 * num_elements).at[tip].set(as_float(a)) for a in (amplitude, phase))
    stop = Stop(tip, position, "upper", restitution)
    damping = 2 * as_float(damping_ratio) / first * stiffness
    return ImpactSystem(mass, damping, stiffness, Harmonic(force, frequency, angle), [stop])


def _assembled(element: np.ndarray, h: Float[Array, ""], count: int) -> Float[Array, "n n"]:
    """Matrix of `count` elements of length h in a row, by deflections and slopes; the first node is clamped."""
    whole = np.zeros((2 * count + 2, 2 * count + 2))
    for k in range(count):
        whole[2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += element
    scale = jnp.stack([jnp.ones_like(h), h] * count)
    return jnp.asarray(whole[2:, 2:]) * scale[:, None] * scale[None]
