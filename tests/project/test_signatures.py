"""Signatures as `help` prints them."""

import inspect
from typing import get_args, get_type_hints

import pytest

import vijax as vx

# Half a screen: 12 lines of 80 columns.
SCREEN = 80 * 12
SIGNATURE_OF_FRICTION = "(row: Mapping[int, ArrayLike] | Any, force: ArrayLike, static: ArrayLike | None = None, velocity: ArrayLike = 0.0)"


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
    assert "system: ImpactSystem | Family" in text
    assert vx.ImpactSystem in get_args(get_type_hints(vx.simulate)["system"])
