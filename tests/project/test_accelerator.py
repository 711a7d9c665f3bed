"""The program that measures graphics cards, on the processor. Nothing here is timed."""

import json
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import accelerator
from benchmarks import accelerator as measured

# Twice the errors that the scene has on a processor with twenty impacts.
TIME_ERROR = 3e-14


def test_sizes_may_be_written_with_exponents():
    options = accelerator.arguments(["--sizes", "1e4", "100000", "--lanes", "64"])
    assert options.sizes == [10_000, 100_000]
    assert options.lanes == 64


def test_all_sizes_and_scenes_are_measured_if_none_are_named():
    options = accelerator.arguments([])
    assert options.sizes == [10**4, 10**5, 10**6, 10**7]
    assert options.scenes == ["all"]


@pytest.mark.parametrize("size", ["0", "-5", "2.5", "many", "inf"])
def test_a_size_that_is_no_number_of_points_is_refused(size, capsys):
    with pytest.raises(SystemExit):
        accelerator.arguments(["--sizes", size])
    assert "--sizes" in capsys.readouterr().err


def test_lanes_are_no_more_than_points():
    settings = measured.settings_for(100, 1 << 14)
    assert (settings.lanes, settings.points, settings.cores) == (100, 100, 1)


@pytest.mark.slow
def test_every_figure_has_its_error_and_the_hardware(tmp_path):
    given = ["--sizes", "40", "--lanes", "16", "--scenes", "paper_a_om080", "--out", str(tmp_path)]
    results = accelerator.main(given)
    assert json.loads((tmp_path / "accelerator.json").read_text())["throughput"] == results["throughput"]
    assert [row["by"] for row in results["throughput"]] == ["sweep", "vmap of simulate"]
    for row in results["throughput"]:
        assert row["device"]
        assert row["bits"] == 64
        assert row["error"] < TIME_ERROR
        assert row["systems per second"] == pytest.approx(row["ratio"] * 4.1e3)
    (scene,) = results["scenes"]
    assert scene["outcome"] == "right"
    assert scene["time error"] < TIME_ERROR
