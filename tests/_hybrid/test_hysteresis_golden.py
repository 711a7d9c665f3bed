"""Golden scenes of Jenkins elements, compared event by event."""

import numpy as np
import pytest
from helpers import ROUNDING
from hysteresis_scenes import data_of, system_of

import vijax as vx

_KINDS = {"slip": vx.SLIP, "stick": vx.STICK}


@pytest.fixture(
    scope="module", params=["jenkins_forced", pytest.param("jenkins_iwan", marks=pytest.mark.thorough)]
)
def data(request) -> dict:
    return data_of(request.param)


@pytest.fixture(scope="module")
def solution(data) -> vx.Solution:
    return vx.simulate(system_of(data), data["t0"], data["t1"], data["x0"], data["v0"])


def test_events_are_those_of_the_scene(solution, data):
    log, n = solution.events, int(solution.num_events)
    found = sorted(zip(*(np.asarray(a)[:n].tolist() for a in (log.stop, log.t, log.kind)), strict=True))
    expected = sorted((e["index"], e["t"], _KINDS[e["kind"]]) for e in data["events"])
    assert [(stop, kind) for stop, _, kind in found] == [(stop, kind) for stop, _, kind in expected]
    late = ROUNDING * data["amplification_worst_restart_events"]
    assert np.allclose([t for _, t, _ in found], [t for _, t, _ in expected], rtol=0, atol=late)


def test_end_is_that_of_the_scene(solution, data):
    slack = ROUNDING * data["amplification_worst_restart"]
    assert np.allclose(solution.x1, data["x1"], rtol=0, atol=slack)
    assert np.allclose(solution.v1, data["v1"], rtol=0, atol=slack)
    force = np.asarray(solution.hysteresis_force(data["t1"]))
    assert np.allclose(force, data["jenkins_force1"], rtol=0, atol=slack)
    stiffness, rows = (np.array([one[a] for one in data["jenkins"]]) for a in ("stiffness", "row"))
    sliders = rows @ np.array(data["x1"]) - np.array(data["jenkins_force1"]) / stiffness
    assert np.allclose(solution.sliders1, sliders, rtol=0, atol=slack)
    assert np.allclose(solution.evaluate_sliders(data["t1"]), sliders, rtol=0, atol=slack)
