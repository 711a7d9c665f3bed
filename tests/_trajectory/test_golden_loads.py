"""Golden scenes of loads by tables, compared event by event."""

import numpy as np
import pytest
from load_scenes import LoadScene, load_scene_names, scene_of_loads

import vijax as vx

# Its program takes as long to compile as those of the other scenes together.
LONG = "wave_and_harmonic_three"
SCENES = [pytest.param(a, marks=pytest.mark.thorough if a == LONG else []) for a in load_scene_names()]


@pytest.fixture(scope="module", params=SCENES)
def scene(request) -> LoadScene:
    return scene_of_loads(request.param)


@pytest.fixture(scope="module")
def solution(scene) -> vx.Solution:
    return scene.simulate()


def test_there_are_the_same_events_in_the_same_order_at_the_same_times(solution, scene):
    expected, found = scene.expected, scene.found(solution)
    assert [(e.element, e.kind) for e in found] == [(e.element, e.kind) for e in expected]
    for a, b in zip(expected, found, strict=True):
        assert abs(a.t - b.t) <= scene.time_tolerance(a.t), (a, b)


def test_the_end_state_agrees(solution, scene):
    assert solution.result == vx.RESULTS.successful
    for found, name in ((solution.x1, "x1"), (solution.v1, "v1")):
        np.testing.assert_allclose(found, scene.data[name], rtol=0, atol=scene.state_tolerance)
