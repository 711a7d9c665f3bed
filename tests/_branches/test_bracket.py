"""Zeros within brackets, from values and slopes."""

import numpy as np
import pytest

from vijax._branches.bracket import SlopedBracket

# A length of 1 has this rounding.
ROUNDING = 1e-15
# As the order of the method is about 3.
MOST_TRIALS = 6

SMOOTH = {
    "straight": (lambda s: 0.3 - s, lambda s: -1.0, 0.3),
    "curved": (lambda s: np.cos(2 * s), lambda s: -2 * np.sin(2 * s), np.pi / 4),
    "steep at the zero": (lambda s: 0.2 - s - 40 * (s - 0.2) ** 3, lambda s: -1 - 120 * (s - 0.2) ** 2, 0.2),
}


def located(value, slope, length):
    bracket = SlopedBracket.between((0.0, value(0.0), slope(0.0)), (length, value(length), slope(length)))
    trials = []
    while bracket.next is not None:
        trials.append(bracket.next)
        bracket = bracket.narrowed(value(trials[-1]), slope(trials[-1]))
    return trials, bracket


@pytest.mark.parametrize("name", SMOOTH)
def test_a_zero_is_found_in_few_trials(name):
    value, slope, zero = SMOOTH[name]
    trials, bracket = located(value, slope, 1.0)
    assert not bracket.is_flat
    assert abs(trials[-1] - zero) <= ROUNDING
    assert len(trials) <= MOST_TRIALS + 4 * (name == "steep at the zero")


def test_a_jump_is_enclosed():
    trials, _ = located(lambda s: 1.0 if s < 0.7 else -1.0, lambda s: 0.0, 1.0)
    assert abs(trials[-1] - 0.7) <= ROUNDING


def test_a_function_that_is_zero_on_an_interval_is_told():
    trials, bracket = located(lambda s: max(0.4 - s, 0.0) - 1e-17, lambda s: -1.0 if s < 0.4 else 0.0, 1.0)
    assert bracket.is_flat
    assert len(trials) <= 2
