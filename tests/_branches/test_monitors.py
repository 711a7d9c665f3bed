"""Zeros of functions of one cycle along a branch, against closed forms; conditions that end it; its step and tolerance."""

import numpy as np
import pytest
import scipy.optimize
from exact_orbits import exact_orbit
from helpers import counted

import vijax as vx

pytestmark = pytest.mark.thorough

PATH, POSITION, RESTITUTION, DAMPING, FREQUENCY = "forcing.amplitude[0]", 1.0, 0.8, 0.05, 1.0
# The free response of unit load has this amplitude at its resonance.
GAIN = 1 / (2 * DAMPING)
SPEED, SIZE = 0.5, 0.8
# Of a zero located by single runs, each with its own rounding.
ROUNDING = 1e-12


def machine(amplitude: float) -> vx.ImpactSystem:
    return vx.models.impact_oscillator(
        FREQUENCY, amplitude, position=POSITION, restitution=RESTITUTION, damping_ratio=DAMPING
    )


def exact_speed(amplitude: float) -> float:
    span = 2 * np.pi / FREQUENCY
    return exact_orbit(2 * DAMPING, 1.0, amplitude, FREQUENCY, POSITION, RESTITUTION, span, 1).speed


def hit(sol: vx.Solution) -> float:
    """Largest speed of impact beyond `SPEED`."""
    return (
        float(np.abs(sol.events.velocity_minus).max(initial=0.0, where=sol.events.kind == vx.IMPACT)) - SPEED
    )


def size(sol: vx.Solution) -> float:
    """Amplitude of the motion at the end of a period beyond `SIZE`: that of the response, as w = 1."""
    return float(np.hypot(sol.x1[0], sol.v1[0])) - SIZE


def jump(sol: vx.Solution) -> float:
    """Jumps from -1/2 to 1/2 where the impact appears, and has no zero."""
    return float(sol.num_events) - 0.5


@pytest.fixture(scope="module")
def orbit() -> vx.PeriodicOrbit:
    system = machine(1.0)
    settled = vx.simulate(system, 0.0, 40 * system.forcing.period)
    return vx.periodic_orbit(system, settled.x1, settled.v1)


def follow(orbit: vx.PeriodicOrbit, low: float = 0.05, **options) -> vx.Branch:
    return vx.continuation(orbit, PATH, (low, 1.0), progress=False, **options)


@pytest.fixture(scope="module")
def branch(orbit) -> vx.Branch:
    return follow(orbit, monitor={"hit": hit, "size": size, "jump": jump})


@pytest.mark.slow
def test_zeros_of_monitors_are_those_of_the_closed_form(branch):
    found = {(point.kind, point.value) for point in branch.special_points if point.kind.startswith("monitor")}
    (at_speed,) = [value for kind, value in found if kind == "monitor:hit"]
    exact = scipy.optimize.brentq(lambda a: exact_speed(a) - SPEED, 0.2, 0.5, xtol=1e-15)
    assert at_speed == pytest.approx(exact, rel=ROUNDING)
    # Below the fold there is the response alone.
    (at_size,) = [value for kind, value in found if kind == "monitor:size" and value < 0.0999]
    assert at_size == pytest.approx(SIZE / GAIN, rel=ROUNDING)
    assert "monitor:jump" not in {kind for kind, _ in found}


def test_special_points_are_in_order_and_no_bifurcations(branch):
    assert [point.kind for point in branch.bifurcations] == ["gr", "fold"]
    assert [point.index for point in branch.special_points] == sorted(
        point.index for point in branch.special_points
    )
    assert (np.diff(branch.points.arclength) > 0).all()
    (zero,) = [point for point in branch.special_points if point.kind == "monitor:hit"]
    assert abs(branch.points.hit.values[zero.index]) < ROUNDING
    assert zero.orbit.is_stable
    assert "hit 0.308" in repr(branch)
    with pytest.raises(ValueError, match="zero of a monitor"):
        vx.bifurcation_value(zero, zero.orbit.system)


def test_a_branch_ends_where_a_condition_holds(orbit):
    ended = follow(orbit, monitor={"hit": hit}, stop="monitor:hit")
    assert ended.ends == ("stop:monitor:hit", "bounds")
    assert abs(ended.points.hit.values[0]) < ROUNDING
    assert ended.points.hit.values.min() == ended.points.hit.values[0]
    kinds = follow(orbit, stop=["pd", "fold"])
    assert kinds.ends == ("stop:fold", "bounds")
    assert [point.index for point in kinds.bifurcations] == [0]

    def is_slow(so_far: vx.Branch) -> bool:
        assert so_far.points.arclength.values[0] == 0  # it begins at the orbit
        return so_far.points.impact_speed.values[-1].max() < SPEED

    one, other = follow(orbit, stop={"slow": is_slow, "first": "gr"}, max_points=200), ended
    assert one.ends == ("stop:slow", "bounds")
    speeds = np.nanmax(one.points.impact_speed.values, axis=1)
    assert speeds[0] < SPEED <= speeds[1]
    assert one.values[0] < other.values[0]


@pytest.mark.slow
def test_step_and_tolerance_change_no_program(orbit):
    follow(orbit, 0.5, monitor={"hit": hit})
    with counted() as compilations:
        short = follow(
            orbit, 0.5, monitor={"size": size}, stop={"no": lambda _: False}, step=0.004, tolerance=1e-9
        )
    assert compilations == []
    assert 0.003 < np.abs(np.diff(short.values)).max() <= 0.004 * (1 + ROUNDING)
    coarse = follow(orbit, tolerance=1e-8)
    for point, kind, exact in zip(coarse.bifurcations, ("gr", "fold"), (1 / GAIN, 0.0999707536), strict=True):
        assert point.kind == kind
        assert point.value == pytest.approx(exact, abs=2e-9)
    # A point that is solved to a tolerance lies as near to the exact branch.
    speeds = np.nanmax(coarse.points.impact_speed.values[-10:], axis=1)
    exact = [exact_speed(a) for a in coarse.values[-10:]]
    np.testing.assert_allclose(speeds, exact, rtol=0, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("side", [-1e-9, 1e-9])
def test_a_closed_branch_has_each_zero_once(side):
    from test_closed_branch import faster_orbit

    start = faster_orbit(2.45)
    speed = float(np.abs(start.events.velocity_minus).max(initial=0.0, where=start.events.kind == vx.IMPACT))

    def faster(sol: vx.Solution) -> float:
        fastest = np.abs(sol.events.velocity_minus).max(initial=0.0, where=sol.events.kind == vx.IMPACT)
        return float(fastest) - speed - side

    branch = vx.continuation(
        start, "forcing.frequency", (1.8, 3.2), monitor={"faster": faster}, progress=False
    )
    assert branch.ends == ("closed", "closed")
    values = branch.points.faster.values
    changes = np.count_nonzero(
        np.diff(np.sign(np.append(values, values[0]))[np.abs(np.append(values, values[0])) > 1e-11])
    )
    found = [point.value for point in branch.special_points if point.kind == "monitor:faster"]
    assert len(found) == changes >= 2
    assert min(abs(value - 2.45) for value in found) < 1e-7


def test_what_cannot_be_monitored_is_refused(orbit):
    for options, words in [
        (
            {"monitor": {"hit": hit, "energy": "max_position"}},
            "a function of one cycle, but gives 'max_position'",
        ),
        ({"monitor": {"residual": size}}, "`monitor` must have names of its own"),
        ({"monitor": {"my size": size}}, "names like those of variables"),
        (
            {"monitor": {"place": lambda sol: sol.x1}},
            r"returns a real number, but it returned float64 of shape \(1,\)",
        ),
        ({"stop": "period_doubling"}, "The kinds are .*pd.*"),
        ({"stop": "monitor:energy"}, "must be kinds of special points"),
        ({"step": 2.0}, "`step` must be between"),
        ({"tolerance": 1e-3}, "`tolerance` must be between 0"),
    ]:
        with pytest.raises(ValueError, match=words):
            follow(orbit, **options)
