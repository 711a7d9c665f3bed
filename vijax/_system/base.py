"""Load on a machine from the motion of its base."""

import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .forcing import Harmonic


@evaluate_eagerly
def base_excitation(
    mass: Numbers,
    amplitude: Numbers,
    frequency: ArrayLike,
    phase: Numbers | None = None,
    mean: Numbers | None = None,
) -> Harmonic:
    """Return the load on a machine whose base moves, in coordinates relative to the base.

    The base carries the wall, springs, dampers and stops. It moves by `y(t) = sum_h a_h cos(h W t + phase_h)`,
    h = 1, 2, ... Positions and velocities are relative to the base; every mass feels the inertia force `-m_i y''`,
    whose harmonics have the amplitudes `m_i a_h (h W)^2`.

    A sweep over `forcing.frequency` changes the frequency of this load and keeps its amplitude: the acceleration of
    the base stays constant, its displacement does not.

    Args:
        mass: the masses, (n,).
        amplitude: a, the displacement of the base: a length for a single harmonic, or (harmonics,).
        frequency: angular frequency W of the first harmonic.
        phase: radians, the shape of `amplitude`; zero if left out.
        mean: an additional constant force, (n,), for instance the weight; zero if left out.

    Returns:
        The load.

    Raises:
        ValueError: for shapes that do not fit together.

    Example:
        ```python
        import vijax as vx
        masses = [1.0, 2.0]
        load = vx.base_excitation(masses, amplitude=0.1, frequency=0.8)
        system = vx.chain(masses, [0.1, 0.1], [1.0, 1.0], load, [vx.Stop(1, 0.2, "upper", 0.7)])
        ```

    References:
        J. P. Den Hartog, Mechanical Vibrations (4th ed., 1956), Ch. 2.
    """
    m, a, w = as_float(mass, "mass"), as_float(amplitude, "amplitude"), as_float(frequency, "frequency")
    angle = as_float(jnp.zeros_like(a) if phase is None else phase)
    if m.ndim != 1:
        raise ValueError(f"Argument `mass` must have shape (n,), but has shape {m.shape}.")
    if a.ndim > 1:
        raise ValueError(
            f"Argument `amplitude` must be a number or have shape (harmonics,), but has shape {a.shape}: "
            "the base moves all masses alike."
        )
    if angle.shape != a.shape:
        raise ValueError(
            f"Argument `phase` must have the shape of `amplitude`, {a.shape}, but has shape {angle.shape}."
        )
    order = jnp.arange(1.0, a.size + 1).reshape(a.shape)
    forces = (a * (order * w) ** 2)[..., None] * m.reshape((1,) * a.ndim + m.shape)
    angles = jnp.broadcast_to(angle[..., None], forces.shape)
    return Harmonic(forces, w, angles, mean)
