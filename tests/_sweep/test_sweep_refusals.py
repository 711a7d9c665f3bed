"""Sweeps that are not possible are rejected in one sentence."""

import re

import jaxtyping
import numpy as np
import pytest

import vijax as vx

FREQUENCIES = [0.5, 0.8, 1.4]
SYSTEM = vx.models.wagg_bishop_b(0.8)


@pytest.mark.parametrize(
    "path",
    [
        "frequency",
        "forcing.omega",
        "stops[2].position",
        "stops[0].side",
        "stops.position",
        "mass[2]",
        "mass[0][0]",
        "damping[0][2]",
        "x0[-1]",
        "x0 [1]",
        "",
    ],
)
def test_a_path_that_names_nothing_is_refused(path):
    sentence = re.escape(f"The path `{path}` names nothing that can be swept. There are mass, damping, ")
    with pytest.raises(ValueError, match=sentence) as refusal:
        vx.sweep(SYSTEM, {path: [1.0]})
    assert "the machine has 2 masses and 2 stops." in str(refusal.value)


NO_MACHINES = {
    "mass of zero": ({"mass[0]": [1.0, 0.0]}, "Every swept `mass` must be positive."),
    "NaN": ({"mass[0]": [np.nan]}, "All swept values must be finite."),
    "restitution above 1": (
        {"stops[*].restitution": [0.5, 1.1]},
        "Every `stops[0].restitution` must lie between 0 and 1.",
    ),
    "negative restitution": (
        {"stops[1].restitution": [-0.1]},
        "Every `stops[1].restitution` must lie between 0 and 1.",
    ),
    "no frequency": ({"forcing.frequency": [0.5, 0.0]}, "Every `forcing.frequency` must be positive"),
    "scalar": ({"forcing.frequency": 0.5}, "The values of `forcing.frequency` must have shape (points, ...)"),
    "no points": ({"forcing.frequency": []}, "The values of `forcing.frequency` must have shape"),
    "vector for an entry": ({"mass[0]": [[1.0, 2.0]]}, "The values of `mass[0]` must have shape (points)"),
    "entry for a matrix": ({"damping": [1.0, 2.0]}, "The values of `damping` must have shape (points, 2, 2)"),
    "start beyond a stop": (
        {"x0[1]": [0.0, 0.2]},
        "Some points start beyond a stop: `x0[1]` is past `stops[1]`.",
    ),
    "stop before the start": (
        {"stops[0].position": [-0.3, 0.1]},
        "Some points start beyond a stop: `x0[0]` is past `stops[0]`.",
    ),
}


@pytest.mark.parametrize("case", NO_MACHINES)
def test_values_that_make_no_machine_are_refused(case):
    values, sentence = NO_MACHINES[case]
    with pytest.raises(ValueError, match=re.escape(sentence)):
        vx.sweep(SYSTEM, values)


def test_stops_that_leave_no_room_are_refused():
    load = vx.Harmonic([0.5], 0.8)
    stops = [vx.Stop(0, -0.3, "lower", 0.7), vx.Stop(0, 0.3, "upper", 0.7)]
    system = vx.chain([1.0], [0.1], [1.0], load, stops)
    with pytest.raises(ValueError, match="lower stop of mass 0 must lie below its upper stop"):
        vx.sweep(system, {"stops[1].position": [0.2, -0.3]}, x0=[-0.3])


@pytest.mark.parametrize(
    ("name", "value"), [("transient", -1), ("record", -2), ("max_impacts", True), ("max_steps", -1)]
)
def test_counts_must_be_whole(name, value):
    with pytest.raises(ValueError, match=f"Argument `{name}` must be a whole number"):
        vx.sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, **{name: value})


@pytest.mark.parametrize("name", ["x0", "v0"])
def test_a_start_of_the_wrong_shape_is_refused(name):
    with pytest.raises(ValueError, match=re.escape(f"Argument `{name}` must have shape (2,)")):
        vx.sweep(SYSTEM, {"forcing.frequency": FREQUENCIES}, **{name: [0.0]})


def test_a_sweep_of_nothing_is_refused():
    with pytest.raises(ValueError, match="`values` is empty"):
        vx.sweep(SYSTEM, {})


@pytest.mark.parametrize(
    ("system", "name", "sentence"),
    [
        ([SYSTEM, SYSTEM], "forcing.frequency", "`system` must be one machine"),
        (SYSTEM, ("forcing.frequency", "x0[0]"), "`values` must name each quantity by its path"),
    ],
    ids=["a list of machines", "a tuple as a name"],
)
def test_what_has_the_wrong_type_is_refused_by_name(system, name, sentence):
    with pytest.raises((ValueError, jaxtyping.TypeCheckError)) as refusal:
        vx.sweep(system, {name: [1.0, 1.1]})
    # Users get the sentence: tests alone check annotations, if they do.
    assert sentence in str(refusal.value) or refusal.type is jaxtyping.TypeCheckError


def test_machines_without_masses_and_friction_in_the_place_of_a_force_are_refused_by_name():
    with pytest.raises(ValueError, match="`mass` must have shape"):
        vx.ImpactSystem([], [], [])
    with pytest.raises(ValueError, match=r"`friction=\[...\]`"):
        vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [], [vx.Friction(0, 1.0)])
