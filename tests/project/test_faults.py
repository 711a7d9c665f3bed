"""Kills and faults: a slice of what `scripts/faults.py` plays for hours."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import faults


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 10])  # killed; on a full disk
def test_a_disturbed_sweep_goes_on_and_finds_the_same(number):
    line = faults.play(number, {})
    assert line["broken"] == ""
    assert line["kills"] + line["sentences"] > 0


def test_what_is_no_sentence_is_seen():
    assert faults.says_a_sentence(
        "Traceback\n  File ...\nOSError: [Errno 28] Results cannot be written to 'a': make room.\n"
    )
    assert not faults.says_a_sentence("Segmentation fault\n")
