"""Forces without Taylor series are refused by the name of the operation."""

import jax
import jax.numpy as jnp
import pytest
from force_series import bound

from vijax._series.plan import plan_force
from vijax._series.refused import Refused

FORCES = {
    "sort": lambda t, x, v, a: -jnp.sort(x),
    "while": lambda t, x, v, a: jax.lax.while_loop(lambda s: jnp.all(s < 1), lambda s: s + 1, x),
    "lu": lambda t, x, v, a: jnp.linalg.solve(jnp.eye(2) + jnp.outer(x, x), x),
    "pure_callback": lambda t, x, v, a: jax.pure_callback(lambda x: x, jax.ShapeDtypeStruct((2,), float), x),
    "floor": lambda t, x, v, a: -jnp.floor(x),
    "ceil": lambda t, x, v, a: -jnp.ceil(x),
    "round": lambda t, x, v, a: -jnp.round(x),
    "rem": lambda t, x, v, a: -jnp.mod(x, 1.0),
    "bessel_i0e": lambda t, x, v, a: jax.scipy.special.i0e(x),
    "lgamma": lambda t, x, v, a: jax.scipy.special.gammaln(x + 3),
    "complex numbers": lambda t, x, v, a: jnp.abs(jnp.fft.fft(x)),
    "convert_element_type": lambda t, x, v, a: x.astype(int) * 1.0,
    "gather": lambda t, x, v, a: x[jnp.array([jnp.argmax(x), 0])],
}


@pytest.mark.parametrize("name", FORCES)
def test_the_sentence_names_the_operation(name):
    with pytest.raises(Refused) as refused:
        plan_force(bound(FORCES[name], 2), 2)
    assert refused.value.operation.startswith(name)
    assert f"`{refused.value.operation}`" in str(refused.value)
    assert "vx.DiffraxFlow" in str(refused.value)


def test_operations_on_numbers_alone_are_not_refused():
    force = bound(lambda t, x, v, a: -jnp.floor(a) * x + jnp.round(2.3 * a) * jnp.mod(a, 0.7), 1, 1.3)
    assert plan_force(force, 1).num_switches == 0
