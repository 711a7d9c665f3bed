"""Table 1: natural frequencies and damping ratios, free and with a mass held."""

from pathlib import Path

import numpy as np
import pandas as pd

import vijax as vx

from .output import NUMBERS, save_table

_GOLDEN = (5**0.5 - 1) / 2
# Motion: which masses move, which of their modes, the exact frequency, what the paper prints, its errata.
TABLE_1 = {
    "free, mode 1": ((0, 1), 0, _GOLDEN, ("0.618", "0.031", "0.618"), ""),
    "free, mode 2": ((0, 1), 1, 1 + _GOLDEN, ("1.618", "0.081", "1.613"), ""),
    "x_0 = s_0": ((1,), 0, 1.0, ("1", "0.05", "0.999"), ""),
    "x_1 = s_1": (
        (0,), 0, 2**0.5, ("1", "0.05", "0.705"), "errata: two springs hold mass 0, Eq. 35; 0.705 is half of w_d"
    ),
}  # fmt: skip


def table1(out: Path, coarse: int = 1) -> None:
    """Natural frequencies and damping ratios of the two-mass example."""
    del coarse  # there is nothing to thin out
    system = vx.models.wagg_bishop_a(1.0)
    rows = []
    for motion, (free, mode, exact, paper, note) in TABLE_1.items():
        found = [values[mode] for values in modes(system, free)]
        zeta = 0.05 * exact  # of damping in proportion to the stiffness, c w / (2 k)
        truth = (exact, zeta, exact * (1 - zeta**2) ** 0.5)
        triples = zip(found, truth, paper, strict=True)
        rows.append((motion, *(a for f, t, p in triples for a in (f"{f:.6f}", f"{t:.6f}", p)), note))
    names = (f"{name}{kind}" for name in ("w_n", "zeta", "w_d") for kind in ("", " exact", " paper"))
    table = pd.DataFrame(rows, columns=["motion", *names, "note"])
    save_table(table, f"Table 1, frequencies and damping ratios of the two masses; {NUMBERS}", out / "table1")


def modes(system: vx.ImpactSystem, free: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Natural frequencies, damping ratios and damped frequencies while all but some masses are held."""
    which = np.ix_(free, free)
    root = np.sqrt(np.asarray(system.mass))[list(free)]
    stiffness, damping = (
        np.asarray(a)[which] / np.outer(root, root) for a in (system.stiffness, system.damping)
    )
    squares, shapes = np.linalg.eigh(stiffness)
    frequency = np.sqrt(squares)
    ratio = np.diag(shapes.T @ damping @ shapes) / (2 * frequency)
    return frequency, ratio, frequency * np.sqrt(1 - ratio**2)
