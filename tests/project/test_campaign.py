"""The campaign over random machines: a few of them, and that it goes on where it was stopped."""

import json
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import campaign


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


def test_what_is_done_is_not_played_again(tmp_path, monkeypatch, capsys):
    played = []

    def play(number, machines, most_masses, families, sweeps, is_symmetric, degenerates):
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
