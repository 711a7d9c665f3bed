"""Branches are complete: they end only where they must, list all bifurcations and no others, and have exact points."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import vijax as vx

pytestmark = pytest.mark.slow

FREQUENCY, RESTITUTION, POSITION = "forcing.frequency", "stops[0].restitution", "stops[0].position"
MEAN = "forcing.mean[0]"
# Event capacity for orbits of one mass: one program.
ROOM = 32
# Error of located points, in the scale of the parameter.
LOCATED = 1e-10
# Displacement by an impact whose speed is the square root of rounding.
LIGHT_IMPACT = 1e-7


def oscillator(frequency, **how):
    return vx.models.impact_oscillator(frequency, **{"damping_ratio": 0.05} | how)


def orbit_of(system, x, v, n=1):
    return vx.periodic_orbit(system, jnp.atleast_1d(x), jnp.atleast_1d(v), n, max_events=ROOM)


def response(system, frequency=None):
    """Orbit without impacts, as positions and velocities at phase 0."""
    w = float(system.forcing.frequency) if frequency is None else frequency
    matrix = system.stiffness - w**2 * jnp.diag(system.mass) + 1j * w * system.damping
    x = np.linalg.solve(
        matrix, np.asarray(system.forcing.amplitude) * np.exp(1j * np.asarray(system.forcing.phase))
    )
    return x.real, (1j * w * x).real


def follow(orbit, path, low, high, **how):
    return vx.continuation(orbit, path, (low, high), progress=False, **how)


def told(branch):
    return [(point.kind, point.value) for point in branch.bifurcations]


def kinds(branch):
    return [point.kind for point in branch.bifurcations]


def undamped(mean=0.0):
    """A machine whose orbits of two periods double by a symmetry, and whose light impacts are close to each other."""
    forcing = vx.Harmonic([1.0], 2.7124729112505848, [0.0], mean=[mean])
    stop = vx.Stop(0, 0.07597419633412433, "upper", 0.9)
    return vx.ImpactSystem([1.0], [[0.0]], [[1.0]], forcing, [stop])


@pytest.fixture(scope="module")
def cascade():
    """A branch along the restitution whose grazings add ever more bounces."""
    orbit = orbit_of(oscillator(2.3, position=-0.2, restitution=0.6), -1.56766, 0.771438)
    return orbit, follow(orbit, RESTITUTION, 0.0, 1.0)


def test_ever_more_bounces_are_no_return_to_an_earlier_point(cascade):
    orbit, branch = cascade
    assert branch.ends == ("chatter_completion", "bounds")
    narrow = follow(orbit, RESTITUTION, 0.0488, 0.65)
    assert narrow.ends == ("bounds", "bounds")
    shared = [(kind, value) for kind, value in told(branch) if value > 0.0488]
    assert kinds(narrow) == ["pd", "gr", "pd", "gr"] == [kind for kind, _ in shared]
    np.testing.assert_allclose([a for _, a in told(narrow)], [a for _, a in shared], rtol=0, atol=LOCATED)


def test_a_grazing_after_a_light_bounce_is_where_a_run_grazes(cascade):
    """The gap has a maximum and a minimum between two samples of its motion."""
    grazing = cascade[1].bifurcations[-3]
    assert grazing.kind == "gr"
    assert grazing.value == pytest.approx(0.0490313844, abs=1e-10)
    orbit = grazing.orbit
    period = float(orbit.period)
    around = np.linspace(0.285, 0.295, 4001) * period
    sol = vx.simulate(orbit.system, 0.0, period, orbit.x0, orbit.v0, ts=around, max_steps=10**6)
    assert abs(float(jnp.max(sol.xs)) + 0.2) < 1e-10


def end_of_leap(frequency, damping_ratio=0.05):
    """Position a period after the mass left x = 0 at rest, as the load began to pull; zero at the onset of sticks."""
    rate, start, period = np.sqrt(1 - damping_ratio**2), np.pi / 2 / frequency, 2 * np.pi / frequency
    forced = lambda t: np.exp(1j * frequency * t) / (1 - frequency**2 + 2j * damping_ratio * frequency)  # noqa: E731
    x, v = -forced(start).real, -(1j * frequency * forced(start)).real
    swing = x * np.cos(rate * period) + (v + damping_ratio * x) * np.sin(rate * period) / rate
    return np.exp(-damping_ratio * period) * swing + forced(start + period).real


@pytest.fixture(scope="module")
def plastic():
    """Impacts without rebound, after which the mass leaves at once or sticks for a while."""
    orbit = orbit_of(oscillator(2.8, position=0.0, restitution=0.0), -0.402128, 0.0874282)
    return follow(orbit, FREQUENCY, 1.5, 4.0)


def test_without_rebound_sticks_begin_where_an_impact_is_not_pulled_away(plastic):
    assert plastic.ends == ("bounds", "bounds")
    onset, doubling = plastic.bifurcations
    assert (onset.kind, doubling.kind) == ("chatter_completion", "pd")
    assert onset.value == pytest.approx(brentq(end_of_leap, 2.0, 2.1, xtol=1e-15), abs=1e-13)
    again = follow(plastic.orbit(0), FREQUENCY, 1.5, 4.0)
    np.testing.assert_allclose(
        [a for _, a in told(again)], [a for _, a in told(plastic)], rtol=0, atol=LOCATED
    )


def test_orbits_with_sticks_without_rebound_have_all_their_events(plastic):
    orbit = plastic.orbit(0)
    events = [vx.IMPACT, vx.STICK, vx.RELEASE]
    assert np.asarray(orbit.events.kind)[:3].tolist() == events
    sol = orbit.solution()
    assert np.asarray(sol.events.kind)[: int(sol.num_events)].tolist() == events
    assert abs(float(sol.x1[0] - orbit.x0[0])) < 1e-14


@pytest.mark.parametrize("position", [0.0, 0.1])
def test_a_bound_without_rebound_is_reached_and_nothing_is_told_beyond(position):
    system = oscillator(2.8, position=position, restitution=0.3)
    sol = vx.simulate(system, 0.0, 400 * system.forcing.period, [-0.3], max_events=0, throw=False)
    branch = follow(orbit_of(system, sol.x1, sol.v1), RESTITUTION, 0.0, 1.0)
    assert branch.values.min() == 0.0
    assert branch.values.max() == 1.0
    assert all(0 <= value <= 1 for _, value in told(branch))
    assert branch.orbit(int(np.argmin(branch.values))).is_admissible


def test_without_damping_multipliers_on_the_circle_do_not_cross_it():
    system = oscillator(0.55, position=3.0, damping_ratio=0.0)
    branch = follow(orbit_of(system, *response(system)), FREQUENCY, 0.3, 0.9, max_points=150)
    grazing = min(abs(value - np.sqrt(2 / 3)) for kind, value in told(branch) if kind == "gr")
    assert grazing < 1e-12
    assert not {"ns", "pd", "bp", "fold"} & {kind for kind, value in told(branch) if value < np.sqrt(2 / 3)}


@pytest.mark.parametrize("share", [0.7, 0.995])
def test_a_window_of_a_narrow_resonance_is_found(share):
    """Two uncoupled masses; the second, of quality 5000, reaches its stop only near its resonance."""
    quality, natural, load = 5000.0, 1.3, 1e-3
    damping = natural / quality
    position = share * load / (natural * damping)
    system = vx.ImpactSystem(
        [1.0, 1.0],
        [[0.1, 0.0], [0.0, damping]],
        [[1.0, 0.0], [0.0, natural**2]],
        vx.Harmonic([1.0, load], 1.1),
        [vx.Stop(0, 50.0, "upper", 0.7), vx.Stop(1, position, "upper", 0.7)],
    )
    branch = follow(orbit_of(system, *response(system)), FREQUENCY, 1.0, 1.6, max_points=400)
    square = np.roots([1.0, damping**2 - 2 * natural**2, natural**4 - (load / position) ** 2])
    grazings = sorted(value for kind, value in told(branch) if kind == "gr")
    np.testing.assert_allclose(grazings, np.sort(np.sqrt(square)), rtol=0, atol=1e-11)


def test_three_grazings_at_once_are_passed_by_an_orbit_gone_round_three_times():
    once = follow(orbit_of(undamped(-0.1), -0.257294, 0.0), MEAN, -0.3, 0.3)
    thrice = follow(orbit_of(undamped(-0.1), -0.257294, 0.0, 3), MEAN, -0.3, 0.3)
    assert thrice.ends == once.ends == ("bounds", "bounds")
    assert kinds(once) == kinds(thrice) == ["gr", "pd"]
    np.testing.assert_allclose([a for _, a in told(thrice)], [a for _, a in told(once)], rtol=0, atol=LOCATED)


def test_an_orbit_gone_round_twice_crosses_the_doubled_ones_at_the_doubling():
    orbit = follow(orbit_of(undamped(0.05), -0.44067815, 0.00474863), MEAN, 0.0, 0.12)
    (doubling,) = [point for point in orbit.bifurcations if point.kind == "pd" and point.value > 0.1]
    at = doubling.branch.orbit(doubling.index - 1)
    twice = follow(orbit_of(at.system, at.x0, at.v0, 2), MEAN, 0.09, 0.12)
    (crossing,) = [point for point in twice.bifurcations if point.kind == "bp"]
    assert crossing.value == pytest.approx(doubling.value, abs=1e-12)
    check_point(crossing)


def check_point(point):
    """Check that the orbit of a bifurcation, its columns and a run of the machine agree."""
    orbit, columns = point.orbit, point.branch.points.isel(point=point.index)
    np.testing.assert_array_equal(orbit.x0, columns.x0)
    np.testing.assert_array_equal(orbit.multipliers, columns.multipliers)
    growth = np.abs(orbit.multipliers)
    # Where an impact appears or vanishes, a run may lack it, or have it with the square root of rounding as its
    # speed.
    least = LIGHT_IMPACT if point.kind in ("gr", "chatter_completion") else 1e-13
    error = least * max(1.0, growth[np.isfinite(growth)].max())
    sol = vx.simulate(orbit.system, 0.0, orbit.period, orbit.x0, orbit.v0, max_events=512)
    np.testing.assert_allclose(sol.x1, orbit.x0, rtol=0, atol=error)
    np.testing.assert_allclose(sol.v1, orbit.v0, rtol=0, atol=error)
    assert float(columns.residual) < 1e-13
    where = {"fold": 1.0, "pd": -1.0, "bp": 1.0}
    if point.kind in where:
        assert np.abs(orbit.multipliers - where[point.kind]).min() < 1e-6


def test_orbits_of_all_bifurcations_are_what_the_branch_says(cascade, plastic):
    for branch in (cascade[1], plastic):
        for point in branch.bifurcations:
            check_point(point)


def test_an_impact_that_passes_the_start_of_the_cycle_is_no_grazing():
    """The solution of the equations beyond that impact is not admissible."""
    branches = []
    for frequency in (0.93, 0.94):
        system = oscillator(
            frequency,
            position=1.447379595395179,
            restitution=0.7263859153912613,
            damping_ratio=0.05897494850827774,
        )
        sol = vx.simulate(system, 0.0, 200 * system.forcing.period, [0.0], max_events=0, throw=False)
        branches.append(follow(orbit_of(system, sol.x1, sol.v1), FREQUENCY, 0.5, 2.0))
    assert [branch.ends for branch in branches] == [("bounds", "bounds")] * 2
    assert kinds(branches[0]) == kinds(branches[1]) == ["gr", "fold", "fold", "gr"]
    values = [[value for _, value in told(branch)] for branch in branches]
    np.testing.assert_allclose(values[0], values[1], rtol=0, atol=LOCATED)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_hop_between_two_holds_vanishes_where_the_force_touches_zero(restitution):
    """A load stronger than 0.31 pulls the mass off the stop on which the spring presses it."""
    found = []
    for amplitude in (0.2, 0.5):
        system = oscillator(
            1.8, amplitude=amplitude, position=-0.31, damping_ratio=0.1, restitution=restitution
        )
        sol = vx.simulate(system, 0.0, 400 * system.forcing.period, [-0.31], max_events=0, throw=False)
        branch = follow(orbit_of(system, sol.x1, sol.v1), "forcing.amplitude[0]", 0.1, 1.0)
        assert branch.ends[0] == "bounds"
        (value,) = [value for kind, value in told(branch) if kind == "force_zero"]
        assert value == pytest.approx(0.31, abs=1e-12)
        found.append(kinds(branch))
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("numbers", "n", "start"),
    [
        pytest.param(
            (1.13498519570028, -0.36230239228048, 0.06896643399205, 0.0, 1.0), 2, (-0.36230239228048, 0.0)
        ),
        pytest.param(
            (2.7511168901050387, -0.02549055743887335, 0.11170630544373185, 0.0, 2.0),
            1,
            (-0.0721787251, 0.6046945924),
        ),
    ],
    ids=["release", "plastic impact"],
)
def test_no_event_that_passes_the_start_of_the_cycle_is_a_change(numbers, n, start):
    frequency, position, damping_ratio, restitution, phase = numbers
    own = {"damping_ratio": damping_ratio, "restitution": restitution, "position": position}
    branches = []
    for angle in (phase, 0.0):
        system = vx.models.impact_oscillator(frequency, phase=angle, **own)
        x, v = start
        if angle == 0.0:  # the same motion, started at a later phase
            first = vx.periodic_orbit(vx.models.impact_oscillator(frequency, phase=phase, **own), [x], [v], n)
            later = vx.simulate(first.system, 0.0, (2 * np.pi - phase) / frequency, first.x0, first.v0)
            x, v = later.x1, later.v1
        branches.append(follow(orbit_of(system, x, v, n), POSITION, -0.8, 1.2))
    assert branches[0].ends == branches[1].ends == ("bounds", "bounds")
    assert kinds(branches[0]) == kinds(branches[1])
    values = [[value for _, value in told(branch)] for branch in branches]
    np.testing.assert_allclose(values[0], values[1], rtol=0, atol=LOCATED)


def test_a_chatter_has_room_for_its_last_bounces():
    """The cycle has nearly as many events as the capacity of its program."""
    system = vx.models.impact_oscillator(
        0.5745788216196517, damping_ratio=0.09978594367951248, restitution=0.0, position=0.6084226900248537
    )
    branch = follow(orbit_of(system, 0.6084226900248537, 0.0), RESTITUTION, 0.0, 1.0)
    assert branch.ends == ("bounds", "chatter_completion")
    for point in branch.bifurcations:
        check_point(point)
        point.orbit.solution()


def turns_below_stop(point, phase):
    """How far below its stop the mass of an oscillator turns, where it comes nearest to it without an impact."""
    frequency, position = float(point[FREQUENCY]), float(point[POSITION])
    system = oscillator(frequency, position=position, phase=phase)
    sol = vx.simulate(system, 0.0, system.forcing.period, point["x0"].values, point["v0"].values)
    times = np.linspace(0.0, float(system.forcing.period), 20001)
    x, v = (np.asarray(a)[:, 0] for a in sol.evaluate(times))
    k = np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0) & (v[:-1] - v[1:] < 0.01))
    highest = x[k] + v[k] * times[1] * v[k] / (v[k] - v[k + 1]) / 2
    return float(np.max(highest)) - position


def test_branches_and_curves_do_not_depend_on_the_phase_at_which_the_cycle_begins():
    found = []
    for phase, x, v in ((0.0, 0.14675255, 1.58969241), (1.0, -0.50656606, -0.25007669)):
        system = oscillator(1.0648343, position=0.2, phase=phase)
        branch = follow(orbit_of(system, x, v), FREQUENCY, 0.9, 1.5)
        bounds = {FREQUENCY: (0.9, 1.5), POSITION: (-0.3, 0.5)}
        curve = vx.bifurcation_curve(branch.bifurcations[0], POSITION, bounds, progress=False)
        ends = curve[POSITION].values[[0, -1]]
        for k in (0, -1):
            assert np.abs(curve["multipliers"].values[k] + 1).min() < LOCATED
            assert abs(turns_below_stop(curve.isel(point=k), phase)) < LOCATED
        found.append((branch.ends, kinds(branch), [a for _, a in told(branch)], curve.attrs["ends"], ends))
    one, other = found
    assert one[:2] == other[:2]
    assert one[3] == other[3] == '["gr+pd", "gr+pd"]'
    np.testing.assert_allclose(one[2], other[2], rtol=0, atol=LOCATED)
    np.testing.assert_allclose(one[4], other[4], rtol=0, atol=1e-8)


def test_multipliers_do_not_depend_on_how_a_cycle_is_cut():
    """Cycles that begin at other phases, and a cycle traversed twice."""
    system = vx.models.wagg_bishop_a(0.8)
    orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
    for share in (0.2, 0.55, 0.8):
        later = vx.simulate(system, 0.0, share * system.forcing.period, orbit.x0, orbit.v0)
        phase = np.asarray(system.forcing.phase) + 2 * np.pi * share
        turned = vx.ImpactSystem(
            system.mass,
            system.damping,
            system.stiffness,
            vx.Harmonic(system.forcing.amplitude, system.forcing.frequency, phase),
            system.stops,
        )
        other = vx.periodic_orbit(turned, later.x1, later.v1)
        np.testing.assert_allclose(other.multipliers, orbit.multipliers, rtol=0, atol=1e-12)
    twice = vx.periodic_orbit(system, orbit.x0, orbit.v0, 2)
    squares = np.sort_complex(orbit.multipliers**2)
    np.testing.assert_allclose(np.sort_complex(twice.multipliers), squares, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("position", "num_impacts"), [(-1.2, 0), (-0.5, 28)])
def test_a_mass_that_a_stop_holds_as_the_cycle_begins_has_no_impacts_there(position, num_impacts):
    system = vx.models.impact_oscillator(0.3, position=position, restitution=0.6)
    orbit = vx.periodic_orbit(system, [position - 0.1], [0.3])
    assert abs(int(orbit.num_impacts[0]) - num_impacts) <= (num_impacts > 0)
    assert bool(orbit.is_admissible)


def test_an_orbit_at_rest_at_0_begins_a_branch():
    """The mean load presses the mass on a stop; where the stop is counts only by the force of the spring."""

    def branch(position, mean, end):
        load, stop = vx.Harmonic([mean / 5], 1.0, mean=[mean + position]), vx.Stop(0, position, "upper", 0.8)
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [stop])
        orbit = vx.periodic_orbit(system, [position], [0.0])
        return vx.continuation(orbit, "forcing.amplitude[0]", (mean / 10, end), progress=False)

    at_zero, elsewhere = branch(0.0, 0.5, 1.0), branch(0.1, 0.4, 0.8)
    assert kinds(at_zero) == kinds(elsewhere) == ["force_zero", "chatter_completion"]
    assert at_zero.ends == elsewhere.ends == ("bounds", "chatter_completion")
    shares = [
        [point.value / mean for point in one.bifurcations] for one, mean in ((at_zero, 0.5), (elsewhere, 0.4))
    ]
    assert shares[0][0] == pytest.approx(1.0, abs=LOCATED)
    np.testing.assert_allclose(*shares, rtol=0, atol=1e-9)
