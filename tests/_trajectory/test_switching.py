"""Friction and compliant stops against published figures; derivatives, batches, sweeps, files, and what is refused."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# A few hundred roundings.
ROUNDING = 1e-12
# Figures to twelve digits after the point.
FIGURE = 1e-11
# Central differences with two steps: O(h^4) and rounding over h.
DIFFERENCES = 1e-7


def oscillator(
    zeta: float, amplitude: float, frequency: float, *, static: float | None = None
) -> vx.ImpactSystem:
    """x'' + 2 zeta x' + x = amplitude cos(frequency t) - sgn x'."""
    load = vx.Harmonic([amplitude], frequency)
    return vx.ImpactSystem([1.0], [[2 * zeta]], [[1.0]], load, friction=[vx.Friction(0, 1.0, static)])


def capsule(amplitude=1.2) -> vx.ImpactSystem:
    """A mass in a capsule with a compliant stop, on rough ground."""
    load = vx.Harmonic([amplitude, 0.0], 1.05)
    inside = vx.CompliantContact({0: 1.0, 1: -1.0}, 0.05, 15.0, 0.2)
    matrix = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return vx.ImpactSystem(
        [1.0, 2.5], 0.1 * matrix, matrix, load, [inside], friction=[vx.Friction(1, 0.6, 0.7)]
    )


@pytest.mark.parametrize("before", [1e-6, 1e-5, 1e-4, 3e-4, 1e-3, -1e-6, -1e-5, -1e-4])
@pytest.mark.parametrize("start", [-0.11, -0.05, 0.2, 0.34])
def test_an_event_just_behind_or_before_a_saved_state_or_the_end_is_exact(start: float, before: float):
    load = vx.Harmonic([0.0], 1.0)
    stop = vx.CompliantStop(0, 0.5, "upper", stiffness=10.0)
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [stop])
    event, x0, v0 = np.pi / 6, [np.sin(start)], [np.cos(start)]
    sol = vx.simulate(system, start, 1.0, x0, v0, ts=[event - before])
    assert abs(float(sol.events.t[0]) - event) < ROUNDING
    assert int(vx.simulate(system, start, event - before, x0, v0).num_events) == (before < 0)


@pytest.mark.parametrize(("force", "end"), [(0.08, 6 * 0.08 - 0.5), (0.6, 0.5)])
def test_friction_acts_after_an_impact_without_rebound(force: float, end: float):
    # Three half oscillations back from the stop lose 2 F each, unless the friction exceeds the spring there.
    load, stop = vx.Harmonic([0.0], 1.0), vx.Stop(0, 0.5, "upper", restitution=0.0)
    system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [stop], friction=[vx.Friction(0, force)])
    sol = vx.simulate(system, 0.0, 15.0, [0.0], [1.5])
    assert float(sol.x1[0]) == pytest.approx(end, abs=ROUNDING)
    assert float(sol.v1[0]) == 0


def test_free_decay_ends_where_coulomb_friction_stops_it():
    system = oscillator(0.0, 0.0, 1.0)
    sol = vx.simulate(system, 0.0, 60.0, [12.0], [6.0])
    assert abs(float(sol.x1[0]) - (15 - np.sqrt(205))) < ROUNDING
    assert abs(float(sol.events.t[int(sol.num_events) - 1]) - (np.arctan(6 / 13) + 7 * np.pi)) < ROUNDING
    assert bool(sol.sticking1[0])


@pytest.mark.slow
def test_multipliers_of_a_slipping_oscillator_agree_with_known_ones():
    system = oscillator(0.05, 1.5, 0.8)
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period)
    found = np.sort(np.linalg.eigvals(vx.monodromy_matrix(system, sol.x1, sol.v1)).real)
    np.testing.assert_allclose(found, [0.0365532703531, 0.2502568051573], rtol=0, atol=FIGURE)


@pytest.mark.thorough
def test_an_oscillator_that_sticks_slides_for_the_known_time_and_has_a_zero_multiplier():
    system = oscillator(0.05, 1.5, 0.6)
    sol = vx.simulate(system, 0.0, 100 * system.forcing.period)
    n = int(sol.num_events)
    kind, t = (np.asarray(a)[:n][-8:] for a in (sol.events.kind, sol.events.t))
    first = int(np.flatnonzero(kind == vx.SLIP)[0])
    assert kind[first + 1] == vx.STICK
    assert abs(t[first + 1] - t[first] - 4.509431030497) < FIGURE
    multipliers = np.linalg.eigvals(vx.monodromy_matrix(system, sol.x1, sol.v1))
    assert np.min(np.abs(multipliers)) < ROUNDING


@pytest.mark.slow
def test_friction_forces_keep_their_bounds_and_compliant_stops_never_pull():
    sol = vx.simulate(capsule(), 0.0, 60.0)
    t = np.linspace(0, 60, 1001)
    v = np.asarray(sol.evaluate(t)[1])
    friction, pushing = np.asarray(sol.friction_force(t))[:, 0], np.asarray(sol.contact_force(t))[:, 0]
    is_slipping = np.abs(v[:, 1]) > 1e-9
    np.testing.assert_allclose(friction[is_slipping], 0.6 * np.sign(v[is_slipping, 1]))
    assert is_slipping.any()
    assert not is_slipping.all()
    assert np.abs(friction).max() <= 0.7 + ROUNDING
    assert pushing.min() >= -ROUNDING
    assert pushing.max() > 1


@pytest.mark.slow
def test_derivatives_go_through_sticks_slips_and_contact():
    leaves, structure = jax.tree.flatten(capsule())
    sizes = np.cumsum([0, *(np.size(a) for a in leaves)])
    whole = np.concatenate([np.ravel(a) for a in leaves])
    # The static friction of the machine, the stiffness and damping of its stop, its load and a mass.
    names = [jax.tree_util.keystr(k) for k, _ in jax.tree_util.tree_flatten_with_path(capsule())[0]]
    wanted = [
        int(sizes[names.index(name)])
        for name in (
            ".friction[0].static",
            ".friction[0].force",
            ".stops[0].stiffness",
            ".stops[0].damping",
            ".mass",
        )
    ]

    def end(numbers):
        z = jnp.asarray(whole).at[jnp.array(wanted)].set(numbers)
        parts = [z[a:b].reshape(np.shape(leaf)) for a, b, leaf in zip(sizes, sizes[1:], leaves, strict=False)]
        sol = vx.simulate(jax.tree.unflatten(structure, parts), 0.0, 12.0, throw=False)
        return jnp.concatenate([sol.x1, sol.v1])

    here = whole[wanted]
    forward, reverse = jax.jacfwd(end)(here), jax.jacrev(end)(here)
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=ROUNDING * np.abs(forward).max())
    for k in range(len(wanted)):
        step = np.eye(len(wanted))[k] * 1e-4
        wide, narrow = ((end(here + h * step) - end(here - h * step)) / (2e-4 * h) for h in (1, 0.5))
        np.testing.assert_allclose(forward[:, k], (4 * narrow - wide) / 3, rtol=0, atol=DIFFERENCES)


@pytest.mark.slow
def test_a_batch_equals_its_trajectories():
    amplitudes = np.array([0.9, 1.1, 1.3])
    ends = jax.vmap(lambda a: vx.simulate(capsule(a), 0.0, 40.0, throw=False))(amplitudes)
    for k, a in enumerate(amplitudes):
        alone = vx.simulate(capsule(float(a)), 0.0, 40.0)
        np.testing.assert_allclose(ends.x1[k], alone.x1, rtol=0, atol=1e-10)
        assert int(ends.num_events[k]) == int(alone.num_events)
        assert bool(ends.sticking1[k, 0]) == bool(alone.sticking1[0])


@pytest.mark.slow
def test_a_sweep_by_paths_ends_where_its_trajectories_do():
    system, forces = oscillator(0.05, 1.5, 0.6), np.array([0.8, 1.0])
    ds = vx.sweep(system, {"friction[0].force": forces}, transient=3, record=2, progress=False)
    assert ds.sizes["friction"] == 1
    for k, force in enumerate(forces):
        machine = eqx.tree_at(lambda s: s.friction[0].force, system, jnp.asarray(force))
        sol = vx.simulate(machine, 0.0, 5 * system.forcing.period)
        np.testing.assert_allclose(ds.x.values[k], sol.x1, rtol=0, atol=1e-10)
        assert ds.sticking.values[k, 0] == bool(sol.sticking1[0])
    assert (ds.num_friction_sticks.values > 0).all()
    assert (ds.sticking_time.values >= 0).all()


def test_a_machine_file_gives_the_machine_back(tmp_path):
    system = capsule()
    vx.save(system, tmp_path / "machine.toml")
    again = vx.load(tmp_path / "machine.toml")
    assert jax.tree.structure(again) == jax.tree.structure(system)
    assert all((a == b).all() for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(system), strict=True))


def test_a_mass_rests_on_a_preloaded_stop_until_its_load_leaves_the_range():
    # The load 0.2 + 0.5 cos t presses within [0, 1] at first, then pulls.
    stop = vx.CompliantStop(0, 0.0, "upper", 10.0, 0.0, preload=1.0)
    load = vx.Harmonic([0.5], 1.0, mean=[0.2])
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [stop])
    sol = vx.simulate(system, 0.0, 2.5)
    assert bool(vx.simulate(system, 0.0, 1.0).stuck1[0])
    assert int(sol.events.kind[0]) == vx.OPEN
    assert abs(float(sol.events.t[0]) - np.arccos(-0.4)) < ROUNDING


LOAD = vx.Harmonic([0.5], 0.8)
BAD = {
    "a negative force": (lambda: vx.Friction(0, -1.0), "`force` must be finite and not negative"),
    "static below force": (lambda: vx.Friction(0, 1.0, 0.5), "`static` must not be below `force`"),
    "a row of zeros": (lambda: vx.Friction({0: 0.0}, 1.0), "must have a coefficient that is not zero"),
    "a negative stiffness": (lambda: vx.CompliantStop(0, 0.1, "upper", -2.0), "`stiffness` must be finite"),
    "a mass that is none": (
        lambda: vx.ImpactSystem([1.0], [[0.1]], [[1.0]], LOAD, friction=[vx.Friction(3, 1.0)]),
        r"`friction\[0\].row` names mass 3",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_a_sentence(name):
    make, sentence = BAD[name]
    with pytest.raises(ValueError, match=sentence):
        make()


def test_printing_names_friction_and_compliance():
    shown = repr(capsule())
    assert "stiffness 15, damping 0.2" in shown
    assert "friction 0" in shown


@pytest.mark.slow
def test_a_slip_just_before_a_contact_closes_is_located():
    """The steps to an event of one guard must not pass an earlier one of another; closed forms of both."""
    random = np.random.default_rng(0)
    for _ in range(100):
        between = 10 ** random.uniform(-3.3, -1.3)
        force, speed, stiffness = random.uniform(0.2, 0.9), random.uniform(0.2, 2.0), random.uniform(0.5, 3)
        slip = np.arcsin(force)
        close = slip + between
        load = vx.Harmonic([0.0, 1.0], 1.0, [0.0, -np.pi / 2])
        cushion, friction = vx.CompliantStop(0, close * speed, "upper", 10.0), vx.Friction(1, force)
        nothing, springs = np.zeros((2, 2)), np.diag([0.0, stiffness])
        system = vx.ImpactSystem([1.0, 1.0], nothing, springs, load, [cushion], friction=[friction])
        sol = vx.simulate(system, 0.0, slip + 0.3, [0.0, 0.0], [speed, 0.0])
        kinds, times = np.asarray(sol.events.kind), np.asarray(sol.events.t)
        assert times[kinds == vx.SLIP][0] == pytest.approx(slip, abs=1e-13)
        assert times[kinds == vx.CLOSE][0] == pytest.approx(close, abs=1e-13)
