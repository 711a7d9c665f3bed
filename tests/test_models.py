"""Ready-made machines against closed forms, published numbers, and SciPy's integrator in a frame at rest."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from helpers import Event, log_of
from scipy.integrate import solve_ivp

import vijax as vx

# Rounding of 1e-16 in some hundred steps.
EXACT = 2e-14
# The same, magnified by the multipliers of an orbit over the periods it is followed: below 100.
ORBIT = 2e-12
# What DOP853 at its tightest tolerance loses over some ten impacts.
SCIPY = 1e-10
# Budd and Dux give 12 digits.
PRINTED = 1e-10
# Transients of stable orbits, all multipliers below 0.9 a period, after 300 of them.
SETTLED = 1e-11
# Central differences over steps of 1e-5: 1e-16 / 1e-5 of rounding, 1e-10 of curvature, magnified.
DIFFERENCES = 1e-8


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
    build, values = getattr(vx.models, name), PARAMETERS[name]
    plain = jax.tree.leaves(build(**values))
    traced = jax.jit(lambda p: jax.tree.leaves(build(**p)))(values)
    for ours, theirs in zip(traced, plain, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=EXACT)
    slopes = jax.jacfwd(lambda p: jnp.concatenate([jnp.ravel(a) for a in jax.tree.leaves(build(**p))]))(
        values
    )
    for parameter, slope in slopes.items():
        assert np.isfinite(slope).all(), parameter
        assert np.abs(slope).max() > 0.1, parameter


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
    np.testing.assert_allclose([event.velocity for event in impacts], -speed * bounces, rtol=1e-9, atol=EXACT)
    assert stick.kind == "stick"
    assert stick.t == pytest.approx(fall * (1 + r) / (1 - r), rel=EXACT)
    assert float(solution.contact_force(2.0)[0]) == pytest.approx(2.0 * g, rel=EXACT)


def test_a_sweep_over_the_weight_of_a_ball_gives_its_falls():
    gravity = np.array([0.5, 1.0, 4.0, 9.81])
    ball = vx.models.bouncing_ball(0.6, frequency=0.5)
    ds = _sweep(ball, {"forcing.mean[0]": -gravity}, transient=0, record=1, x0=[0.7])
    np.testing.assert_allclose(ds.impact_time[:, 0], np.sqrt(2 * 0.7 / gravity), rtol=EXACT)
    np.testing.assert_allclose(ds.impact_velocity[:, 0], -np.sqrt(2 * 0.7 * gravity), rtol=EXACT)
    assert (ds.num_sticks == 1).all()
    assert ds.stuck.all()


class Table(NamedTuple):
    """A ball that hits a table once in n periods: restitution, weight, acceleration of the table over it."""

    n: int
    restitution: float
    gravity: float
    strength: float
    frequency: float = 3.0

    @property
    def slope(self) -> float:
        """-W y' / g as the ball hits the table: it flies n T and comes down as fast as it went up, and
        (1 + r) y' = (1 - r) g n T / 2 for its speed to be what it was."""
        return -np.pi * self.n * (1 - self.restitution) / (1 + self.restitution)

    @property
    def angle(self) -> float:
        """W t + phase at the impact, where y'' < 0."""
        return float(np.arcsin(self.slope / self.strength))

    @property
    def speed(self) -> float:
        """Relative to the table."""
        return self.gravity * self.n * 2 * np.pi / self.frequency / (1 + self.restitution)

    @property
    def amplitude(self) -> float:
        """Travel of the table."""
        return self.strength * self.gravity / self.frequency**2

    def system(self, phase: float) -> vx.ImpactSystem:
        """The machine."""
        return vx.models.ball_on_table(
            self.frequency, self.amplitude, phase=phase, restitution=self.restitution, gravity=self.gravity
        )

    def later(self, share: float) -> "Start":
        """The orbit, started that share of a flight after an impact."""
        r, g, w = self.restitution, self.gravity, self.frequency
        t = share * 2 * np.pi * self.n / w
        angle = self.angle + w * t
        # Height and speed in the frame at rest, less those of the table.
        height = self.amplitude * np.cos(self.angle)
        speed = r * self.speed - self.amplitude * w * np.sin(self.angle)
        x = height + speed * t - g * t**2 / 2 - self.amplitude * np.cos(angle)
        v = speed - g * t + self.amplitude * w * np.sin(angle)
        return Start(self.system(angle), np.array([x]), np.array([v]))


class Start(NamedTuple):
    """A machine and a start."""

    system: vx.ImpactSystem
    x: np.ndarray
    v: np.ndarray


STABLE = [Table(1, 0.5, 9.81, 1.3), Table(2, 0.7, 2.0, 1.4), Table(3, 0.8, 2.0, 1.2)]


@pytest.mark.parametrize("table", STABLE)
def test_a_ball_on_a_table_repeats_the_orbit_of_one_impact_in_n_periods(table):
    period, turns = 2 * np.pi * table.n / table.frequency, 6
    start = table.later(0.5)
    solution = vx.simulate(start.system, 0.0, turns * period, start.x, start.v)
    _assert_repeats(solution, start, (np.arange(turns) + 0.5) * period, np.full(turns, -table.speed))


@pytest.mark.parametrize("n", [1, 2])
def test_the_orbit_of_a_ball_doubles_its_period_where_the_exact_map_says_so(n):
    r = 0.5
    losses = np.pi * n * (1 - r) / (1 + r)
    # High bounces, which neglect the travel of the table, would put it at 2 instead.
    push = 2 * (1 + r**2) / (1 + r) ** 2
    start = Table(n, r, 9.81, float(np.hypot(losses, push))).later(0.5)
    multipliers = np.linalg.eigvals(_differences(start, 2 * np.pi * n / 3.0))
    np.testing.assert_allclose(np.sort(multipliers), [-1, -(r**2)], rtol=0, atol=DIFFERENCES)


def test_a_sweep_over_the_strength_of_a_table_finds_the_exact_orbit_up_to_its_bound():
    strengths = [1.2, 1.35, 1.5, 1.56]
    tables = [Table(1, 0.5, 9.81, strength) for strength in strengths]
    middle = tables[1]
    ds = _sweep(
        middle.system(0.0),
        {"forcing.amplitude[0]": [table.strength * table.gravity for table in tables]},
        record=2,
        x0=[0.0],
        v0=[middle.restitution * middle.speed],
    )
    for k, table in enumerate(tables[:3]):
        np.testing.assert_allclose(ds.impact_velocity[k, :2], -table.speed, rtol=SETTLED)
        np.testing.assert_allclose(ds.impact_phase[k, :2], table.angle % (2 * np.pi), rtol=SETTLED)
    # The bound is sqrt((pi / 3)^2 + (10 / 9)^2) = 1.527.
    assert abs(ds.impact_velocity[3, 0] - ds.impact_velocity[3, 1]) > 0.1


# Oscillators


class Orbit(NamedTuple):
    """An orbit with an impact at an upper stop, and perhaps another at its mirror image."""

    speed: float
    angle: float
    step: np.ndarray
    start: Callable[[float], tuple[float, np.ndarray]]


def _orbit(c: float, k: float, force: float, w: float, s: float, r: float, span: float, flip: int) -> Orbit:
    """The motion of x'' + c x' + k x = force cos(w t + phase) that hits s at speed v every `span`.

    With `flip` = 1 the load returns after `span`; with -1 it is reversed, and the next impact is at -s.
    Let z be (x, x') less the steady response, just before the impact at s. Just after it it is
    z - (1 + r) v e2, and E = expm(((0, 1), (-k, -c)) span) takes it to flip z: z = v u. Where the mass
    hits, the response has the position s - v u_1 and the velocity v (1 - u_2), and its amplitude is that
    of the load, which gives v, the larger root. The impact is linearised by S = ((-r, 0), (b, -r)),
    b = (a+ + r a-) / v, with the accelerations before and after it.
    """
    a = np.array([[0.0, 1.0], [-k, -c]])
    e, e2 = scipy.linalg.expm(a * span), np.array([0.0, 1.0])
    u1, u2 = (1 + r) * np.linalg.solve(e - flip * np.eye(2), e @ e2)
    gain = force / (k - w**2 + 1j * c * w)
    v = np.roots([u1**2 + ((1 - u2) / w) ** 2, -2 * s * u1, s**2 - abs(gain) ** 2]).max()
    angle = np.angle(s - v * u1 - 1j * v * (1 - u2) / w) - np.angle(gain)
    push = force * np.cos(angle) - k * s
    s_matrix = np.array([[-r, 0.0], [(push + c * r * v + r * (push - c * v)) / v, -r]])

    def later(t: float) -> tuple[float, np.ndarray]:
        """The angle of the load and the state, a time t after the impact."""
        wave = gain * np.exp(1j * (angle + w * t))
        return angle + w * t, scipy.linalg.expm(a * t) @ (v * np.array([u1, u2 - 1 - r])) + np.array(
            [wave.real, (1j * w * wave).real]
        )

    return Orbit(float(v), float(angle), s_matrix @ e, later)


PERIOD_DOUBLING = {"frequency": 2.8, "position": -0.068575652279, "restitution": 0.8, "damping_ratio": 0.0}
DAMPED = {"frequency": 1.5, "position": 0.1, "restitution": 0.6, "damping_ratio": 0.05}


@pytest.mark.parametrize("values", [PERIOD_DOUBLING, DAMPED], ids=["undamped", "damped"])
def test_an_impact_oscillator_has_the_exact_orbit_and_multipliers_of_one_impact_a_period(values):
    w, s, r, zeta = values.values()
    period = 2 * np.pi / w
    orbit = _orbit(2 * zeta, 1.0, 1.0, w, s, r, period, 1)
    if values is PERIOD_DOUBLING:
        # Budd and Dux (1994), Table 1.
        assert orbit.speed == pytest.approx(0.493081581866, abs=PRINTED)
        np.testing.assert_allclose(np.sort(np.linalg.eigvals(orbit.step)), [-1, -(r**2)], atol=PRINTED)
    phase, (x, v) = orbit.start(period / 2)
    start = Start(vx.models.impact_oscillator(phase=phase, **values), np.array([x]), np.array([v]))
    turns = 6
    solution = vx.simulate(start.system, 0.0, turns * period, start.x, start.v)
    _assert_repeats(solution, start, (np.arange(turns) + 0.5) * period, np.full(turns, orbit.speed))
    matrix = np.asarray(vx.monodromy_matrix(*start))
    assert np.trace(matrix) == pytest.approx(np.trace(orbit.step), abs=ORBIT)
    assert np.linalg.det(matrix) == pytest.approx(r**2 * np.exp(-2 * zeta * period), abs=ORBIT)


def test_a_sweep_of_an_impact_oscillator_finds_the_grazing_of_its_steady_motion():
    w, zeta = 0.7, 0.1
    response = 1 / (1 - w**2 + 2j * zeta * w)
    reach = abs(response)
    # At its lowest at t = 0.
    system = vx.models.impact_oscillator(w, phase=np.pi - np.angle(response), damping_ratio=zeta)
    places = reach * np.array([1.01, 1 + 1e-9, 1 - 1e-9, 0.99])
    ds = _sweep(system, {"stops[0].position": places}, transient=0, record=20, x0=[-reach])
    assert ds.num_impacts[:2].values.tolist() == [[0], [0]]
    assert (ds.num_impacts[2:] > 0).all()


TWO_SIDED = {"frequency": 0.8, "position": 0.5, "restitution": 0.7, "damping_ratio": 0.1}


def test_a_mass_between_two_stops_has_the_exact_symmetric_orbit_and_multipliers():
    w, s, r, zeta = TWO_SIDED.values()
    half = np.pi / w
    orbit = _orbit(2 * zeta, 1.0, 1.0, w, s, r, half, -1)
    phase, (x, v) = orbit.start(half / 2)
    system = vx.models.two_sided_oscillator(phase=phase, **TWO_SIDED)
    _assert_symmetric(Start(system, np.array([x]), np.array([v])), half, orbit.speed, orbit.step)


def test_a_mass_in_a_shaken_box_has_the_exact_symmetric_orbit_and_multipliers():
    w, a, d, r = 2.0, 0.4, 1.0, 0.6
    angle, speed = _rattle(w, a, d, r)
    half = np.pi / w
    # As a load on a mass without a spring; the general formula must agree with the elementary one.
    orbit = _orbit(0.0, 0.0, a * w**2, w, d, r, half, -1)
    assert orbit.speed == pytest.approx(speed, rel=EXACT)
    assert np.cos(orbit.angle) == pytest.approx(np.cos(angle), rel=EXACT)
    # In the frame at rest the mass goes from wall to wall at constant speed, and is half way at 0.
    phase = angle + np.pi / 2
    x = -a * np.cos(phase)
    v = -2 * w / np.pi * (d + a * np.cos(angle)) + a * w * np.sin(phase)
    system = vx.models.impact_pair(w, a, phase=phase, position=d, restitution=r, mass=3.0)
    _assert_symmetric(Start(system, np.array([x]), np.array([v])), half, speed, orbit.step)


def _rattle(w: float, a: float, d: float, r: float) -> tuple[float, float]:
    """Angle b of the box and speed against it, where the mass hits the upper wall.

    At rest, the mass leaves X = d + a cos b with the velocity u and is at -X half a period later, so
    u = -2 w X / pi; it came with -u. The wall moves by -a w sin b, and (1 - r) u = -(1 + r) a w sin b.
    """
    q = np.pi * (1 + r) / (1 - r) / 2
    angle = np.arcsin(d / a / np.hypot(1, q)) + np.arctan(1 / q)
    return float(angle), float(2 * w / np.pi * (d + a * np.cos(angle)) + a * w * np.sin(angle))


def test_the_symmetric_motion_of_a_mass_in_a_box_ends_in_a_fold():
    w, d, r = 2.0, 1.0, 0.6
    a = d / np.hypot(1, np.pi * (1 + r) / (1 - r) / 2)
    angle, _ = _rattle(w, a * (1 + 1e-12), d, r)
    orbit = _orbit(0.0, 0.0, a * (1 + 1e-12) * w**2, w, d, r, np.pi / w, -1)
    assert np.cos(orbit.angle) == pytest.approx(np.cos(angle), abs=1e-5)
    assert np.abs(np.linalg.eigvals(-orbit.step) - 1).min() < 1e-4


SYMMETRIC = {
    "two_sided_oscillator": (
        vx.models.two_sided_oscillator(1.5, restitution=0.7, damping_ratio=0.1),
        {"forcing.amplitude[0]": [0.5, 0.6, 0.7, 0.8]},
        [_orbit(0.2, 1.0, a, 1.5, 0.5, 0.7, np.pi / 1.5, -1)[:2] for a in (0.5, 0.6, 0.7, 0.8)],
    ),
    "impact_pair": (
        vx.models.impact_pair(2.0, 0.4, restitution=0.6),
        {"forcing.amplitude[0]": [4 * a for a in (0.3, 0.35, 0.4, 0.45)]},
        [_rattle(2.0, a, 1.0, 0.6)[::-1] for a in (0.3, 0.35, 0.4, 0.45)],
    ),
}


@pytest.mark.parametrize("name", SYMMETRIC)
def test_a_sweep_of_a_mass_between_two_walls_settles_on_the_exact_symmetric_orbit(name):
    system, amplitudes, expected = SYMMETRIC[name]
    # One compilation serves both where both are flown by Taylor series.
    ds = _sweep(system, amplitudes, record=2, x0=[0.0], v0=[1.0], flow=vx.TaylorFlow())
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
    with pytest.raises(ValueError, match="`num_masses` must be 2 or more, but is 1"):
        vx.models.uniform_chain(0.8, num_masses=1)


def test_ten_masses_hit_their_stops_as_in_scipy():
    system, rest = vx.models.uniform_chain(0.8, 3.0), np.zeros(10)
    load = np.eye(10)[0] * 3.0
    seen = _by_scipy(system, lambda t: load * np.cos(0.8 * t), None, rest, rest, 60.0)
    assert {event.stop for event in seen[0]} == {0, 1}
    _assert_agrees(vx.simulate(system, 0.0, 60.0, rest, rest), *seen)


def test_a_sweep_of_ten_masses_finds_the_grazing_of_either_stop():
    w = 0.8
    system = vx.models.uniform_chain(w, 3.0, position=100.0)
    k, c = np.asarray(system.stiffness), np.asarray(system.damping)
    response = np.linalg.solve(k - w**2 * np.eye(10) + 1j * w * c, 3.0 * np.eye(10)[0])
    near = np.array([1 + 1e-9, 1 - 1e-9])
    places = {f"stops[{j}].position": abs(response[i]) * near for j, i in ((0, 0), (1, 9))}
    ds = _sweep(system, places, transient=0, record=2, x0=response.real, v0=-w * response.imag)
    assert ds.num_impacts[0, 0].values.tolist() == [0, 0]
    assert int(ds.num_impacts[1, 0, 0]) > 0
    assert int(ds.num_impacts[0, 1, 1]) > 0


# A moving base


def test_a_machine_on_a_moving_base_moves_as_in_the_frame_at_rest():
    mass, w, weight = [1.0, 2.0], 0.8, [0.05, 0.1]
    travel, phase, order = np.array([0.4, 0.15]), np.array([0.5, -1.0]), np.array([1, 2])
    load = vx.base_excitation(mass, travel, w, phase, weight)
    stops = [vx.Stop(0, 0.3, "upper", 0.7), vx.Stop(1, 0.25, "upper", 0.6)]
    system = vx.chain(mass, [0.1, 0.2], [1.0, 1.5], load, stops)

    def base(t: float) -> tuple[float, float]:
        angle = order * w * t + phase
        return float(travel @ np.cos(angle)), float(-(travel * order * w) @ np.sin(angle))

    x, v = np.array([0.1, -0.2]), np.array([0.0, 0.3])
    seen = _by_scipy(system, lambda t: np.array(weight), base, x, v, 40.0)
    assert {event.stop for event in seen[0]} == {0, 1}
    _assert_agrees(vx.simulate(system, 0.0, 40.0, x, v), *seen)


def test_a_base_of_one_harmonic_is_the_first_of_several():
    one = vx.base_excitation([1.0, 2.0], 0.4, 0.8, 0.5)
    two = vx.base_excitation([1.0, 2.0], [0.4, 0.1], 0.8, [0.5, 0.0])
    np.testing.assert_allclose(one.amplitude, 0.4 * 0.64 * np.array([1.0, 2.0]), rtol=EXACT)
    np.testing.assert_array_equal(one.amplitude, two.amplitude[0])
    np.testing.assert_allclose(two.amplitude[1], 0.1 * 2.56 * np.array([1.0, 2.0]), rtol=EXACT)
    assert one.phase.tolist() == two.phase[0].tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((1.0, 0.4, 0.8), r"`mass` must have shape \(n,\), but has shape \(\)"),
        (([1.0], [[0.4]], 0.8), r"`amplitude` must be a number or have shape \(harmonics,\)"),
        (([1.0], [0.4, 0.1], 0.8, 0.0), r"`phase` must have the shape of `amplitude`, \(2,\)"),
        (([1.0], 0.4, 0.8, 0.0, [1.0, 2.0]), r"`mean` must have shape \(n,\) = \(1,\)"),
        (([1.0], 0.4, -0.8), r"`frequency` must be finite and not negative"),
    ],
)
def test_a_base_that_makes_no_sense_is_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.base_excitation(*arguments)


# How motions are compared


def _sweep(system: vx.ImpactSystem, values: dict, *, transient: int = 300, **options):
    ds = vx.sweep(system, values, transient=transient, progress=False, **options)
    assert (ds.result == 0).all()
    return ds


def _assert_repeats(
    solution: vx.Solution, start: Start, times: np.ndarray, velocities: Sequence[float]
) -> None:
    """The impacts are these, nothing else happens, and in the end all is as it was."""
    events = log_of(solution)
    assert [event.kind for event in events] == ["impact"] * len(times)
    np.testing.assert_allclose([event.t for event in events], times, rtol=ORBIT)
    np.testing.assert_allclose([event.velocity for event in events], velocities, rtol=ORBIT)
    np.testing.assert_allclose(solution.x1, start.x, rtol=0, atol=ORBIT)
    np.testing.assert_allclose(solution.v1, start.v, rtol=0, atol=ORBIT)


def _assert_symmetric(start: Start, half: float, speed: float, step: np.ndarray) -> None:
    """Started half way to the lower stop, it hits both in turn; its multipliers are those of two steps."""
    turns = 8
    solution = vx.simulate(start.system, 0.0, turns * half, start.x, start.v)
    side = (-1.0) ** np.arange(turns)
    assert [event.stop for event in log_of(solution)] == [1, 0] * (turns // 2)
    _assert_repeats(solution, start, (np.arange(turns) + 0.5) * half, -side * speed)
    matrix, expected = _differences(start, 2 * half), step @ step
    assert np.trace(matrix) == pytest.approx(np.trace(expected), abs=DIFFERENCES)
    assert np.linalg.det(matrix) == pytest.approx(np.linalg.det(expected), abs=DIFFERENCES)


def _differences(start: Start, period: float, step: float = 1e-5) -> np.ndarray:
    """The derivative of the map over a period, by central differences."""
    columns = []
    for dx, dv in ((step, 0.0), (0.0, step)):
        ends = [
            vx.simulate(start.system, 0.0, period, start.x + sign * dx, start.v + sign * dv)
            for sign in (1, -1)
        ]
        columns.append([float(ends[0].x1[0] - ends[1].x1[0]), float(ends[0].v1[0] - ends[1].v1[0])])
    return np.array(columns).T / (2 * step)


Base = Callable[[float], tuple[float, float]]


def _by_scipy(
    system: vx.ImpactSystem,
    load: Callable[[float], np.ndarray],
    base: Base | None,
    x0: np.ndarray,
    v0: np.ndarray,
    t1: float,
) -> tuple[list[Event], np.ndarray, np.ndarray]:
    """Impacts and end state, relative to the base, integrated in the frame at rest."""
    moves = (lambda t: (0.0, 0.0)) if base is None else base
    n, stops = system.num_masses, system.stops
    mass, c, k = (np.asarray(a) for a in (system.mass, system.damping, system.stiffness))

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        y, dy = moves(t)
        return np.append(z[n:], (load(t) - c @ (z[n:] - dy) - k @ (z[:n] - y)) / mass)

    def gap_of(stop: vx.Stop):
        def gap(t: float, z: np.ndarray) -> float:
            return stop.sign * (float(stop.position) + moves(t)[0] - z[stop.mass])

        gap.terminal, gap.direction = True, -1
        return gap

    gaps = [gap_of(stop) for stop in stops]
    t, events = 0.0, []
    y, dy = moves(t)
    z = np.append(x0 + y, v0 + dy)
    while t < t1:
        flight = solve_ivp(rates, (t, t1), z, "DOP853", events=gaps, rtol=3e-14, atol=1e-15, max_step=0.05)
        t, z = float(flight.t[-1]), flight.y[:, -1]
        y, dy = moves(t)
        for j, hits in enumerate(flight.t_events):
            if hits.size:
                i = n + stops[j].mass
                events.append(Event(t, "impact", j, float(z[i] - dy)))
                z[i] = dy - float(stops[j].restitution) * (z[i] - dy)
    return events, z[:n] - y, z[n:] - dy


def _assert_agrees(solution: vx.Solution, events: list[Event], x: np.ndarray, v: np.ndarray) -> None:
    ours = log_of(solution)
    assert [(event.kind, event.stop) for event in ours] == [(event.kind, event.stop) for event in events]
    assert len(events) > 8
    for name in ("t", "velocity"):
        mine, theirs = ([getattr(event, name) for event in log] for log in (ours, events))
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=SCIPY)
    np.testing.assert_allclose(solution.x1, x, rtol=0, atol=SCIPY)
    np.testing.assert_allclose(solution.v1, v, rtol=0, atol=SCIPY)
