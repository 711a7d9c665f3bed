"""Reproduce the figures and tables of Wagg & Bishop (2004), doi 10.1142/S0218127404009223.

    python scripts/reproduce.py fig7          # the bifurcation diagrams of case (b), to out/
    python scripts/reproduce.py all --out DIR

Everything goes into a picture (PNG, SVG, PDF) and a table (CSV), and what the paper says is printed beside what is
found. Masses are counted from 0, as in vijax: 0 and 1 are the paper's 1 and 2. Curves of the masses are red and blue, as in the paper.
`--style dark_background`, or any other style of matplotlib, is that of the pictures. Figs. 1 to 3 are drawings.
"""

import argparse
import time
from pathlib import Path

import jax
import matplotlib.pyplot as plt
from paper import bifurcation, frequencies, impact_maps, motions, regions, sticking, time_series

JOBS = {
    job.__name__: job
    for job in (
        bifurcation.fig4, time_series.fig5, regions.fig6, bifurcation.fig7, time_series.fig8, impact_maps.fig9,
        sticking.fig10, sticking.fig11, sticking.fig12, frequencies.table1, motions.table2, motions.table3,
    )
}  # fmt: skip


def main() -> None:
    """Run what the command line names."""
    parser = argparse.ArgumentParser(description="Reproduce figures and tables of Wagg & Bishop (2004).")
    parser.add_argument("what", choices=[*JOBS, "all"])
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for pictures and data")
    parser.add_argument("--coarse", type=int, default=1, help="every n-th point only, for a quick look")
    parser.add_argument("--style", default="default", help="style of matplotlib for the pictures")
    options = parser.parse_args()
    plt.style.use(options.style)
    jax.config.update("jax_enable_x64", True)
    for name in JOBS if options.what == "all" else [options.what]:
        start = time.perf_counter()
        JOBS[name](options.out, options.coarse)
        print(f"{name} took {time.perf_counter() - start:.0f} s\n", flush=True)


if __name__ == "__main__":
    main()
