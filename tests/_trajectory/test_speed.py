"""Properties that make a sweep fast, checked in its compiled text: nothing here is timed."""

import os
import re

import jax
import numpy as np
import pytest

import vijax as vx
from vijax._execution import lane_loop, lane_queue
from vijax._execution.packed import pack
from vijax._execution.points import LaneInput, points_of_lanes
from vijax._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from vijax._flow.choose import choose_flow
from vijax._machine.numbers import numbers_of

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(
        "VIJAX_COMPILE_FULLY" not in os.environ, reason="compiled the short way, see conftest.py"
    ),
]

POINTS, LANES = 16, 8


@pytest.fixture(scope="module")
def compiled() -> str:
    """Text of the loop over lanes for a frequency sweep of case (b)."""
    base = LaneInput(vx.models.wagg_bishop_b(1.0), np.zeros((2, 1)), np.zeros((2, 1)))
    points = points_of_lanes(base, {"forcing.frequency": np.linspace(0.5, 1.5, POINTS)})
    flow = choose_flow(points.system, can_stick=True)
    start = np.zeros((2, POINTS))
    given = lane_queue.Points(numbers_of(points.system), flow, start, start)
    layout, packed = pack(given, np.arange(POINTS), repeated=True)
    program = lane_queue.LaneProgram(layout, can_stick=True)
    counts = np.array([POINTS, POINTS, 1, 2, 1000, 16, 1000])
    with jax.numpy_rank_promotion("allow"):
        queue = lane_queue.new_queue(program, POINTS, LANES, DEFAULT_SETTINGS)
        return lane_queue.lane_programs.compiled(program, packed, counts, None, queue).as_text()


def test_no_library_sine_is_computed_in_the_loop(compiled):
    assert not re.search(r"f64\S* (?:cosine|sine|exponential)\(", compiled)


def test_the_loop_over_turns_is_one_kernel(compiled):
    calls = [line for line in compiled.splitlines() if 'while/body/jit(called)"' in line and " call(" in line]
    kernels = [found[1] for line in calls if (found := re.search(r"to_apply=%([\w.]+).*small_call", line))]
    assert len(kernels) == 1
    body = re.search(rf"^%{re.escape(kernels[0])} .*?^\}}", compiled, re.DOTALL | re.MULTILINE)
    assert body
    assert body[0].count(" while(") == 1


def test_shared_parts_of_a_step_are_computed_once(compiled):
    # XLA repeats operations that two results share, unless a call is between; without those calls the text has twice
    # as many operations.
    assert compiled.count(" call(") >= 12
    operations = sum(compiled.count(f" {name}(") for name in ("add", "subtract", "multiply", "divide"))
    assert operations < 2500


def test_nothing_but_what_has_to_be_is_divided_or_rooted_in_a_turn(compiled):
    # A division takes as long as ten multiplications. The preparation of the machines has as many as a turn.
    in_lanes = re.findall(rf"f64\[(?:\d+,)*{LANES}\]\S* (?:divide|sqrt)\(", compiled)
    assert len(in_lanes) <= 40


def test_a_second_sweep_of_the_same_shape_is_not_traced_again(monkeypatch):
    traces = []
    original = lane_loop.advance
    monkeypatch.setattr(lane_loop, "advance", lambda *args: traces.append(1) or original(*args))
    # A shape of no other test.
    settings = ExecutionSettings(points=40, lanes=24)
    run = lambda first: vx.sweep(  # noqa: E731
        vx.models.wagg_bishop_b(0.8), {"forcing.frequency": np.linspace(first, 1.6, 30)}, transient=1, record=1,
        progress=False, settings=settings,
    )  # fmt: skip
    run(0.5)
    num_traces = len(traces)
    assert num_traces > 0
    run(0.7)
    assert len(traces) == num_traces
