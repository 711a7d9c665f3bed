"""Contacts between masses: laws, limits, derivatives, sweeps, orbits. Most machines share one shape."""

from itertools import combinations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contact_scenes import contact_scene, gaps_at, random_machine
from helpers import log_of, paired
from scipy.linalg import expm

import vijax as vx
from vijax._hybrid.complementarity import solve_complementarity

DAMPING, STIFFNESS = [[0.04, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]]


def damper(restitution=0.7, frequency=1.0, amplitude=0.35, force=None, mean=None) -> vx.ImpactSystem:
    """A free mass in a container on an oscillator."""
    load = vx.Harmonic([amplitude, 0.0], frequency, mean=mean)
    ends = [vx.Contact({1: 1.0, 0: -1.0}, 0.2, restitution), vx.Contact({0: 1.0, 1: -1.0}, 0.2, restitution)]
    return vx.ImpactSystem([1.0, 0.12], DAMPING, STIFFNESS, load, ends, force)


def energy(system: vx.ImpactSystem, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    mass = np.asarray(system.mass)
    mass = np.diag(mass) if mass.ndim == 1 else mass
    return (np.einsum("ti,ij,tj->t", v, mass, v) + np.einsum("ti,ij,tj->t", x, system.stiffness, x)) / 2


@pytest.mark.slow
def test_a_contact_of_one_mass_is_a_stop():
    stops = vx.models.wagg_bishop_a(0.8)
    rows = [vx.Contact({s.mass: s.sign}, s.sign * s.position, s.restitution) for s in stops.stops]
    contacts = eqx.tree_at(lambda s: s.stops, stops, rows)
    one, other = (vx.simulate(system, 0.0, 60.0) for system in (stops, contacts))
    pairs = paired(log_of(one), log_of(other))
    assert len(pairs) > 10
    assert max(abs(a.t - b.t) for a, b in pairs) < 1e-12
    np.testing.assert_allclose(other.x1, one.x1, rtol=0, atol=1e-12)
    signs = np.array([s.sign for s in stops.stops])
    n = int(one.num_events)
    of_stops = np.asarray(one.events.velocity_minus)[:n] * signs[np.asarray(one.events.stop)[:n]]
    np.testing.assert_allclose(np.asarray(other.events.velocity_minus)[:n], of_stops, rtol=0, atol=1e-11)
    # The impulse of a contact is positive where it opens the gap; that of a stop is the one on its mass.
    along = -np.asarray(one.events.impulse)[:n] * signs[np.asarray(one.events.stop)[:n]]
    np.testing.assert_allclose(np.asarray(other.events.impulse)[:n], along, rtol=0, atol=1e-11)


@pytest.mark.thorough
def test_a_contact_that_holds_stays_closed_to_rounding():
    sol = vx.simulate(damper(restitution=0.5, amplitude=0.02, mean=[0.0, 0.5]), 0.0, 1000.0)
    assert sol.stuck1.tolist() == [True, False]
    x, v = sol.evaluate(np.linspace(500.0, 1000.0, 200))
    # If the errors of all steps added up, the gap would be 1e-10.
    np.testing.assert_allclose(x[:, 1] - x[:, 0], 0.2, rtol=0, atol=5e-16)
    np.testing.assert_allclose(v[:, 1] - v[:, 0], 0.0, rtol=0, atol=5e-16)


def test_an_impact_keeps_momentum_and_turns_the_relative_velocity_round():
    sol = vx.simulate(damper(), 0.0, 40.0)
    is_heavy = (np.asarray(sol.events.kind) == vx.IMPACT) & (np.asarray(sol.events.velocity_minus) > 1e-3)
    t = np.asarray(sol.events.t)[is_heavy]
    (_, before), (_, after) = sol.evaluate(t - 1e-9), sol.evaluate(t + 1e-9)
    mass = np.array([1.0, 0.12])
    np.testing.assert_allclose(after @ mass, before @ mass, rtol=0, atol=1e-8)
    relative = np.diff(np.stack([before, after]), axis=2)[..., 0]
    assert len(t) > 5
    np.testing.assert_allclose(relative[1], -0.7 * relative[0], rtol=0, atol=1e-8)


@pytest.mark.parametrize("restitution", [1.0, 0.6])
def test_energy_is_kept_by_elastic_contacts_and_never_made_by_others(restitution):
    system = eqx.tree_at(lambda s: s.damping, damper(restitution, amplitude=0.0), jnp.zeros((2, 2)))
    sol = vx.simulate(system, 0.0, 40.0, [0.3, 0.2], [0.7, -0.4])
    x, v = sol.evaluate(np.linspace(0.0, 40.0, 512))
    found = energy(system, np.asarray(x), np.asarray(v))
    assert int(sol.num_events) > 10
    if restitution == 1:
        np.testing.assert_allclose(found, found[0], rtol=1e-12)
    assert np.diff(found).max() < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("has_full_mass", [True, False])
def test_random_machines_end_and_no_contact_is_passed(has_full_mass):
    t = np.linspace(0.0, 40.0, 512)
    for seed in range(60):
        system = random_machine(seed, 3, 4, has_full_mass=has_full_mass, is_moving=has_full_mass)
        sol = vx.simulate(system, 0.0, 40.0, max_events=4096, throw=False)
        assert sol.result in (vx.RESULTS.successful, vx.RESULTS.max_events_reached), seed
        t_known = np.minimum(t, float(sol.known_until))
        assert gaps_at(sol, system, t_known).min() > -1e-11, seed
        assert np.nanmin(sol.contact_force(t_known)) >= -1e-12, seed


@pytest.mark.slow
def test_random_machines_without_a_load_gain_no_energy():
    t = np.linspace(0.0, 30.0, 512)
    for seed in range(40):
        system = random_machine(seed, 3, 4, 0.4 + 0.5 * (seed % 2), is_driven=False)
        v0 = np.random.default_rng(seed).normal(size=3)
        sol = vx.simulate(system, 0.0, 30.0, None, v0, max_events=4096)
        x, v = (np.asarray(a) for a in sol.evaluate(t))
        found = energy(system, x, v)
        assert np.diff(found).max() < 1e-12 * found[0], seed


def test_a_dropped_stack_comes_to_rest_after_the_impacts_of_an_independent_count():
    """Two beads on a floor: exact parabolas from impact to impact, in plain Python."""
    r, g, m = 0.6, 1.0, np.array([1.0, 0.5])
    contacts = [vx.Contact({0: -1.0}, 0.0, r), vx.Contact({0: 1.0, 1: -1.0}, 0.0, r)]
    zero = np.zeros((2, 2))
    stack = vx.ImpactSystem(m, zero, zero, vx.Harmonic([0.0, 0.0], 1.0, mean=-m * g), contacts)
    sol = vx.simulate(stack, 0.0, 12.0, [0.5, 0.8])
    t, x, v, times = 0.0, np.array([0.5, 0.8]), np.zeros(2), []
    while abs(v[0]) + abs(v[1]) > 1e-4 or not times:
        to_floor = (v[0] + np.sqrt(v[0] ** 2 + 2 * g * x[0])) / g
        closing = v[0] - v[1]
        to_meet = (x[1] - x[0]) / closing if closing > 0 else np.inf
        step = min(to_floor, to_meet)
        x, v, t = x + v * step - g * step**2 / 2, v - g * step, t + step
        if to_floor <= to_meet:
            x[0], v[0] = 0.0, -r * v[0]
        else:
            x[0] = x[1] = x.mean()
            total, u = m @ v / m.sum(), v[0] - v[1]
            v = total + np.array([-m[1], m[0]]) / m.sum() * r * u
        times.append(t)
        if len(times) > 500:
            break
    log = log_of(sol)
    impacts = [event.t for event in log if event.kind == "impact"]
    same = min(len(impacts), len(times), 25)
    assert same > 10
    np.testing.assert_allclose(impacts[:same], times[:same], rtol=0, atol=1e-11)
    assert np.asarray(sol.stuck1).all()
    np.testing.assert_allclose(sol.contact_force(12.0), [1.5 * g, 0.5 * g], rtol=1e-12)
    np.testing.assert_allclose(sol.x1, 0, rtol=0, atol=1e-14)
    assert max(event.t for event in log) < t + 1e-3


def test_impacts_of_one_instant_are_logged_in_their_order():
    """Two masses in a wedge: bounces of two contacts follow closer than adjacent floating-point numbers."""
    column = [vx.Contact({0: -1.0}, 0.0, 0.3), vx.Contact({0: 1.0, 1: -1.0}, 0.0, 0.3)]
    zero = np.zeros((2, 2))
    stack = vx.ImpactSystem([1.0, 3.0], zero, zero, vx.Harmonic([0.0, 0.0], 1.0, mean=[-1.0, -3.0]), column)
    sol = vx.simulate(stack, 0.0, 3.0, [0.0, 0.0], [0.0, -1.0])
    log, n = sol.events, int(sol.num_events)
    t, speed = np.asarray(log.t)[:n], np.asarray(log.velocity_minus)[:n]
    assert (
        np.diff(np.asarray(sol.restarts.t)[: n + 1][np.isfinite(np.asarray(sol.restarts.t)[: n + 1])]) >= 0
    ).all()
    of_second = speed[(np.asarray(log.stop)[:n] == 1) & (np.asarray(log.kind)[:n] == vx.IMPACT)]
    assert of_second[0] == pytest.approx(1.0)
    assert (np.diff(t) >= 0).all()
    assert speed.max() == of_second[0]
    assert np.asarray(sol.stuck1).all()


def test_the_law_of_several_contacts_is_the_one_solution_of_its_conditions():
    random = np.random.default_rng(0)
    solve = jax.jit(solve_complementarity)
    for _ in range(50):
        rows = random.normal(size=(4, 5))
        g, q = rows @ rows.T, random.normal(size=4)
        allowed = random.random(4) < 0.8
        members, p, w = map(np.asarray, solve(jnp.asarray(g), jnp.asarray(q), jnp.asarray(allowed)))
        among = np.flatnonzero(allowed)
        assert (p[among] >= -1e-12).all()
        assert (w[among] >= -1e-12).all()
        assert not p[~allowed].any()
        np.testing.assert_allclose(np.where(members, 0, q + g @ p), w, atol=1e-12)
        solutions = 0  # by trial of all sets
        for k in range(len(among) + 1):
            for chosen in map(list, combinations(among, k)):
                trial = np.zeros(4)
                trial[chosen] = np.linalg.solve(g[np.ix_(chosen, chosen)], -q[chosen])
                if (trial >= 0).all() and ((q + g @ trial)[among] > -1e-12).all():
                    solutions += 1
                    np.testing.assert_allclose(p, trial, atol=1e-10)
        assert solutions == 1


@pytest.mark.slow
def test_two_contacts_that_say_the_same_are_one():
    system = damper(mean=[0.0, -0.1])
    doubled = eqx.tree_at(lambda s: s.stops, system, (*system.stops, system.stops[1]))
    one, other = (vx.simulate(s, 0.0, 40.0) for s in (system, doubled))
    np.testing.assert_allclose(other.x1, one.x1, rtol=0, atol=1e-11)
    t = np.linspace(0.0, 40.0, 200)
    force = np.asarray(other.contact_force(t))
    assert np.isfinite(force).all()
    np.testing.assert_allclose(force[:, 1] + force[:, 2], np.asarray(one.contact_force(t))[:, 1], atol=1e-11)


def _end(p):
    """End of a motion with chatter, sticks and releases, by a row, a position, r, a mass."""
    names = lambda s: (s.stops[0].row, s.stops[0].position, s.stops[1].restitution, s.mass)  # noqa: E731
    base = damper(mean=[0.0, 0.02])
    system = eqx.tree_at(names, base, (p[:2], p[2], p[3], base.mass.at[1].set(p[4])))
    sol = vx.simulate(system, 0.0, 14.0, [0.1, 0.0])
    return jnp.concatenate([sol.x1, sol.v1])


@pytest.mark.slow
def test_derivatives_agree_with_differences_both_ways():
    p = jnp.array([1.0, -1.0, 0.2, 0.7, 0.12])
    forward = np.asarray(jax.jit(jax.jacfwd(_end))(p))
    backward = np.asarray(jax.jit(jax.jacrev(_end))(p))
    h = 1e-6
    differences = np.stack([(_end(p.at[k].add(h)) - _end(p.at[k].add(-h))) / (2 * h) for k in range(5)], 1)
    scale = np.abs(forward).max()
    np.testing.assert_allclose(backward, forward, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(forward, differences, rtol=0, atol=1e-7 * scale)


def test_a_saltation_matrix_is_the_derivative_of_an_impact():
    system = damper()
    x, v, h = np.array([0.1, 0.3]), np.array([0.2, 0.9]), 1e-3
    start = np.concatenate([x - h / 2 * v, v])
    follow = lambda z, t1: vx.simulate(system, 0.0, t1, z[:2], z[2:])  # noqa: E731
    sol = follow(start, h)
    t = float(sol.events.t[0])
    at = follow(start, t - 1e-12)
    matrix = vx.saltation_matrix(system, t, at.x1, at.v1, 0)
    end = lambda z: np.concatenate([(sol := follow(z, h)).x1, sol.v1])  # noqa: E731
    shifts = 1e-5 * np.eye(4)
    whole = [
        (8 * (end(start + s) - end(start - s)) - end(start + 2 * s) + end(start - 2 * s)) / 12e-5
        for s in shifts
    ]
    # Between impacts the machine is linear.
    inverse = 1 / np.asarray(system.mass)[:, None]
    motion = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse * STIFFNESS, -inverse * DAMPING]])
    expected = expm((h - t) * motion) @ matrix @ expm(t * motion)
    np.testing.assert_allclose(np.transpose(whole), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(matrix), 0.7**2, rtol=1e-9)


@pytest.mark.slow
def test_orbits_close_and_their_multipliers_obey_liouville():
    system = damper(0.6, frequency=1.05, amplitude=0.1)
    end = vx.simulate(system, 0.0, 300 * system.forcing.period, max_events=8192)
    orbit = vx.periodic_orbit(system, end.x1, end.v1)
    assert orbit.is_admissible
    back = vx.stroboscopic_map(system, orbit.x0, orbit.v0)
    np.testing.assert_allclose(
        jnp.concatenate(back), jnp.concatenate([orbit.x0, orbit.v0]), rtol=0, atol=1e-12
    )
    if not np.asarray(orbit.events.kind == vx.STICK).any():
        loss = np.exp(-0.04 * float(orbit.period)) * 0.6 ** (2 * int(orbit.num_impacts.sum()))
        np.testing.assert_allclose(np.prod(orbit.multipliers), loss, rtol=1e-9)


@pytest.mark.slow
def test_a_sweep_is_its_motions_one_by_one_and_keeps_its_machine():
    ds = vx.sweep(
        damper(), {"stops[0].position": [0.1, 0.2, 0.3]}, transient=6, record=2, x0=[0.1, 0.0], progress=False
    )
    assert (ds.stop_mass == -1).all()
    for k in range(3):
        system = vx.system_of(ds.isel({"stops[0].position": k}))
        assert isinstance(system.stops[0], vx.Contact)
        sol = vx.simulate(system, 0.0, 8 * system.forcing.period, [0.1, 0.0], max_events=4096)
        np.testing.assert_allclose(ds.x[k], sol.x1, rtol=0, atol=1e-10)
        is_recorded = (sol.events.kind == vx.IMPACT) & (sol.events.t > 6 * system.forcing.period)
        velocity = ds.impact_velocity[k].dropna("impact")
        np.testing.assert_allclose(velocity, sol.events.velocity_minus[is_recorded], rtol=0, atol=1e-8)


@pytest.mark.slow
def test_a_carried_sweep_starts_on_the_right_side_of_contacts_that_moved():
    ds = vx.sweep(
        damper(mean=[0.0, 0.1]),
        {"stops[0].position": [0.3, 0.2, 0.1]},
        transient=30,
        record=1,
        carry="up",
        progress=False,
    )
    assert (ds.result == 0).all()
    gap = ds["stops[0].position"] - (ds.x.isel(mass=1) - ds.x.isel(mass=0))
    assert (gap > -1e-12).all()


@pytest.mark.slow
def test_simulate_is_batched_and_compiled_like_any_function():
    def end(position):
        system = eqx.tree_at(lambda s: s.stops[0].position, damper(), position)
        return vx.simulate(system, 0.0, 20.0).x1

    positions = jnp.array([0.1, 0.2, 0.3])
    batch = jax.jit(jax.vmap(end))(positions)
    np.testing.assert_allclose(batch, [end(p) for p in positions], rtol=0, atol=1e-11)


@pytest.mark.slow
def test_a_solver_of_diffrax_meets_the_same_contacts():
    scene = contact_scene("gears_load")
    sol = vx.simulate(scene.system, scene.t0, 10.0, scene.x0, scene.v0, flow=vx.DiffraxFlow())
    exact = vx.simulate(scene.system, scene.t0, 10.0, scene.x0, scene.v0)
    pairs = paired(log_of(exact), log_of(sol))
    assert {a.kind for a, _ in pairs} >= {"impact", "release"}
    np.testing.assert_allclose(sol.x1, exact.x1, rtol=0, atol=1e-8)
    np.testing.assert_allclose(sol.v1, exact.v1, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_a_force_acts_between_contacts():
    spring = lambda t, x, v, args: jnp.array([-0.5 * x[0], 0.0])  # noqa: E731
    forced = damper(force=spring)
    linear = eqx.tree_at(lambda s: s.stiffness, damper(), jnp.array([[1.5, 0.0], [0.0, 0.0]]))
    one, other = (vx.simulate(s, 0.0, 20.0) for s in (linear, forced))
    paired(log_of(one), log_of(other))
    np.testing.assert_allclose(other.x1, one.x1, rtol=0, atol=1e-7)


@pytest.mark.slow
def test_stops_of_one_mass_may_move_differently():
    """A ball between a fixed and a moving wall: elastic, so v -> 2 w' - v at the moving wall."""
    moving = vx.Harmonic([0.1], 2.0, [0.3])
    walls = [vx.Stop(0, 0.0, "lower", 1.0), vx.Stop(0, 1.0, "upper", 1.0, moving)]
    box = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.0], 2.0), walls)
    sol = vx.simulate(box, 0.0, 30.0, [0.5], [1.0])
    log, n = sol.events, int(sol.num_events)
    stop, before, after, t = (
        np.asarray(a)[:n] for a in (log.stop, log.velocity_minus, log.velocity_plus, log.t)
    )
    wall = np.where(stop == 1, -0.2 * np.sin(2.0 * t + 0.3), 0.0)
    assert n > 15
    np.testing.assert_allclose(after, 2 * wall - before, rtol=0, atol=1e-13)
    np.testing.assert_allclose(before[1:], after[:-1], rtol=0, atol=1e-13)
    place = np.where(stop == 1, 1.0 + 0.1 * np.cos(2.0 * t + 0.3), 0.0)
    np.testing.assert_allclose(np.diff(place), after[:-1] * np.diff(t), rtol=0, atol=1e-13)
    np.testing.assert_allclose(log.impulse[:n], after - before, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: vx.Contact({}), "Argument `row` must give the coefficient of each mass"),
        (lambda: vx.Contact({0: 0.0}), "must have a coefficient that is not zero"),
        (lambda: vx.Contact({-1: 1.0}), "Argument `row` must be a whole number"),
        (lambda: vx.Contact({0: np.nan}), "Argument `row` must be finite"),
        (lambda: vx.Contact({0: 1.0}, restitution=1.5), "must lie between 0"),
        (lambda: _with([vx.Contact({2: 1.0}, 1.0)]), r"`stops\[0\].row` names mass 2, but the machine has"),
        (lambda: _with([], [[1.0, 2.0], [2.0, 1.0]]), "must be positive definite"),
        (lambda: _with([], [[1.0, 1.0], [1.0, 1.0]]), "Argument `mass` must be positive definite"),
        (lambda: _with([], [[1.0, 0.5], [0.0, 1.0]]), "Argument `mass` must be symmetric"),
        (
            lambda: vx.simulate(damper(), 0.0, 1.0, [0.0, 0.3]),
            r"The start lies beyond a stop: `row . x0` is past the position of `stops\[0\]`",
        ),
        (lambda: vx.sticking_region(damper(), 0), "`Solution.contact_force` has them along"),
    ],
)
def test_what_makes_no_contact_is_refused_with_a_sentence(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


def _with(stops, mass=(1.0, 1.0)):
    zero = np.zeros((2, 2))
    return vx.ImpactSystem(np.array(mass), zero, zero, vx.Harmonic([0.0, 0.0], 1.0), stops)


def test_contacts_are_printed_in_a_line():
    assert repr(damper().stops[0]) == "Contact: x1 - x0 <= 0.2, restitution 0.7"
    assert "contact 1  x0 - x1 <= 0.2, restitution 0.7" in repr(damper())
    full = _with([vx.Contact({0: 2.0}, 0.1, 0.5)], [[1.0, 0.2], [0.2, 1.0]])
    assert "mass       [1 0.2] [0.2 1]" in repr(full)
    assert repr(full.stops[0]) == "Contact: 2 x0 <= 0.1, restitution 0.5"


@pytest.mark.slow
def test_a_symmetric_orbit_loses_its_symmetry_at_a_branch_point():
    """A multiplier is 1 there, confirmed by individual orbits around the point."""
    system = damper(0.6, frequency=1.26, amplitude=0.1)
    end = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=8192)
    orbit = vx.periodic_orbit(system, end.x1, end.v1)
    branch = vx.continuation(orbit, "forcing.frequency", (1.22, 1.28), progress=False)
    (point,) = branch.bifurcations
    assert point.kind == "pitchfork"
    names, off = lambda s: s.forcing.frequency, np.array([-8, -6, -4, 4, 6, 8]) * 1e-4
    surplus = []
    for w in point.value + off:
        near = vx.periodic_orbit(eqx.tree_at(names, system, jnp.asarray(w)), point.orbit.x0, point.orbit.v0)
        surplus.append(float(np.prod(1 - np.asarray(near.multipliers)).real))
    fit = np.polynomial.Polynomial.fit(off, surplus, 4)
    root = min(fit.roots(), key=abs)
    assert abs(root) < 1e-9
