"""Golden scenes of contacts between masses, compared event by event."""

from collections import Counter

import numpy as np
import pytest
from contact_scenes import (
    contact_data,
    contact_machine,
    contact_scene,
    contact_scene_names,
    gaps_at,
    shape_of_scene,
)
from helpers import Scene, kinds_at_stops, log_of, paired, swapped

import vijax as vx

_SHAPES = Counter(shape_of_scene(name) for name in contact_scene_names())
# Scenes whose shape serves no other, but that are of a kind of their own: a moving wall, a full mass matrix, a stick torn off.
_ALONE = ("beam2_tip",)


def _marks(name: str) -> list[pytest.MarkDecorator]:
    """Marks of a scene: shapes that serve few scenes, and take seconds to compile, belong to the long runs."""
    if _SHAPES[shape_of_scene(name)] >= 5:
        return []
    return [pytest.mark.thorough if name in _ALONE else pytest.mark.slow]


_SCENES = [pytest.param(name, marks=_marks(name)) for name in contact_scene_names()]
_LIGHT = 1e-5


@pytest.fixture(scope="module", params=_SCENES)
def scene(request) -> Scene:
    return contact_scene(request.param)


@pytest.fixture(scope="module")
def solution(scene) -> vx.Solution:
    return scene.simulate()


@pytest.mark.slow
def test_there_are_the_same_events_in_the_same_order_and_none_else(solution, scene):
    assert solution.result == vx.RESULTS.successful
    found = log_of(solution)
    assert kinds_at_stops(found) == kinds_at_stops(scene.events)
    assert swapped(scene.events, found) == []
    assert np.flatnonzero(solution.stuck1).tolist() == scene.held_at_end


def test_event_times_and_speeds_agree(solution, scene):
    for expected, found in paired(scene.events, log_of(solution)):
        if expected.kind != "stick":
            assert abs(found.t - expected.t) <= scene.time_tolerance(expected), (expected, found)
        if expected.kind == "impact":
            # Speeds are derivatives of positions: a shift of the time of a light impact does not change the speed.
            assert abs(found.velocity - expected.velocity) <= 10 * scene.state_tolerance


def test_the_end_state_agrees(solution, scene):
    np.testing.assert_allclose(solution.x1, scene.x1, rtol=0, atol=scene.state_tolerance)
    np.testing.assert_allclose(solution.v1, scene.v1, rtol=0, atol=scene.state_tolerance)


def test_impulses_agree(solution, scene):
    data = contact_data(scene.name)
    expected = [e["impulse"] for e in data["events"] if e["kind"] == "impact" and e["v_before"] > _LIGHT]
    log = solution.events
    is_impact = (np.asarray(log.kind) == vx.IMPACT) & (np.asarray(log.velocity_minus) > _LIGHT)
    found = np.asarray(log.impulse)[is_impact]
    assert len(found) == len(expected)
    scale = max(1.0, *np.abs(expected))
    np.testing.assert_allclose(
        np.sort(found), np.sort(expected), rtol=0, atol=20 * scale * scene.state_tolerance
    )


@pytest.mark.slow
def test_contacts_press_while_they_hold_and_no_gap_is_negative(solution, scene):
    t = np.linspace(scene.t0, scene.t1, 512)
    force, gaps = np.asarray(solution.contact_force(t)), gaps_at(solution, scene.system, t)
    assert (force >= 0).all()
    assert gaps.min() > -1e-12
    assert np.abs(gaps[force > 0]).max(initial=0) < 1e-12


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["damper_r07", "gears_load", "pair_wall_chatter", "damper_vertical"])
def test_a_machine_in_other_coordinates_has_the_same_events(name):
    scene, data = contact_scene(name), contact_data(name)
    basis = np.array([[0.8, -0.5], [0.7, 0.9]])
    turned = contact_machine(data, basis)
    x0, v0 = np.linalg.solve(basis, scene.x0), np.linalg.solve(basis, scene.v0)
    sol = vx.simulate(turned, scene.t0, scene.t1, x0, v0)
    pairs = paired(scene.events, log_of(sol))
    worst = max(abs(a.t - b.t) / scene.time_tolerance(a) for a, b in pairs if a.kind != "stick")
    assert worst < 10
    np.testing.assert_allclose(basis @ sol.x1, scene.x1, rtol=0, atol=10 * scene.state_tolerance)
