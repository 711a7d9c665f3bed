"""Series of every function against 50 digits."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from force_series import bound, by_loop, exact, motion, of_time, sizes
from jax import lax
from jax.scipy.special import erf, erfc, erfinv

from vijax._series.plan import plan_force

ORDER = 14
# Rounding errors grow with the number of terms: a few units in the last place for an order each.
ROUNDING = 30 * np.finfo(float).eps

# Function, the same by mpmath, places
FUNCTIONS = {
    "add": (lambda t: t + 1.5 + t, lambda t: 2 * t + 1.5, (0, 0.3, -1e3)),
    "subtract": (lambda t: 2.5 - t - 3 * t, lambda t: mpmath.mpf(2.5) - 4 * t, (0, 0.3)),
    "multiply": (
        lambda t: t * jnp.cos(t) * jnp.exp(t),
        lambda t: t * mpmath.cos(t) * mpmath.exp(t),
        (0, 0.3, -2),
    ),
    "square": (lambda t: jnp.square(jnp.sin(t)), lambda t: mpmath.sin(t) ** 2, (0, 0.3, 50)),
    "cube": (lambda t: (t + 0.5) ** 3, lambda t: (t + mpmath.mpf(0.5)) ** 3, (0, -0.5, 7)),
    "seventh power": (lambda t: jnp.sin(t) ** 7, lambda t: mpmath.sin(t) ** 7, (0, 0.3)),
    "power -3": (lambda t: t**-3, lambda t: t**-3, (0.4, -7, 1e4)),
    "divide": (
        lambda t: jnp.sin(t) / (1.5 - t),
        lambda t: mpmath.sin(t) / (mpmath.mpf(1.5) - t),
        (0, 1.4, 30),
    ),
    "divide number": (lambda t: 3.0 / (2 + t * t), lambda t: 3 / (2 + t * t), (0, 0.7)),
    "sqrt": (jnp.sqrt, mpmath.sqrt, (1e-3, 0.3, 1e6)),
    "rsqrt": (lax.rsqrt, lambda t: 1 / mpmath.sqrt(t), (1e-3, 0.3, 1e6)),
    "cbrt": (jnp.cbrt, lambda t: mpmath.sign(t) * mpmath.cbrt(abs(t)), (1e-3, 0.3, -0.3, 1e6)),
    "power": (lambda t: t**1.7, lambda t: t ** mpmath.mpf(1.7), (0.02, 0.3, 1e3)),
    "negative power": (lambda t: t**-0.3, lambda t: t ** mpmath.mpf(-0.3), (0.02, 0.3, 1e3)),
    "power of power": (lambda t: t**t, lambda t: t**t, (0.1, 0.9, 3)),
    "power of number": (lambda t: 1.3**t, lambda t: mpmath.mpf(1.3) ** t, (0, 2, -40)),
    "exp": (jnp.exp, mpmath.exp, (0, 0.3, -600, 600)),
    "exp2": (jnp.exp2, lambda t: 2**t, (0, 0.3, -60)),
    "expm1": (jnp.expm1, mpmath.expm1, (0, 1e-2, -30, 30)),
    "log": (jnp.log, mpmath.log, (1e-3, 1, 1e6)),
    "log1p": (jnp.log1p, mpmath.log1p, (0, 1e-2, -0.9, 1e6)),
    "sin": (jnp.sin, mpmath.sin, (0, 0.3, np.pi / 2, 999)),
    "cos": (jnp.cos, mpmath.cos, (0, 0.3, np.pi / 2, 999)),
    "tan": (jnp.tan, mpmath.tan, (0, 0.3, 1.5, -20)),
    "sinh": (jnp.sinh, mpmath.sinh, (0, 0.3, -40)),
    "cosh": (jnp.cosh, mpmath.cosh, (0, 0.3, -40)),
    "tanh": (jnp.tanh, mpmath.tanh, (0, 0.3, -2)),
    "asin": (jnp.arcsin, mpmath.asin, (0, 0.3, -0.99)),
    "acos": (jnp.arccos, mpmath.acos, (0, 0.3, -0.99)),
    "atan": (jnp.arctan, mpmath.atan, (0, 0.3, 1e4)),
    "asinh": (jnp.arcsinh, mpmath.asinh, (0, 0.3, 1e4)),
    "acosh": (jnp.arccosh, mpmath.acosh, (1.01, 1.7, 1e4)),
    "atanh": (jnp.arctanh, mpmath.atanh, (0, 0.3, -0.99)),
    "atan2": (
        lambda t: jnp.arctan2(jnp.sin(t), t - 0.5),
        lambda t: mpmath.atan2(mpmath.sin(t), t - mpmath.mpf(0.5)),
        (0.1, 0.5, 2),
    ),
    "erf": (erf, mpmath.erf, (0, 0.3, -2)),
    "erfc": (erfc, mpmath.erfc, (0, 0.3, -2, 5)),
    "erfinv": (erfinv, mpmath.erfinv, (0, 0.3, -0.9)),
    "logistic": (jax.nn.sigmoid, lambda t: 1 / (1 + mpmath.exp(-t)), (0, 0.3, -30)),
    "inverse of cosh": (lambda t: 1 / jnp.cosh(t) ** 2, lambda t: 1 / mpmath.cosh(t) ** 2, (0, 0.3, -300)),
    "inverse of exp": (lambda t: t / jnp.exp(2 * t), lambda t: t / mpmath.exp(2 * t), (0.1, 0.3, 300)),
    "inverse of 3 + 5 exp": (
        lambda t: 2 / (3 + 5 * jnp.exp(t)),
        lambda t: 2 / (3 + 5 * mpmath.exp(t)),
        (0, 0.3, 40),
    ),
    "silu": (jax.nn.silu, lambda t: t / (1 + mpmath.exp(-t)), (0, 0.3, -30)),
}
# mpmath takes long to find the reference of these.
LONG = ("erfinv",)


def marked(name, *more):
    return pytest.param(name, *more, marks=[pytest.mark.thorough] if name in LONG else [])


CASES = [marked(name, at) for name, (_, _, places) in FUNCTIONS.items() for at in places]


def check(found, reference, at, scale):
    """Hold coefficients against exact ones; errors are relative to these, and to what a rounded argument makes of them."""
    more = ORDER + 4
    wanted = exact(lambda t: reference(t, 1), at, more, scale)
    moved = exact(lambda t: reference(t, 1 + mpmath.mpf(10) ** -20), at, more, scale)
    by_rounding = [(b - a) * mpmath.mpf(10) ** 20 for a, b in zip(wanted, moved, strict=True)]
    errors = np.array([abs(float(a - mpmath.mpf(float(b)))) for a, b in zip(wanted, found, strict=False)])
    allowed = ROUNDING * (sizes(wanted) + sizes(by_rounding))[:ORDER]
    # Of the exact ones.
    largest = max(abs(float(c)) * scale**k for k, c in enumerate(wanted))
    noise = [1e-30 * largest / scale**k for k in range(ORDER)]
    assert np.all(errors <= allowed + noise), errors / allowed


@pytest.mark.parametrize(("name", "at"), CASES)
def test_coefficients_are_exact(name, at):
    function, reference, _ = FUNCTIONS[name]
    scale = abs(at) if 0 < abs(at) < 0.1 or abs(at) >= 1e3 else 0.1
    check(of_time(function, at, ORDER), lambda t, factor: reference(t * factor), at, scale)


@pytest.mark.parametrize(
    ("function", "at"),
    [
        (lambda t: 1 / jnp.cosh(t), 900.0),
        (lambda t: t / jnp.cosh(-3 * t) ** 2, 400.0),
        (lambda t: t / (2 * jnp.exp(t * t)), 40.0),
        (lambda t: 2 / (3 + 5 * jnp.exp(t)), 900.0),
        (lambda t: jnp.exp(-t * t), 900.0),
        (lambda t: jnp.tanh(t) - 1, 900.0),
    ],
)
def test_what_overflows_in_a_denominator_leaves_zeros(function, at):
    np.testing.assert_array_equal(of_time(function, at, ORDER), 0.0)


@pytest.mark.parametrize("name", [marked(name) for name in FUNCTIONS])
def test_functions_of_functions_are_exact(name):
    function, reference, places = FUNCTIONS[name]
    place = places[1]
    found = of_time(lambda t: function(place * (1 + 0.001 * jnp.sin(t))), 0.4, ORDER)
    part = mpmath.mpf(0.001)
    check(found, lambda t, factor: reference(factor * mpmath.mpf(place) * (1 + part * mpmath.sin(t))), 0.4, 1)


@pytest.mark.thorough
def test_every_function_has_its_coefficients_in_a_loop_over_the_orders():
    names = [*FUNCTIONS]
    places = jnp.array([float(FUNCTIONS[name][2][1]) for name in names])

    def force(t, x, v, args):
        at = [place * (1 + 0.001 * jnp.sin(t + x[j])) for j, place in enumerate(places)]
        return jnp.stack([FUNCTIONS[name][0](a) for name, a in zip(names, at, strict=True)])

    n = len(names)
    own = bound(force, n)
    plan = plan_force(own, n)
    order, t, x, v = 8, jnp.float64(0.4), jnp.linspace(-0.2, 0.2, n), jnp.linspace(0.3, 0.1, n)
    wanted, _, _ = motion(plan, own, t, x, v, order)
    found, _ = by_loop(plan, own, t, x, v, order)
    wanted = np.stack(wanted[:order])
    sizes = np.maximum.accumulate(np.abs(wanted[::-1]))[::-1]
    assert np.all(np.abs(found - wanted) <= 30 * ROUNDING * sizes)
