"""Tables of a modal flow: modes, the steady response to the load, and bounds of derivatives."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import matrix_product, matvec
from .._machine.machine import Machine
from .._system.waves import Waves


class Modes(eqx.Module):
    """Normal modes for one set of held masses, or with a leading axis over all sets.

    Attributes:
        squared_frequency: w^2, (modes,).
        decay: a, (modes,).
        shape: matrix from modal coordinates to positions, (n, modes).
        inverse: matrix from positions to modal coordinates, (modes, n).
        anchor: matrix from positions of held masses to the displacement of the rest position, (n, n).
    """

    squared_frequency: Float[Array, "..."]
    decay: Float[Array, "..."]
    shape: Float[Array, "..."]
    inverse: Float[Array, "..."]
    anchor: Float[Array, "..."]


class SteadyResponse(eqx.Module):
    """Steady response to the load, for one set of held masses, or with a leading axis over all sets.

    Attributes:
        mean: its mean, (n,); None where forces switch.
        waves: its harmonics.
        compliance: matrix that makes the mean of the mean load, (n, n), where forces switch; otherwise None.
    """

    mean: Float[Array, "..."] | None
    waves: Waves
    compliance: Float[Array, "..."] | None = None

    def offset(self, machine: Machine) -> Float[Array, "n ..."]:
        """Mean of the response, in the mode of the machine."""
        if self.mean is not None:
            return self.mean
        assert self.compliance is not None
        return matvec(self.compliance, machine.mean)


class Rests(eqx.Module):
    """Bounds of derivatives, for one set of held masses, or with a leading axis over all sets.

    |x''''| / 24 <= x . root + x_load, with the roots of the energies q'^2 + w^2 q^2 of the modes; |force'''| / 6 likewise.

    Attributes:
        x: (n, modes).
        x_load: part of the steady response, (n,).
        force: (n, modes).
        force_load: (n,).
        fifth: likewise for |v^(4)| / 24, (n, modes); None where forces do not switch.
        fifth_load: (n,).
    """

    x: Float[Array, "..."]
    x_load: Float[Array, "..."]
    force: Float[Array, "..."]
    force_load: Float[Array, "..."]
    fifth: Float[Array, "..."] | None = None
    fifth_load: Float[Array, "..."] | None = None


def response_of(machine: Machine, modes: Modes, *, switches: bool) -> SteadyResponse:
    w2, a, shape, waves = modes.squared_frequency, modes.decay, modes.shape, machine.waves
    speed = waves.speeds(machine.pace)
    stiff, drag = w2[None] - speed * speed, 2 * a[None] * speed
    scale = stiff * stiff + drag * drag
    c, s = _both(waves.cosine, waves.sine, shape)
    transposed = jnp.swapaxes(shape, 0, 1)
    response = Waves(*_both((stiff * c - drag * s) / scale, (stiff * s + drag * c) / scale, transposed))
    if switches:
        return SteadyResponse(None, response, matrix_product(shape / w2[None], transposed))
    return SteadyResponse(matvec(shape, matvec(transposed, machine.mean) / w2), response)


def bounds_of_rests(machine: Machine, modes: Modes, response: SteadyResponse) -> Rests:
    """The energy of a mode never grows, and q''' and q'''' are linear in q and q'."""
    w2, a = modes.squared_frequency, modes.decay
    w = jnp.sqrt(w2)
    skew = jnp.abs(4 * a * a - w2)
    third, fourth = skew + 2 * a * w, w * skew + 4 * a * jnp.abs(w2 - 2 * a * a)
    shape = jnp.abs(modes.shape)
    x4 = shape * fourth[None]
    x4_load = response.waves.rate_bound(4, machine.pace)
    # Forces are formed before absolute values are taken: symmetry may keep that on a held mass zero.
    drag, spring = (jnp.abs(matrix_product(a, modes.shape)) for a in (machine.damping, machine.stiffness))
    force = drag * fourth[None] + spring * third[None]
    force_load = _force_waves(machine, response).rate_bound(3, machine.pace)
    rests = x4 * (1 / 24), x4_load * (1 / 24), force * (1 / 6), force_load * (1 / 6)
    if response.compliance is None:
        return Rests(*rests)
    x5 = shape * (2 * a * fourth + w2 * third)[None]
    x5_load = response.waves.rate_bound(5, machine.pace)
    return Rests(*rests, x5 * (1 / 24), x5_load * (1 / 24))


def _force_waves(machine: Machine, response: SteadyResponse) -> Waves:
    """Harmonics of the forces on the masses in the steady response."""
    x, load = response.waves, machine.waves
    speed = x.speeds(machine.pace)
    spring, drag = (jnp.swapaxes(a, 0, 1) for a in (machine.stiffness, machine.damping))
    c, s = _both(x.cosine, x.sine, spring)
    c_rate, s_rate = _both(speed * x.sine, speed * x.cosine, drag)
    return Waves(load.cosine - c - c_rate, load.sine - s + s_rate)


def _both(a: Array, b: Array, matrix: Array) -> tuple[Array, Array]:
    """Products of two arrays with the same matrix, as one."""
    whole = matrix_product(jnp.concatenate([a, b]), matrix)
    return whole[: len(a)], whole[len(a) :]
