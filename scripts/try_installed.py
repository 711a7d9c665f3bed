"""Try an installed vijax, and nothing beside it: one trajectory, one sweep, one picture, from an empty folder.

`python try_installed.py 0.2.0` also checks that it is that version.
"""

import os
import sys
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")

import jax
import matplotlib.pyplot as plt
import numpy as np

import vijax as vx


def main() -> None:
    """Run it; every step fails loudly."""
    jax.config.update("jax_enable_x64", True)
    if sys.argv[1:] not in ([], [vx.__version__]):
        raise SystemExit(f"This is vijax {vx.__version__}, not {sys.argv[1]}.")
    sol = vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 50.0)
    ds = vx.sweep(
        vx.models.wagg_bishop_a(0.8), {"forcing.frequency": np.linspace(0.6, 1.0, 9)}, progress=False
    )
    picture = Path("sweep.png")
    fig, ax = plt.subplots()
    vx.plot.bifurcation(ds, ax=ax)
    fig.savefig(picture)
    place = Path(vx.__file__).parent
    if not (place / "py.typed").exists():
        raise SystemExit("The types are not marked: py.typed is missing.")
    print(
        f"vijax {vx.__version__} in {place}: {int(sol.num_events)} events, {dict(ds.sizes)},",
        picture.resolve(),
    )


if __name__ == "__main__":
    main()
