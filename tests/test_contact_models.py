"""Ready-made machines with contacts between masses, full mass matrices and walls that move, against closed forms."""

from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_depends_on_every_parameter, log_of
from scipy.integrate import solve_ivp

import vijax as vx

# Rounding of 1e-16 in some hundred steps.
EXACT = 2e-14
# The same, magnified by the multipliers of an orbit over the periods it is followed.
ORBIT = 5e-13

PARAMETERS = {
    "impact_damper": {
        "frequency": 0.9,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.7,
        "restitution": 0.6,
        "damping_ratio": 0.1,
        "mass_ratio": 0.2,
    },
    "gear_pair": {
        "frequency": 2.0,
        "amplitude": 1.5,
        "phase": 0.3,
        "torque": 0.7,
        "position": 0.1,
        "restitution": 0.6,
        "inertias": jnp.array([2.0, 1.5]),
        "radii": jnp.array([1.2, 0.8]),
        "damping": 0.1,
    },
    "cantilever": {
        "frequency": 2.0,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.1,
        "restitution": 0.6,
        "length": 1.3,
        "bending_stiffness": 2.0,
        "mass_per_length": 0.7,
        "damping_ratio": 0.1,
    },
    "multi_piston": {
        "frequency": 1.2,
        "amplitudes": jnp.array([0.3, 0.4]),
        "phases": jnp.array([0.5, -0.2]),
        "positions": jnp.array([0.1, 0.2]),
        "mass_ratios": jnp.array([0.2, 0.3]),
        "restitution": 0.6,
        "gravity": 0.3,
    },
    "ball_between_walls": {
        "frequency": 2.0,
        "amplitude": 0.2,
        "phase": 0.3,
        "position": 1.5,
        "restitution": 0.6,
        "mass": 2.0,
    },
    "bead_column": {
        "frequency": 2.0,
        "amplitude": 0.2,
        "phase": 0.3,
        "position": 5.0,
        "diameter": 0.1,
        "restitution": 0.6,
        "gravity": 2.0,
        "mass": jnp.array([2.0, 1.0, 0.5]),
    },
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_of_a_model_may_be_traced_and_differentiated(name):
    assert_depends_on_every_parameter(getattr(vx.models, name), PARAMETERS[name], EXACT)


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (
            lambda: vx.models.gear_pair(1.0, 1.0, radii=[1.0]),
            r"`radii` must have shape \(2,\), but has shape \(1,\)",
        ),
        (lambda: vx.models.cantilever(1.0, num_elements=0), "`num_elements` must be 1 or more, but is 0"),
        (lambda: vx.models.bead_column(num_beads=0), "`num_beads` must be 1 or more, but is 0"),
        (
            lambda: vx.models.ball_between_walls(1.0, jnp.array([0.1])),
            r"`amplitude` must be a number, but has shape \(1,\)",
        ),
    ],
)
def test_what_is_no_machine_is_refused(build, sentence):
    with pytest.raises(ValueError, match=sentence):
        build()


# The impact damper


DAMPER = {"position": 0.6, "restitution": 0.6, "damping_ratio": 0.02, "mass_ratio": 0.15}


def symmetric(
    w: float, amplitude: float, position: float, restitution: float, damping_ratio: float, mass_ratio: float
):
    """Phase, and positions and velocities just after the impact at contact 0, of the orbit with one impact at each end.

    Half a period T later all is reversed. So the free mass flies at the speed s from s T / 4 to -s T / 4; momentum and
    restitution give the velocities of the oscillator, times s. With E the matrix of its free motion over T / 2, and p the
    response to the load at the impact, E (y+ - p) - p = -y-: linear in s, and |p| is known. Of the two motions that of the
    larger s is returned.
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
    # Just left: the start is on contact 0, and opens it.
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


@pytest.mark.parametrize("w", [0.98, 1.0])
def test_an_impact_damper_that_is_hit_as_periods_end_repeats_after_one(w):
    phase, x, v, _ = symmetric(w, 0.1, **DAMPER)
    system = vx.models.impact_damper(w, 0.1, phase=phase, **DAMPER)
    sol = vx.simulate(system, 0.0, 16 * 2 * np.pi / w, x, v)
    points = {"forcing.frequency": [w]}
    ds = vx.sweep(system, points, transient=0, record=16, x0=x, v0=v, progress=False)
    for source in (sol, ds):
        # Rounding puts some of those impacts before the end of their period and some after.
        motion = vx.classify(source, last=16)
        assert int(motion.num_periods.squeeze()) == 1
        assert motion.num_impacts.values.ravel().tolist() == [1, 1]
        assert float(motion.recurrence_error.squeeze()) < 1e-10


def test_a_light_energy_sink_drains_a_free_vibration_as_the_slow_flow_on_its_invariant_manifold_says():
    """Two impacts a period while A falls slowly, to the first order of the mass ratio mu.

    Half a period pi the free mass flies at a speed V, from end to end of a container that moves as A sin. At the upper end the
    container is met at x = k U - d, going back at the speed U, with V = U (1 + r) / (1 - r) by the impact law and
    k = (pi / 2) (1 + r) / (1 - r) by the flight: so A^2 = U^2 + (k U - d)^2. The impacts take (2 / pi) mu U^2 (1 + r) / (1 - r) in
    a unit of time, which A^2 / 2 loses. Such manifolds: T. Li, E. Gourc, S. Seguy, A. Berlioz, Int. J. Non-Linear
    Mechanics 90 (2017) 100-110.
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


# Gears


GEARS = {"torque": 0.7, "position": 0.1, "inertias": [2.0, 1.5], "radii": [1.2, 0.8], "restitution": 0.5}


def in_mesh(amplitude: float, t: float) -> vx.Solution:
    """The driving flanks start closed."""
    system = vx.models.gear_pair(1.3, amplitude, **GEARS)
    return vx.simulate(system, 0.0, t, x0=[0.1 / 1.2, 0.0])


def test_teeth_press_with_the_mean_torque_and_their_share_of_the_rest():
    first, second = 2.0 / 1.2**2, 1.5 / 0.8**2
    amplitude = 0.999 * 0.7 * (first + second) / second
    sol = in_mesh(amplitude, 20.0)
    assert int(sol.num_events) == 0
    t = np.linspace(0.0, 20.0, 50)
    share = second / (first + second)
    expected = (0.7 + amplitude * share * np.cos(1.3 * t)) / 1.2
    np.testing.assert_allclose(sol.contact_force(t)[:, 0], expected, rtol=0, atol=EXACT)


def test_teeth_part_where_the_torque_no_longer_presses_them():
    first, second = 2.0 / 1.2**2, 1.5 / 0.8**2
    amplitude = 1.2 * 0.7 * (first + second) / second
    sol = in_mesh(amplitude, 4.0)
    release, impact, *_ = log_of(sol)
    assert (release.kind, release.stop) == ("release", 0)
    assert release.t == pytest.approx(np.arccos(-1 / 1.2) / 1.3, rel=EXACT)
    # From there the distance of the flanks is that of a ball from a table.
    gravity = 0.7 / 1.2 * (1 / first + 1 / second)
    strength, w, t = amplitude / 1.2 / first, 1.3, impact.t - release.t
    angle = w * release.t
    speed = strength / w * (np.sin(angle + w * t) - np.sin(angle)) + gravity * t
    gone = strength / w**2 * (np.cos(angle) - np.cos(angle + w * t)) - strength / w * np.sin(angle) * t
    assert gone + gravity * t**2 / 2 == pytest.approx(0, abs=EXACT)
    assert impact.velocity == pytest.approx(speed, rel=10 * EXACT)
    assert (impact.kind, impact.stop) == ("impact", 0)


# Rounding at an angle of 5 over 12 impacts, 1e-14, magnified by 1 / (1 - 0.88), and by 30 in the multipliers.
TURNED = 1e-11
ROTATING = {"torque": 0.15, "damping": 0.2, "position": 0.3, "restitution": 0.9}


@pytest.fixture(scope="module")
def rattling() -> vx.PeriodicOrbit:
    """Gears that hammer on both flanks, turned by an angle that nothing tells."""
    system = vx.models.gear_pair(1.0, 1.0, **ROTATING)
    sol = vx.simulate(system, 0.0, 40 * system.forcing.period, x0=[5.1, 5.0])
    return vx.periodic_orbit(system, sol.x1, sol.v1, 2)


@pytest.mark.thorough
def test_gears_rattle_as_a_ball_between_walls_that_feels_their_relative_force(rattling):
    forcing = vx.Harmonic([1.0], 1.0, mean=[0.3])
    walls = [vx.Stop(position=0.3, restitution=0.9), vx.Stop(position=-0.3, side="lower", restitution=0.9)]
    ball = vx.ImpactSystem([1.0], [[0.2]], [[0.0]], forcing, walls)
    y, u = (a[0] - a[1] for a in (rattling.x0, rattling.v0))
    alone = vx.periodic_orbit(ball, y[None], u[None], 2)
    drag = np.exp(-0.2 * 4 * np.pi)
    expected = np.sort_complex(np.append(alone.multipliers, [1.0, drag]))
    np.testing.assert_allclose(
        np.sort_complex(np.asarray(rattling.multipliers)), expected, rtol=0, atol=TURNED
    )
    np.testing.assert_array_equal(rattling.num_impacts, alone.num_impacts)
    assert rattling.num_impacts.min() > 0
    assert float(alone.x0[0]) == pytest.approx(float(y), abs=ORBIT)
    assert float(alone.v0[0]) == pytest.approx(float(u), abs=ORBIT)


@pytest.mark.slow
def test_gears_turned_by_an_angle_have_the_same_orbit_once(rattling):
    angles = np.array([0.0, 0.7, -3.0])[:, None]
    starts = np.asarray(rattling.x0) + angles, np.asarray(rattling.v0) + 0 * angles
    orbits = vx.find_periodic_orbits(rattling.system, 2, starts, progress=False)
    assert len(orbits) == 1
    np.testing.assert_allclose(orbits[0].multipliers, rattling.multipliers, rtol=0, atol=TURNED)


def test_gears_with_a_mean_load_in_one_direction_drift():
    system = vx.models.gear_pair(1.0, 1.0, **ROTATING)
    pushed = eqx.tree_at(lambda s: s.forcing.mean, system, jnp.array([0.4, -0.15]))
    orbit = vx.periodic_orbit(pushed, [0.0, 0.0], [0.0, 0.0], 2, throw=False)
    assert orbit.result == vx.ORBIT_RESULTS.drifts


# The beam


# Of the elements: the error of a frequency falls with the fourth power of their length.
ORDER = 4


@pytest.mark.parametrize("num_elements", [1, 3])
def test_a_cantilever_bends_as_the_beam_does(num_elements):
    length, stiffness, force = 1.3, 2.0, 0.4
    beam = vx.models.cantilever(1.0, num_elements=num_elements, length=length, bending_stiffness=stiffness)
    load = np.zeros(2 * num_elements)
    load[-2] = force
    nodes = length * np.arange(1, num_elements + 1) / num_elements
    shape = np.linalg.solve(np.asarray(beam.stiffness), load)
    exact = force * nodes**2 * (3 * length - nodes) / (6 * stiffness)
    np.testing.assert_allclose(shape[::2], exact, rtol=100 * EXACT)
    np.testing.assert_allclose(
        shape[1::2], force * nodes * (2 * length - nodes) / (2 * stiffness), rtol=100 * EXACT
    )


def test_the_frequencies_of_a_cantilever_tend_to_those_of_the_beam_from_above():
    length, stiffness, mass = 1.3, 2.0, 0.7
    exact = (np.array([1.8751040687119611, 4.694091132974175]) / length) ** 2 * np.sqrt(stiffness / mass)
    errors = []
    for num_elements in (8, 16):
        beam = vx.models.cantilever(
            1.0,
            num_elements=num_elements,
            length=length,
            bending_stiffness=stiffness,
            mass_per_length=mass,
            damping_ratio=0.07,
        )
        back = np.linalg.inv(np.linalg.cholesky(beam.mass))
        squares = np.linalg.eigvalsh(back @ np.asarray(beam.stiffness) @ back.T)
        errors.append(np.sqrt(squares[:2]) / exact - 1)
        ratio = np.asarray(beam.damping)[0, 0] / np.asarray(beam.stiffness)[0, 0] * exact[0] / 2
        assert ratio == pytest.approx(0.07, rel=EXACT)
    assert (errors[1] > 0).all()
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), ORDER, atol=0.1)


@pytest.mark.thorough
def test_a_beam_that_loses_nothing_keeps_its_energy_through_impacts():
    beam = vx.models.cantilever(1.0, 0.0, num_elements=2, restitution=1.0, damping_ratio=0.0, position=0.05)
    start = np.array([-0.1, -0.3, -0.3, -0.5])
    sol = vx.simulate(beam, 0.0, 6.0, x0=start)
    assert int((sol.events.kind == vx.IMPACT).sum()) > 5
    mass, stiffness = np.asarray(beam.mass), np.asarray(beam.stiffness)
    at_first = start @ stiffness @ start / 2
    for t in (1.0, 3.0, 6.0):
        x, v = (np.asarray(a) for a in sol.evaluate(t))
        assert (v @ mass @ v + x @ stiffness @ x) / 2 == pytest.approx(at_first, rel=100 * EXACT)
    assert np.asarray(sol.evaluate(np.linspace(0, 6, 500))[0])[:, -2].max() < 0.05 + EXACT


# A ball between walls


@pytest.mark.parametrize(("r", "n", "a"), [(1.0, 1, 0.1), (0.9, 2, 0.02)])
def test_a_ball_between_walls_has_the_exact_orbit_of_one_impact_at_each(r, n, a):
    w, d = 1.5, 1.0
    period, k = 2 * np.pi / w, (1 - r**2) / (2 * np.pi * n * r)
    # Of the two such instants that at which the wall speeds up: whoever comes late is thrown back faster.
    angle = -np.arccos(k * d / (a * np.hypot(1, k))) - np.arctan2(1, k)
    assert a * (k * np.cos(angle) - np.sin(angle)) == pytest.approx(k * d, abs=EXACT)
    flight = d - a * np.cos(angle)
    speed = flight * (1 + 1 / r) / (n * period)
    # Time 0 is when the ball leaves the moving wall.
    x = [a * np.cos(angle)]
    system = vx.models.ball_between_walls(w, a, phase=angle, position=d, restitution=r)
    turns = 5
    sol = vx.simulate(system, 0.0, (turns + 0.1) * n * period, x, [speed])
    events = log_of(sol)
    assert [(event.kind, event.stop) for event in events] == [("impact", 0), ("impact", 1)] * turns
    starts = n * period * np.arange(turns)
    times = np.stack([starts + flight / speed, starts + n * period], axis=1).ravel()
    np.testing.assert_allclose([event.t for event in events], times, rtol=ORBIT)
    np.testing.assert_allclose([event.velocity for event in events], [speed, -r * speed] * turns, rtol=ORBIT)


# Pistons


# ln |mu| of the largest multiplier for g = 0.130, 0.134 and 0.140, to all digits, as the program
# github.com/professionalMachine1/Multi-piston_vibro-impact_mechanism wrote them (LD_DMV.txt).
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("gravity", "exponent"),
    [
        (0.130, -0.2963060962),
        pytest.param(0.134, -0.7793959414, marks=pytest.mark.slow),
        pytest.param(0.140, -1.3862943611, marks=pytest.mark.slow),
    ],
)
def test_the_multipliers_of_a_machine_on_two_pistons_are_the_published_ones(gravity, exponent):
    system = vx.models.multi_piston(gravity=gravity)
    # There are others; this one is reached from the start of the program, half a turn later by its count.
    end = vx.simulate(system, np.pi, 400 * 2 * np.pi, [0.005 - 0.12], [0.2], max_events=4096)
    orbit = vx.periodic_orbit(system, end.x1, end.v1)
    assert orbit.is_admissible
    assert np.asarray(orbit.num_impacts).tolist() == [1, 1]
    assert np.log(np.abs(orbit.multipliers)).max() == pytest.approx(exponent, abs=2e-10)


@pytest.mark.thorough
def test_a_casing_at_rest_on_one_piston_is_thrown_up_by_another():
    # Both rows say the same, and their pistons move differently.
    sol = vx.simulate(vx.models.multi_piston(), 0.0, 60.0, [0.3])
    log = log_of(sol)
    taken_over = [
        (hit, left)
        for hit, left in pairwise(log)
        if hit.kind == "impact" and left.kind == "release" and hit.t == left.t
    ]
    assert taken_over
    assert all((hit.stop, left.stop) == (1, 0) for hit, left in taken_over)
    t = np.linspace(0.0, 60.0, 2000)
    x, floors = np.asarray(sol.evaluate(t)[0]), -np.asarray(sol.evaluate_stops(t)[0])
    assert (x - floors).min() > -EXACT
    hit, _ = taken_over[0]
    before, after = (float(sol.evaluate(at)[1][0]) for at in (np.nextafter(hit.t, 0), hit.t))
    assert after - before == pytest.approx(1.5 * hit.velocity, rel=1e-12)


# Beads


def reflected(x: np.ndarray, v: np.ndarray, t: float, length: float) -> np.ndarray:
    """Where points are that fly freely between 0 and a wall and pass through each other."""
    folded = np.mod(x + v * t, 2 * length)
    return np.where(folded > length, 2 * length - folded, folded)


def test_elastic_beads_between_walls_are_points_that_pass_through_each_other_in_order():
    d, height = 0.1, 2.0
    column = vx.models.bead_column(position=height, diameter=d, restitution=1.0, gravity=0.0)
    x, v = np.array([0.2, 0.7, 1.4]), np.array([1.1, -0.7, 0.4])
    ts = np.array([1.0, 3.0, 10.0])
    sol = vx.simulate(column, 0.0, 10.0, x, v, ts=ts)
    sizes = d * np.arange(3)  # what the beads below take of the height
    for t, found in zip(ts, np.asarray(sol.xs), strict=True):
        expected = np.sort(reflected(x - sizes, v, t, height - 3 * d)) + sizes
        np.testing.assert_allclose(found, expected, rtol=0, atol=ORBIT)
    assert len({event.stop for event in log_of(sol)}) == 4
    assert float((sol.v1**2).sum()) == pytest.approx((v**2).sum(), rel=EXACT)


@pytest.mark.thorough
def test_a_column_that_is_dropped_lies_still_and_each_contact_carries_what_is_above():
    column = vx.models.bead_column(diameter=0.1, restitution=0.5, mass=[3.0, 2.0, 0.5])
    sol = vx.simulate(column, 0.0, 3.0, x0=[0.5, 0.65, 0.8])
    assert np.asarray(sol.stuck1).all()
    np.testing.assert_allclose(sol.x1, [0.0, 0.1, 0.2], rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.v1, 0.0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.contact_force(3.0), 9.81 * np.array([5.5, 2.5, 0.5]), rtol=EXACT)


def test_a_light_ball_on_a_heavy_one_is_thrown_up():
    heavy, light, r = 4.0, 0.5, 0.9
    stack = vx.models.bead_column(num_beads=2, restitution=r, mass=[heavy, light])
    # The light ball follows at a distance d: they meet just after the heavy one has left the floor.
    h, d = 1.0, 1e-9
    sol = vx.simulate(stack, 0.0, 0.5, x0=[h, h + d])
    floor, meeting, *_ = log_of(sol)
    assert (floor.stop, meeting.stop) == (0, 1)
    speed = np.sqrt(2 * 9.81 * h)
    approach = (1 + r) * speed
    assert meeting.velocity == pytest.approx(approach, rel=EXACT)
    after = -speed + (1 + r) * approach * heavy / (heavy + light)
    # The light ball fell for the moment between, d / approach.
    assert float(sol.evaluate(meeting.t)[1][1]) == pytest.approx(after, rel=10 * d)


@pytest.mark.slow
def test_a_shaken_column_rides_on_a_floor_slower_than_its_weight():
    w, a = 3.0, 0.5
    column = vx.models.bead_column(w, a, num_beads=2, diameter=0.2, mass=2.0, phase=0.3)
    place, speed = a * np.cos(0.3), -a * w * np.sin(0.3)
    sol = vx.simulate(column, 0.0, 5.0, [place, place + 0.2], [speed, speed])
    assert int(sol.num_events) == 0
    t = np.linspace(0.0, 5.0, 20)
    force = 9.81 - a * w**2 * np.cos(w * t + 0.3)
    np.testing.assert_allclose(sol.contact_force(t), np.outer(force, [4.0, 2.0]), rtol=10 * EXACT)
