"""Golden scenes of dry friction and compliant stops, compared event by event."""

from collections import Counter

import numpy as np
import pytest
from switching_scenes import SwitchingScene, data_of, scene_names, scene_of, shape_of, switching_scene

import vijax as vx

_SHAPES = Counter(shape_of(name) for name in scene_names())
# Scenes whose shape serves no other, but that are of a kind of their own.
_ALONE = ("capsule", "held_and_stuck")
# At its start the friction force is at the bound of the grip to 1e-16 of it: rounding of its terms, so it holds, as the force falls
# next. The exact sum is above. With a grip that is lower by more than rounding the scene begins as it does there.
_TIES = ("damper_between",)
_LOWER = 1 - 1e-13


def _marks(name: str) -> list:
    """Marks of a scene: shapes that serve few scenes, and take seconds to compile, belong to the long runs."""
    count = _SHAPES[shape_of(name)]
    if count < 3 and name not in _ALONE:
        return [pytest.mark.slow]
    return [pytest.mark.thorough] if count < 4 else []


_SCENES = [pytest.param(a, marks=_marks(a)) for a in scene_names()]
# Machines of which others hold the same in less: elements with static forces, `test_resting_bodies.py`.
_LONG = ("drop_on_stack", "lets_go_three", "random_219", "reach_stuck", "two_elements_static")
_MIXED = [
    pytest.param(a, marks=pytest.mark.slow if a in _LONG else pytest.mark.thorough)
    for a in scene_names("golden_mixed")
]


@pytest.fixture(scope="module", params=[*_SCENES, *_MIXED])
def scene(request) -> SwitchingScene:
    name = request.param
    if name not in _TIES:
        return switching_scene(name)
    data = data_of(name)
    friction = [{**element, "static": _LOWER * element["static"]} for element in data["friction"]]
    return scene_of(name, {**data, "friction": friction})


def test_friction_at_its_bound_holds_where_the_force_falls_next():
    scene = switching_scene("damper_between")
    first = scene.expected[0]
    sol = vx.simulate(scene.system, 0.0, 0.5 * first.t, scene.data["x0"], scene.data["v0"])
    assert int(sol.num_events) == 0
    np.testing.assert_array_equal(sol.v1[0], sol.v1[1])


@pytest.fixture(scope="module")
def solution(scene) -> vx.Solution:
    return scene.simulate()


def test_every_element_has_the_same_events_and_no_others(solution, scene):
    scene.check_events(solution)


def test_event_times_agree(solution, scene):
    scene.check_times(solution)


def test_the_end_state_agrees(solution, scene):
    scene.check_end(solution)


def test_the_log_is_in_the_order_of_time(solution):
    n = int(solution.num_events)
    assert (np.diff(np.asarray(solution.events.t)[:n]) >= 0).all()


@pytest.mark.slow
def test_states_read_off_the_solution_agree_with_a_shorter_run(solution, scene):
    data = scene.data
    for share in (0.3, 0.77):
        t = data["t0"] + share * (data["t1"] - data["t0"])
        shorter = vx.simulate(scene.system, data["t0"], t, data["x0"], data["v0"])
        x, v = solution.evaluate(t)
        np.testing.assert_allclose(x, shorter.x1, rtol=0, atol=scene.state_tolerance)
        np.testing.assert_allclose(v, shorter.v1, rtol=0, atol=scene.state_tolerance)
