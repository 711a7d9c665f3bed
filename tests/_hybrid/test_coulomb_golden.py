"""Golden scenes of friction of contacts and impacts with friction, compared event by event."""

import numpy as np
import pytest
from switching_scenes import SwitchingScene, scene_names, switching_scene

import vijax as vx

# The end of a chatter is that of a geometric series of light bounces.
_STICK = 1e-8
# Scenes of one shape, which share a program with each other.
_QUICK = ("block_forced", "block_lifts", "dropped")
_SCENES = [
    pytest.param(a, marks=pytest.mark.thorough if a in _QUICK else pytest.mark.slow)
    for a in scene_names("golden_coulomb")
]
# Velocities of the woodpecker are of the order of 100.
_UNITS = {"woodpecker": 100.0}


@pytest.fixture(scope="module", params=_SCENES)
def scene(request) -> SwitchingScene:
    return switching_scene(request.param)


@pytest.fixture(scope="module")
def solution(scene) -> vx.Solution:
    return scene.simulate()


def test_every_element_has_the_same_events_and_no_others(solution, scene):
    found, expected = scene.found(solution), scene.expected
    assert len(found) == len(expected)
    for element in range(scene.num_stops + len(scene.system.friction)):
        ours, theirs = ([e.kind for e in events if e.element == element] for events in (found, expected))
        assert ours == theirs, element


def test_event_times_agree(solution, scene):
    key = lambda e: (e.element, e.t)  # noqa: E731
    for ours, theirs in zip(
        sorted(scene.found(solution), key=key), sorted(scene.expected, key=key), strict=True
    ):
        tolerance = _STICK if theirs.kind == "stick" else 0.0
        assert abs(ours.t - theirs.t) <= tolerance + scene.time_tolerance(theirs.t), (ours, theirs)


def test_the_end_state_agrees(solution, scene):
    tolerance = scene.state_tolerance * _UNITS.get(scene.name, 1.0)
    np.testing.assert_allclose(solution.x1, scene.data["x1"], rtol=0, atol=tolerance)
    np.testing.assert_allclose(solution.v1, scene.data["v1"], rtol=0, atol=tolerance)


def test_impulses_of_contact_and_friction_agree(solution, scene):
    log, tied = solution.events, [element.contact for element in scene.system.friction]
    is_impact = np.asarray(log.kind) == vx.IMPACT
    times, stops = (np.asarray(a)[is_impact] for a in (log.t, log.stop))
    normal, rubbed = (np.asarray(a)[is_impact] for a in (log.impulse, log.friction_impulse))
    for event in scene.data["events"]:
        if event["kind"] != "impact":
            continue
        k = int(np.argmin(np.abs(times - event["t"]) + (stops != event["index"])))
        own = [P for j, P in event["friction_impulses"].items() if tied[int(j)] == event["index"]]
        size = 1e-10 * max(1.0, scene.data["amplification_worst_restart"])
        assert abs(normal[k] - event["impulses"][str(event["index"])]) < size, event["t"]
        assert abs(rubbed[k] - sum(own)) < size, event["t"]


def test_friction_at_the_end_sticks_or_slips_as_it_should(solution, scene):
    ends = scene.data["end"]
    assert np.asarray(solution.sticking1).tolist() == [state == "stick" for state in ends["friction"]]
