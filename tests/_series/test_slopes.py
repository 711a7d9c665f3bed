"""Infinite slopes of forces where a power below 1 begins."""

import jax.numpy as jnp
import pytest
from force_series import bound

from vijax._series.plan import plan_force

FINITE = {
    "the root times what vanishes with it": lambda t, x, v, a: -x * jnp.sqrt(jnp.abs(x)),
    "behind a clearance": lambda t, x, v, a: -(x - 0.3) * jnp.sqrt(jnp.maximum(x - 0.3, 0)),
    "of a velocity": lambda t, x, v, a: -v * jnp.sqrt(jnp.abs(v)),
    "a power above 1": lambda t, x, v, a: -(jnp.maximum(x - 0.3, 0) ** 1.5) * (1 + 0.3 * v),
    "kept from zero": lambda t, x, v, a: -jnp.sqrt(jnp.maximum(x, 1e-6)),
    "smooth": lambda t, x, v, a: -x * (1 - 1 / jnp.sqrt(1 + x**2)),
    "of a number": lambda t, x, v, a: -x * jnp.sqrt(jnp.maximum(a, 0)),
}
INFINITE = {
    "a root": lambda t, x, v, a: -jnp.sqrt(jnp.maximum(x, 0)),
    "a flow through an orifice": lambda t, x, v, a: -jnp.sign(v) * jnp.sqrt(jnp.abs(v)),
    "a factor that vanishes elsewhere": lambda t, x, v, a: -(x - 0.2) * jnp.sqrt(jnp.maximum(x - 0.3, 0)),
    "a factor of the velocity": lambda t, x, v, a: -v * jnp.abs(x) ** 0.5,
}


@pytest.mark.parametrize("name", FINITE | INFINITE)
def test_slopes_where_a_power_begins(name):
    plan = plan_force(bound((FINITE | INFINITE)[name], 1, 0.7), 1, jacobian=True)
    assert plan.has_infinite_slopes == (name in INFINITE)
