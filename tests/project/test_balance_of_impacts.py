"""The check of the campaign on impacts: momentum, restitution and loss of energy at instants of a motion."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

from random_machines.impacts import impact_faults
from random_machines.machines import draw_numbers
from random_machines.runs import run
from random_machines.shapes import Shape

pytestmark = pytest.mark.slow

COUNT = 6
PLAIN = Shape(masses=2, stops=((0, "upper"),), contacts=((0, 1),))
RUBBING = PLAIN._replace(contacts=(), rubs=(((1,), 0), ((0, 1), 0)))
CASES = [
    (PLAIN, "mass"),
    (PLAIN, "restitution"),
    (PLAIN, "contact_restitution"),
    (PLAIN._replace(is_moving=True), "travel"),
    (RUBBING, "coefficient"),
]


def faults(shape: Shape, numbers: dict, whole) -> int:
    return len(impact_faults(shape, numbers, whole, np.random.default_rng(2)))


@pytest.mark.parametrize(("shape", "name"), CASES)
def test_impacts_obey_their_law_and_not_that_of_another_machine(shape, name, monkeypatch):
    numbers = draw_numbers(np.random.default_rng(4), shape, COUNT)
    whole = run(shape, numbers, np.zeros(COUNT), 12 * 2 * np.pi / numbers["frequency"])
    assert faults(shape, numbers, whole) == 0
    # Runs are those of the machine, and the law of another.
    monkeypatch.setattr(
        "random_machines.impacts.run", lambda shape, a, *rest, **named: run(shape, numbers, *rest, **named)
    )
    assert faults(shape, numbers | {name: 0.98 * numbers[name]}, whole) > 0
