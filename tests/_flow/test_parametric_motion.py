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


@pytest.mark.parametrize(
    ("flow", "error"), [(None, 1e-12), (vx.TaylorFlow(order=20, tolerance=1e-14), 5e-14)]
)
def test_the_edges_of_mathieus_chart(flow, error):
    numbers = [(n, is_even) for n in range(7) for is_even in (True, False) if n or is_even]
    cases = [(n, is_even, q) for n, is_even in numbers for q in (0.5, 2.0, 5.0, 10.0, 20.0)]
    edges = np.array([(mathieu_a if is_even else mathieu_b)(n, q) for n, is_even, q in cases])
    qs = np.array([q for *_, q in cases])
    states = jax.jit(lambda a: jax.lax.map(lambda at: ends(at[0], at[1], flow), (a, qs)))
    found, after, before = (np.asarray(states(edges + step)) for step in (0.0, 1e-3, -1e-3))
    slopes = (after - before) / 2e-3
    at = [(k, *EDGES[is_even, n % 2]) for k, (n, is_even, _) in enumerate(cases)]
    errors = np.array([found[place] / slopes[place] for place in at])
    assert np.abs(errors).max() < error


def test_the_motion_is_that_of_a_force_written_by_hand():
    k, c, load = [0.3, -0.2], 0.05, vx.Harmonic([0.5], 0.9)
    terms = vx.Parametric([[[a]] for a in k], [[[c]]], phase=[0.3, 0.7])

    def by_hand(t, x, v, args):
        first, second = jnp.cos(0.9 * t + 0.3), jnp.cos(1.8 * t + 0.7)
        return -(k[0] * first + k[1] * second) * x - c * first * v - 0.1 * x**3

    def machine(force, terms=None):
        return vx.ImpactSystem(
            [1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.3, "upper", 0.7)], force, parametric=terms
        )

    found = vx.simulate(machine(lambda t, x, v, args: -0.1 * x**3, terms), 0.0, 40.0)
    known = vx.simulate(machine(by_hand), 0.0, 40.0)
    n = int(known.num_events)
    assert n == int(found.num_events) > 3
    np.testing.assert_allclose(found.events.t[:n], known.events.t[:n], rtol=1e-12)
    np.testing.assert_allclose(found.x1, known.x1, rtol=1e-12)


@pytest.mark.slow
def test_sweeps_count_the_periods_of_the_terms():
    def machine(frequency):
        terms = vx.Parametric([[[-0.8]]], frequency=frequency)
        return vx.ImpactSystem(
            [1.0], [[0.1]], [[1.0]], None, [vx.Stop(0, 0.3, "upper", 0.7)], parametric=terms
        )

    values = np.array([1.8, 2.0, 2.1])
    ds = vx.sweep(
        machine(2.0), {"parametric.frequency": values}, x0=[0.1], transient=8, record=4, progress=False
    )
    for k, w in enumerate(values):
        sol = vx.simulate(machine(w), 0.0, 12 * 2 * np.pi / w, x0=[0.1])
        np.testing.assert_allclose(ds.x.values[k], sol.x1, atol=1e-11)
    other = vx.Parametric([[0.3]], frequency=1.1)
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 0.9), parametric=other)
    with pytest.raises(ValueError, match="period of the load"):
        vx.sweep(system, {"forcing.frequency": [0.9, 1.0]}, progress=False)
