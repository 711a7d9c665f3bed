"""The one rule that ends Newton's method: on scalar equations, whose iterates are known."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import vijax
from vijax._orbits.newton import has_converged, is_worth_a_step

MOST = 30


def iterate(function, slope, x, tolerance=0.0, dtype=np.float64):
    """Newton's method on a scalar equation; its result, its last step and the number of steps."""
    x, step, last, number = dtype(x), dtype(np.finfo(dtype).max), dtype(np.finfo(dtype).max), 0
    while is_worth_a_step(step, last, number, MOST, tolerance=tolerance):
        change = dtype(function(x) / slope(x))
        x, step, last, number = dtype(x - change), np.abs(change), step, number + 1
    return x, step, number


@pytest.mark.parametrize(("dtype", "most"), [(np.float64, 6), (np.float32, 5)])
def test_a_simple_zero_is_found_to_rounding(dtype, most):
    x, step, number = iterate(lambda x: x * x - 2, lambda x: 2 * x, 1.5, dtype=dtype)
    assert abs(x - dtype(np.sqrt(2))) <= 2 * np.finfo(dtype).eps
    assert number <= most
    assert has_converged(step)


def test_steps_that_are_rounding_and_do_not_shrink_end_it():
    noise = iter(np.tile([3e-12, -2e-12], MOST))
    _, step, number = iterate(lambda x: next(noise), lambda x: 1.0, 0.0)
    assert (number, bool(has_converged(step))) == (2, True)


def test_a_tolerance_ends_it_before_rounding():
    *_, whole = iterate(lambda x: x * x - 2, lambda x: 2 * x, 1.5)
    _, step, number = iterate(lambda x: x * x - 2, lambda x: 2 * x, 1.5, tolerance=1e-2)
    assert number < whole
    assert not has_converged(step)


def test_behind_a_tiny_step_the_next_is_rounding():
    step, last = np.float64(1e-14), np.float64(1e-12)
    assert is_worth_a_step(step, last, 3, MOST)
    assert not is_worth_a_step(step, last, 3, MOST, settled=1e-10)
    assert is_worth_a_step(step, np.float64(1e-6), 3, MOST, settled=1e-10)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_steps_that_are_no_numbers_end_it_without_a_solution(value):
    _, step, number = iterate(lambda x: value, lambda x: 1.0, 0.0)
    assert (number, bool(has_converged(step))) == (1, False)


def test_one_without_a_zero_ends_at_the_bound():
    _, step, number = iterate(lambda x: x * x + 1, lambda x: 2 * x, 0.7)
    assert (number, bool(has_converged(step))) == (MOST, False)


def test_traced_numbers_end_as_those_of_numpy_do():
    sizes = np.array([1e-3, 1e-9, 1e-11, 1e-17, np.nan])
    for step in sizes:
        for last in sizes[:-1]:
            traced = is_worth_a_step(jnp.asarray(step), jnp.asarray(last), jnp.asarray(3), MOST)
            assert bool(traced) == bool(is_worth_a_step(step, last, 3, MOST))


def test_no_other_file_compares_the_steps_of_newton():
    """Each loop hands its steps to the rule: no file of cycles and circles has a comparison of its own."""
    folder = Path(vijax.__file__).parent
    own = re.compile(r"(?:\b|\.)step\b(?:\.max\(\))? (?:<|>=?|<=) (?!0\b)")
    files = [
        file
        for room in ("_orbits", "_branches", "_tori")
        for file in sorted((folder / room).rglob("*.py"))
        if "linalg.solve" in file.read_text() or "solve_condensed" in file.read_text()
    ]
    assert len(files) > 5
    found = {file.name: own.findall(file.read_text()) for file in files if file.name != "newton.py"}
    assert {name: lines for name, lines in found.items() if lines} == {}
