"""Branches where the damper of a stop tears friction off its stick, or friction slips just before or behind it."""

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

PATH = "forcing.amplitude[0]"
DAMPING, STIFFNESS, FREQUENCY, GRIP, BELT = 0.19834927, 1.0, 0.44916823, 0.61201737, 0.2
POSITION, OF_STOP = 1.03194322, (12.52607974, 0.4376979366)
LOCATED = 1e-10
# Of central differences.
STEP = 1e-5


def between_stops(
    amplitude: float,
    damping: float = DAMPING,
    frequency: float = FREQUENCY,
    *,
    scale: float = 1.0,
    side: int = 1,
) -> vx.ImpactSystem:
    """A mass on a belt between a rigid stop and a damped compliant one: all masses and forces scaled, or its mirror image."""
    load = vx.Harmonic([scale * amplitude], frequency, [0.0 if side > 0 else np.pi])
    lower, upper = ("lower", "upper")[::side]
    stiffness, damper = (scale * number for number in OF_STOP)
    stops = [
        vx.Stop(0, -0.31487488 * side, lower, 0.8389289),
        vx.CompliantStop(0, POSITION * side, upper, stiffness, damper),
    ]
    belt = vx.Friction(0, scale * 0.47078259, static=scale * GRIP, velocity=BELT * side)
    return vx.ImpactSystem([scale], [[scale * damping]], [[scale * STIFFNESS]], load, stops, friction=[belt])


def between_cushions(amplitude: float) -> vx.ImpactSystem:
    """Two masses, one on the other by friction, the lower one between damped cushions: a symmetric machine."""
    stops = [vx.CompliantStop(0, -1.0, "lower", 10.0, 2.0), vx.CompliantStop(0, 1.0, "upper", 10.0, 2.0)]
    load, rider = vx.Harmonic([amplitude, 0.0], 0.8), vx.Friction({0: 1.0, 1: -1.0}, 0.5, static=0.7)
    damping, stiffness = np.diag([0.2, 0.1]), np.diag([1.0, 0.05])
    return vx.ImpactSystem([1.0, 0.5], damping, stiffness, load, stops, friction=[rider])


def branch_from(
    system: vx.ImpactSystem, bounds: tuple[float, float], start: Sequence[float] | None = None
) -> vx.Branch:
    at_rest = () if start is None else (start, np.zeros(len(start)))
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, *at_rest, throw=False, max_events=8)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), PATH, bounds, progress=False)


def push_at_close(point: vx.Bifurcation) -> tuple[float, float]:
    """Force of friction that moves with its belt where the stop closes, before it and behind it."""
    events = point.orbit.events
    closes = np.asarray(events.kind) == vx.CLOSE
    (time,) = np.asarray(events.t)[closes]
    load = point.value * np.cos(FREQUENCY * time)
    before = load - DAMPING * BELT - STIFFNESS * POSITION
    return before, before - OF_STOP[1] * BELT


def values_of(branch: vx.Branch, kind: str) -> list[float]:
    return sorted(point.value for point in branch.bifurcations if point.kind == kind)


@pytest.mark.slow
def test_a_branch_goes_on_where_friction_is_no_longer_torn_off():
    """Below it slips behind the event that tore it off, at first at once."""
    one, other = (branch_from(between_stops(amplitude), (0.9, 1.15)) for amplitude in (1.0, 1.14))
    assert sorted(one.ends) == sorted(other.ends) == ["adding_sliding", "bounds"]
    for kind in ("double_impact", "gr", "fold"):
        np.testing.assert_allclose(values_of(one, kind), values_of(other, kind), rtol=LOCATED)
    assert values_of(one, "double_impact") == pytest.approx([1.051564812, 1.068735885], rel=1e-9)
    assert one.points["is_admissible"].all()
    for branch in (one, other):
        for point in branch.bifurcations:
            if point.kind == "double_impact":
                assert push_at_close(point)[1] == pytest.approx(-GRIP, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [1.069, 1.0687])
def test_orbits_on_either_side_of_a_tear_have_the_multipliers_of_differences(amplitude):
    system, step = between_stops(amplitude, DAMPING + 1e-4), 1e-6
    orbit = vx.periodic_orbit(system, [0.57], [BELT])

    def after_a_period(x: float) -> float:
        return float(vx.simulate(system, 0.0, system.forcing.period, [x], [BELT]).x1[0])

    ends = [after_a_period(float(orbit.x0[0]) + side * step) for side in (-1, 1)]
    assert np.abs(orbit.multipliers).max() == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-7)
    assert not orbit.is_stable


@pytest.mark.slow
@pytest.mark.parametrize(("damping", "frequency"), [(0.0, 0.0), (1e-4, 0.0), (0.0, 1e-4)])
def test_a_branch_ends_where_friction_would_stick_for_a_while(damping, frequency):
    """Behind the impact it is within its grip. Beside the end there is another branch, 0.005 away."""
    system = between_stops(0.85, DAMPING + damping, FREQUENCY + frequency)
    branch = branch_from(system, (0.7, 1.0))
    assert branch.ends == ("bounds", "double_impact")
    assert branch.points["is_admissible"].all()
    assert branch.values[-1] == branch.values.max() == pytest.approx(0.93867, abs=1e-4)


@pytest.mark.slow
def test_friction_may_slip_before_the_stop_closes():
    branch = branch_from(between_stops(0.85), (0.7, 1.0))
    points = {round(point.value, 4): point for point in branch.bifurcations}
    assert branch.values[-1] == pytest.approx(0.9386692322, rel=1e-7)
    assert points[0.8075].kind == "gr"
    assert points[0.8075].value == pytest.approx(0.80753776, rel=2e-8)
    for value in (0.8076, 0.8068):
        assert points[value].kind == "double_impact"
        assert push_at_close(points[value])[0] == pytest.approx(-GRIP, rel=1e-9)
    for value in (0.8186, 0.7608):
        assert points[value].kind == "double_impact"
        assert push_at_close(points[value])[1] == pytest.approx(-GRIP, rel=1e-9)
    for value in (0.8076, 0.8186):
        assert_value_of(points[value])


def assert_value_of(point: vx.Bifurcation) -> None:
    """The value as a function of the damping is that of the branch, and its derivative that of differences."""
    machine = point.orbit.system

    def value(damping: float | jax.Array) -> jax.Array:
        return vx.bifurcation_value(point, replace(machine, damping=jnp.reshape(damping, (1, 1))))

    assert float(value(DAMPING)) == pytest.approx(point.value, rel=LOCATED)
    difference = (value(DAMPING + STEP) - value(DAMPING - STEP)) / (2 * STEP)
    assert float(jax.grad(value)(DAMPING)) == pytest.approx(float(difference), rel=1e-7)


@pytest.mark.slow
def test_scaled_and_mirrored_machines_have_the_same_branches():
    """Masses and forces scaled scale the amplitude; the mirror image slips the other way."""
    for amplitude, bounds in ((1.0, (0.9, 1.15)), (0.85, (0.7, 1.0))):
        told = []
        for scale, side in ((1.0, 1), (2.5, -1)):
            system = between_stops(amplitude, scale=scale, side=side)
            branch = branch_from(system, (scale * bounds[0], scale * bounds[1]))
            found = sorted((point.value / scale, point.kind) for point in branch.bifurcations)
            told.append((branch.ends, [kind for _, kind in found], [value for value, _ in found]))
        one, other = told
        assert one[:2] == other[:2]
        np.testing.assert_allclose(one[2], other[2], rtol=1e-9)


def carried(point: vx.Bifurcation) -> list[float]:
    """Force of friction that the rider would need behind each close of a cushion to stay where it is."""
    events, found = point.orbit.events, []
    sol = point.orbit.solution()
    for time in np.asarray(events.t)[np.asarray(events.kind) == vx.CLOSE]:
        x, v = (np.asarray(a) for a in sol.evaluate(time))
        load = point.value * np.cos(0.8 * time) - 0.2 * v[0] - x[0] - 2.0 * v[0]
        drag = 0.1 * v[1] + 0.05 * x[1]
        found.append(float(abs(0.5 * (load - drag) / 1.5 + drag)))
    return found


@pytest.mark.slow
def test_friction_is_torn_off_at_both_cushions_at_once():
    """Of a symmetric machine, from either side."""
    forth, back = (branch_from(between_cushions(a), (1.0, 2.3), [0.1, 0.1]) for a in (1.3, 2.1))
    for branch in (forth, back):
        assert branch.ends == ("bounds", "bounds")
        assert branch.points["is_admissible"].all()
        (point,) = (point for point in branch.bifurcations if point.kind == "double_impact")
        assert carried(point) == pytest.approx([0.7, 0.7], rel=1e-9)
    for kind in ("double_impact", "gr", "fold", "pd", "pitchfork"):
        np.testing.assert_allclose(values_of(forth, kind), values_of(back, kind), rtol=LOCATED)
