"""Motions under loads by tables, against restarts, matrix exponentials, other ways to write a load, and other flows."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import vijax as vx

# A few hundred roundings of motions of size one.
ROUNDING = 1e-13
# Central differences with a step of 1e-5.
DIFFERENCES = 1e-8
# Default tolerances of a solver.
SOLVER = 1e-9
STOP = [vx.Stop(0, 0.4, "upper", 0.7)]
WAVE = ([0.3, 2.0, 4.0], [[1.0], [-0.8], [0.3]], 0.8)
OTHER = ([0.0, 3.0], [[0.7], [-1.0]], 1.37)


def machine(load, **parts) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, STOP, **parts)


ONE = {"mass": [1.0], "damping": [[0.15]], "stiffness": [[2.0]]}
TWO = {
    "mass": [1.0, 0.8],
    "damping": [[0.25, -0.1], [-0.1, 0.1]],
    "stiffness": [[10.0, -4.0], [-4.0, 4.0]],
}
TWO_STOPS = [vx.Stop(0, 0.15, "upper", 0.2), vx.Stop(1, -0.2, "lower", 0.3)]
MACHINES = {
    "light stop": ONE | {"stops": [vx.Stop(0, 0.2, "upper", 0.3)]},
    "plastic stops": ONE | {"stops": [vx.Stop(0, 0.2, "upper", 0.0), vx.Stop(0, -0.3, "lower", 0.0)]},
    "friction": ONE | {"friction": [vx.Friction(0, 0.4, 0.6)]},
    "friction and stop": ONE | {"stops": [vx.Stop(0, 0.2, "upper", 0.5)], "friction": [vx.Friction(0, 0.3)]},
    "compliant stop": ONE | {"stops": [vx.CompliantStop(0, 0.2, "upper", 20.0, 1.0, 0.1)]},
    "preloaded stop": ONE | {"stops": [vx.CompliantStop(0, 0.2, "upper", 20.0, 0.5, preload=0.8)]},
    "no spring": {"mass": [1.0], "damping": [[0.0]], "stiffness": [[0.0]]}
    | {"stops": [vx.Stop(0, 1.0, "upper", 0.6), vx.Stop(0, -1.0, "lower", 0.6)]},
    "two masses": TWO | {"stops": TWO_STOPS},
    "general damping": TWO | {"damping": [[0.3, -0.05], [-0.05, 0.02]], "stops": TWO_STOPS},
    "contact": TWO | {"stops": [vx.Contact({0: 1.0, 1: -1.0}, 0.05, 0.2), vx.Stop(0, 0.3, "upper", 0.0)]},
    "full mass": TWO | {"mass": [[1.0, 0.2], [0.2, 0.8]], "stops": [vx.Stop(0, 0.15, "upper", 0.2)]},
    "friction and compliant stop": TWO
    | {"stops": [vx.CompliantStop(1, 0.1, "upper", 30.0)], "friction": [vx.Friction(0, 0.5, 0.6)]},
}
_FAST = ("light stop", "plastic stops", "friction")


@pytest.mark.parametrize(
    "name", [name if name in _FAST else pytest.param(name, marks=pytest.mark.slow) for name in MACHINES]
)
def test_steps_of_the_load_are_restarts_under_constant_loads(name: str):
    parts, rng = MACHINES[name], np.random.default_rng(5)
    n = len(parts["mass"])
    knots, values = np.cumsum(rng.uniform(0.5, 3.0, 14)), rng.normal(0.5, 1.5, (14, n))
    end = knots[-1] + 2.0
    whole = vx.ImpactSystem(forcing=vx.Tabulated(knots, values, "previous"), **parts)
    sol = vx.simulate(whole, 0.0, end, ts=knots)
    x = v = np.zeros(n)
    begin, impacts = 0.0, 0
    for k, until in enumerate([*knots, end]):
        mean = values[k - 1] if 0 < k < len(knots) else np.zeros(n)
        still = vx.ImpactSystem(forcing=vx.Harmonic(np.zeros(n), 0.0, mean=mean), **parts)
        part = vx.simulate(still, begin, until, x, v)
        x, v, begin = np.asarray(part.x1), np.asarray(part.v1), until
        impacts += int(np.sum(np.asarray(part.events.kind) == vx.IMPACT))
        if k < len(knots):
            np.testing.assert_allclose(sol.xs[k], x, rtol=0, atol=ROUNDING)
            np.testing.assert_allclose(sol.vs[k], v, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(sol.x1, x, rtol=0, atol=ROUNDING)
    assert int(np.sum(np.asarray(sol.events.kind) == vx.IMPACT)) == impacts


@pytest.mark.thorough
def test_a_jump_of_the_load_releases_a_mass_and_lets_friction_slip():
    pull = vx.Tabulated([0.0, 5.0, 10.0], [[2.0], [-0.5], [0.0]], "previous")
    stop = vx.ImpactSystem(**ONE, forcing=pull, stops=[vx.Stop(0, 0.2, "upper", 0.0)])
    log = vx.simulate(stop, 0.0, 8.0).events
    assert list(np.asarray(log.kind)[:3]) == [vx.IMPACT, vx.STICK, vx.RELEASE]
    assert float(log.t[2]) == 5.0
    rough = vx.ImpactSystem(**ONE, forcing=vx.Tabulated([3.0, 6.0], [[1.0]] * 2, "previous"))
    rough = vx.ImpactSystem(**ONE, forcing=rough.forcing, friction=[vx.Friction(0, 0.5)])
    log = vx.simulate(rough, 0.0, 5.0).events
    assert (int(log.kind[0]), float(log.t[0])) == (vx.SLIP, 3.0)


def test_a_record_agrees_with_matrix_exponentials_from_knot_to_knot():
    rng = np.random.default_rng(3)
    times = np.linspace(0, 20, 2001)
    waves = rng.normal(size=(3, 50))
    values = (waves[0] * np.cos(np.outer(times, 3 * abs(waves[1])) + waves[2])).sum(axis=1)
    system = vx.ImpactSystem([1.0], [[0.2]], [[4.0]], vx.Tabulated(times, values))
    sol = vx.simulate(system, 0.0, 20.0, ts=times[::250])
    y, expected = np.zeros(2), [np.zeros(2)]
    for k in range(2000):
        h = times[k + 1] - times[k]
        a = np.array([[0, 1, 0, 0], [-4, -0.2, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], float)
        slope = (values[k + 1] - values[k]) / h
        y = (expm(a * h) @ np.array([*y, values[k], slope]))[:2]
        expected.append(y)
    size = np.abs(expected).max()
    found = np.stack([np.asarray(sol.xs)[:, 0], np.asarray(sol.vs)[:, 0]], axis=1)
    np.testing.assert_allclose(found, np.array(expected)[::250], rtol=0, atol=ROUNDING * size)


def table_of(*waves, until: float = 80.0) -> vx.Tabulated:
    """The sum of linear wave forms as one table in time."""
    knots = sorted(
        (phase + 2 * np.pi * m) / w
        for phases, _, w in waves
        for phase in phases
        for m in range(-1, int(until * w / (2 * np.pi)) + 2)
    )
    total = np.zeros(len(knots))
    for phases, values, w in waves:
        turns = np.concatenate([np.array(phases) + 2 * np.pi * m for m in (-1, 0, 1)])
        total += np.interp(np.array(knots) * w % (2 * np.pi), turns, np.tile(np.ravel(values), 3))
    is_new = np.append(True, np.diff(knots) > 1e-9)
    return vx.Tabulated(np.array(knots)[is_new], total[is_new])


@pytest.mark.slow
@pytest.mark.parametrize("t0", [0.0, 5.3])
def test_loads_of_any_frequencies_add_up(t0: float):
    wave, other = vx.Waveform(*WAVE), vx.Waveform(*OTHER)
    same, faster = vx.Harmonic([0.5], 0.8), vx.Harmonic([0.5], 1.37)
    for load, table in (
        (wave + other, table_of(WAVE, OTHER)),
        (wave + faster, table_of(WAVE) + faster),
        (wave + same, table_of(WAVE) + same),
        (wave + table_of(OTHER) + same, table_of(WAVE, OTHER) + same),
    ):
        one, two = (vx.simulate(machine(load), t0, 80.0) for load in (load, table))
        assert int(one.num_events) == int(two.num_events) > 0
        np.testing.assert_allclose(one.x1, two.x1, rtol=0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["linear", "previous", "cubic"])
def test_a_solver_of_diffrax_gives_the_same_motion(kind: str):
    rng = np.random.default_rng(1)
    table = vx.Tabulated(np.cumsum(rng.uniform(0.2, 1.0, 30)), rng.normal(size=(30, 1)), kind)
    exact = vx.simulate(machine(table), 0.0, 20.0)
    solver = vx.simulate(machine(table), 0.0, 20.0, flow=vx.DiffraxFlow())
    spring = vx.ImpactSystem([1.0], [[0.1]], [[0.6]], table, STOP, force=lambda t, x, v, args: -0.4 * x)
    for other in (solver, vx.simulate(spring, 0.0, 20.0)):
        assert int(other.num_events) == int(exact.num_events) > 0
        np.testing.assert_allclose(other.x1, exact.x1, rtol=0, atol=SOLVER)


def test_motions_are_evaluated_at_any_time():
    sol = vx.simulate(machine(vx.Waveform(*WAVE) + vx.Waveform(*OTHER)), 0.0, 40.0)
    times = np.linspace(0.0, 40.0, 57)
    saved = vx.simulate(machine(vx.Waveform(*WAVE) + vx.Waveform(*OTHER)), 0.0, 40.0, ts=times)
    x, v = sol.evaluate(times)
    np.testing.assert_allclose(x, saved.xs, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(v, saved.vs, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_wave_form_is_exact_over_a_million_periods():
    system = machine(vx.Waveform([0.0, np.pi], [[1.0], [-1.0]], 0.8, "previous"))
    few, many = (
        vx.simulate(system, 0.0, n * system.forcing.period, max_events=0, throw=False)
        for n in (400, 1_000_000)
    )
    np.testing.assert_allclose(many.x1, few.x1, rtol=0, atol=1e-8)  # the end is rounded to 1e-9 of a period


def _end_by(values, times):
    return _end(machine(vx.Tabulated(times, values)), 10.0)


def _end_by_wave(phases, values, frequency):
    return _end(machine(vx.Waveform(phases, values, frequency, "previous")), 20.0)


def _end(system, t1):
    sol = vx.simulate(system, 0.3, t1, [0.1], [0.0])
    return jnp.concatenate([sol.x1, sol.v1, sol.events.t[:1]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "given"),
    [
        (_end_by, ([[0.3], [1.0], [-2.0], [0.7], [1.4], [-0.2]], [0.5, 1.0, 2.2, 3.1, 4.0, 9.0])),
        (_end_by_wave, ([0.2, 3.0], [[1.0], [-1.0]], 0.8)),
    ],
    ids=["table", "wave form"],
)
def test_derivatives_by_knots_values_and_frequency(end, given):
    given = tuple(map(jnp.asarray, given))
    places = tuple(range(len(given)))
    forward, reverse = (of(end, places)(*given) for of in (jax.jacfwd, jax.jacrev))
    for k in places:
        for i in np.ndindex(given[k].shape):
            ends = [
                end(*(a.at[i].add(h) if j == k else a for j, a in enumerate(given))) for h in (1e-5, -1e-5)
            ]
            difference = (ends[0] - ends[1]) / 2e-5
            size = 1 + np.abs(difference).max() ** 2
            found = np.asarray(forward[k])[(..., *i)]
            np.testing.assert_allclose(found, difference, rtol=0, atol=DIFFERENCES * size)
        np.testing.assert_allclose(forward[k], reverse[k], rtol=0, atol=ROUNDING * 1e2)


@pytest.mark.slow
def test_each_trajectory_of_a_batch_may_have_its_own_record():
    rng = np.random.default_rng(1)
    times, records = np.cumsum(rng.uniform(0.2, 1.0, 30)), jnp.asarray(rng.normal(size=(5, 30, 1)))
    end = lambda record: vx.simulate(machine(vx.Tabulated(times, record, "cubic")), 0.0, 20.0).x1  # noqa: E731
    each = np.stack([end(record) for record in records])
    np.testing.assert_allclose(jax.vmap(end)(records), each, rtol=0, atol=ROUNDING)
    slopes = jax.vmap(jax.jacrev(end))(records)
    np.testing.assert_allclose(slopes[1], jax.jacfwd(end)(records[1]), rtol=0, atol=ROUNDING * 1e2)
