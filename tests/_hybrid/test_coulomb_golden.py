"""Golden scenes of friction of contacts and impacts with friction, compared event by event."""

import numpy as np
import pytest
from switching_scenes import SwitchingScene, scene_names, switching_scene

import vijax as vx

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
    scene.check_events(solution)


def test_event_times_agree(solution, scene):
    scene.check_times(solution)


def test_the_end_state_agrees(solution, scene):
    scene.check_end(solution, _UNITS.get(scene.name, 1.0))


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
