"""Large machines whose parts do not act on each other move as the parts do alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# Parts and whole take other steps.
ROUNDING = 1e-11
SPAN = 40.0


def chain(n: int, position: float = 0.3) -> vx.ImpactSystem:
    """A chain with a stop on each mass, upper and lower in turns, in an order of their own."""
    stops = [
        vx.Stop(i, position if i % 2 else -position, "upper" if i % 2 else "lower", 0.7) for i in range(n)
    ]
    stops = stops[1::2] + stops[::2]
    return vx.chain([1.0] * n, [0.1] * n, [1.0] * n, vx.Harmonic([0.9] + [0.0] * (n - 1), 0.8), stops)


def side_by_side(first: vx.ImpactSystem, second: vx.ImpactSystem) -> vx.ImpactSystem:
    n = first.num_masses
    blocks = lambda a, b: np.block([[a, np.zeros((n, len(b)))], [np.zeros((len(b), n)), b]])  # noqa: E731
    amplitude = np.concatenate([first.forcing.amplitude, second.forcing.amplitude])
    moved = [vx.Stop(n + s.mass, s.position, s.side, s.restitution) for s in second.stops]
    return vx.ImpactSystem(
        np.concatenate([first.mass, second.mass]),
        blocks(first.damping, second.damping),
        blocks(first.stiffness, second.stiffness),
        vx.Harmonic(amplitude, 0.8),
        [*first.stops, *moved],
    )


@pytest.fixture(scope="module")
def parts() -> list[vx.ImpactSystem]:
    return [chain(3), chain(20, 0.2)]


@pytest.fixture(scope="module")
def exact(parts) -> np.ndarray:
    ends = [vx.simulate(part, 0.0, SPAN) for part in parts]
    return np.concatenate([np.concatenate([sol.x1, sol.v1]) for sol in ends])


def states(x, v):
    """Those of the parts one after another."""
    return np.concatenate([x[:3], v[:3], x[3:], v[3:]])


@pytest.mark.thorough
def test_a_trajectory(parts, exact):
    sol = vx.simulate(side_by_side(*parts), 0.0, SPAN)
    assert int(sol.num_events) > 20
    np.testing.assert_allclose(states(sol.x1, sol.v1), exact, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_batch_and_derivatives(parts, exact):
    whole = side_by_side(*parts)

    def end(v):
        v0 = jnp.zeros(23).at[0].set(v)
        sol = vx.simulate(whole, 0.0, SPAN, jnp.zeros(23), v0, throw=False)
        return jnp.stack([sol.x1, sol.v1])

    x, v = jax.vmap(end)(jnp.array([0.0, 0.1]))[0]
    np.testing.assert_allclose(states(x, v), exact, rtol=0, atol=ROUNDING)

    def of_part(v):
        sol = vx.simulate(parts[0], 0.0, SPAN, jnp.zeros(3), jnp.zeros(3).at[0].set(v))
        return jnp.stack([sol.x1, sol.v1])

    slope, own = jax.jacfwd(end)(0.0), jax.jacfwd(of_part)(0.0)
    np.testing.assert_allclose(slope[:, :3], own, rtol=1e-9, atol=1e-9)
    assert float(jnp.abs(slope[:, 3:]).max()) < ROUNDING


@pytest.mark.thorough
@pytest.mark.parametrize("path", ["forcing.frequency", "stops[0].position", "stiffness[0][0]"])
def test_a_sweep(parts, path):
    """Numbers of a machine are shared by the points of a sweep by frequency, and their own in others."""
    values = {
        "forcing.frequency": [0.8, 0.85],
        "stops[0].position": [0.3, 0.25],
        "stiffness[0][0]": [2.0, 2.2],
    }
    options = {"transient": 2, "record": 1, "progress": False}
    ds = vx.sweep(side_by_side(*parts), {path: values[path]}, **options)
    own = vx.sweep(parts[0], {path: values[path]}, **options)
    np.testing.assert_allclose(ds.x[..., :3], own.x, rtol=0, atol=ROUNDING)
