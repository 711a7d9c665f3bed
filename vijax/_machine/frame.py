"""Coordinates that move with the stops: in them every stop stands still.

A mass whose stops move by w(t) is followed by z = x - w, in which M z'' + C z' + K z = f - M w'' - C w' - K w. That
is a machine with another periodic load, whose stops are fixed: impacts, chatter, sticking and their
derivatives stay what they are, and the motion of a linear machine stays exact. All that computes works in z;
x comes in with the start and goes out with what is saved, logged and recorded.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._system.system import ImpactSystem
from .._types import Scalar, add_up, lift, matvec, stack


class Frame(eqx.Module):
    """The motions w of the stops, as their masses follow them: waves over harmonics and masses.

    w = sum_h (cosine_h cos(h W t) + sine_h sin(h W t)); zero for masses whose stops stand still.
    """

    cosine: Float[Array, "harmonics n ..."]
    sine: Float[Array, "harmonics n ..."]
    frequency: Scalar

    def at(self, phase: Float[Array, "2 harmonics ..."]) -> tuple[Array, Array]:
        """The positions w and velocities w', (n, ...), at cosines and sines of h W t."""
        c, s = phase[0][:, None], phase[1][:, None]
        speed = self._orders(self.cosine) * self.frequency
        return add_up(self.cosine * c + self.sine * s), add_up(speed * (self.sine * c - self.cosine * s))

    def at_time(self, t: Scalar) -> tuple[Array, Array]:
        """The same at a time."""
        angle = self._orders(self.cosine[:, 0]) * (self.frequency * t)
        return self.at(jnp.stack([jnp.cos(angle), jnp.sin(angle)]))

    def extent(self, t: Scalar | float) -> tuple[Array, Array]:
        """Bounds of w and w', (n, ...), by which their rounding is told at a time: that of h W t counts."""
        size = jnp.abs(self.cosine) + jnp.abs(self.sine)
        speed = self._orders(size) * self.frequency
        rounding = size * (1 + speed * jnp.abs(t))
        return add_up(rounding), add_up(speed * rounding)

    def load(self, system: ImpactSystem) -> tuple[Array, Array]:
        """The load - M w'' - C w' - K w, as waves over harmonics and masses."""
        speeds = [(h + 1) * self.frequency for h in range(len(self.cosine))]
        m, c, k = system.mass, system.damping, system.stiffness
        cosine, sine = [], []
        for w, a, b in zip(speeds, self.cosine, self.sine, strict=True):
            cosine.append(w * w * m * a - w * matvec(c, b) - matvec(k, a))
            sine.append(w * w * m * b + w * matvec(c, a) - matvec(k, b))
        return stack(cosine), stack(sine)

    def _orders(self, like: Array) -> Array:
        return lift(jnp.arange(1, len(self.cosine) + 1, dtype=like.dtype), like)


def num_harmonics(system: ImpactSystem) -> int:
    """Harmonics of the load and of the motions of the stops; lanes may stand last."""
    moving = [system.forcing, *(stop.motion for stop in system.stops if stop.motion is not None)]
    return max(harmonic.num_harmonics(system.mass.ndim - 1) for harmonic in moving)


def frame_of(system: ImpactSystem) -> Frame | None:
    """The frame in which the stops stand still, if any of them moves."""
    moving = [(stop.mass, stop.motion) for stop in system.stops if stop.motion is not None]
    if not moving:
        return None
    lanes = system.mass.ndim - 1
    nothing = jnp.zeros((num_harmonics(system), *system.mass.shape[1:]), system.mass.dtype)

    def waves_of(mass: int) -> tuple[Array, Array]:
        waves = [motion.waves(lanes) for i, motion in moving if i == mass]
        if not waves:
            return nothing, nothing
        own = [[padded(wave[:, 0], len(nothing)) for wave in part] for part in zip(*waves, strict=True)]
        # Two stops of one mass move alike: the mean of both gives each its half of a derivative.
        return add_up(own[0]) / len(waves), add_up(own[1]) / len(waves)

    rows = zip(*map(waves_of, range(len(system.mass))), strict=True)
    cosine, sine = (jnp.stack(jnp.broadcast_arrays(*part), axis=1) for part in rows)
    return Frame(cosine, sine, system.forcing.frequency)


def padded(waves: Float[Array, "harmonics ..."], size: int) -> Float[Array, "size ..."]:
    """The waves with harmonics of no amplitude after them."""
    missing = jnp.zeros((size - len(waves), *waves.shape[1:]), waves.dtype)
    return jnp.concatenate([waves, missing])
