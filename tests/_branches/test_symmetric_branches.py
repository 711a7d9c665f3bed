"""Branches of symmetric machines, where several events appear or vanish at once; they keep the symmetry."""

from collections.abc import Callable

import jax
import numpy as np
import pytest

import vijax as vx

PATH, BOUNDS = "forcing.frequency", (0.45, 2.5)
LOCATED = 1e-10
# At a grazing the speeds of two impacts that vanish are determined up to the square root of rounding.
SYMMETRIC = 1e-7


def between_stops(
    frequency: float, amplitude: float | jax.Array = 1.0, *, friction: tuple[vx.Friction, ...] = ()
) -> vx.ImpactSystem:
    """A mass between two rigid stops."""
    stops = [vx.Stop(0, -2.5, "lower", 0.6), vx.Stop(0, 2.5, "upper", 0.6)]
    load = vx.Harmonic([amplitude], frequency)
    return vx.ImpactSystem([1.0], [[0.2]], [[1.0]], load, stops, friction=list(friction))


def between_cushions(frequency: float) -> vx.ImpactSystem:
    """The same mass between two compliant stops."""
    stops = [vx.CompliantStop(0, -2.5, "lower", 5.0), vx.CompliantStop(0, 2.5, "upper", 5.0)]
    return vx.ImpactSystem([1.0], [[0.2]], [[1.0]], vx.Harmonic([1.0], frequency), stops)


def rubbing_between_stops(frequency: float) -> vx.ImpactSystem:
    """The same mass between rigid stops, with dry friction, which turns it where it touches them."""
    return between_stops(frequency, friction=(vx.Friction(0, 0.1),))


def rubbing(frequency: float) -> vx.ImpactSystem:
    """A light mass on a stiff spring, with dry friction: it sticks on its way, between two slips."""
    load = vx.Harmonic([2.53417], frequency, [1.72426])
    return vx.ImpactSystem([0.284943], [[0.0]], [[14.2302]], load, friction=[vx.Friction(0, 0.295973)])


def branch_through(make: Callable[[float], vx.ImpactSystem], frequency: float, bounds: tuple) -> vx.Branch:
    system = make(frequency)
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, [0.1], [0.1], throw=False, max_events=8)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), PATH, bounds, progress=False)


def touches(damping: float, size: float = 2.5) -> np.ndarray:
    """Frequencies at which the vibration without contact just reaches its stops: (1 - w^2)^2 + (c w)^2 = size^-2."""
    return np.sqrt(np.sort(np.roots([1.0, damping**2 - 2.0, 1.0 - size**-2]).real))


def asymmetry(branch: vx.Branch) -> float:
    """How far the states half a period apart are from mirror images, on the whole branch."""
    found = []
    for k in range(0, len(branch), 5):
        orbit = branch.orbit(k)
        half = orbit.system.forcing.period / 2
        sol = vx.simulate(orbit.system, 0.0, half, orbit.x0, orbit.v0)
        found.append(np.abs(np.concatenate([sol.x1 + orbit.x0, sol.v1 + orbit.v0])).max())
    return max(found)


@pytest.mark.slow
@pytest.mark.parametrize("make", [between_stops, between_cushions, rubbing_between_stops])
def test_a_symmetric_motion_gains_both_contacts_at_once_and_loses_both(make):
    whole = [branch_through(make, frequency, BOUNDS) for frequency in (0.5, 1.0, 2.4)]
    for branch in whole:
        assert branch.ends == ("bounds", "bounds")
        assert branch.points["is_admissible"].all()
        assert asymmetry(branch) < SYMMETRIC
    first, *others = ([(point.kind, point.value) for point in branch.bifurcations] for branch in whole)
    for other in others:
        assert [kind for kind, _ in other] == [kind for kind, _ in first]
        np.testing.assert_allclose([v for _, v in other], [v for _, v in first], rtol=LOCATED)
    if make is not rubbing_between_stops:
        grazings = [value for kind, value in first if kind == "gr"]
        np.testing.assert_allclose(sorted(grazings), touches(0.2), rtol=1e-14)


@pytest.mark.slow
def test_the_grazing_of_both_stops_is_a_differentiable_function_of_the_machine():
    """At the point of a branch that comes with both impacts, whose speeds vanish at once."""
    branch = branch_through(between_stops, 1.0, (1.0, 1.8))
    (point,) = (point for point in branch.bifurcations if point.kind == "gr")
    value = lambda amplitude: vx.bifurcation_value(point, between_stops(1.0, amplitude))  # noqa: E731
    w, square = point.value, 2.5**-2
    by_amplitude = 2 * square / (-4 * w * (1 - w**2) + 2 * 0.2**2 * w)
    assert float(jax.grad(value)(1.0)) == pytest.approx(by_amplitude, rel=1e-13)


@pytest.mark.slow
def test_two_sticks_of_a_symmetric_motion_vanish_at_once():
    """From either side of the bifurcation, where the mass just stops between two slips, in either half of a period."""
    bounds = 0.40, 0.412
    one, other = (branch_through(rubbing, frequency, bounds) for frequency in bounds)
    for branch in (one, other):
        assert branch.ends == ("bounds", "bounds")
        assert [point.kind for point in branch.bifurcations] == ["grazing_sliding"]
        assert branch.points["is_admissible"].all()
        sticks = np.count_nonzero(branch.points["event_kind"] == vx.STICK, axis=1)
        at = branch.bifurcations[0].value
        assert set(sticks[branch.values < at - 1e-9]) == {4}
        assert set(sticks[branch.values > at + 1e-9]) == {6}
    assert one.bifurcations[0].value == pytest.approx(other.bifurcations[0].value, rel=LOCATED)


@pytest.mark.slow
def test_a_symmetric_grazing_is_passed_wherever_the_cycle_begins():
    """At some phases an impact passes the start of the cycle right there. A random machine, made symmetric."""

    def orbit_at(phase):
        stops = [vx.Stop(0, sign * 0.0723837, side, 0.690614) for sign, side in ((-1, "lower"), (1, "upper"))]
        load = vx.Harmonic([0.587407], 1.79, [phase])
        system = vx.ImpactSystem([0.335392], [[0.976174]], [[3.1508]], load, stops)
        sol = vx.simulate(system, 0.0, 200 * system.forcing.period, [0.0], [0.1], throw=False, max_events=8)
        return vx.periodic_orbit(system, sol.x1, sol.v1)

    starts = [orbit_at(phase) for phase in np.linspace(0, np.pi, 41)[:-1]]
    found = vx.continuation(starts, "forcing.frequency", (1.7, 1.8), progress=False)
    assert {branch.ends for branch in found} == {("bounds", "bounds")}
    points = [[(point.kind, point.value) for point in branch.bifurcations] for branch in found]
    assert {tuple(kind for kind, _ in own) for own in points} == {("fold", "gr", "fold", "gr")}
    values = np.array([[value for _, value in own] for own in points])
    np.testing.assert_allclose(values, values[:1].repeat(len(values), axis=0), rtol=1e-10)
