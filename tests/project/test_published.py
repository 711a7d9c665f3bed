"""Numbers that others have printed are found again, to their digits or with a reason."""

import sys
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import pytest
from documents import ROOT

mpl.use("Agg")
sys.path.append(str(Path(__file__).parents[2] / "scripts"))

import published

pytestmark = pytest.mark.thorough

# Rounding of a motion over tens of events, relative to the number.
ROUNDING = 1e-12
PAGE = (ROOT / "docs/explanation/published.md").read_text()


# Their programs take long to compile.
LARGE = ("beam", "bead_column", "rods", "tang", "mehta_luck", "weidemann", "code_aster")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in published.SOURCES]
)
def test_printed_numbers_are_met_or_differ_for_a_reason(name, tmp_path):
    values = published.SOURCES[name].values()
    for one in values:
        assert one.is_met != bool(one.reason) or (one.is_met and one.reason), one
        if one.exact == one.exact:
            assert one.found == pytest.approx(one.exact, rel=ROUNDING, abs=ROUNDING), one
        # The page says what is printed and found, and by how much they differ.
        row = next(
            line
            for line in PAGE.splitlines()
            if line.startswith(f"| {one.machine} | {one.quantity} | {one.printed:.14g} |")
        )
        assert one.is_met or f" | {one.found - one.printed:.1e} | " in row


@pytest.mark.slow
def test_each_source_writes_its_table_and_picture(tmp_path):
    published.write("code_aster", tmp_path)
    assert len(pd.read_csv(tmp_path / "code_aster.csv")) == len(published.code_aster.values())
    assert (tmp_path / "code_aster.png").stat().st_size > 10_000
