"""Motion of machines with periodic stiffness and damping."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import vijax as vx

pytestmark = pytest.mark.thorough

# Edges of the chart of x'' + (a - 2 q cos 2 t) x = 0: what of the solutions with x = 1, v = 0 or x = 0, v = 1 at t = 0 vanishes
# at t = pi / 2, for numbers that are even and odd.
EDGES = {(True, 0): (0, 1), (True, 1): (0, 0), (False, 1): (1, 1), (False, 0): (1, 0)}


def mathieu(a, q) -> vx.ImpactSystem:
    of = lambda number, ndim: jnp.reshape(number, (1,) * ndim)  # noqa: E731
    terms = vx.Parametric(stiffness=of(-2 * q, 3), frequency=2.0)
    return vx.ImpactSystem([1.0], [[0.0]], of(a, 2), parametric=terms)


def ends(a, q, flow):
    """Solutions at t = pi / 2, (start, x or v)."""

    def end(start):
        sol = vx.simulate(mathieu(a, q), 0.0, jnp.pi / 2, start[:1], start[1:], flow=flow)
        return jnp.concatenate([sol.x1, sol.v1])

    return jnp.stack([end(start) for start in jnp.eye(2)])


@pytest.mark.parametrize("flow", [None, vx.TaylorFlow(order=20, tolerance=1e-14)])
def test_the_edges_of_mathieus_chart(flow):
    numbers = [(n, is_even) for n in range(7) for is_even in (True, False) if n or is_even]
    cases = [(n, is_even, q) for n, is_even in numbers for q in (0.5, 2.0, 5.0, 10.0, 20.0)]
    edges = np.array([(mathieu_a if is_even else mathieu_b)(n, q) for n, is_even, q in cases])
    qs = np.array([q for *_, q in cases])
    states = jax.jit(lambda a: jax.lax.map(lambda at: ends(*at, flow), (a, qs)))
    found, after, before = (np.asarray(states(edges + step)) for step in (0.0, 1e-3, -1e-3))
    slopes = (after - before) / 2e-3
    at = [(k, *EDGES[is_even, n % 2]) for k, (n, is_even, _) in enumerate(cases)]
    errors = np.array([found[place] / slopes[place] for place in at])
    assert np.abs(errors).max() < 1e-12
