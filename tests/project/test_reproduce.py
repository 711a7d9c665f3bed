"""Every figure and table of the paper is drawn and written, and contains the exact values."""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

mpl.use("Agg")
sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import reproduce

pytestmark = pytest.mark.thorough

FILES = {"fig4": "case_a", "fig7": "case_b"}
# The others compile the engine, for many seconds each.
QUICK = ("table1",)


@pytest.mark.parametrize(
    "name", [job if job in QUICK else pytest.param(job, marks=pytest.mark.slow) for job in reproduce.JOBS]
)
def test_every_figure_and_table_is_drawn_and_written_beside_what_the_paper_says(name, tmp_path, capsys):
    reproduce.JOBS[name](tmp_path, coarse=8)
    path = tmp_path / FILES.get(name, name)
    for ending in (".png", ".svg", ".pdf"):
        assert path.with_suffix(ending).stat().st_size > 10_000
    table = pd.read_csv(path.with_suffix(".csv"))
    assert len(table) >= 4
    assert "paper" in capsys.readouterr().out


def test_table_1_is_that_of_the_two_masses(tmp_path):
    reproduce.JOBS["table1"](tmp_path)
    table = pd.read_csv(tmp_path / "table1.csv", index_col="motion")
    for name in ("w_n", "zeta", "w_d"):
        np.testing.assert_allclose(table[name], table[f"{name} exact"], rtol=1e-5)
    as_printed = table.drop(index="x_1 = s_1")
    for name in ("w_n", "zeta", "w_d"):
        np.testing.assert_allclose(as_printed[name], as_printed[f"{name} paper"], atol=6e-4)


# `test_attractors.py` finds the same motions without the script.
@pytest.mark.slow
def test_table_3_finds_the_coexisting_motions(tmp_path):
    reproduce.JOBS["table3"](tmp_path, coarse=2)
    table = pd.read_csv(tmp_path / "table3.csv").ffill()
    found = table.groupby("Omega")["mass 1"].agg(set).to_dict()
    assert found[0.3] == {"inf in 1"}
    assert found[1.1] == {"3 in 2"}
    assert found[1.7] == found[2.0] == found[2.1] == {"1 in 1", "non-periodic"}
