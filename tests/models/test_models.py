"""Ready-made machines against closed forms and published numbers."""

from collections.abc import Sequence

import jax
import numpy as np
import pytest
import xarray as xr
from exact_orbits import Start, Table, exact_orbit, rattle
from helpers import assert_depends_on_every_parameter, log_of

import vijax as vx

# Rounding of 1e-16 in some hundred steps.
EXACT = 2e-14
# The same, magnified by the multipliers of an orbit over the periods simulated (measured: 8e-14).
ORBIT = 5e-13
# Transients of stable orbits, all multipliers below 0.9 a period, after 300 of them.
SETTLED = 1e-13
# Error of central differences over steps of 1e-5: rounding 1e-16 / 1e-5, curvature 1e-10, magnified.
DIFFERENCES = 3e-9
# Budd and Dux print the stop and the speed to 12 digits; the multipliers magnify the last of them.
PRINTED = 2e-12
PRINTED_MULTIPLIERS = 1e-10


# Every number of every machine


PARAMETERS = {
    "bouncing_ball": {"restitution": 0.5, "gravity": 2.0, "mass": 1.5, "frequency": 0.7},
    "ball_on_table": {
        "frequency": 3.0,
        "amplitude": 0.5,
        "phase": 0.3,
        "restitution": 0.5,
        "gravity": 2.0,
        "mass": 1.5,
    },
    "impact_oscillator": {
        "frequency": 2.8,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.2,
        "restitution": 0.6,
        "damping_ratio": 0.1,
    },
    "two_sided_oscillator": {
        "frequency": 2.8,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.2,
        "restitution": 0.6,
        "damping_ratio": 0.1,
    },
    "impact_pair": {
        "frequency": 2.8,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.2,
        "restitution": 0.6,
        "mass": 2.0,
    },
    "duffing_oscillator": {
        "frequency": 2.8,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.2,
        "restitution": 0.6,
        "damping": 0.1,
        "stiffness": 2.0,
        "cubic_stiffness": -0.5,
    },
    "impacting_pendulum": {
        "frequency": 2.8,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.2,
        "restitution": 0.6,
        "damping": 0.1,
        "natural_frequency": 1.3,
    },
    "uniform_chain": {
        "frequency": 0.8,
        "amplitude": 1.5,
        "position": 0.2,
        "restitution": 0.6,
        "mass": 2.0,
        "damping": 0.2,
        "stiffness": 3.0,
    },
    "wagg_bishop_a": {"frequency": 0.8, "amplitude": 0.3},
    "wagg_bishop_b": {"frequency": 0.8, "amplitude": 0.5},
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_of_a_model_may_be_traced_and_differentiated(name):
    assert_depends_on_every_parameter(getattr(vx.models, name), PARAMETERS[name], EXACT)


# Balls


def test_a_ball_bounces_at_the_times_of_a_geometric_series_and_comes_to_rest():
    r, g, h = 0.6, 9.81, 0.7
    solution = vx.simulate(vx.models.bouncing_ball(r, gravity=g, mass=2.0), 0.0, 2.0, [h])
    *impacts, stick = log_of(solution)
    fall, speed = np.sqrt(2 * h / g), np.sqrt(2 * g * h)
    bounces = r ** np.arange(len(impacts))
    assert len(impacts) > 20
    times = fall * (1 + 2 * np.append(0, np.cumsum(bounces[1:])))
    np.testing.assert_allclose([event.t for event in impacts], times, rtol=EXACT)
    np.testing.assert_allclose([event.velocity for event in impacts], -speed * bounces, rtol=EXACT)
    assert stick.kind == "stick"
    assert stick.t == pytest.approx(fall * (1 + r) / (1 - r), rel=EXACT)
    assert float(solution.contact_force(2.0)[0]) == pytest.approx(2.0 * g, rel=EXACT)


def test_a_sweep_over_the_weight_of_a_ball_gives_its_falls():
    gravity = np.array([0.5, 1.0, 4.0, 9.81])
    ball = vx.models.bouncing_ball(0.6, frequency=0.5)
    ds = _sweep(ball, {"forcing.mean[0]": -gravity}, transient=0, x0=[0.7])
    np.testing.assert_allclose(ds.impact_time[:, 0], np.sqrt(2 * 0.7 / gravity), rtol=EXACT)
    np.testing.assert_allclose(ds.impact_velocity[:, 0], -np.sqrt(2 * 0.7 * gravity), rtol=EXACT)
    assert (ds.num_sticks == 1).all()
    assert ds.stuck.all()


STABLE = [Table(1, 0.5, 9.81, 1.3), Table(2, 0.7, 2.0, 1.4), Table(3, 0.8, 2.0, 1.2)]


@pytest.mark.parametrize("table", STABLE)
def test_a_ball_on_a_table_repeats_the_orbit_of_one_impact_in_n_periods(table):
    period, turns = 2 * np.pi * table.n / table.frequency, 6
    start = table.later(0.5)
    solution = vx.simulate(start.system, 0.0, turns * period, start.x, start.v)
    _assert_repeats(solution, start, (np.arange(turns) + 0.5) * period, np.full(turns, -table.fall))


@pytest.mark.parametrize("n", [1, 2])
def test_the_orbit_of_a_ball_doubles_its_period_where_the_exact_map_says_so(n):
    r = 0.5
    losses = np.pi * n * (1 - r) / (1 + r)
    # The high-bounce approximation, which neglects the displacement of the table, would give 2 instead.
    push = 2 * (1 + r**2) / (1 + r) ** 2
    start = Table(n, r, 9.81, float(np.hypot(losses, push))).later(0.5)
    multipliers = np.linalg.eigvals(_differences(start, 2 * np.pi * n / 3.0))
    np.testing.assert_allclose(np.sort(multipliers), [-1, -(r**2)], rtol=0, atol=DIFFERENCES)


@pytest.mark.slow
def test_a_sweep_over_the_weight_of_a_ball_on_a_table_finds_the_exact_orbit_up_to_its_bound():
    acceleration = 12.0
    tables = [Table(1, 0.5, acceleration / strength, strength) for strength in (1.3, 1.4, 1.5, 1.56)]
    start, first = tables[1].later(0.5), tables[1].angle + np.pi
    weights = {"forcing.mean[0]": [-table.gravity for table in tables]}
    ds = _sweep(start.system, weights, x0=start.x, v0=start.v)
    for k, table in enumerate(tables[:3]):
        np.testing.assert_allclose(ds.impact_velocity[k, :2], -table.fall, rtol=SETTLED)
        np.testing.assert_allclose(ds.impact_phase[k, :2], (table.angle - first) % (2 * np.pi), rtol=SETTLED)
    # The bound is at a strength of sqrt((pi / 3)^2 + (10 / 9)^2) = 1.527.
    assert abs(ds.impact_velocity[3, 0] - ds.impact_velocity[3, 1]) > 0.1


# Oscillators


PERIOD_DOUBLING = {"frequency": 2.8, "position": -0.068575652279, "restitution": 0.8, "damping_ratio": 0.0}
DAMPED = {"frequency": 1.5, "position": 0.1, "restitution": 0.6, "damping_ratio": 0.05}


@pytest.mark.thorough
@pytest.mark.parametrize("values", [PERIOD_DOUBLING, DAMPED], ids=["undamped", "damped"])
def test_an_impact_oscillator_has_the_exact_orbit_and_multipliers_of_one_impact_a_period(values):
    w, s, r, zeta = values.values()
    period = 2 * np.pi / w
    orbit = exact_orbit(2 * zeta, 1.0, 1.0, w, s, r, period, 1)
    if values is PERIOD_DOUBLING:
        # Value of Budd and Dux (1994).
        assert orbit.speed == pytest.approx(0.493081581866, abs=PRINTED)
        np.testing.assert_allclose(
            np.sort(np.linalg.eigvals(orbit.step)), [-1, -(r**2)], rtol=0, atol=PRINTED_MULTIPLIERS
        )
    phase, (x, v) = orbit.start(period / 2)
    start = Start(vx.models.impact_oscillator(phase=phase, **values), np.array([x]), np.array([v]))
    turns = 6
    solution = vx.simulate(start.system, 0.0, turns * period, start.x, start.v)
    _assert_repeats(solution, start, (np.arange(turns) + 0.5) * period, np.full(turns, orbit.speed))
    matrix = np.asarray(vx.monodromy_matrix(*start))
    assert np.trace(matrix) == pytest.approx(np.trace(orbit.step), abs=ORBIT)
    assert np.linalg.det(matrix) == pytest.approx(r**2 * np.exp(-2 * zeta * period), abs=ORBIT)


@pytest.mark.thorough
def test_a_sweep_of_an_impact_oscillator_finds_the_grazing_of_its_steady_motion():
    w, zeta = 0.7, 0.1
    response = 1 / (1 - w**2 + 2j * zeta * w)
    reach = abs(response)
    # The lowest point is at t = 0.
    system = vx.models.impact_oscillator(w, phase=np.pi - np.angle(response), damping_ratio=zeta)
    places = reach * np.array([1.01, 1 + 1e-9, 1 - 1e-9, 0.99])
    ds = _sweep(system, {"stops[0].position": places}, transient=0, x0=[-reach])
    assert ds.num_impacts[:2].values.tolist() == [[0], [0]]
    assert (ds.num_impacts[2:] > 0).all()


TWO_SIDED = {"frequency": 0.8, "position": 0.5, "restitution": 0.7, "damping_ratio": 0.1}


def test_a_mass_between_two_stops_has_the_exact_symmetric_orbit_and_multipliers():
    w, s, r, zeta = TWO_SIDED.values()
    half = np.pi / w
    orbit = exact_orbit(2 * zeta, 1.0, 1.0, w, s, r, half, -1)
    phase, (x, v) = orbit.start(half / 2)
    system = vx.models.two_sided_oscillator(phase=phase, **TWO_SIDED)
    _assert_symmetric(Start(system, np.array([x]), np.array([v])), half, orbit.speed, orbit.step)


def test_a_mass_in_a_shaken_box_has_the_exact_symmetric_orbit_and_multipliers():
    w, a, d, r = 2.0, 0.4, 1.0, 0.6
    angle, speed = rattle(w, a, d, r)
    half = np.pi / w
    # The box as a load on a mass without a spring; the general formula must agree with the elementary one.
    orbit = exact_orbit(0.0, 0.0, a * w**2, w, d, r, half, -1)
    assert orbit.speed == pytest.approx(speed, rel=EXACT)
    assert np.cos(orbit.angle) == pytest.approx(np.cos(angle), rel=EXACT)
    # In the fixed frame the mass moves from wall to wall at constant speed, and is half way at time 0.
    phase = angle + np.pi / 2
    x = -a * np.cos(phase)
    v = -2 * w / np.pi * (d + a * np.cos(angle)) + a * w * np.sin(phase)
    system = vx.models.impact_pair(w, a, phase=phase, position=d, restitution=r, mass=3.0)
    _assert_symmetric(Start(system, np.array([x]), np.array([v])), half, speed, orbit.step)


def test_the_symmetric_motion_of_a_mass_in_a_box_ends_in_a_fold():
    w, d, r = 2.0, 1.0, 0.6
    a = d / np.hypot(1, np.pi * (1 + r) / (1 - r) / 2)
    angle, _ = rattle(w, a * (1 + 1e-12), d, r)
    orbit = exact_orbit(0.0, 0.0, a * (1 + 1e-12) * w**2, w, d, r, np.pi / w, -1)
    assert np.cos(orbit.angle) == pytest.approx(np.cos(angle), abs=1e-5)
    assert np.abs(np.linalg.eigvals(-orbit.step) - 1).min() < 1e-4


SYMMETRIC = {
    "two_sided_oscillator": (
        vx.models.two_sided_oscillator(1.5, restitution=0.7, damping_ratio=0.1),
        {"forcing.amplitude[0]": [0.5, 0.6, 0.7, 0.8]},
        [exact_orbit(0.2, 1.0, a, 1.5, 0.5, 0.7, np.pi / 1.5, -1)[:2] for a in (0.5, 0.6, 0.7, 0.8)],
    ),
    "impact_pair": (
        vx.models.impact_pair(2.0, 0.4, restitution=0.6),
        {"forcing.amplitude[0]": [4 * a for a in (0.3, 0.35, 0.4, 0.45)]},
        [rattle(2.0, a, 1.0, 0.6)[::-1] for a in (0.3, 0.35, 0.4, 0.45)],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SYMMETRIC)
def test_a_sweep_of_a_mass_between_two_walls_settles_on_the_exact_symmetric_orbit(name):
    system, amplitudes, expected = SYMMETRIC[name]
    ds = _sweep(system, amplitudes, x0=[0.0], v0=[1.0], flow=vx.TaylorFlow())
    assert (ds.num_impacts == 2).all()
    for k, (speed, angle) in enumerate(expected):
        point = ds.isel({"forcing.amplitude[0]": k})
        for stop, side in ((0, 1), (1, -1)):
            mine = point.impact_stop.values == stop
            np.testing.assert_allclose(point.impact_velocity.values[mine], side * speed, rtol=SETTLED)
            turned = np.exp(1j * (point.impact_phase.values[mine] - angle))
            np.testing.assert_allclose(turned, side, rtol=0, atol=SETTLED)


# A long chain


def test_a_uniform_chain_has_the_exact_frequencies_and_modes():
    n, m, k = 10, 2.0, 3.0
    system = vx.models.uniform_chain(0.8, mass=m, stiffness=k, damping=0.5)
    angles = (2 * np.arange(1, n + 1) - 1) * np.pi / (4 * n + 2)
    squares, modes = np.linalg.eigh(np.asarray(system.stiffness) / m)
    np.testing.assert_allclose(np.sqrt(squares), 2 * np.sqrt(k / m) * np.sin(angles), rtol=EXACT)
    exact = np.sin(2 * np.outer(np.arange(1, n + 1), angles)) * 2 / np.sqrt(2 * n + 1)
    np.testing.assert_allclose(np.abs(exact.T @ modes), np.eye(n), rtol=0, atol=EXACT)
    np.testing.assert_allclose(system.damping, system.stiffness * (0.5 / k), rtol=EXACT)


def test_a_uniform_chain_of_two_masses_is_that_of_the_paper():
    ours, theirs = vx.models.uniform_chain(0.8, 0.4, num_masses=2), vx.models.wagg_bishop_a(0.8, 0.4)
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_chain_of_one_mass_is_refused():
    with pytest.raises(ValueError, match="`num_masses` must be a whole number, 2 or more, but is 1"):
        vx.models.uniform_chain(0.8, num_masses=1)


@pytest.mark.slow
def test_a_sweep_of_ten_masses_finds_the_grazing_of_either_stop():
    w = 0.8
    system = vx.models.uniform_chain(w, 3.0, position=100.0)
    k, c = np.asarray(system.stiffness), np.asarray(system.damping)
    response = np.linalg.solve(k - w**2 * np.eye(10) + 1j * w * c, 3.0 * np.eye(10)[0])
    near = np.array([1 + 1e-9, 1 - 1e-9])
    places = {f"stops[{j}].position": abs(response[i]) * near for j, i in ((0, 0), (1, 9))}
    ds = _sweep(system, places, transient=0, x0=response.real, v0=-w * response.imag)
    assert ds.num_impacts[0, 0].values.tolist() == [0, 0]
    assert int(ds.num_impacts[1, 0, 0]) > 0
    assert int(ds.num_impacts[0, 1, 1]) > 0


# Comparison of motions


def _sweep(system: vx.ImpactSystem, values: dict, *, transient: int = 300, **options) -> xr.Dataset:
    """Sweep of four points and two recorded periods, so that machines of one shape share a compilation."""
    ds = vx.sweep(system, values, transient=transient, record=2, progress=False, **options)
    assert (ds.result == 0).all()
    return ds


def _assert_repeats(
    solution: vx.Solution, start: Start, times: np.ndarray, velocities: Sequence[float]
) -> None:
    """Check the impacts, the absence of other events, and that the end state is the start."""
    events = log_of(solution)
    assert [event.kind for event in events] == ["impact"] * len(times)
    np.testing.assert_allclose([event.t for event in events], times, rtol=ORBIT)
    np.testing.assert_allclose([event.velocity for event in events], velocities, rtol=ORBIT)
    np.testing.assert_allclose(solution.x1, start.x, rtol=0, atol=ORBIT)
    np.testing.assert_allclose(solution.v1, start.v, rtol=0, atol=ORBIT)


def _assert_symmetric(start: Start, half: float, speed: float, step: np.ndarray) -> None:
    """Check that a start half way to the lower stop hits both in turn, with the multipliers of two steps.

    Taylor series serve with and without a spring, so that one compilation suffices.
    """
    turns, flow = 8, vx.TaylorFlow()
    solution = vx.simulate(start.system, 0.0, turns * half, start.x, start.v, flow=flow)
    side = (-1.0) ** np.arange(turns)
    assert [event.stop for event in log_of(solution)] == [1, 0] * (turns // 2)
    _assert_repeats(solution, start, (np.arange(turns) + 0.5) * half, -side * speed)
    matrix, expected = _differences(start, 2 * half, flow), step @ step
    assert np.trace(matrix) == pytest.approx(np.trace(expected), abs=DIFFERENCES)
    assert np.linalg.det(matrix) == pytest.approx(np.linalg.det(expected), abs=DIFFERENCES)


def _differences(start: Start, period: float, flow: vx.TaylorFlow | None = None) -> np.ndarray:
    """Derivative of the map over a period, by central differences."""
    columns, step = [], 1e-5
    for dx, dv in ((step, 0.0), (0.0, step)):
        ends = [
            vx.simulate(start.system, 0.0, period, start.x + sign * dx, start.v + sign * dv, flow=flow)
            for sign in (1, -1)
        ]
        columns.append([float(ends[0].x1[0] - ends[1].x1[0]), float(ends[0].v1[0] - ends[1].v1[0])])
    return np.array(columns).T / (2 * step)
