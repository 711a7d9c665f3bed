"""Turns of loads of other frequencies in whole forcing periods, exact however many there are.

In k periods of the frequency W a load of the frequency w makes k w / W turns. Their fraction sets its phase. Rounded at once, it
loses a digit with every tenfold of k. So the quotient is split into parts of few bits, whose products with k are exact, and
every part drops its whole turns by itself.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._jax.arrays import Scalar, with_derivative_of


class Turns(eqx.Module):
    """Quotient w / W of two frequencies, in parts whose sum has twice the digits.

    Attributes:
        quotient: w / W, (...).
        whole: whole turns in a period.
        coarse: first bits of the rest.
        fine: its next bits.
        rest: what they leave.
    """

    quotient: Float[Array, "..."]
    whole: Float[Array, "..."]
    coarse: Float[Array, "..."]
    fine: Float[Array, "..."]
    rest: Float[Array, "..."]

    @classmethod
    def of(cls, frequency: Scalar, clock: Scalar) -> "Turns":
        """Quotient of a frequency and that by which periods are counted; 0 where none are."""
        is_driven = clock > 0
        frequency, clock = jnp.broadcast_arrays(
            jnp.where(is_driven, frequency, 0), jnp.where(is_driven, clock, 1)
        )
        quotient = frequency / clock
        q, w = jax.lax.stop_gradient((quotient, clock))
        low = _remainder(jax.lax.stop_gradient(frequency), q, w) / w
        bits = _bits(q)
        whole = jnp.floor(q)
        coarse = jnp.floor((q - whole) * 2.0**bits) * 2.0**-bits
        left = (q - whole) - coarse
        fine = jnp.floor(left * 2.0 ** (2 * bits)) * 2.0 ** (-2 * bits)
        return cls(quotient, whole, coarse, fine, (left - fine) + low)

    def in_periods(self, periods: Int[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Whole turns, and the rest of a turn, between -1/2 and 1/2, in a number of periods below 2^31."""
        count = periods.astype(self.quotient.dtype)
        (a, a_rest), (b, b_rest) = (_parted(count * part) for part in (self.coarse, self.fine))
        c, rest = _parted((a_rest + b_rest) + count * self.rest)
        whole = count * self.whole + a + b + c
        return whole, with_derivative_of(rest, count * self.quotient)


def _parted(turns: Array) -> tuple[Array, Array]:
    """Whole turns and the rest."""
    whole = jnp.round(turns)
    return whole, turns - whole


def _bits(like: Array) -> int:
    """Bits of a part: with those of a number of periods they fill the digits of a float."""
    return 22 if jnp.finfo(like.dtype).bits == 64 else 8


def _remainder(y: Array, a: Array, b: Array) -> Array:
    """Return y - a b where a is the rounded quotient y / b: products of few bits are exact, and so is every difference."""
    rest = y
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (2, 0), (1, 2), (2, 1), (2, 2)):
        rest = rest - _pieces(a)[i] * _pieces(b)[j]
    return rest


def _pieces(a: Array) -> tuple[Array, Array, Array]:
    """Three parts of a number, of less than half of its digits each."""
    digits = _bits(a) + 1
    parts = []
    for _ in range(2):
        parts.append(
            jax.lax.reduce_precision(a, exponent_bits=11 if digits > 20 else 8, mantissa_bits=digits)
        )
        a = a - parts[-1]
    return parts[0], parts[1], a
