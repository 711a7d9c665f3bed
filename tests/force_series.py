"""Taylor coefficients of forces, and those that they are held against."""

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import mpmath
import numpy as np

from vijax._series.modes import decide, num_rounds
from vijax._series.order_loop import first_sums, one_order
from vijax._series.plan import plan_force
from vijax._series.series import Series, series_of
from vijax._system.force import as_force, bind_args


def bound(force, num_masses=1, args=None):
    """A force as a machine holds it."""
    found = bind_args(as_force(force), args, num_masses)
    assert found is not None
    return found


def of_time(function, at, order):
    """Coefficients of a function of time alone, without modes."""
    force = bound(lambda t, x, v, args: function(t) + 0 * x)
    series = series_of(plan_force(force, 1), force, jnp.float64(at), like=jnp.zeros(1))
    for _ in range(order):
        series = series.extend(jnp.zeros(1), jnp.zeros(1))
    return np.array([float(series.force(k)[0]) for k in range(order)])


def motion(plan, force, t, x, v, order, modes=()):
    """Coefficients of a motion of unit masses, and the series of its force."""
    series = series_of(plan, force, t, like=x, modes=modes)
    xs, vs = [x], [v]
    for k in range(order):
        series = series.extend(xs[k], vs[k])
        xs.append(vs[k] / (k + 1))
        vs.append(series.force(k) / (k + 1))
    return xs, vs, series


def by_loop(plan, force, t, x, v, order, modes=()):
    """Coefficients of a motion of unit masses, and from order 1 on of the derivatives of its force, by a loop."""
    start = series_of(plan, force, t, like=x, modes=modes).extend(x, v)

    def one(carry, k):
        sums, x, v = carry
        own = one_order(start, k, sums, x, v)
        entries = {"x": own.by_x(k), "v": own.by_v(k)} if plan.has_jacobian else {}
        return (own.sums, v / (k + 1), own.force(k) / (k + 1)), (x, entries)

    begin = first_sums(plan, order, x), v, start.force(0)
    _, (later, entries) = jax.lax.scan(one, begin, jnp.arange(1.0, order))
    return jnp.concatenate([x[None], later]), entries


def first_modes(plan, force, t, x, v):
    """Modes at the start of a motion of unit masses."""
    modes = jnp.zeros((plan.num_switches, *x.shape[1:]))
    for _ in range(num_rounds(plan)):
        modes = decide(motion(plan, force, t, x, v, 4, modes)[2])
    return modes


def nested(force, function, order):
    """Coefficients of a function of (t, x, v) along a motion of unit masses, by derivatives of derivatives."""

    def along(of):
        return lambda t, x, v: jax.jvp(of, (t, x, v), (jnp.ones(()), v, force(t, x, v)))[1]

    functions = list(itertools.accumulate(range(order - 1), lambda of, _: along(of), initial=function))

    return lambda t, x, v: [of(t, x, v) / float(mpmath.factorial(k)) for k, of in enumerate(functions)]


def exact(function, at, order, scale=1.0):
    """Taylor coefficients by 60 digits, from differences on the length `scale`."""
    with mpmath.workdps(60):
        at, scale = mpmath.mpf(float(at)), mpmath.mpf(scale)
        found = mpmath.taylor(lambda u: function(at + scale * u), 0, order - 1, chop=False)
        return [c / scale**k for k, c in enumerate(found)]


def sizes(coefficients):
    """Sizes that rounding errors are relative to: the largest on a line between logarithms of two coefficients."""
    sizes: list[Any] = [abs(c) for c in coefficients]
    found: list[Any] = []
    for k, own in enumerate(sizes):
        pairs = itertools.product(range(k), range(k + 1, len(sizes)))
        between = (sizes[i] ** ((j - k) / (j - i)) * sizes[j] ** ((k - i) / (j - i)) for i, j in pairs)
        found.append(max([own, *between]))
    return np.array(list(map(float, found)))


def entries(series: Series, k, num_masses):
    """Matrices of coefficient k of the derivatives by positions and velocities."""
    out = np.zeros((2, num_masses, num_masses))
    for block, found in zip(out, (series.by_x(k), series.by_v(k)), strict=True):
        for at, entry in found.items():
            block[at] = entry
    return out
