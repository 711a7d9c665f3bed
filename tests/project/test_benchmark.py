"""Errors, failures and operations that the benchmark reports of a program. Nothing here is timed."""

import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import peers
from benchmarks import convergence, cpp, diffeqsolve, duffing, peak, scenes, sizes, timing

pytestmark = pytest.mark.thorough

LIGHT, CHATTER = scenes.load("paper_a_om080"), scenes.load("paper_b_om030")
# Error of peers at tight tolerances, with the roundings of some twenty impacts.
TIGHT = 1e-11
# The scalar program ends a chatter at impacts of 1e-6.
CHATTER_ENDED = 1e-9


def truth(scene: scenes.Scene) -> scenes.Outcome:
    impacts = [(e["t"], e["stop"], e["v_before"]) for e in scene["events"] if e["kind"] == "impact"]
    return scenes.Outcome(impacts, np.array([*scene["x1"], *scene["v1"]]))


def test_the_truth_has_no_error():
    judged = scenes.judge(truth(LIGHT), LIGHT)
    assert judged == {"time error": 0.0, "state error": 0.0, "outcome": "right"}


def test_an_error_is_that_of_the_worst_impact():
    outcome = truth(LIGHT)
    t, *rest = outcome.impacts[7]
    outcome.impacts[7] = (t + 1e-6, *rest)
    assert scenes.judge(outcome, LIGHT)["time error"] == pytest.approx(1e-6)


def test_a_missed_impact_is_no_small_error_but_a_fall_through_the_stop():
    outcome = truth(LIGHT)
    del outcome.impacts[7]
    judged = scenes.judge(outcome, LIGHT)
    assert judged["time error"] is None
    assert judged["outcome"] == "fell through a stop"


def test_the_true_impacts_played_again_never_pass_a_stop():
    assert scenes.deepest(truth(LIGHT), LIGHT) < 1e-12


def test_who_gives_up_has_no_state():
    judged = scenes.judge(truth(LIGHT)._replace(gave_up=True), LIGHT)
    assert judged["state error"] is None
    assert judged["outcome"] == "gave up"


def test_heyoka_is_right_in_a_light_scene_and_falls_through_a_stop_where_masses_stick():
    pytest.importorskip("heyoka")
    assert scenes.judge(peers.heyoka(LIGHT, 1e-15).outcome(), LIGHT)["time error"] < TIGHT
    assert scenes.judge(peers.heyoka(CHATTER, 1e-15).outcome(), CHATTER)["outcome"] == "fell through a stop"


def test_scipy_is_right_in_a_light_scene():
    pytest.importorskip("scipy")
    assert scenes.judge(peers.scipy(LIGHT, 1e-12).outcome(), LIGHT)["time error"] < 2 * TIGHT


def test_diffeqsolve_is_right_in_a_light_scene_and_misses_an_impact_that_comes_and_goes_in_a_step():
    loose, tight = (diffeqsolve.by_diffeqsolve(LIGHT, t, "Tsit5").outcome() for t in (1e-4, 1e-12))
    assert scenes.judge(loose, LIGHT)["outcome"] == "right"
    assert scenes.judge(tight, LIGHT)["time error"] < TIGHT
    grazing = convergence.two_stops(scenes.load(convergence.LIGHT))
    found = diffeqsolve.by_diffeqsolve(grazing, 1e-7, "Tsit5").outcome()
    assert found.impacts == []
    assert scenes.judge(found, grazing)["outcome"] == "impacts missed or added"


def test_programs_beside_vijax_are_right_in_the_nonlinear_scene():
    scene = duffing.golden()
    assert scenes.judge(peers.scipy(scene, 1e-12).outcome(), scene)["time error"] < 2 * TIGHT
    by_events = diffeqsolve.by_diffeqsolve(scene, 1e-12, duffing.SOLVER).outcome()
    assert scenes.judge(by_events, scene)["time error"] < 1e-9
    pytest.importorskip("heyoka")
    assert scenes.judge(peers.heyoka(scene, 1e-15).outcome(), scene)["time error"] < TIGHT
    points = peers.heyoka_points(partial(peers.duffing, scene), np.array([scene["Omega"]]), 3, 1e-13)
    until = 3 * 2 * np.pi / scene["Omega"]
    assert points() == points() == len(scenes.exact_impacts(scene, until))


def test_a_stop_far_off_changes_nothing_in_a_scene():
    scene = scenes.load(convergence.LIGHT)
    assert scenes.deepest(truth(convergence.two_stops(scene)), convergence.two_stops(scene)) < 1e-12
    end = np.array([*scene["x1"], *scene["v1"]])
    assert 1e-5 < np.max(np.abs(scenes.smooth_end(scene) - end)) < 1e-3


def test_an_order_is_fitted_to_the_shortest_steps_above_rounding():
    lengths = convergence.LENGTHS
    errors = np.where(lengths > 0.3, 1.0, np.maximum(1e-3 * lengths**5, 1e-15))
    rows = [
        {"length of steps": h, "state error": e, "outcome": "right"}
        for h, e in zip(lengths.tolist(), errors.tolist(), strict=True)
    ]
    assert convergence.fitted_order(rows, "state error") == pytest.approx(5)
    assert convergence.fitted_order(rows[:1], "state error") is None


@pytest.mark.parametrize(("scene", "tolerance"), [(LIGHT, TIGHT), (CHATTER, CHATTER_ENDED)])
def test_the_scalar_program_is_right_in_every_scene(scene, tolerance):
    if cpp.compiled(cpp.SCALAR) is None:
        pytest.skip("needs a C++ compiler")
    program = cpp.scalar(scene)
    assert program is not None
    judged = scenes.judge(program.outcome(), scene)
    assert judged["outcome"] == "right"
    assert judged["time error"] < tolerance
    assert judged["state error"] < TIGHT
    assert len(program.seconds(3)) == 3


def test_a_machine_with_a_scene_beside_it_is_not_coupled_to_it():
    system = sizes.beside(LIGHT, 3, [])
    assert system.num_masses == 5
    assert system.num_stops == 2
    assert not np.asarray(system.stiffness)[:2, 2:].any()
    np.testing.assert_array_equal(system.stiffness[:2, :2], LIGHT["K"])


def test_floating_point_operations_of_a_loop_are_counted():
    matrix, lanes = jnp.ones((8, 8)), jnp.ones(8)

    def turn(carry):
        count, x = carry
        return count + 1, jnp.sqrt(x * 2.5 + matrix @ x) - jnp.sum(x)

    loop = jax.jit(lambda n, x: jax.lax.while_loop(lambda c: c[0] < n, turn, (0, x)))
    text = loop.lower(3, lanes).compile().as_text()
    # Product and sum of the matrix 2 * 64, four operations on 8 lanes, and a sum of 8 numbers.
    assert peak.operations_per_turn(text) == 2 * 64 + 4 * 8 + 7


def test_compilations_are_counted_and_a_second_call_has_none():
    double = jax.jit(lambda x: 2 * x)
    with timing.Compilations() as first:
        double(np.ones(11))
    with timing.Compilations() as second:
        double(np.zeros(11))
    assert first.programs >= 1
    assert first.seconds > 0
    assert (second.programs, second.traces) == (0, 0)
