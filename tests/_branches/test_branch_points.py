"""Symmetry breaking of a symmetric orbit, as a function of the machine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

FREQUENCY, AMPLITUDE = "forcing.frequency", "forcing.amplitude[0]"
DAMPING, GAP, RESTITUTION = 0.1, 0.5, 0.8


def between_stops(amplitude, frequency, lower=GAP):
    """One mass between two stops."""
    stops = [vx.Stop(0, GAP, "upper", RESTITUTION), vx.Stop(0, -lower, "lower", RESTITUTION)]
    return vx.chain([1.0], [DAMPING], [1.0], vx.Harmonic(jnp.stack([amplitude]), frequency), stops)


def flight(t, t0, x0, v0, frequency, amplitude):
    """State (x, v) at a time, in closed form."""
    forced = amplitude / (1 - frequency**2 + 1j * DAMPING * frequency)
    turning = lambda t: forced * jnp.exp(1j * frequency * t)  # noqa: E731
    decay, natural = DAMPING / 2, jnp.sqrt(1 - DAMPING**2 / 4)
    p = x0 - turning(t0).real
    q = (v0 - (1j * frequency * turning(t0)).real + decay * p) / natural
    cos, sin, shrunk = (
        f(natural * (t - t0)) for f in (jnp.cos, jnp.sin, lambda a: jnp.exp(-decay * a / natural))
    )
    x = turning(t).real + shrunk * (p * cos + q * sin)
    v = (1j * frequency * turning(t)).real
    return jnp.stack([x, v + shrunk * ((q * natural - decay * p) * cos - (p * natural + decay * q) * sin)])


@jax.jit
def loss_of_symmetry(guess, amplitude):
    """Time and speed of the upper impact, and frequency where the mirrored half-period map has the eigenvalue -1."""

    def equations(y):
        t0, speed, frequency = y

        def end(q):
            return flight(q[2], q[0], GAP, -RESTITUTION * q[1], frequency, amplitude)

        q = jnp.stack([t0, speed, t0 + jnp.pi / frequency])
        (x, v), by = end(q), jax.jacfwd(end)(q)
        later = -by[0, :2] / by[0, 2]
        half = jnp.stack([later, -(by[1, :2] + by[1, 2] * later)])
        return jnp.stack([x + GAP, v + speed, jnp.linalg.det(half + jnp.eye(2))])

    def step(_, y):
        return y - jnp.linalg.solve(jax.jacfwd(equations)(y), equations(y))

    return jax.lax.fori_loop(0, 12, step, guess)


@pytest.fixture(scope="module")
def point():
    system = between_stops(1.0, 2.0)
    end = vx.simulate(system, 0.0, 300 * system.forcing.period, [0.1], [0.0], max_events=9000)
    branch = vx.continuation(
        vx.periodic_orbit(system, end.x1, end.v1), FREQUENCY, (1.45, 2.1), progress=False
    )
    (point,) = branch.bifurcations
    assert point.kind == "pitchfork"
    return point


@pytest.fixture(scope="module")
def asymmetric(point):
    """The branch of the asymmetric orbits, through the point to the mirror images."""
    (orbit,) = vx.switch_branch(point)
    return vx.continuation(orbit, FREQUENCY, (1.45, 2.1), progress=False)


@pytest.fixture(scope="module")
def exact(point):
    """Symmetry breaking near the point in closed form, as a function of the amplitude."""
    log = point.orbit.events
    k = int(np.flatnonzero(np.asarray(log.stop) == 0)[0])
    known = jnp.stack([log.t[k], log.velocity_minus[k], point.value])

    def at(amplitude):
        y = known
        for a in np.linspace(1.0, amplitude, 12):
            y = loss_of_symmetry(y, a)
        return float(y[2])

    return at


@pytest.mark.thorough
@pytest.mark.slow
def test_a_branch_point_has_a_value_and_derivatives(point, exact):
    value = lambda amplitude: vx.bifurcation_value(point, between_stops(amplitude, 2.0))  # noqa: E731
    np.testing.assert_allclose(value(1.0), exact(1.0), rtol=0, atol=1e-13)
    np.testing.assert_allclose(value(1.02), exact(1.02), rtol=0, atol=1e-12)
    slope = (exact(1 + 1e-4) - exact(1 - 1e-4)) / 2e-4
    np.testing.assert_allclose(jax.grad(value)(1.0), slope, rtol=1e-6)
    np.testing.assert_allclose(jax.jacfwd(value)(1.0), slope, rtol=1e-6)


@pytest.mark.slow
def test_a_curve_of_branch_points(point, exact):
    bounds = {FREQUENCY: (1.0, 2.5), AMPLITUDE: (0.8, 1.6)}
    curve = vx.bifurcation_curve(point, AMPLITUDE, bounds, progress=False)
    assert curve.attrs["ends"] == '["bounds", "bounds"]'
    assert not np.any(curve.special)
    told = [exact(float(a)) for a in curve[AMPLITUDE].values[::7]]
    np.testing.assert_allclose(curve[FREQUENCY].values[::7], told, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_where_the_symmetry_is_broken_branches_no_longer_cross(point):
    with pytest.raises(RuntimeError, match="came to no such bifurcation"):
        vx.bifurcation_value(point, between_stops(1.0, 2.0, lower=0.49))
    bounds = {FREQUENCY: (1.0, 2.5), "stops[0].position": (0.3, 0.7)}
    with pytest.raises(ValueError, match=r"a symmetry that `stops\[0\].position` breaks"):
        vx.bifurcation_curve(point, "stops[0].position", bounds, progress=False)


@pytest.mark.slow
def test_one_of_two_mirror_images_branches_off_and_leads_back(point, asymmetric):
    assert len(point.orbit.symmetries()) == 1
    (orbit,) = vx.switch_branch(point)
    assert orbit.symmetries() == ()
    other = orbit.mirrored()
    away = abs(float(other.x0[0] - orbit.x0[0]))
    assert 1e-5 < away < 1e-2
    np.testing.assert_allclose(other.multipliers, orbit.multipliers, rtol=0, atol=1e-10)
    (same,) = asymmetric.bifurcations
    assert same.kind == "pitchfork"
    assert same.value == pytest.approx(point.value, abs=1e-13)
    assert asymmetric.ends == ("bounds", "bounds")
    np.testing.assert_allclose(asymmetric.values[[0, -1]], 1.45, rtol=0, atol=1e-14)
    first, last = asymmetric.orbit(0), asymmetric.orbit(-1)
    np.testing.assert_allclose(first.mirrored().x0, last.x0, rtol=0, atol=1e-11)
    (back,) = vx.switch_branch(same)
    assert len(back.symmetries()) == 1
    assert asymmetric.points.is_stable.values[asymmetric.points.bifurcation.values == ""].all()


@pytest.mark.slow
def test_the_normal_form_tells_how_far_the_images_are_and_that_they_are_stable(point, asymmetric):
    form = point.normal_form
    assert (form.criticality, form.side) == ("supercritical", "below")
    assert point.criticality == asymmetric.bifurcations[0].criticality
    assert np.isnan(form.amplitude(1e-3))
    told = asymmetric.bifurcations[0].normal_form
    assert told.coefficient == pytest.approx(form.coefficient, rel=1e-6)
    assert told.rate == pytest.approx(form.rate, rel=1e-6)
    errors, distances = [], []
    for k in range(1, 5):
        orbit = asymmetric.orbit(asymmetric.bifurcations[0].index + k)
        distance, other = float(orbit.system.forcing.frequency) - point.value, orbit.mirrored()
        half = np.array([(orbit.x0 - other.x0)[0], (orbit.v0 - other.v0)[0] / point.value]) / 2
        errors.append(abs(np.linalg.norm(half) / form.amplitude(distance) - 1))
        distances.append(-distance)
    ratio = np.array(errors) / np.array(distances)
    assert errors[0] < 1e-3
    assert ratio.max() < 2 * ratio.min() + 5


@pytest.mark.slow
def test_runs_beside_the_point_settle_as_its_normal_form_says(point):
    for side, num_symmetries in ((-2e-3, 0), (2e-3, 1)):
        system = between_stops(1.0, point.value + side)
        x, v = point.orbit.x0 + 1e-3, point.orbit.v0
        end = vx.simulate(system, 0.0, 4000 * system.forcing.period, x, v, max_events=8, throw=False)
        orbit = vx.periodic_orbit(system, end.x1, end.v1)
        np.testing.assert_allclose(orbit.x0, end.x1, rtol=0, atol=1e-6)
        assert len(orbit.symmetries()) == num_symmetries
