"""Forces in narrow ranges of positions, walls and steep steps: no step passes over them, from any start."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.special
from test_force_flow import flow_map_of

import vijax as vx
from vijax._flow import force_flow

pytestmark = pytest.mark.thorough

# Errors of energies, relative to its largest part.
ACCURACY = 1e-10
STARTS = 250

# Force by the distance d from its place and its width, and its potential.
FORCES = {
    "gaussian": (
        lambda d, w: jnp.exp(-((d / w) ** 2)),
        lambda d, w: -w * np.sqrt(np.pi) / 2 * scipy.special.erf(d / w),
    ),
    "lorentzian": (lambda d, w: 1 / (1 + (d / w) ** 2), lambda d, w: -w * np.arctan(d / w)),
    "inverse cosh": (lambda d, w: 1 / jnp.cosh(d / w) ** 2, lambda d, w: -w * np.tanh(d / w)),
    "tanh": (lambda d, w: -jnp.tanh(d / w), lambda d, w: w * (np.logaddexp(d / w, -d / w))),
    "logistic wall": (lambda d, w: -40 * jax.nn.sigmoid(d / w), lambda d, w: 40 * w * np.logaddexp(0, d / w)),
    "exponential wall": (lambda d, w: -jnp.exp(d / w), lambda d, w: w * np.exp(d / w)),
    "Hertz wall": (
        lambda d, w: -1e9 * jnp.maximum(d, 0.0) ** 1.5,
        lambda d, w: 4e8 * np.maximum(d, 0) ** 2.5,
    ),
    "linear wall": (lambda d, w: -1e9 * jnp.maximum(d, 0.0), lambda d, w: 5e8 * np.maximum(d, 0) ** 2),
}
_OFTEN = ("gaussian", "exponential wall")


@pytest.mark.parametrize(
    "name", [name if name in _OFTEN else pytest.param(name, marks=pytest.mark.slow) for name in FORCES]
)
def test_energy_is_kept_from_any_start_for_any_width(name):
    force, potential = FORCES[name]

    def own(t, x, v, args):
        place, width = args
        return force(x - place, width)

    machine = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], None, [], force=own)
    rng = np.random.default_rng(3)
    x, v = rng.uniform(-1, 0.2, STARTS), rng.uniform(-2, 2, STARTS)
    place, width = rng.uniform(0.25, 1.2, STARTS), 10 ** rng.uniform(-4, -0.5, STARTS)

    @jax.jit
    @jax.vmap
    def end(x, v, *args):
        found = vx.simulate(machine, 0.0, 10.0, x[None], v[None], args=args, max_steps=20_000)
        return found.x1[0], found.v1[0]

    x1, v1 = map(np.asarray, end(x, v, place, width))
    energy = lambda x, v: (v**2 + x**2) / 2 + potential(x - place, width)  # noqa: E731
    np.testing.assert_allclose(energy(x1, v1), energy(x, v), rtol=0, atol=ACCURACY)


def test_a_narrow_force_is_met_when_a_dense_reference_has_it():
    width, span = 1e-3, 2.0
    start = [-0.5, 1.0]
    bump = lambda x: np.exp(-(((x - 0.3) / width) ** 2))  # noqa: E731
    right = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], 50 * bump(y[0])],
        (0, span),
        start,
        "DOP853",
        rtol=1e-13,
        atol=1e-13,
        max_step=2e-4,
    )
    motion = flow_map_of(lambda t, x, v, args: 50 * jnp.exp(-(((x - 0.3) / width) ** 2)), span)
    np.testing.assert_allclose(motion(jnp.array(start)), right.y[:, -1], rtol=0, atol=1e-11)


def test_narrow_forces_need_the_bound_on_complex_times(monkeypatch):
    def gain():
        force = lambda t, x, v, args: jnp.exp(-(((x - 0.3) / 0.01) ** 2))  # noqa: E731
        return float(flow_map_of(force, 2.0)(jnp.array([-0.5, 1.0]))[1] ** 2) - 1

    right = 2 * 0.01 * np.sqrt(np.pi)
    np.testing.assert_allclose(gain(), right, rtol=0, atol=1e-11)
    monkeypatch.setattr(force_flow, "_bounded", lambda *args: args[4])
    assert abs(gain() - right) > 1e-4


def test_a_choice_by_a_narrow_function_is_met():
    def kick(t, x, v, args):
        return jnp.where(jnp.exp(-(((x - 0.3) / 1e-3) ** 2)) > np.exp(-1), 2.0, 0.0)

    machine = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], None, [], force=kick)
    found = vx.simulate(machine, 0.0, 2.0, [-0.5], [1.0])
    np.testing.assert_allclose(found.v1[0] ** 2, 1 + 2 * 2.0 * 2e-3, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    "law",
    [
        lambda x: jnp.sqrt(x * x),
        lambda x: jnp.sqrt(4 * x * x) / 2,
        lambda x: jnp.hypot(x, 0.0),
        lambda x: (x * x) ** 0.5,
    ],
)
def test_roots_of_squares_have_corners(law):
    machine = vx.ImpactSystem(
        [1.0], [[0.0]], [[0.0]], None, [], force=lambda t, x, v, args: -jnp.sign(x) * law(x)
    )
    found = vx.simulate(machine, 0.0, 10.0, [0.3], [1.0])
    right = 0.3 * np.cos(10) + np.sin(10), -0.3 * np.sin(10) + np.cos(10)
    np.testing.assert_allclose([found.x1[0], found.v1[0]], right, rtol=0, atol=1e-11)
