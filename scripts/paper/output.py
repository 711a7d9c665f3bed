"""What all figures and tables share: where they are written, and what the paper says beside what is found."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

FREQUENCY = "forcing.frequency"
AMPLITUDE = "forcing.amplitude[0]"
FREQUENCY_STEP = 0.0025


def save(fig: Figure, table: pd.DataFrame, path: Path) -> None:
    """Write a picture and its numbers, as PNG and CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(f"{path}.png", dpi=200, bbox_inches="tight")
    plt.close(fig)
    table.to_csv(f"{path}.csv", index=False, float_format="%.10g")
    print(f"Wrote {path}.png and {path}.csv\n")


def compare(rows: Iterable[tuple[str, str, str]]) -> None:
    """Print what the paper says beside what is found."""
    print(as_text(pd.DataFrame(rows, columns=["", "paper", "found"])))


def save_table(table: pd.DataFrame, title: str, path: Path) -> None:
    """Print a table and write it, as PNG and CSV."""
    print(f"{title}\n{as_text(table)}")
    fig, ax = plt.subplots(figsize=(14, 0.6 + 0.26 * len(table)), layout="constrained")
    ax.set_axis_off()
    ax.set_title(title, loc="left")
    drawn = ax.table(
        table.astype(str).values.tolist(), colLabels=list(table.columns), loc="center", cellLoc="left",
        edges="horizontal",
    )  # fmt: skip
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(9)
    drawn.auto_set_column_width(list(range(table.shape[1])))
    save(fig, table, path)


def as_text(table: pd.DataFrame) -> str:
    """Columns of text, each aligned to the left."""
    rows = [list(map(str, table.columns)), *table.astype(str).values.tolist()]
    widths = [max(len(row[k]) for row in rows) for k in range(table.shape[1])]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def impacts_of(ds: xr.Dataset, names: Sequence[str] = ("phase", "velocity")) -> pd.DataFrame:
    """All recorded impacts of a sweep, a row each, masses counted from 1 as in the paper."""
    columns = ["impact_stop", *(f"impact_{name}" for name in names)]
    table = ds[columns].to_dataframe().query("impact_stop >= 0").reset_index().drop(columns="impact")
    table["impact_stop"] = ds.stop_mass.values[table["impact_stop"]] + 1
    return table.rename(columns={"impact_stop": "mass", FREQUENCY: "frequency"})


def ranges(where: xr.DataArray) -> str:
    """The frequencies at which something is so, in either direction; gaps of a few steps are passed over."""
    is_found = where.any([dim for dim in where.dims if dim != FREQUENCY])
    found = where[FREQUENCY].values[is_found.values]
    runs = np.split(found, np.flatnonzero(np.diff(found) > 5.5 * FREQUENCY_STEP) + 1)
    texts = [f"{run[0]:.4f}" + f"-{run[-1]:.4f}" * (len(run) > 1) for run in runs if len(run)]
    return ", ".join(texts) or "none"
