"""The check of the campaign that no decision of the library enters: allowed forces give the accelerations."""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

from random_machines.balance import balance_faults
from random_machines.machines import draw_numbers
from random_machines.runs import run
from random_machines.shapes import Shape

pytestmark = pytest.mark.slow

COUNT = 6
# Friction beside a stop that it is tied to, a soft stop and a Jenkins element.
SHAPE = Shape(
    masses=2,
    stops=((0, "upper"),),
    cushions=((1, "lower"),),
    pads=((1,),),
    rubs=(((1,), 0),),
    sliders=((0,),),
)


@pytest.fixture(scope="module")
def machines():
    numbers = draw_numbers(np.random.default_rng(4), SHAPE, COUNT)
    # The contact is closed for a part of the time, and friction of it acts.
    numbers["mean"] = np.tile([0.8, 0.1], (COUNT, 1))
    numbers["position"][:] = 0.05
    return numbers, run(SHAPE, numbers, np.zeros(COUNT), 12 * 2 * np.pi / numbers["frequency"])


def faults(numbers: dict, whole) -> int:
    """Number of faults in many parts of the motions."""
    found = [balance_faults(SHAPE, numbers, whole, np.random.default_rng(seed)) for seed in range(8)]
    return sum(map(len, found))


def test_motions_have_forces_that_the_laws_allow(machines):
    assert faults(*machines) == 0


@pytest.mark.parametrize(
    "name", ["friction", "slider_limit", "coefficient", "cushion_stiffness", "mean", "damping"]
)
def test_those_of_another_machine_have_none(machines, name, monkeypatch):
    numbers, whole = machines
    # Runs are those of the machine, and the forces of another.
    monkeypatch.setattr(
        "random_machines.balance.run", lambda shape, a, *rest, **named: run(shape, numbers, *rest, **named)
    )
    assert faults(numbers | {name: 1.02 * numbers[name]}, whole) > 0


def test_states_behind_the_end_of_a_run_that_stopped_early_are_not_looked_at(machines, monkeypatch):
    numbers, whole = machines
    monkeypatch.setattr("random_machines.balance.run", partial(run, most_steps=40))
    assert faults(numbers, whole) == 0
