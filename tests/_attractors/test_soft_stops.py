"""Attractors, shocks and edge states of a mass in a compliant stop, and beside Jenkins elements: those of the same machine written otherwise."""

import numpy as np
import pytest
from combinations import Choice

import vijax as vx
from vijax._attractors.attractors import machines_of_one
from vijax._attractors.integrity_measures import window_of

# Cycles are polished by a program that takes long to compile.
pytestmark = pytest.mark.thorough
QUIET = {"progress": False}
# Boundaries are found by bisection.
BISECTED = 1e-6
WALL = vx.CompliantStop(0, -1.0, "upper", 3.0)
STARTS = np.random.default_rng(3).uniform([-3.0, -3.0], [2.0, 3.0], (40, 2))


def machine(stops=(), frequency=1.7, stiffness=1.0, **parts) -> vx.ImpactSystem:
    """A mass with a small motion that stays in the stop, at all times deeper than -1, beside a large one that leaves it."""
    return vx.ImpactSystem([1.0], [[0.04]], [[stiffness]], vx.Harmonic([0.2], frequency), stops, **parts)


def answers(system) -> dict[str, np.ndarray]:
    """What is asked of a machine."""
    found = vx.attractors(system, STARTS, transient=150, **QUIET)
    shock = vx.critical_shock(found, 1, direction="v0[0]", rays=16, steps=32, **QUIET)
    tipping = vx.tipping_probability(found, 0.3 * np.eye(2), 1, samples=200, **QUIET)
    edge = vx.edge_state(found, max_periods=60, **QUIET)
    return {
        "share": found.share.values,
        "state": np.stack([found.x0.values[:, 0], found.v0.values[:, 0]]),
        "shock": np.array([shock["size"], shock.kick_x[0], shock.kick_v[0], shock.goes_to]),
        "tipping": tipping.probability.values,
        "edge": np.array([edge.x0[0], edge.v0[0], edge.num_periods]),
    }


def assert_same(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> None:
    for name, a in ours.items():
        assert np.isfinite(a).all(), name
        np.testing.assert_allclose(a, theirs[name], rtol=0, atol=BISECTED, err_msg=name)


@pytest.mark.usefixtures("optimised_lanes")
def test_states_in_a_compliant_stop_are_states_as_under_its_force():
    soft, forced = machine([WALL]), machine(force=Choice(3.0, -1.0))
    ours = answers(soft)
    assert ours["state"][0, 1] > -1  # in the stop
    assert_same(ours, answers(forced))

    def drawn(system):
        bounds = [[-3.0, 2.0], [-3.0, 3.0]]
        return vx.attractors(system, 40, bounds=bounds, transient=150, **QUIET).share

    np.testing.assert_array_equal(drawn(soft), drawn(forced))


@pytest.mark.slow
def test_a_jenkins_element_has_the_shocks_of_its_halves():
    whole, half = vx.Jenkins(0, 0.1, 0.01), vx.Jenkins(0, 0.05, 0.005)
    ours = answers(machine([WALL], stiffness=0.9, hysteresis=[whole]))
    assert_same(ours, answers(machine([WALL], stiffness=0.9, hysteresis=[half] * 2)))


def test_a_stop_that_moves_over_a_mass_carries_it_along_if_it_is_rigid():
    state = np.array([[1.7 * -0.5, 0.3]])

    def moved(stop):
        machines = machines_of_one(
            "", machine([stop]), None, 1, 2, None, None, None, vx.ExecutionSettings(), None
        )
        return machines.onto_stops(state, np.zeros(1, int))

    np.testing.assert_array_equal(moved(WALL), state)
    np.testing.assert_allclose(moved(vx.Stop(0, -1.0, "upper", 0.7)), [[-1.7, 0.3]], atol=1e-12)


def test_the_edge_of_a_grid_is_a_wall_at_a_rigid_stop_alone():
    axes = {"x0[0]": np.linspace(-3.0, -1.0, 5), "v0[0]": np.linspace(-1.0, 1.0, 5)}
    walls = lambda stop: window_of(axes, {}, machine([stop]))[0].is_wall.tolist()  # noqa: E731
    assert walls(vx.Stop(0, -1.0, "upper", 0.7)) == [[False, True], [False, False]]
    assert walls(WALL) == [[False, False], [False, False]]
