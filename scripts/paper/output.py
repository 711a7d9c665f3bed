"""What all figures and tables share: where they are written, colours, and what the paper says beside what is found.

Masses and stops are counted from 0, as in vijax; the paper counts masses from 1. Every title says so.
"""

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from cycler import cycler
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

FREQUENCY = "forcing.frequency"
AMPLITUDE = "forcing.amplitude[0]"
FREQUENCY_STEP = 0.0025
PICTURES = ("png", "svg", "pdf")
NUMBERS = "masses 0 and 1 are the paper's 1 and 2"
# Red and blue, as in the paper, of which grey makes a light and a dark one, on light and on dark paper.
_COLORS = {False: ("#e8604c", "#1b3f8b"), True: ("#d6402b", "#a9cdf5")}


def colors_of_the_paper() -> AbstractContextManager[None]:
    """Within it the curves of the masses have the paper's two colours."""
    is_dark = bool(np.mean(to_rgb(plt.rcParams["axes.facecolor"])) < 0.5)
    return plt.rc_context({"axes.prop_cycle": cycler(color=_COLORS[is_dark])})


def save(fig: Figure, table: pd.DataFrame, path: Path) -> None:
    """Write a picture and its numbers, as PNG, SVG, PDF and CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for ending in PICTURES:
        fig.savefig(f"{path}.{ending}", dpi=200, bbox_inches="tight")
    plt.close(fig)
    table.to_csv(f"{path}.csv", index=False, float_format="%.10g")
    print(f"Wrote {', '.join(f'{path}.{ending}' for ending in PICTURES)} and {path}.csv\n")


def announce(title: str) -> None:
    """Print a title, without the marks of symbols."""
    print(title.replace("$", "").replace("\\", "").replace("\n", " "))


def compare(rows: Iterable[tuple[str, str, str]]) -> None:
    """Print what the paper says beside what is found."""
    print(as_text(pd.DataFrame(rows, columns=["", "paper", "found"])))


def save_table(table: pd.DataFrame, title: str, path: Path, *, left_out: Sequence[str] = ()) -> None:
    """Print a table and write it, the picture without some of its columns."""
    announce(title)
    print(as_text(table))
    seen = table.drop(columns=list(left_out)).astype(str).replace(r"\binf\b", r"$\\infty$", regex=True)
    seen = seen.rename(columns={"Omega": r"$\Omega$"})
    fig, ax = plt.subplots(figsize=(14, 0.6 + 0.26 * len(table)), layout="constrained")
    ax.set_axis_off()
    ax.set_title(title, loc="left")
    drawn = ax.table(
        seen.values.tolist(),
        colLabels=list(seen.columns),
        loc="upper left",
        cellLoc="left",
        edges="horizontal",
    )
    ink = plt.rcParams["text.color"]
    for cell in drawn.get_celld().values():
        cell.set_edgecolor(ink)
        cell.get_text().set_color(ink)
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(9)
    drawn.auto_set_column_width(list(range(seen.shape[1])))
    save(fig, table, path)


def as_text(table: pd.DataFrame) -> str:
    """Columns of text, each aligned to the left."""
    rows = [list(map(str, table.columns)), *table.astype(str).values.tolist()]
    widths = [max(len(row[k]) for row in rows) for k in range(table.shape[1])]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def impacts_of(ds: xr.Dataset, names: Sequence[str] = ("phase", "velocity")) -> pd.DataFrame:
    """All recorded impacts of a sweep, a row each."""
    columns = ["impact_stop", *(f"impact_{name}" for name in names)]
    table = ds[columns].to_dataframe().query("impact_stop >= 0").reset_index().drop(columns="impact")
    table["impact_stop"] = ds.stop_mass.values[table["impact_stop"]]
    return table.rename(columns={"impact_stop": "mass", FREQUENCY: "frequency"})


def ranges(where: xr.DataArray) -> str:
    """The frequencies at which something is so, in either direction; gaps of a few steps are passed over."""
    is_found = where.any([dim for dim in where.dims if dim != FREQUENCY])
    found = where[FREQUENCY].values[is_found.values]
    runs = np.split(found, np.flatnonzero(np.diff(found) > 5.5 * FREQUENCY_STEP) + 1)
    texts = [f"{run[0]:.4f}" + f"-{run[-1]:.4f}" * (len(run) > 1) for run in runs if len(run)]
    return ", ".join(texts) or "none"
