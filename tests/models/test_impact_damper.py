"""The impact damper against its symmetric orbit in closed form, and the slow flow of a light one."""

import numpy as np
import pytest
from helpers import log_of
from model_roundings import ORBIT
from scipy.integrate import solve_ivp

import vijax as vx

DAMPER = {"position": 0.6, "restitution": 0.6, "damping_ratio": 0.02, "mass_ratio": 0.15}


def symmetric(
    w: float, amplitude: float, position: float, restitution: float, damping_ratio: float, mass_ratio: float
):
    """Phase, and state just after the impact at contact 0, of the orbit with one impact at each end.

    Half a period T later all is reversed. So the free mass flies at the speed s from s T / 4 to -s T / 4; momentum
    and restitution give the velocities of the oscillator, times s. With E the matrix of its free motion over T / 2,
    and p the response to the load at the impact, E (y+ - p) - p = -y-: linear in s, and |p| is known. Of the two
    motions the one with the larger s is returned.
    """
    half, d, r, mu = np.pi / w, position, restitution, mass_ratio
    minus = -(1 - r + 2 * mu) / (1 + r)
    before, after = np.array([half / 2, minus]), np.array([half / 2, minus + 2 * mu])
    zeta, wd = damping_ratio, np.sqrt(1 - damping_ratio**2)
    c, s, decay = np.cos(wd * half), np.sin(wd * half), np.exp(-zeta * half)
    flow = decay * np.array([[c + zeta / wd * s, s / wd], [-s / wd, c - zeta / wd * s]])
    of = lambda plus, minus: np.linalg.solve(flow + np.eye(2), flow @ plus + minus)  # noqa: E731
    slope, offset = of(after, before), of(np.array([-d, 0.0]), np.array([-d, 0.0]))
    scale = np.array([1.0, 1 / w])
    slope, offset = scale * slope, scale * offset
    response = amplitude / (1 - w**2 + 2j * zeta * w)
    speed = np.roots([slope @ slope, 2 * slope @ offset, offset @ offset - abs(response) ** 2]).real.max()
    p = slope * speed + offset
    phase = np.arctan2(-p[1], p[0]) - np.angle(response)
    x = speed * half / 2 - d
    return phase, np.array([x, speed * half / 2]), speed * np.array([minus + 2 * mu, -1.0]), speed * minus


def test_an_impact_damper_has_the_exact_symmetric_orbit():
    w, amplitude = 1.0, 0.1
    phase, x, v, minus = symmetric(w, amplitude, **DAMPER)
    system, period, turns = vx.models.impact_damper(w, amplitude, phase=phase, **DAMPER), 2 * np.pi / w, 3
    # Just after the impact: the start is on contact 0, which opens.
    sol = vx.simulate(system, 0.0, (turns + 0.25) * period, x, v)
    events = log_of(sol)
    assert [event.kind for event in events] == ["impact"] * 2 * turns
    assert [event.stop for event in events] == [1, 0] * turns
    times = period / 2 * np.arange(1, 2 * turns + 1)
    np.testing.assert_allclose([event.t for event in events], times, rtol=ORBIT)
    approach = -v[1] - minus
    np.testing.assert_allclose([event.velocity for event in events], approach, rtol=ORBIT)
    # Without the free mass the resonance would be at 2.5.
    reach = np.abs(sol.evaluate(np.linspace(0, turns * period, 300))[0][:, 0]).max()
    assert reach < 0.5


def test_the_ends_of_an_impact_damper_keep_the_momentum():
    w, amplitude = 1.0, 0.1
    phase, x, v, _ = symmetric(w, amplitude, **DAMPER)
    system = vx.models.impact_damper(w, amplitude, phase=phase + 0.4, **DAMPER)
    sol = vx.simulate(system, 0.0, 40.0, x, v)
    t = np.array([event.t for event in log_of(sol) if event.kind == "impact"])
    assert len(t) > 5
    before, after = (np.asarray(sol.evaluate(at)[1]) for at in (np.nextafter(t, 0), t))
    masses = np.array([1.0, DAMPER["mass_ratio"]])
    np.testing.assert_allclose(after @ masses, before @ masses, rtol=0, atol=ORBIT)
    relative = [v[:, 1] - v[:, 0] for v in (before, after)]
    np.testing.assert_allclose(relative[1], -DAMPER["restitution"] * relative[0], rtol=0, atol=ORBIT)


@pytest.mark.thorough
@pytest.mark.parametrize("w", [pytest.param(0.98, marks=pytest.mark.slow), 1.0])
def test_an_impact_damper_that_is_hit_as_periods_end_repeats_after_one(w):
    phase, x, v, _ = symmetric(w, 0.1, **DAMPER)
    system = vx.models.impact_damper(w, 0.1, phase=phase, **DAMPER)
    sol = vx.simulate(system, 0.0, 16 * 2 * np.pi / w, x, v)
    points = {"forcing.frequency": [w]}
    ds = vx.sweep(system, points, transient=0, record=16, x0=x, v0=v, progress=False)
    for source in (sol, ds):
        # Rounding puts some of these impacts before the end of their period and some after.
        motion = vx.classify(source, last=16)
        assert int(motion.num_periods.squeeze()) == 1
        assert motion.num_impacts.values.ravel().tolist() == [1, 1]
        assert float(motion.recurrence_error.squeeze()) < 1e-10


def test_a_light_energy_sink_drains_a_free_vibration_as_the_slow_flow_on_its_invariant_manifold_says():
    """Two impacts a period while A falls slowly, to the first order of the mass ratio mu.

    For half a period pi the free mass flies at a speed V, from end to end of a container that moves as A sin. At the
    upper end it hits the container at x = k U - d, which moves back at the speed U, with V = U (1 + r) / (1 - r) by
    the impact law and k = (pi / 2) (1 + r) / (1 - r) by the flight: so A^2 = U^2 + (k U - d)^2. The impacts dissipate
    (2 / pi) mu U^2 (1 + r) / (1 - r) per unit of time, which A^2 / 2 loses. Such manifolds: T. Li, E. Gourc, S.
    Seguy, A. Berlioz, Int. J. Non-Linear Mechanics 90 (2017) 100-110.
    """
    r, first, slow_time = 0.6, 0.6, 0.4
    ratio = (1 + r) / (1 - r)
    k = np.pi / 2 * ratio

    def speed(a: float) -> float:
        return (k + np.sqrt(k * k - (1 + k * k) * (1 - a * a))) / (1 + k * k)

    errors = []
    for mu in (0.01, 0.0025):
        system = vx.models.impact_damper(1.0, 0.0, restitution=r, mass_ratio=mu)
        u = speed(first)
        x = k * u - 1
        until = 2 * np.pi * round(slow_time / mu / (2 * np.pi))
        sol = vx.simulate(system, 0.0, until, [x, x + 1], [-u, -ratio * u])
        assert int(sol.num_events) == round(until / np.pi) - 1
        slow = solve_ivp(
            lambda _, a: -(2 / np.pi) * ratio * speed(a[0]) ** 2 / a, (0, mu * until), [first], rtol=1e-9
        )
        errors.append(float(np.hypot(sol.x1[0], sol.v1[0])) - slow.y[0, -1])
    assert abs(errors[0]) < 0.02
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
