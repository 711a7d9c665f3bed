"""Restitution that falls with the speed of impact, against recurrences in 30 digits and determinants."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import vijax as vx

# Some dozen bounces, each of some roundings.
ROUNDED = 1e-12
# A chatter is completed from speeds of 1e-6 on, as if its coefficient were r0 from there.
CHATTER = 1e-11
GRAVITY, SPEED, LAW = 1.0, 2.0, (0.9, 0.5, 0.25)


def ball(law, **options):
    """A free ball that is thrown down onto a table."""
    load = vx.Harmonic(amplitude=[0.0], frequency=1.0, mean=[-GRAVITY])
    return vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0, "lower", law, **options)])


def bounces(law, num):
    """Times and speeds of the first impacts, in 30 digits; speeds fall by r(u)."""
    with mpmath.workdps(30):
        r0, scale, exponent = map(mpmath.mpf, law)
        t, u, found = mpmath.mpf(0), mpmath.mpf(SPEED), []
        for _ in range(num):
            after = u * r0 * (1 + u / scale) ** -exponent
            found.append((t, u, after))
            t, u = t + 2 * after / GRAVITY, after
        return np.array(found, float).T


def test_a_ball_bounces_as_the_recurrence_says():
    system = ball(vx.FallingRestitution(*LAW))
    events = vx.simulate(system, 0.0, 20.0, x0=[0.0], v0=[-SPEED]).events
    t, u, after = bounces(LAW, 60)
    np.testing.assert_allclose(events.t[:60], t, atol=ROUNDED)
    np.testing.assert_allclose(events.velocity_minus[:60], -u, rtol=ROUNDED, atol=ROUNDED)
    np.testing.assert_allclose(events.velocity_plus[:60], after, rtol=ROUNDED, atol=ROUNDED)


def test_its_chatter_ends_when_the_series_does():
    system = ball(vx.FallingRestitution(*LAW))
    events = vx.simulate(system, 0.0, 40.0, x0=[0.0], v0=[-SPEED]).events
    is_stick = np.asarray(events.kind) == vx.STICK
    assert is_stick.sum() == 1
    t, _, after = bounces(LAW, 400)
    np.testing.assert_allclose(events.t[is_stick], t[-1] + 2 * after[-1] / (1 - LAW[0]), atol=CHATTER)


def test_without_an_exponent_it_is_newtons_law():
    for law in (vx.FallingRestitution(0.7, 0.5, 0.0), 0.7):
        sol = vx.simulate(ball(law), 0.0, 20.0, x0=[0.0], v0=[-SPEED], max_events=16, throw=False)
        np.testing.assert_allclose(sol.events.velocity_plus[:8], SPEED * 0.7 ** np.arange(1, 9), rtol=ROUNDED)


@pytest.mark.slow
def test_derivatives_are_those_of_the_recurrence():
    def time_of_fifth(numbers):
        t, u = 0.0, SPEED
        for _ in range(4):
            u = u * numbers[0] * (1 + u / numbers[1]) ** -numbers[2]
            t = t + 2 * u / GRAVITY
        return t

    def by_engine(numbers):
        system = ball(vx.FallingRestitution(*numbers))
        return vx.simulate(system, 0.0, 8.0, x0=[0.0], v0=[-SPEED], max_events=8, throw=False).events.t[4]

    numbers = jnp.array(LAW)
    exact = jax.grad(time_of_fifth)(numbers)
    np.testing.assert_allclose(jax.jacfwd(by_engine)(numbers), exact, rtol=ROUNDED)
    np.testing.assert_allclose(jax.jacrev(by_engine)(numbers), exact, rtol=ROUNDED)


@pytest.mark.slow
def test_an_orbit_loses_volume_by_its_damper_and_its_impacts_and_is_followed():
    """Each impact takes phase volume by r d(r u)/du, the damper by exp(-c T)."""
    damping, law = 0.1, vx.FallingRestitution(0.9, 1.0, 0.5)
    load = vx.Harmonic(amplitude=[1.0], frequency=2.0)
    system = vx.ImpactSystem([1.0], [[damping]], [[1.0]], load, [vx.Stop(0, 0.0, "upper", law)])
    ends = vx.simulate(
        system, 0.0, 200 * system.forcing.period, x0=[-0.1], v0=[0.0], max_events=0, throw=False
    )
    orbit = vx.periodic_orbit(system, ends.x1, ends.v1)
    loss = np.exp(-damping * orbit.period)
    for u in np.asarray(orbit.events.velocity_minus)[: int(orbit.num_impacts.sum())]:
        loss *= law(u) * jax.grad(lambda u: law(u) * u)(jnp.abs(u))
    np.testing.assert_allclose(np.prod(orbit.multipliers), loss, rtol=1e-9)
    branch = vx.continuation(orbit, "stops[0].restitution.speed", (0.8, 1.3), progress=False)
    assert branch.ends == ("bounds", "bounds")
    last = branch.orbit(len(branch) - 1)
    assert float(last.system.stops[0].restitution.speed) == 1.3
    assert last.residual < 1e-11


def test_a_sweep_draws_its_numbers_and_its_table(tmp_path):
    system = ball(vx.FallingRestitution(*LAW))
    vx.save(system, tmp_path / "ball.toml")
    assert repr(vx.load(tmp_path / "ball.toml")) == repr(system)
    assert "FallingRestitution(restitution=0.9, speed=0.5, exponent=0.25)" in repr(system.stops[0])
    vx.plot.machine(system)
