"""Periodic load on the masses."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Numbers, Reals, array_namespace, as_float
from .._printing import describe_harmonic
from .checks import FINITE, NOT_NEGATIVE, check_number, check_one
from .load import AbstractLoad, with_more_columns
from .waves import Waves


class Harmonic(AbstractLoad):
    """A load with a constant part and one or several harmonics of one angular frequency.

    Mass i feels `mean_i + sum_h A_hi cos(h W t + phase_hi)`, h = 1, 2, ...

    Args:
        amplitude: A, shape (n,) for a single harmonic or (harmonics, n); a force.
        frequency: angular frequency W of the first harmonic, 0 or more, in radians per time.
            At 0 the load is constant.
        phase: radians, the shape of `amplitude`; zero if left out.
        mean: constant force, shape (n,); zero if left out.
        from_base: whether this is the inertia force -m_i y'' of a base that moves, as `vx.base_excitation` makes it, but for the mean: the
            quantity "max_absolute_acceleration" then has the acceleration y'' of the base.

    Raises:
        ValueError: for shapes that do not fit together or a negative frequency.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.3, 0.0], frequency=0.8)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2: f(t) = A cos(W t).
    """

    amplitude: Float[Array, "..."]
    frequency: Float[
        Array, "..."
    ]  # None in a machine's stop or sum of loads, which has that of the whole load
    phase: Float[Array, "..."]
    mean: Float[Array, "..."]
    from_base: bool = eqx.field(static=True)

    def __init__(
        self,
        amplitude: Numbers,
        frequency: ArrayLike,
        phase: Numbers | None = None,
        mean: Numbers | None = None,
        *,
        from_base: bool = False,
    ):
        self.amplitude = as_float(amplitude, "amplitude")
        self.frequency = as_float(frequency, "frequency")
        n = self.amplitude.shape[-1:]
        self.phase = (
            as_float(np.zeros(self.amplitude.shape, self.amplitude.dtype))
            if phase is None
            else as_float(phase, "phase")
        )
        self.from_base = bool(from_base)
        self.mean = as_float(np.zeros(n, self.amplitude.dtype) if mean is None else mean, "mean")

    def __check_init__(self):
        shape = self.amplitude.shape
        if len(shape) not in (1, 2) or 0 in shape:
            raise ValueError(
                f"Argument `amplitude` must have shape (n,) or (harmonics, n), but has shape {shape}."
            )
        if self.phase.shape != shape:
            raise ValueError(
                f"Argument `phase` must have the shape of `amplitude`, {shape}, "
                f"but has shape {self.phase.shape}."
            )
        if self.mean.shape != shape[-1:]:
            raise ValueError(
                f"Argument `mean` must have shape (n,) = {shape[-1:]}, but has shape {self.mean.shape}."
            )
        if self.frequency is not None:
            check_number("frequency", self.frequency, NOT_NEGATIVE)
        for name in ("amplitude", "phase", "mean"):
            check_one(name, getattr(self, name), FINITE)

    __repr__, _repr_html_ = described_by(describe_harmonic)

    def num_harmonics(self, lane_axes: int = 0) -> int:
        """Number of harmonics; lanes may be last."""
        return len(self.amplitude) if self.amplitude.ndim - lane_axes == 2 else 1

    def waves(self, lane_axes: int = 0) -> Waves:
        """Fourier series of the load without its mean; lanes may be last."""
        is_single = self.amplitude.ndim - lane_axes == 1
        amplitude, phase = (a[None] if is_single else a for a in (self.amplitude, self.phase))
        library = array_namespace(amplitude, phase)
        return Waves(amplitude * library.cos(phase), -amplitude * library.sin(phase))

    @property
    def has_waves(self) -> bool:
        """True for harmonics."""
        return True

    def num_columns(self, lane_axes: int = 0) -> int:
        """Number of masses; lanes may be last."""
        return self.amplitude.shape[self.amplitude.ndim - lane_axes - 1]

    def size(self) -> Reals:
        """Sum of all amplitudes and of the mean, (n,); lanes may be last."""
        n = len(self.mean)
        return abs(self.amplitude).reshape(-1, n, *self.mean.shape[1:]).sum(axis=0) + abs(self.mean)

    def with_more(self, count: int) -> "Harmonic":
        """The load, zero on some more coordinates."""
        names = lambda load: (load.amplitude, load.phase, load.mean)  # noqa: E731
        return eqx.tree_at(names, self, tuple(with_more_columns(a, count) for a in names(self)))
