"""Golden scenes, compared event by event."""

from collections import Counter

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import (
    Scene,
    golden_names,
    kinds_at_stops,
    load_scene,
    log_of,
    machine_shape,
    paired,
    swapped,
)

import vijax as vx

# State at a time where it is stored: a rounding or two.
READ_BACK = 1e-14
# One number of times for all evaluations of a solution, so that each machine compiles them once.
QUESTIONS = 1024

_SHAPES = Counter(machine_shape(name) for name in golden_names())
# A shape of machine takes seconds to compile: those that serve few scenes are left to the thorough tests.
_FEW_SCENES = 4
_SCENES = [
    pytest.param(name, marks=[pytest.mark.thorough] if _SHAPES[machine_shape(name)] <= _FEW_SCENES else [])
    for name in golden_names()
]


@pytest.fixture(scope="module", params=_SCENES)
def scene(request) -> Scene:
    return load_scene(request.param)


@pytest.fixture(scope="module")
def solution(scene) -> vx.Solution:
    return scene.simulate()


def test_the_motion_reaches_its_end(solution, scene):
    assert solution.result == vx.RESULTS.successful
    assert float(solution.t1) == scene.t1


def test_there_are_the_same_events_in_the_same_order_and_none_else(solution, scene):
    found = log_of(solution)
    assert kinds_at_stops(found) == kinds_at_stops(scene.events)
    assert swapped(scene.events, found) == []
    assert len(found) == int(solution.num_events)


def test_event_times_agree(solution, scene):
    for expected, found in paired(scene.events, log_of(solution)):
        if expected.kind != "stick":
            assert abs(found.t - expected.t) <= scene.time_tolerance(expected), (expected, found)


def test_the_log_is_in_the_order_of_time_and_padded_after_it(solution):
    n = int(solution.num_events)
    t, kind, stop = (np.asarray(a) for a in (solution.events.t, solution.events.kind, solution.events.stop))
    assert (np.diff(t[:n]) >= 0).all()
    assert np.isnan(t[n:]).all()
    assert (kind[n:] == -1).all()
    assert (stop[n:] == -1).all()


def test_the_end_state_agrees(solution, scene):
    np.testing.assert_allclose(solution.x1, scene.x1, rtol=0, atol=scene.state_tolerance)
    np.testing.assert_allclose(solution.v1, scene.v1, rtol=0, atol=scene.state_tolerance)


def test_the_same_stops_hold_their_mass_at_the_end(solution, scene):
    assert np.flatnonzero(solution.stuck1).tolist() == scene.held_at_end


def test_impacts_obey_the_impact_law_and_nothing_else_has_a_velocity(solution, scene):
    log, n = solution.events, int(solution.num_events)
    kind, stop, before, after, impulse = (
        np.asarray(a)[:n] for a in (log.kind, log.stop, log.velocity_minus, log.velocity_plus, log.impulse)
    )
    restitution = np.array([float(s.restitution) for s in scene.system.stops])[stop]
    mass = np.asarray(scene.system.mass)[[s.mass for s in scene.system.stops]][stop]
    sign = np.array([s.sign for s in scene.system.stops])[stop]
    is_impact = kind == vx.IMPACT
    assert (sign[is_impact] * before[is_impact] > 0).all()
    np.testing.assert_allclose(after[is_impact], -(restitution * before)[is_impact], rtol=READ_BACK)
    np.testing.assert_allclose(impulse[is_impact], (mass * (after - before))[is_impact], rtol=READ_BACK)
    assert not before[~is_impact].any()
    assert not after[~is_impact].any()


def test_a_start_held_on_a_stop_is_no_event(solution, scene):
    if not scene.held_at_start:
        assert all(event.kind == "impact" for event in log_of(solution) if event.t == scene.t0)
    for j in scene.held_at_start:
        of_stop = [event for event in log_of(solution) if event.stop == j]
        assert of_stop == [] or (of_stop[0].kind == "release" and of_stop[0].t > scene.t0)
        assert of_stop or bool(solution.stuck1[j])


def test_the_motion_at_event_times_is_that_of_the_log(solution, scene):
    n = int(solution.num_events)
    t = jnp.where(solution.events.t <= solution.t1, solution.events.t, solution.t1)
    x, v = (np.asarray(a) for a in solution.evaluate(t))
    events = log_of(solution)
    for i, event in enumerate(events):
        if event.t > scene.t1:
            continue
        stop = scene.system.stops[event.stop]
        following = next((e.kind for e in events[i + 1 :] if e.stop == event.stop), None)
        # At the last impact of a chatter the mass comes to rest.
        is_rebound = event.kind == "impact" and following != "stick"
        expected = float(solution.events.velocity_plus[i]) if is_rebound else 0.0
        assert x[i, stop.mass] == pytest.approx(float(stop.position), rel=READ_BACK, abs=0)
        assert v[i, stop.mass] == pytest.approx(expected, rel=READ_BACK, abs=0), event
    assert n == len(events)


def test_stops_press_while_they_hold_their_mass_and_only_then(solution, scene):
    spans = _spans_held(scene, solution)
    middles = [(low + high) / 2 for _, low, high, _ in spans]
    t = np.append(np.linspace(scene.t0, scene.t1, QUESTIONS - len(middles)), middles)
    force, (x, v) = (np.asarray(solution.contact_force(t)), map(np.asarray, solution.evaluate(t)))
    assert (force >= 0).all()
    for j, stop in enumerate(scene.system.stops):
        is_held = np.zeros(t.shape, bool)
        is_free = np.ones(t.shape, bool)
        for k, low, high, first in spans:
            if k == j:
                is_held |= (t >= low) & (t < high)
                is_free &= (t < first) | (t >= high)
                assert force[t == (low + high) / 2, j].min() > 0
        assert not force[is_free, j].any()
        assert (x[is_held, stop.mass] == float(stop.position)).all()
        assert not v[is_held, stop.mass].any()
        sign = stop.sign
        assert (sign * (float(stop.position) - x[:, stop.mass]) >= -READ_BACK).all()


def _spans_held(scene: Scene, solution: vx.Solution) -> list[tuple[int, float, float, float]]:
    """Stop, times of stick and release, and time of the last impact before; it may stick from there on."""
    held = {j: (scene.t0, scene.t0) for j in scene.held_at_start}
    last_impact, spans = {}, []
    for event in log_of(solution):
        if event.kind == "impact":
            last_impact[event.stop] = event.t
        elif event.kind == "stick":
            held[event.stop] = event.t, last_impact[event.stop]
        else:
            low, first = held.pop(event.stop)
            spans.append((event.stop, low, event.t, first))
    ends = [(j, low, np.nextafter(scene.t1, np.inf), first) for j, (low, first) in held.items()]
    return [span for span in spans + ends if span[2] > span[1]]
