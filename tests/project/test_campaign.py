"""The campaign over random machines: a few of them, and that it goes on where it was stopped."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import campaign
from random_machines.machines import draw_numbers
from random_machines.motions import check_motions
from random_machines.shapes import Shape


# To follow branches of a machine too takes as long again.
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("families", "is_symmetric"),
    [
        (0, False),
        pytest.param(1, False, marks=pytest.mark.slow),
        pytest.param(1, True, marks=pytest.mark.slow),
    ],
)
def test_a_few_random_machines_obey_all_checks(families, is_symmetric):
    line = campaign.play(3, machines=4, most_masses=2, families=families, is_symmetric=is_symmetric)
    assert line["compared"] > 0
    assert line["failures"] == []


@pytest.mark.slow
def test_a_few_rows_of_bodies_in_touch_obey_all_checks():
    line = campaign.play(campaign.TOUCHING + 6, machines=12, most_masses=3)
    assert line["compared"] > 3
    assert line["failures"] == []


@pytest.mark.slow
def test_machines_that_touch_their_stop_once_a_cycle_obey_all_checks():
    """Without damper, load and rebound, the first impact leaves an amplitude of the gap, for all numbers of the machine."""
    shape, rng = Shape(masses=1, stops=((0, "lower"),), is_driven=False), np.random.default_rng(5)
    numbers = draw_numbers(rng, shape, 24)
    numbers["damping"][:18], numbers["restitution"][:18] = 0.0, 0.0
    failures, compared = check_motions(shape, numbers, rng)
    assert compared > 3
    assert failures == []


def test_what_is_done_is_not_played_again(tmp_path, monkeypatch, capsys):
    played = []

    def play(number, machines, most_masses, families, sweeps, curves, is_symmetric, degenerates):
        played.append(number)
        sums = {"machines": machines, "runs": 7, "compared": 1, "cpu_seconds": 0.0}
        if len(played) == 3:
            raise KeyboardInterrupt
        return {"round": number, "failures": [], **sums}

    monkeypatch.setattr(campaign, "play", play)
    monkeypatch.setattr(campaign.jax, "clear_caches", lambda: None)
    monkeypatch.setattr(sys, "argv", ["campaign.py", "--out", str(tmp_path)])
    with pytest.raises(KeyboardInterrupt):
        campaign.main()
    played.clear()
    with pytest.raises(KeyboardInterrupt):
        campaign.main()
    assert played == [2, 3, 4]
    rounds = [json.loads(line)["round"] for line in (tmp_path / "tally.jsonl").read_text().splitlines()]
    assert rounds == [0, 1, 2, 3]
    assert "failures: none" in capsys.readouterr().out
