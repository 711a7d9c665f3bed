"""Measure vijax beside what one would take instead: run time against error, throughput, cost of derivatives.

    python scripts/benchmark.py               # quick: a few minutes
    python scripts/benchmark.py --full        # everything, all sizes
    python scripts/benchmark.py --only sweeps derivatives

Writes benchmark.json, CSV files and pictures to out/. Errors are against scenes solved to 36 digits
(tests/data/golden), never against vijax. Compilation and runs are timed apart; of repeated runs the
minimum and the median are given, and what is compared runs in turns, because machines are noisy.
Peers that are not installed are left out; `pip install '.[bench]'` brings them, and a C++ compiler
serves the scalar program in scripts/peers.
"""

from pathlib import Path

import jax
import numpy as np

import vijax as vx

jax.config.update("jax_enable_x64", True)

ROOT = Path(__file__).parent
GOLDEN = ROOT.parent / "tests" / "data" / "golden"
SWEEPS = {
    "a": (vx.models.wagg_bishop_a, np.linspace(0.2, 2.0, 721), (0.3, 0.3, 0.3)),
    "b": (vx.models.wagg_bishop_b, np.linspace(0.1, 2.5, 961), (-0.3, 0.1, 0.5)),
}
