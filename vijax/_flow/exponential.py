"""The motion of a linear machine over a whole flight at once, by the exponential of its matrix.

With y = (x, v, cos h W t, sin h W t, 1) the motion is y' = A y, whichever masses are held. The aim is E - I
with E = exp(A t), to full accuracy relative to itself however short the flight: a Taylor series of E - I for
a time so short that `_TERMS` suffice, doubled as F -> 2 F + F F, which subtracts nothing. (Padé approximants
were not used: they give E, from which I would have to be subtracted.)
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .._types import Scalar, matvec

# For norms up to 1 the 20th term is below rounding.
_TERMS = 19
# The longest flight, times the rate of the motion: 2 to this power. Longer ones are NaN, not inaccurate.
_DOUBLINGS = 24


def exponential_increments(
    machine: Machine, state: State, hold: Held, span: Scalar
) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
    """Displacement and gain of velocity after a time of any length, with some masses held.

    References:
        C. Moler & C. Van Loan, SIAM Rev. 45 (2003), Methods 1 and 3; L. Shampine, ACM Trans. Math. Softw. 5 (1979)
        for E - I.
    """
    size = jax.lax.stop_gradient(jnp.abs(span) * machine.rate)
    doublings = jnp.ceil(jnp.log2(jnp.maximum(size, 1))).astype(int)
    step = jnp.where(doublings <= _DOUBLINGS, span / 2.0**doublings, jnp.nan)
    a = _matrix(machine, hold) * step
    identity = jnp.eye(len(a), dtype=a.dtype).reshape(*a.shape[:2], *[1] * (a.ndim - 2))
    total = identity / _TERMS
    for k in range(_TERMS - 1, 0, -1):  # A (1 + A / 2 (1 + A / 3 (...)))
        total = (identity + _product(a, total)) / k

    def double(f: Array, k: Array) -> tuple[Array, None]:
        return jnp.where(k < doublings, 2 * f + _product(f, f), f), None

    total, _ = jax.lax.scan(double, _product(a, total), jnp.arange(_DOUBLINGS))
    phase = state.phase.reshape(-1, *state.phase.shape[2:])
    y = jnp.concatenate([state.x, state.v, phase, jnp.ones_like(state.x[:1])])
    gone = jnp.sum(total * y[None], axis=1)
    n = machine.num_masses
    return gone[:n], gone[n : 2 * n]


def _matrix(machine: Machine, hold: Held) -> Float[Array, "y y ..."]:
    """A: its columns are the rates of change of unit vectors."""
    n, num_harmonics = machine.num_masses, machine.waves.num_harmonics
    size = 2 * n + 2 * num_harmonics + 1

    def rate(y: Float[Array, "y ..."]) -> Float[Array, "y ..."]:
        x, v, phase = y[:n], y[n : 2 * n], y[2 * n : -1].reshape(2, num_harmonics, *y.shape[1:])
        load = machine.mean * y[-1:] + machine.waves.at(phase)
        force = load - matvec(machine.damping, v) - matvec(machine.stiffness, x)
        a = machine.contacts.accelerations(force, hold, phase)
        turned = machine.phase_rate(phase).reshape(-1, *y.shape[1:])
        parts = jnp.broadcast_arrays(*v, *a, *turned, jnp.zeros_like(a[0]))
        return jnp.stack(parts)

    unit = jnp.eye(size, dtype=machine.mean.dtype).reshape(size, size, *[1] * (machine.mean.ndim - 1))
    return jnp.swapaxes(jax.vmap(rate)(unit), 0, 1)


def _product(a: Float[Array, "i j ..."], b: Float[Array, "j k ..."]) -> Float[Array, "i k ..."]:
    """Matrix product, lanes last."""
    return a @ b if a.ndim == b.ndim == 2 else jnp.sum(a[:, :, None] * b[None], axis=1)
