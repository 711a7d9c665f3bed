"""What touching bodies with friction and compliant stops do at one instant."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from resting_bodies import Bodies, Rigid, Rubbing, Run, Soft, Undecided, random_chain

import vijax as vx

# Of the independent integration, which finds events by bisection.
_NUMERICAL = 1e-6
_ROUNDING = 1e-12


def _free(masses, mean, stops, friction) -> vx.ImpactSystem:
    nothing = np.zeros((len(masses), len(masses)))
    load = vx.Harmonic(np.zeros(len(masses)), 1.0, mean=mean)
    return vx.ImpactSystem(masses, nothing, nothing, load, stops, friction=friction)


@pytest.mark.thorough
@pytest.mark.parametrize("statics", [(None, None), (1.5, 2.0)])
def test_elements_side_by_side_are_their_sum(statics):
    first, second = statics
    load = vx.Harmonic([3.7], 0.7)
    both = [vx.Friction(0, 1.0, first), vx.Friction(0, 2.0, second)]
    one = [vx.Friction(0, 3.0, None if first is None else first + second)]
    found, sum_ = (
        vx.simulate(vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, friction=f), 0.0, 30.0)
        for f in (both, one)
    )
    np.testing.assert_allclose(found.x1, sum_.x1, rtol=0, atol=_ROUNDING)
    np.testing.assert_allclose(found.v1, sum_.v1, rtol=0, atol=_ROUNDING)
    assert int(found.num_events) == 2 * int(sum_.num_events)


@pytest.mark.slow
def test_a_row_that_counts_twice_is_an_element_of_half_the_force_beside_others():
    load = vx.Harmonic([3.7], 0.7)
    three = [vx.Friction(0, 0.5, 0.7), vx.Friction(0, 2.0, 2.1), vx.Friction({0: 2.0}, 0.25, 0.3)]
    found, sum_ = (
        vx.simulate(vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, friction=f), 0.0, 30.0)
        for f in (three, [vx.Friction(0, 3.0, 3.4)])
    )
    np.testing.assert_allclose(found.x1, sum_.x1, rtol=0, atol=_ROUNDING)


_ROW = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.5), vx.Contact({2: 1.0, 0: -1.0}, -0.5, 0.5)]


@pytest.mark.thorough
def test_the_impulse_of_a_held_contact_reaches_friction_beyond_it():
    system = _free([1.0, 1.0, 1.0], [1.0, 0.0, 0.0], _ROW, [vx.Friction(1, 2.0)])
    sol = vx.simulate(system, 0.0, 1.5, [0.0, 1.0, -1.0], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(sol.x1, [0.25, 1.25, -0.5], rtol=0, atol=_ROUNDING)


@pytest.mark.slow
def test_the_impulse_of_a_held_contact_moves_a_compliant_stop_that_rests():
    stop = vx.CompliantStop(1, 1.0, "upper", 100.0, 0.0, preload=2.0)
    system = _free([1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [*_ROW, stop], [])
    sol = vx.simulate(system, 0.0, 0.6, [0.0, 1.0, -1.0], [0.0, 0.0, 1.0])
    w = np.sqrt(100.0 / 2.0)  # both masses leave with 1/2 against the spring, pressed by 1 - 2
    way = (1.0 - 2.0) / 100.0
    x = way - way * np.cos(w * 0.1) + 0.5 / w * np.sin(w * 0.1)
    np.testing.assert_allclose(sol.x1, [x, 1 + x, -0.5], rtol=0, atol=_ROUNDING)


@pytest.mark.slow
def test_friction_turns_with_what_an_impact_turns_through_a_held_contact():
    stops = [vx.Contact({0: -1.0, 1: 1.0}, 1.0, 0.5), vx.Stop(0, 0.5, "upper", 0.5)]
    sol = vx.simulate(
        _free([1.0, 1.0], [0.0, 2.0], stops, [vx.Friction(1, 0.5)]), 0.0, 0.5, [0.0, 1.0], [1.0, 1.0]
    )
    assert np.isclose(sol.events.t[0], 0.430500874, atol=1e-9)
    hit, speed = 0.43050087404306, 1.3228756555323 / 2
    # Afterwards both forces push the two towards the stop again.
    v = -speed + (2.0 + 0.5) / 2 * (0.5 - hit)
    np.testing.assert_allclose(sol.v1, [v, v], rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("force", "grip"), [(0.1, None), (1e-12, None), (0.3, 0.1)])
def test_bodies_that_forces_part_from_the_start_on_are_hit_in_turn(force, grip):
    """As if they were already apart, by however little: a force holds them together no more."""
    stops = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.5), vx.Contact({1: 1.0, 2: -1.0}, -1.0, 0.5)]
    friction = [] if grip is None else [vx.Friction(2, grip)]
    system, t1 = _free([1.0] * 3, [0.0, 0.0, force], stops, friction), 1e-3
    sol = vx.simulate(system, 0.0, t1, [0.0, 1.0, 2.0], [1.0, 0.0, 0.0])
    v = np.array([1.0, 0.0, 0.0])
    for pair in ([0, 1], [1, 2], [0, 1]):
        v[pair] = np.mean(v[pair]) + 0.25 * np.subtract(*v[pair]) * np.array([-1, 1])
    v[2] += (force - (grip or 0)) * t1
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=_ROUNDING)
    assert np.asarray(sol.events.kind)[: int(sol.num_events)].tolist() == [vx.IMPACT] * 3


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1 / 7, 7.3e4])
def test_a_body_that_leans_without_a_force_leans_in_any_unit_of_mass(unit):
    """Its contact force is a difference of forces that rounding leaves a rest of; an impact must still reach it."""
    masses, e = np.array([2.0, 0.5, 1.0, 2.0]), [0.5, 0.0, 0.5]
    load = vx.Harmonic(unit * np.array([0, 0.4, 0, 0]), 0.7, mean=unit * np.array([0, -0.1, 0.3, 0]))
    stops = [vx.Contact({i: 1.0, i + 1: -1.0}, -1.0, e[i]) for i in range(3)]
    friction = [vx.Friction(1, 0.25 * unit, 0.3 * unit), vx.Friction(2, 0.25 * unit, 0.375 * unit)]
    damping = np.diag([0.0, 0.0, 0.1, 0.0]) * unit
    system = vx.ImpactSystem(masses * unit, damping, 0 * damping, load, stops, friction=friction)
    t1 = 0.5 + 1e-9
    sol = vx.simulate(system, 0.0, t1, [0.0, 1.0, 2.0, 3.4], [0.0, 0.0, 0.0, -0.8])
    rows = np.eye(3, 4) - np.eye(3, 4, k=1)
    impulse = np.linalg.solve(rows / masses @ rows.T, [0.0, 0.0, 1.5 * 0.8])
    assert (impulse > 0).all()
    v = np.array([0.0, 0.0, 0.0, -0.8]) - rows.T @ impulse / masses
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_rounding_does_not_move_bodies_at_rest():
    """The last body leans on one that sticks, without a force; an impact elsewhere decides anew what rests."""
    row = lambda i, k=None: np.eye(4)[i] - (0 if k is None else np.eye(4)[k])  # noqa: E731
    elements = [Rigid(row(i, i + 1), -1.0, (0.3, 0.3, 0.0)[i]) for i in range(3)]
    elements += [Rubbing(row(1), 0.1, 0.1), Rubbing(row(2), 0.3, 0.3)]
    damping, nothing = np.diag([0.0, 0.0, 0.1, 0.1]), np.zeros((4, 4))
    mean, amplitude = np.array([0, 0, 0.1, 0]), np.array([-0.3, -0.3, 0, 0])
    bodies = Bodies(np.array([1.0, 1, 1, 2]), damping, nothing, mean, amplitude, 1.0, elements)
    x0, v0 = np.array([-0.4, 1, 2, 3]), np.array([0.8, 0, 0, 0])
    x, v = Run(bodies, x0, v0).until(2.0)
    sol = vx.simulate(_of(bodies), 0.0, 2.0, x0, v0)
    np.testing.assert_allclose(sol.x1, x, rtol=0, atol=_NUMERICAL)
    np.testing.assert_allclose(sol.v1, v, rtol=0, atol=_NUMERICAL)


def _lets_go(static) -> vx.ImpactSystem:
    stops, friction = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.5)], [vx.Friction(1, 0.277, static)]
    return _free([1.0, 1.0], [-0.1, -0.33], stops, friction)


@pytest.mark.thorough
def test_a_mass_sticks_at_the_instant_at_which_its_neighbour_lets_go():
    sol = vx.simulate(_lets_go(0.36), 0.0, 1.0, [0.0, 1.0], [0.1, 0.1])
    assert np.asarray(sol.events.kind)[:2].tolist() == [vx.STICK, vx.RELEASE]
    assert sol.sticking1[0]
    np.testing.assert_allclose(sol.x1[1], 1.01414427, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_so_it_does_side_by_side_with_another_static_force():
    """With 0.34 each element decides alone."""

    def end(static):
        return vx.simulate(_lets_go(static), 0.0, 1.0, [0.0, 1.0], [0.1, 0.1]).x1[1]

    np.testing.assert_allclose(jax.vmap(end)(jnp.array([0.34, 0.36])), end(0.36), rtol=0, atol=_ROUNDING)


@pytest.mark.slow
def test_derivatives_go_through_decisions():
    """By loads, friction, and the start, along which two bodies in touch move together."""

    def end(p):
        mean = jnp.array([-0.1, -0.33]) * p[0]
        stops = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.5)]
        system = _free([1.0, 1.0], mean, stops, [vx.Friction(1, 0.277 * p[1], 0.36)])
        sol = vx.simulate(system, 0.0, 1.0, jnp.array([0.0, 1.0]) + p[2], 0.1 * jnp.ones(2) * p[3])
        return jnp.concatenate([sol.x1, sol.v1])

    at, step = jnp.array([1.0, 1.0, 0.0, 1.0]), 1e-6
    differences = [(end(at + e) - end(at - e)) / (2 * step) for e in step * np.eye(4)]
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jacobian(end)(at), np.stack(differences, axis=1), rtol=0, atol=1e-8)


@pytest.mark.slow
def test_bodies_come_to_rest_together():
    stops = [vx.Contact({0: 1.0, 1: -1.0}, -1.0, 0.7), vx.Contact({1: 1.0, 2: -1.0}, -1.0, 0.7)]
    system = _free([1.0, 1.0, 0.3], [0.1, 0.0, -0.05], stops, [vx.Friction(1, 0.25)])
    sol = vx.simulate(system, 0.0, 4.0, [-0.05, 1.0, 2.0])
    np.testing.assert_allclose(sol.x1, [0.01485642, 1.01485642, 2.01485642], rtol=0, atol=1e-8)
    np.testing.assert_allclose(sol.v1, 0, rtol=0, atol=_ROUNDING)


@pytest.mark.thorough
@pytest.mark.parametrize("mass", [[5.0, 3.0], [1.0, 1.0]])
def test_rounding_does_not_part_beads_that_touch(mass):
    column = vx.models.bead_column(2 * np.pi * 10, 0.02, num_beads=2, restitution=0.5, mass=mass)
    np.testing.assert_allclose(vx.simulate(column, 0.0, 2.0).x1, 0.136678, rtol=0, atol=1e-6)


def _of(bodies) -> vx.ImpactSystem:
    row = lambda e: {i: float(a) for i, a in enumerate(e.row) if a}  # noqa: E731
    kinds = lambda kind: [e for e in bodies.elements if isinstance(e, kind)]  # noqa: E731
    stops = [vx.Contact(row(e), e.position, e.restitution) for e in kinds(Rigid)]
    stops += [vx.CompliantContact(row(e), e.position, e.stiffness, e.damping, e.preload) for e in kinds(Soft)]
    friction = [vx.Friction(row(e), e.force, e.static) for e in kinds(Rubbing)]
    load = vx.Harmonic(bodies.amplitude, bodies.frequency, mean=bodies.mean)
    return vx.ImpactSystem(bodies.mass, bodies.damping, bodies.stiffness, load, stops, friction=friction)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plain", "soft", "walls"])
def test_random_chains_move_as_an_independent_integration_says(kind):
    num_compared = 0
    for seed in range(8):
        bodies, x0, v0 = random_chain(seed, soft=kind == "soft", walls=kind == "walls")
        try:
            x, v = Run(bodies, x0, v0).until(3.0)
        except Undecided:
            continue
        num_compared += 1
        sol = vx.simulate(_of(bodies), 0.0, 3.0, x0, v0)
        np.testing.assert_allclose(sol.x1, x, rtol=0, atol=_NUMERICAL, err_msg=f"{kind} {seed}")
        np.testing.assert_allclose(sol.v1, v, rtol=0, atol=_NUMERICAL, err_msg=f"{kind} {seed}")
    assert num_compared >= 3
