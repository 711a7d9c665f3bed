"""Coordinates that move with the stops, in which every stop is at rest.

A mass whose stops move by w(t) has the coordinate z = x - w, with M z'' + C z' + K z = f - M w'' - C w' - K w. This
is a machine with another periodic load and fixed stops: impacts, chatter, sticking and their derivatives are
unchanged, and the motion of a linear machine stays exact. All computations use z; x enters with the start and leaves
with saved, logged and recorded results.
"""

import equinox as eqx
from jaxtyping import Array, Float

from .._jax.arrays import Reals, Scalar, matvec, stack
from .._system.waves import Waves, phase_at, phase_rate


class Frame(eqx.Module):
    """Motion w of the stops of every mass; zero where they stand still."""

    waves: Waves
    frequency: Scalar

    def at(self, phase: Float[Array, "2 harmonics ..."]) -> tuple[Array, Array]:
        """Positions w and velocities w', (n, ...), at a phase of the load."""
        return self.waves.at(phase), self.waves.at(phase_rate(phase, self.frequency))

    def acceleration_at(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "n ..."]:
        """Accelerations w'' at a phase of the load."""
        return self.waves.at(phase_rate(phase_rate(phase, self.frequency), self.frequency))

    def at_time(self, t: Scalar) -> tuple[Array, Array]:
        """Positions w and velocities w' at a time."""
        return self.at(phase_at(self.frequency * t, self.waves.num_harmonics))

    def extent(self, t: Scalar | float) -> tuple[Array, Array]:
        """Bounds of w and w', (n, ...), that set their rounding errors at a time."""
        angle = self.frequency * t
        return self.waves.rounded(angle), self.frequency * self.waves.rounded(angle, order=1)

    def load(self, m: Reals, c: Reals, k: Reals) -> Waves:
        """Load - M w'' - C w' - K w, with masses m, (n,), damping c and stiffness k, (n, n)."""
        cosine, sine = [], []
        for h, (a, b) in enumerate(zip(self.waves.cosine, self.waves.sine, strict=True), 1):
            w = h * self.frequency
            cosine.append(w * w * m * a - w * matvec(c, b) - matvec(k, a))
            sine.append(w * w * m * b + w * matvec(c, a) - matvec(k, b))
        return Waves(stack(cosine), stack(sine))
