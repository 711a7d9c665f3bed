"""Signatures as `help` prints them."""

import inspect
from typing import get_type_hints

import vijax as vx

# Half a screen: 12 lines of 80 columns.
SCREEN = 80 * 12


def public_functions() -> dict[str, object]:
    named = {name: getattr(part, name) for part in (vx, vx.plot) for name in dir(part)}
    return {name: one for name, one in named.items() if inspect.isfunction(one)}


def test_signatures_fit_half_a_screen_and_name_no_modules():
    functions = public_functions()
    assert len(functions) > 40
    for name, function in functions.items():
        text = str(inspect.signature(function))
        assert len(text) < SCREEN, name
        assert "jaxlib" not in text, name
        assert "vijax." not in text, name
        assert "collections.abc" not in text, name


def test_a_signature_says_numbers_and_keeps_defaults_and_annotations():
    text = str(inspect.signature(vx.sweep))
    assert "x0: Numbers | None = None" in text
    assert "settings: ExecutionSettings = ExecutionSettings()" in text
    assert repr(vx.ExecutionSettings(cores=2)) == "ExecutionSettings(cores=2)"
    assert inspect.signature(vx.sweep).parameters["transient"].default == 100
    assert get_type_hints(vx.simulate)["system"] is vx.ImpactSystem
