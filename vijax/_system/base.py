"""Load on a machine from the motion of its base."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .forcing import Harmonic
from .load import AbstractLoad
from .tabulated import Tabulated, Waveform


@evaluate_eagerly
def base_excitation(
    mass: Numbers,
    amplitude: Numbers | None = None,
    frequency: ArrayLike | None = None,
    phase: Numbers | None = None,
    mean: Numbers | None = None,
    *,
    acceleration: Any = None,
) -> AbstractLoad:
    """Return the load on a machine whose base moves, in coordinates relative to the base.

    The base carries the wall, springs, dampers and stops. It moves by `y(t) = sum_h a_h cos(h W t + phase_h)`,
    h = 1, 2, ... Positions and velocities are relative to the base; every mass feels the inertia force `-m_i y''`,
    whose harmonics have the amplitudes `m_i a_h (h W)^2`. Or its acceleration is given by a table.

    A sweep over `forcing.frequency` changes the frequency of this load and keeps its amplitude: the acceleration of
    the base stays constant, its displacement does not.

    Args:
        mass: the masses, (n,).
        amplitude: a, the displacement of the base: a length for a single harmonic, or (harmonics,).
        frequency: angular frequency W of the first harmonic.
        phase: radians, the shape of `amplitude`; zero if left out.
        mean: an additional constant force, (n,), for instance the weight; zero if left out.
        acceleration: y'' of the base in place of `amplitude`, `frequency` and `phase`: a `vx.Tabulated` or `vx.Waveform` with
            `values` of shape (knots,) or (knots, 1), an acceleration.

    Returns:
        The load.

    Raises:
        ValueError: for shapes that do not fit together, or an acceleration beside an amplitude.

    Example:
        ```python
        import vijax as vx
        masses = [1.0, 2.0]
        load = vx.base_excitation(masses, amplitude=0.1, frequency=0.8)
        system = vx.chain(masses, [0.1, 0.1], [1.0, 1.0], load, [vx.Stop(1, 0.2, "upper", 0.7)])
        shock = vx.base_excitation(masses, acceleration=vx.Tabulated([0.0, 0.1, 0.2], [0.0, 9.8, 0.0]))
        ```

    References:
        J. P. Den Hartog, Mechanical Vibrations (4th ed., 1956), Ch. 2.
    """
    m = as_float(mass, "mass")
    if m.ndim != 1:
        raise ValueError(f"Argument `mass` must have shape (n,), but has shape {m.shape}.")
    if acceleration is not None:
        if any(a is not None for a in (amplitude, frequency, phase)):
            raise ValueError(
                "Argument `acceleration` stands in place of `amplitude`, `frequency` and `phase`: leave those out, or add two loads."
            )
        load = _of_acceleration(m, acceleration)
        return load if mean is None else load + Harmonic(jnp.zeros_like(m), 0.0, mean=mean)
    if amplitude is None or frequency is None:
        raise ValueError(
            "The motion of the base is missing: give `amplitude` and `frequency`, or `acceleration`, a `vx.Tabulated` or "
            "`vx.Waveform`."
        )
    return _of_displacement(m, amplitude, frequency, phase, mean)


def _of_acceleration(mass: Float[Array, " n"], acceleration: Any) -> AbstractLoad:
    if not isinstance(acceleration, Tabulated | Waveform):
        raise ValueError(
            f"Argument `acceleration` must be a `vx.Tabulated` or `vx.Waveform`, but is {acceleration!r}."
        )
    values = acceleration.values
    if values.shape[1] != 1:
        raise ValueError(
            f"Argument `acceleration` must have one column, `values` of shape (knots,), but has shape {values.shape}: the base moves "
            "all masses alike."
        )
    forces = -values * mass[None]
    if isinstance(acceleration, Tabulated):
        return Tabulated(acceleration.times, forces, acceleration.kind, from_base=True)
    return Waveform(acceleration.phases, forces, acceleration.frequency, acceleration.kind, from_base=True)


def _of_displacement(
    m: Float[Array, " n"],
    amplitude: Numbers,
    frequency: ArrayLike,
    phase: Numbers | None,
    mean: Numbers | None,
) -> Harmonic:
    a, w = as_float(amplitude, "amplitude"), as_float(frequency, "frequency")
    angle = as_float(jnp.zeros_like(a) if phase is None else phase)
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
    return Harmonic(forces, w, angles, mean, from_base=True)
