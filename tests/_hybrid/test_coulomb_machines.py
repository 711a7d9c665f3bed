"""Friction of contacts on bodies, moving and preloaded floors, in sweeps, batches, derivatives and orbits.

A program for each kind of machine takes half a minute to compile.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from switching_scenes import SwitchingScene, switching_scene

import vijax as vx

pytestmark = pytest.mark.slow
_DAMPING, _SPRINGS = np.diag([0.05, 0.02]), np.diag([1.0, 0.3])


def _times(sol: vx.Solution, element: int, kind: int) -> np.ndarray:
    log = sol.events
    return np.asarray(log.t)[(np.asarray(log.stop) == element) & (np.asarray(log.kind) == kind)]


def _shaken(coefficient, *, lift: float, floor=None) -> vx.ImpactSystem:
    """A block on springs on a floor, driven along it and across it."""
    load = vx.Harmonic([0.5, lift], 1.3, [0.0, 1.0], mean=[0.0, -1.0])
    floor = vx.Stop(1, 0.0, "lower", 0.5) if floor is None else floor
    rubbing = vx.Friction(0, coefficient=coefficient)
    return vx.ImpactSystem([1.0, 1.0], _DAMPING, _SPRINGS, load, [floor], friction=[rubbing])


@pytest.mark.parametrize(("one", "other"), [(0.3, 0.3), (0.2, 0.4)])
def test_two_feet_of_a_body_slip_when_the_sum_of_their_friction_is_used_up(one, other):
    # Feet at +-1 below the centre at height .5, pulled along the ground by .5 sin(.4 t).
    height, none = 0.5, np.zeros((3, 3))
    feet = [vx.Contact({1: -1.0, 2: -1.0}, 0.0, 0.0), vx.Contact({1: -1.0, 2: 1.0}, 0.0, 0.0)]
    tangent = {0: 1.0, 2: height}
    friction = [vx.Friction(tangent, coefficient=mu, contact=k) for k, mu in enumerate((one, other))]
    load = vx.Harmonic([0.5, 0.0, 0.0], 0.4, [-np.pi / 2, 0.0, 0.0], mean=[0.0, -1.0, 0.0])
    body = vx.ImpactSystem([1.0, 1.0, 0.3], none, none, load, feet, friction=friction)
    sol = vx.simulate(body, 0.0, 5.0)
    # The pull T tilts the load: N = (1 +- T height) / 2.
    most = (one + other) / 2 / (1 - (one - other) * height / 2)
    for element in (2, 3):
        np.testing.assert_allclose(_times(sol, element, vx.SLIP), [np.arcsin(most / 0.5) / 0.4], rtol=1e-12)
    assert np.abs(sol.x1[1:]).max() < 1e-14


def test_a_floor_that_moves_is_as_a_load():
    frequency = 0.7
    motion = vx.Harmonic([1.3 / frequency**2], frequency, [2.5])
    floor = vx.Stop(1, 0.0, "lower", 0.5, motion=motion)
    load = vx.Harmonic([0.0, 0.0], frequency, mean=[0.0, -1.0])
    none = np.zeros((2, 2))
    block = vx.ImpactSystem([1.0, 1.0], none, none, load, [floor], friction=[vx.Friction(0, coefficient=0.3)])
    start = 1.3 / frequency**2 * np.cos(2.5), -1.3 / frequency * np.sin(2.5)
    sol = vx.simulate(block, 0.0, 5.0, [0.0, start[0]], [9.0, start[1]])
    np.testing.assert_allclose(_times(sol, 0, vx.RELEASE), [4.414321999433], rtol=1e-12)
    np.testing.assert_allclose(sol.friction_force(1.0), [0.3 * (1 - 1.3 * np.cos(3.2))], rtol=1e-12)


def test_a_preloaded_floor_that_does_not_yield_is_as_a_rigid_one():
    rigid = vx.simulate(_shaken(0.2, lift=0.4), 0.0, 20.0, v0=[0.1, 0.0])
    soft = vx.CompliantStop(1, 0.0, "lower", 50.0, 1.0, preload=3.0)
    yielding = vx.simulate(_shaken(0.2, lift=0.4, floor=soft), 0.0, 20.0, v0=[0.1, 0.0])
    np.testing.assert_allclose(yielding.events.t, rigid.events.t, rtol=1e-12)
    np.testing.assert_allclose(yielding.x1, rigid.x1, atol=1e-13)
    np.testing.assert_allclose(yielding.friction_force(3.0), rigid.friction_force(3.0), atol=1e-13)


def test_sweeps_and_batches_follow_the_same_motions():
    coefficients = np.linspace(0.05, 0.3, 3)
    path, end = "friction[0].coefficient", 6 * 2 * np.pi / 1.3
    ds = vx.sweep(_shaken(0.2, lift=1.6), {path: coefficients}, transient=4, record=2, progress=False)
    run = lambda mu: vx.simulate(_shaken(mu, lift=1.6), 0.0, end)  # noqa: E731
    batch = jax.jit(jax.vmap(lambda mu: run(mu).x1))(jnp.asarray(coefficients))
    for k, mu in enumerate(coefficients):
        alone = run(mu)
        np.testing.assert_allclose(ds["section_x"].values[k, -1], alone.x1, atol=1e-10)
        np.testing.assert_allclose(batch[k], alone.x1, atol=1e-12)


def _derivatives(
    scene: SwitchingScene, until: float, v0: list[float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the end by the start, exact and by central differences."""
    data, n = scene.data, scene.data["n"]
    start = jnp.asarray([*data["x0"], *(data["v0"] if v0 is None else v0)])

    def end(z):
        sol = vx.simulate(scene.system, data["t0"], until, z[:n], z[n:])
        return jnp.concatenate([sol.x1, sol.v1])

    slopes, step = np.asarray(jax.jacfwd(end)(start)), 1e-6
    differences = [(end(start + step * e) - end(start - step * e)) / (2 * step) for e in np.eye(2 * n)]
    return slopes, np.stack(differences, axis=1)


def test_derivatives_pass_impacts_that_slip_stick_and_reverse():
    slopes, differences = _derivatives(switching_scene("rod_reverses"), 4.25)
    np.testing.assert_allclose(slopes, differences, atol=2e-7 * np.abs(slopes).max())


def test_derivatives_pass_slip_and_stick_on_a_compliant_floor():
    # Not from the rest of the constant friction, where derivatives have two sides.
    slopes, differences = _derivatives(switching_scene("soft_skid"), 8.0, [0.7, -0.1])
    np.testing.assert_allclose(slopes, differences, atol=2e-7 * np.abs(slopes).max())


@pytest.mark.parametrize("lift", [0.9, 1.6])
def test_orbits_are_found_with_the_multipliers_of_their_map(lift):
    # Without impacts the block sticks and slips, with them it chatters.
    system = _shaken(0.3, lift=lift)
    settled = vx.simulate(system, 0.0, 300 * system.forcing.period)
    orbit = vx.periodic_orbit(system, settled.x1 + 1e-4, settled.v1)
    assert orbit.result == vx.ORBIT_RESULTS.successful
    np.testing.assert_allclose(orbit.x0, settled.x1, atol=1e-12)
    expected = np.linalg.eigvals(vx.monodromy_matrix(system, orbit.x0, orbit.v0))
    np.testing.assert_allclose(np.sort(np.abs(orbit.multipliers)), np.sort(np.abs(expected)), atol=1e-10)
