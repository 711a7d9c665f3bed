"""The periodic response of linear machines, and its distance from stops."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from responses import LOAD, UNEVEN, amplitudes, matrices, response_at

import vijax as vx
from vijax._machine.machine import Machine
from vijax._machine.preparation import prepare
from vijax._sections.non_impacting_proof import highest, never_hits
from vijax._sections.response import modes_of, residual_vibration, response_of
from vijax._trajectory.concrete_machine import known_machine

# Some hundred roundings of numbers of about 1.
ROUNDED = 1e-12
# A margin above all rounding, and too small for sampling without a proof.
MARGIN = 1e-9


prepared = jax.jit(prepare, static_argnames="can_stick")


def machine_of(system: vx.ImpactSystem) -> Machine:
    """The engine's machine as a single lane."""
    nowhere = jnp.zeros(system.num_masses)
    start = jnp.zeros(()), nowhere, nowhere
    machine = prepared(known_machine(system, None).numbers, jnp.ones(()), start, can_stick=True)
    return jax.tree.map(lambda a: np.asarray(a)[..., None], machine)


def is_proved(system: vx.ImpactSystem, x, v, angle: float = 0.0) -> bool:
    clear, _ = never_hits(machine_of(system), angle, np.asarray(x)[None], np.asarray(v)[None])
    return bool(clear[0])


# The response and the free vibration


@pytest.mark.thorough
def test_the_response_is_where_a_long_run_ends():
    period = 2 * np.pi / 0.9
    times = np.linspace(299, 300, 7) * period
    sol = vx.simulate(UNEVEN, 0.0, 300 * period, ts=times)
    machine = machine_of(UNEVEN)
    modes = modes_of(machine)
    response = response_of(machine, modes)
    for t, x, v in zip(times, np.asarray(sol.xs), np.asarray(sol.vs), strict=True):
        left = residual_vibration(machine, modes, response, 0.9 * t, (x[None], v[None]))
        assert left[0] < MARGIN  # with the errors that are allowed for
        np.testing.assert_allclose((x, v), response_at(UNEVEN, 0.9 * t), rtol=0, atol=ROUNDED)


def test_what_is_left_is_the_energy_of_the_free_vibration():
    m, _, k = matrices(UNEVEN)
    machine = machine_of(UNEVEN)
    modes = modes_of(machine)
    dx, dv = np.array([0.3, -0.2, 0.1]), np.array([0.05, 0.4, -0.3])
    x, v = response_at(UNEVEN, 0.4)
    left = residual_vibration(
        machine, modes, response_of(machine, modes), 0.4, ((x + dx)[None], (v + dv)[None])
    )
    np.testing.assert_allclose(left, np.sqrt(dv @ m @ dv + dx @ k @ dx), rtol=1e-9)


def test_the_bound_of_a_sum_of_harmonics_is_above_it_and_close():
    rng = np.random.default_rng(0)
    waves = rng.standard_normal((40, 3)) + 1j * rng.standard_normal((40, 3))
    angles = np.linspace(0, 2 * np.pi, 100_001)
    dense = (waves @ np.exp(1j * np.arange(1, 4)[:, None] * angles)).real.max(axis=1)
    bound = highest(waves, np.full(40, -1.0))
    assert (bound >= dense).all()
    np.testing.assert_allclose(bound, dense, rtol=1e-4)
    # For a single harmonic the bound is exact.
    np.testing.assert_allclose(highest(waves[:, :1], np.zeros(40)), abs(waves[:, 0]), rtol=1e-15)


# Distances from stops


def one_upper(position: float, mass: int = 0, motion=None, load=LOAD) -> vx.ImpactSystem:
    stops = [vx.Stop(mass, position, "upper", 0.7, motion)]
    return vx.chain([1.0, 0.5, 2.0], [1e-3] * 3, [1.0, 3.0, 0.7], load, stops)


def peak(waves: np.ndarray) -> float:
    """Maximum of Re sum_h waves_h exp(i h a), by Newton's method from the best of many samples."""
    orders = np.arange(1, len(waves) + 1)
    angles = np.linspace(0, 2 * np.pi, 10_000)
    a = angles[(waves @ np.exp(1j * orders[:, None] * angles)).real.argmax()]
    for _ in range(5):
        slope, curvature = ((waves * (1j * orders) ** n @ np.exp(1j * orders * a)).real for n in (1, 2))
        a -= slope / curvature
    return (waves @ np.exp(1j * orders * a)).real


ONE = vx.Harmonic([0.3, 0.1, 0.0], 0.9, mean=[0.1, 0.0, -0.2])


@pytest.mark.parametrize(("load", "room"), [(ONE, MARGIN), (LOAD, 1e-4)])
@pytest.mark.parametrize("side", ["upper", "lower"])
def test_a_response_that_touches_a_stop_is_not_quiet(load, room, side):
    far = one_upper(50.0, load=load)
    waves = amplitudes(far, np.atleast_2d(load.amplitude * np.exp(1j * np.asarray(load.phase))))[:, 0]
    mean = np.linalg.solve(far.stiffness, load.mean)[0]
    sign = 1 if side == "upper" else -1
    edge = mean + sign * peak(sign * waves)
    for gap, expected in ((-MARGIN, False), (0.0, False), (room, True)):
        wall = vx.Stop(0, float(edge + sign * gap), side, 0.7)
        system = eqx.tree_at(lambda s: s.stops, far, (wall,))
        assert is_proved(system, *response_at(far)) is expected


def test_a_moving_stop_is_judged_by_what_lies_between_it_and_its_mass():
    motion = vx.Harmonic([0.5], 0.9, [2.0], [0.03])
    far = one_upper(50.0, load=ONE)
    wave = amplitudes(far, np.asarray(ONE.amplitude)[None])[0, 0]
    mean = np.linalg.solve(far.stiffness, ONE.mean)[0] - 0.03
    relative = abs(wave - 0.5 * np.exp(2.0j))
    # The gap gets smaller than with a fixed stop, although the stop never reaches the peak of the mass.
    assert relative > abs(wave) + 0.1
    state = response_at(far)
    for gap, expected in ((-MARGIN, False), (MARGIN, True)):
        assert is_proved(one_upper(mean + relative + gap, motion=motion, load=ONE), *state) is expected
    assert is_proved(one_upper(mean + relative - MARGIN, load=ONE), *state)


def test_a_free_vibration_that_could_reach_the_stop_is_not_quiet():
    far = one_upper(50.0, load=ONE)
    m, _, k = matrices(far)
    wave = amplitudes(far, np.asarray(ONE.amplitude)[None])[0, 0]
    edge = np.linalg.solve(k, ONE.mean)[0] + abs(wave)
    x, v = response_at(far)
    dx, dv = np.array([-0.01, 0.02, 0.01]), np.array([0.01, -0.05, 0.02])
    reach = np.sqrt((dv @ m @ dv + dx @ k @ dx) * np.linalg.inv(k)[0, 0])
    for gap, expected in ((-1e-7, False), (1e-7, True)):
        assert is_proved(one_upper(float(edge + reach + gap), load=ONE), x + dx, v + dv) is expected


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["damping", "stiffness"])
def test_a_machine_with_a_mode_without_damper_or_spring_is_left_alone(name):
    system = one_upper(50.0, load=ONE)
    x, v = response_at(system)
    assert is_proved(system, x, v)
    links = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    free = {
        "damping": np.outer([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]) * 0.0,
        "stiffness": links,
    }[name]
    assert not is_proved(eqx.tree_at(lambda s: getattr(s, name), system, jnp.asarray(free)), x, v)


def test_a_damper_at_a_node_leaves_its_mode_undamped():
    # Two equal masses: the damper between them does nothing while they move together.
    k = np.array([[2.0, -1.0], [-1.0, 2.0]])
    c = 0.1 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    load = vx.Harmonic([0.1, 0.0], 0.6)
    system = vx.ImpactSystem([1.0, 1.0], c, k, load, [vx.Stop(0, 9.0, "upper", 0.7)])
    x, v = response_at(system)
    assert not is_proved(system, x, v)
    assert is_proved(eqx.tree_at(lambda s: s.damping, system, jnp.asarray(c + 1e-6 * np.eye(2))), x, v)


# Wave forms


def under_wave(kind: str, position: float = 50.0) -> vx.ImpactSystem:
    values = np.array([[1.0, 0.2, 0.0], [-0.7, 0.0, 0.3], [0.2, -0.1, 0.1]])
    load = vx.Waveform([0.5, 2.0, 4.0], values, 0.9, kind) + vx.Harmonic(
        [0.1, 0.0, 0.0], 0.9, mean=[0.2, 0.0, 0.0]
    )
    stops = [vx.Stop(0, position, "upper", 0.7)]
    return vx.chain([1.0, 0.5, 2.0], [0.1] * 3, [1.0, 3.0, 0.7], load, stops)


# Distances from the stop at which a motion is proved quiet: what harmonics above the 128th may add, more the more the load jumps.
WIDE = {"previous": 0.1, "linear": 1e-2, "cubic": 1e-3}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", WIDE)
def test_the_response_to_a_wave_form_ends_where_a_long_run_ends_and_is_proved_to_stay_away_from_stops(kind):
    far, period = under_wave(kind), 2 * np.pi / 0.9
    times = np.linspace(399, 400, 401) * period
    sol = vx.simulate(far, 0.0, 400 * period, ts=times)
    machine = machine_of(far)
    modes = modes_of(machine)
    response = response_of(machine, modes)
    found = response.waves[0] * np.exp(
        1j * np.arange(response.num_harmonics + 1)[:, None] * 0.9 * times[:, None, None]
    )
    x = found.sum(axis=1).real @ modes.shapes[0].T
    bound = np.linalg.norm(modes.shapes[0], axis=1) * response.of_positions
    assert (np.abs(x - sol.xs) < bound).all()
    assert bound[0] < WIDE[kind]
    top, ends = np.asarray(sol.xs)[:, 0].max(), (sol.x1, sol.v1)
    for gap, expected in ((-1e-4, False), (WIDE[kind], True)):
        assert is_proved(under_wave(kind, float(top + gap)), *ends) is expected


@pytest.mark.thorough
def test_sweeps_under_wave_forms_without_impacts_are_classified_by_their_response():
    ds = vx.sweep(
        under_wave("cubic"), {"forcing.frequency": [0.7, 0.9]}, transient=5, record=4, progress=False
    )
    motions = vx.classify(ds)
    assert (motions.motion.values == 0).all()
    decay = modes_of(machine_of(under_wave("cubic"))).decay[0]
    np.testing.assert_allclose(motions.contraction, np.exp(decay * ds.forcing_period), rtol=ROUNDED)
