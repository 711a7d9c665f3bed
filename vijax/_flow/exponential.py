"""Motion of a linear machine over a whole flight by the matrix exponential.

With y = (x, v, cos h W t, sin h W t, 1) the motion is y' = A y, for any set of held masses. E - I with E = exp(A t)
is computed to full accuracy relative to itself, however short the flight: a Taylor series of E - I for a time so
short that `_TERMS` suffice, doubled by F -> 2 F + F F, which subtracts nothing. Padé approximants were rejected: they
give E, from which I would have to be subtracted.
"""

from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np
from equinox.internal import unvmap_max
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Scalar, append_axes, matrix_product, matvec
from .._jax.xla import is_any
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .interface import FlightMotion

# Terms of the series, four at a time: for norms up to 1 the 20th is below rounding.
_TERMS = 20
# `_DOUBLINGS`: most doublings. A flight may last 2 to this power, times 1 / rate. Longer ones are NaN, not inaccurate.
# `_TOGETHER`: of these, how many are made or passed over at once where derivatives are taken.
_DOUBLINGS, _TOGETHER = 24, 4


def exponential_increments(machine: Machine, state: State, hold: Held, span: Scalar) -> FlightMotion:
    """Displacement and gain of velocity over a span of any length, with some masses held.

    References:
        C. Moler & C. Van Loan, SIAM Rev. 45 (2003), Methods 1 and 3; L. Shampine, ACM Trans. Math. Softw. 5 (1979)
        for E - I.
    """
    total = _increments(_matrix(machine, hold), span, jax.lax.stop_gradient(machine.rate))
    phase = state.phase.reshape(-1, *state.phase.shape[2:])
    y = jnp.concatenate([state.x, state.v, phase, jnp.ones_like(state.x[:1])])
    gone = jnp.sum(total * y[None], axis=1)
    n = machine.num_masses
    return gone[:n], gone[n : 2 * n]


@jax.custom_jvp
def _increments(a: Float[Array, "y y ..."], span: Scalar, rate: Scalar) -> Float[Array, "y y ..."]:
    """E - I, with as many doublings as the most demanding lane needs."""
    doublings, total = _begun(a, span, rate)
    most = jnp.clip(unvmap_max(doublings), 0, _DOUBLINGS)
    return jax.lax.fori_loop(0, most, lambda k, f: _doubled(f, k < doublings), total)


@partial(_increments.defjvp, symbolic_zeros=True)
def _increments_jvp(primals, tangents):
    (a, span, rate), (change, longer, _) = primals, tangents
    total = _increments(a, span, rate)
    moved = jnp.zeros_like(total)
    if not isinstance(longer, SymbolicZero):  # A E; no product is differentiated
        moved = (a + _product(a, total)) * longer
    if not isinstance(change, SymbolicZero):
        moved = moved + jax.jvp(lambda a: _differentiable_increments(a, span, rate), (a,), (change,))[1]
    return total, moved


def _differentiable_increments(
    a: Float[Array, "y y ..."], span: Scalar, rate: Scalar
) -> Float[Array, "y y ..."]:
    """E - I by a loop of fixed length, which JAX can differentiate; it passes over doublings that no lane needs."""
    doublings, total = _begun(a, span, rate)

    def double(total: Array, first: Array) -> tuple[Array, None]:
        several = lambda f: reduce(lambda f, k: _doubled(f, first + k < doublings), range(_TOGETHER), f)  # noqa: E731
        return jax.lax.cond(is_any(first < doublings), several, lambda f: f, total), None

    return jax.lax.scan(double, total, jnp.arange(0, _DOUBLINGS, _TOGETHER))[0]


def _begun(
    a: Float[Array, "y y ..."], span: Scalar, rate: Scalar
) -> tuple[Int[Array, "..."], Float[Array, "y y ..."]]:
    """Number of doublings, and the series for the span halved as often."""
    size = jax.lax.stop_gradient(jnp.abs(span) * rate)
    doublings = jnp.ceil(jnp.log2(jnp.maximum(size, 1))).astype(int)
    a = a * jnp.where(doublings <= _DOUBLINGS, span / 2.0**doublings, jnp.nan)
    square = _product(a, a)
    powers = jnp.stack([a, square, _product(square, a), _product(square, square)])

    def nest(total: Array, factors: Array) -> tuple[Array, None]:
        block = jnp.sum(append_axes(factors, powers) * powers, axis=0)
        return block + _product(powers[-1], total), None

    factors = 1 / np.cumprod(np.arange(1.0, _TERMS + 1)).reshape(-1, len(powers))
    return doublings, jax.lax.scan(nest, jnp.zeros_like(a), jnp.asarray(factors[::-1], a.dtype))[0]


def _doubled(f: Float[Array, "y y ..."], is_on: Bool[Array, "..."]) -> Float[Array, "y y ..."]:
    """E - I for twice the time, in lanes that need the doubling."""
    return jnp.where(is_on, 2 * f + _product(f, f), f)


def _matrix(machine: Machine, hold: Held) -> Float[Array, "y y ..."]:
    """Matrix A: its columns are the rates of change of unit vectors."""
    n, columns = machine.num_masses, machine.num_columns
    size = 2 * n + 2 * columns + 1

    def rate(y: Float[Array, "y ..."]) -> Float[Array, "y ..."]:
        x, v, phase = y[:n], y[n : 2 * n], y[2 * n : -1].reshape(2, columns, *y.shape[1:])
        load = machine.mean * y[-1:] + machine.varying_load(phase)
        force = load - matvec(machine.damping, v) - matvec(machine.stiffness, x)
        a = machine.contacts.accelerations(force, hold, phase)
        turned = machine.phase_rate(phase)
        turned = turned.reshape(-1, *turned.shape[2:])  # a frequency may have lanes where nothing else has
        parts = jnp.broadcast_arrays(*v, *a, *turned, jnp.zeros_like(a[0]))
        return jnp.stack(parts)

    unit = jnp.eye(size, dtype=machine.mean.dtype).reshape(size, size, *[1] * (machine.mean.ndim - 1))
    return jnp.swapaxes(jax.vmap(rate)(unit), 0, 1)


def _product(a: Float[Array, "i j ..."], b: Float[Array, "j k ..."]) -> Float[Array, "i k ..."]:
    """Matrix product, lanes last."""
    return a @ b if a.ndim == b.ndim == 2 else matrix_product(a, b)
