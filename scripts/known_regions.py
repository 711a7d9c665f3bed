"""Draw where the impact oscillator with its stop at rest hits it once in n periods, with the boundaries known in closed form.

x'' + x = cos(W t), x <= 0, restitution r: Shaw & Holmes, J. Sound and Vibration 90 (1983) 129-155, in the limit of impacts. An orbit with
one impact in n periods, t = 2 pi n / W, has multipliers with the product r^2 and the sum -2 r cos t - (1 + r)^2 (W^2 - 1) (1 + cos t) / 2;
`tests/_charts/test_known_charts.py` derives it. The period doubles where the sum is -(1 + r^2).
"""

import argparse
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import vijax as vx

# Steps of 0.01 and 0.005.
_POINTS = (281, 181)


def known_regions(out: Path, coarse: int = 1) -> None:
    """The motions from one start over frequency and restitution, and the exact doublings for n = 1, 2."""
    right, up = ((n - 1) // coarse + 1 for n in _POINTS)
    frequency, restitution = np.linspace(2.0, 4.8, right), np.linspace(0.05, 0.95, up)
    plane = {"forcing.frequency": frequency, "stops[0].restitution": restitution}
    chart = vx.chart(vx.models.impact_oscillator(1.0), plane, transient=1000, x0=[-0.5])
    fig, ax = plt.subplots(figsize=(8, 4.5), layout="constrained")
    vx.plot.regions(chart, ax=ax)
    for n in (1, 2):
        beyond = _sum_of_multipliers(frequency[:, None], restitution, n) + 1 + restitution**2
        ax.contour(frequency, restitution, beyond.T, [0.0], colors="red", linestyles="dashed")
    ax.set_title("Dashed: where the period of one impact in 1 and 2 periods doubles, exactly", loc="left")
    out.mkdir(parents=True, exist_ok=True)
    fig.savefig(out / "known_regions.png", dpi=150)
    print(f"{float(chart.is_computed.mean()):.0%} of {right} x {up} points were run")


def _sum_of_multipliers(frequency: np.ndarray, restitution: np.ndarray, n: int) -> np.ndarray:
    """Of the orbit with one impact in n periods."""
    c = np.cos(2 * np.pi * n / frequency)
    return -2 * restitution * c - (1 + restitution) ** 2 * (frequency**2 - 1) * (1 + c) / 2


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Draw regions of motions with their exact boundaries.")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture")
    parser.add_argument("--coarse", type=int, default=1, help="every n-th point only, for a quick look")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    known_regions(options.out, options.coarse)


if __name__ == "__main__":
    main()
