"""Compute numbers that others have printed, and print both beside each other.

    python scripts/published.py all
    python scripts/published.py galperin --out DIR

Each source writes a table (CSV) and a picture (PNG) of the motions with the printed values.
"""

import argparse
from pathlib import Path

import jax
import matplotlib.pyplot as plt
from paper.output import as_text
from papers import (
    bead_column,
    beam,
    bernu_mazighi,
    code_aster,
    galperin,
    mcnamara_young,
    mehta_luck,
    rods,
    siconos,
    tang,
    weidemann,
)
from papers.value import table_of

SOURCES = {
    one.__name__.rpartition(".")[2]: one
    for one in (
        code_aster,
        beam,
        rods,
        siconos,
        bead_column,
        galperin,
        mcnamara_young,
        bernu_mazighi,
        mehta_luck,
        tang,
        weidemann,
    )
}


def write(name: str, folder: Path) -> None:
    """Print the table of a source, and write it with its picture."""
    source = SOURCES[name]
    table = table_of(source.values())
    print(f"{(source.__doc__ or '').strip()}\n{as_text(table)}\n", flush=True)
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / f"{name}.csv", index=False)
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    source.draw(list(axes))
    figure.savefig(folder / f"{name}.png", dpi=150)
    plt.close(figure)


def main() -> None:
    """Run what the command line names."""
    parser = argparse.ArgumentParser(description="Compute numbers that others have printed.")
    parser.add_argument("what", choices=[*SOURCES, "all"])
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for pictures and tables")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    for name in SOURCES if options.what == "all" else [options.what]:
        write(name, options.out)


if __name__ == "__main__":
    main()
