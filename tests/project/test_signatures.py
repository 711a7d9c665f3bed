"""Signatures as `help` prints them."""

import inspect
from typing import get_args, get_type_hints

import pytest

import vijax as vx

# Half a screen: 12 lines of 80 columns.
SCREEN = 80 * 12
SIGNATURE_OF_FRICTION = "(row: Mapping[int, ArrayLike] | int, force: ArrayLike | None = None, static: ArrayLike | None = None, velocity: ArrayLike = 0.0, *, coefficient: ArrayLike | None = None, static_coefficient: ArrayLike | None = None, contact: int | None = None)"


def public(is_wanted) -> dict[str, object]:
    named = {name: getattr(part, name) for part in (vx, vx.plot, vx.models) for name in dir(part)}
    return {name: one for name, one in named.items() if is_wanted(one)}


def check_is_short(name: str, one) -> None:
    text = str(inspect.signature(one))
    assert len(text) < SCREEN, name
    for word in ("jaxlib", "vijax.", "jaxtyping", "typing.", "collections.abc"):
        assert word not in text, name


def test_signatures_fit_half_a_screen_and_name_no_modules():
    functions = public(inspect.isfunction)
    assert len(functions) > 60
    for name, function in functions.items():
        check_is_short(name, function)


def test_signatures_of_classes_and_their_methods_fit_half_a_screen_and_name_no_modules():
    classes = {name: one for name, one in public(inspect.isclass).items() if "__init__" in vars(one)}
    assert len(classes) > 20
    for name, one in classes.items():
        check_is_short(name, one)
        for method in vars(one):
            if not method.startswith("_") and inspect.isfunction(getattr(one, method)):
                check_is_short(f"{name}.{method}", getattr(one, method))


def test_a_class_is_made_as_before_its_signature_is_short():
    assert str(inspect.signature(vx.Friction)) == SIGNATURE_OF_FRICTION
    assert get_type_hints(vx.Friction.__init__)["static"] is not None
    with pytest.raises(TypeError, match="positon"):
        vx.Stop(0, positon=0.3)  # pyright: ignore[reportCallIssue]


def test_a_signature_says_numbers_and_keeps_defaults_and_annotations():
    text = str(inspect.signature(vx.sweep))
    assert "x0: Numbers | None = None" in text
    assert "settings: ExecutionSettings = ExecutionSettings()" in text
    assert repr(vx.ExecutionSettings(cores=2)) == "ExecutionSettings(cores=2)"
    assert inspect.signature(vx.sweep).parameters["transient"].default == 100
    assert "transient: int = 100" in text
    assert "system: ImpactSystem | Family" in text
    assert vx.ImpactSystem in get_args(get_type_hints(vx.simulate)["system"])


# Arguments of one name that are not alike in all functions, and why.
DIFFERENT = {
    "ax": "one panel, several, or one to draw over",
    "bounds": "the ends of a parameter, of two, of states, or of a plane",
    "curves": "of bifurcations, or the manifolds of a saddle",
    "direction": "of a crossing, of a shock, or of a load",
    "duration": "of a film, or of a whole motion",
    "ds": "one dataset, or several by their names",
    "file": "to write a machine, or optionally a film",
    "force": "added to a machine, or given back to one that was read",
    "mass": "masses of a machine, or the index of one",
    "masses": "of a machine, or those that touch",
    "max_events": "in a run that may be of any length, or in one cycle",
    "max_points": "of a branch, of many, of a torus, or of a curve in the plane",
    "modes": "their shapes, or the numbers of those to follow",
    "num_periods": "of an orbit, or averaged over",
    "num_samples": "of a whole motion, or of the intervals in which a mass sticks",
    "orbit": "one, or many at once",
    "orbits": "to draw, or to draw over something else",
    "phase": "of a load by mass, or of a section",
    "quantities": "of cycles, which may be functions, or of many runs",
    "rng": "an option of a search, or what a random load is made of",
    "samples": "of machines, or of shocks",
    "sol": "a trajectory, or an orbit in its place",
    "starts": "of one machine, of a chart or of a search",
    "stop": "the index of a stop, or a condition that ends a branch",
    "system": "a machine or a family, or the machine alone whose matrices are changed",
    "t": "an instant, or the frames of a film",
    "t1": "the end of a run, or a bound of a search",
    "tolerance": "of a return, or of a bisection or a curve",
    "v0": "a start, a guess, or one for all points",
    "values": "swept by name, followed along, or drawn",
    "x": "a state, or the pose of a drawing",
    "x0": "as `v0`",
    "xlim": "of axes, or of the part to enlarge",
}


def test_an_argument_of_one_name_has_one_type_default_and_manner_of_call():
    """Over all public functions but the models, which name physical quantities; those that differ have a reason."""
    manners: dict[str, dict[tuple, list[str]]] = {}
    for part in (vx, vx.plot):
        for name in dir(part):
            function = getattr(part, name)
            if inspect.isfunction(function):
                for one in inspect.signature(function).parameters.values():
                    is_named = one.kind is inspect.Parameter.KEYWORD_ONLY
                    manner = (is_named, str(one.annotation), repr(one.default))
                    manners.setdefault(one.name, {}).setdefault(manner, []).append(name)
    assert {name: found for name, found in manners.items() if len(found) > 1 and name not in DIFFERENT} == {}
    assert [name for name in DIFFERENT if len(manners[name]) == 1] == []


def manners_of(callables) -> dict[str, dict[tuple, list[str]]]:
    """Over callables by their names, which of them take an argument how: by name or place, and of which type."""
    found: dict[str, dict[tuple, list[str]]] = {}
    for name, one in callables:
        for parameter in inspect.signature(one).parameters.values():
            if parameter.name != "self":
                manner = (parameter.kind is inspect.Parameter.KEYWORD_ONLY, str(parameter.annotation))
                found.setdefault(parameter.name, {}).setdefault(manner, []).append(name)
    return found


def check_alike(callables, different) -> None:
    """Test that arguments of one name are alike, but for those with a reason, all of which differ."""
    differing = {name: found for name, found in manners_of(callables).items() if len(found) > 1}
    assert {name: found for name, found in differing.items() if name not in different} == {}
    assert set(different) <= set(differing)


# Classes that users make, and those that functions return or raise; flows are written to, see "extending".
MADE = {
    "CompliantContact",
    "CompliantStop",
    "Contact",
    "ExecutionSettings",
    "FallingRestitution",
    "Family",
    "Friction",
    "Harmonic",
    "ImpactSystem",
    "Jenkins",
    "Parametric",
    "Stop",
    "Tabulated",
    "Waveform",
}
RETURNED = {
    "Bifurcation",
    "Branch",
    "EventLog",
    "GrazingForm",
    "Interrupted",
    "NormalForm",
    "ORBIT_RESULTS",
    "Peak",
    "PeriodicOrbit",
    "Precompilation",
    "RESULTS",
    "SimulationError",
    "Solution",
    "StickingRegion",
    "Symmetry",
}
FLOWS = {"AbstractRestitution", "DiffraxFlow", "ModalFlow", "TaylorFlow"}
DIFFERENT_PARTS = {
    "damping": "of one contact, or the matrices of a machine",
    "force": "of friction, or a function of the motion",
    "frequency": "of a load, or that of the load if left out",
    "mass": "the index of one, or all masses",
    "position": "of a stop, or one of each machine in a batch",
    "restitution": "a number or a law, or the number within a law",
    "row": "of a contact between masses, or also the index of one mass that rubs on the ground",
    "stiffness": "as `damping`",
}
DIFFERENT_MODELS = {
    "amplitude": "of the load, which beads need not have and a drill bit has by name",
    "frequency": "of the load, which a bouncing ball and a drill bit need not have",
    "mass": "of one body, or of each bead",
    "phases": "of two loads, or of the points of a wave form",
    "position": "of the stop, or of a lid over the beads, which need not be there",
    "restitution": "by name, but of a ball that has nothing else",
}
DIFFERENT_METHODS = {
    "v": "as `x`",
    "x": "of a user, or of a solver, where it is an array already",
}


def test_every_public_class_is_made_returned_or_written_to():
    classes = {name for name, one in public(inspect.isclass).items() if hasattr(vx, name)}
    assert classes == MADE | RETURNED | FLOWS


def test_an_argument_of_one_name_is_alike_in_all_parts_of_a_machine():
    check_alike([(name, getattr(vx, name)) for name in sorted(MADE)], DIFFERENT_PARTS)


def test_an_argument_of_one_name_is_alike_in_all_models():
    models = [(name, getattr(vx.models, name)) for name in dir(vx.models)]
    check_alike([(name, one) for name, one in models if inspect.isfunction(one)], DIFFERENT_MODELS)


def test_an_argument_of_one_name_is_alike_in_all_methods():
    """Of the parts and of what is returned."""
    methods = [
        (f"{name}.{method}", one)
        for name in sorted(MADE | RETURNED)
        for method, one in vars(getattr(vx, name)).items()
        if not method.startswith("_") and inspect.isfunction(one)
    ]
    assert len(methods) > 20
    check_alike(methods, DIFFERENT_METHODS)


@pytest.mark.parametrize("name", ["legend", "progress", "record", "rng", "settings", "transient", "units"])
def test_options_are_given_by_name(name):
    for part in (vx, vx.plot):
        for function in (getattr(part, one) for one in dir(part) if (one, name) != ("random_load", "rng")):
            if inspect.isfunction(function) and name in inspect.signature(function).parameters:
                assert inspect.signature(function).parameters[name].kind is inspect.Parameter.KEYWORD_ONLY
