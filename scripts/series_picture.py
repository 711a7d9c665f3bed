"""Picture of a step by Taylor series, for the page of the method: `python scripts/series_picture.py` writes docs/series_step.png.

A mass on a hardening spring, x'' = -x - x^3 + cos t. Its series are computed here by their recurrences, without the library.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

ORDER, MANY = 16, 80
TOLERANCE, SHARE = 1e-12, 0.9
START, POSITION = (0.3, 1.6), 0.57
TO = Path(__file__).resolve().parent.parent / "docs/series_step.png"


def coefficients(x: float, v: float, t: float, order: int) -> np.ndarray:
    """Taylor coefficients of the motion at the time t, up to an order."""
    a = np.zeros(order + 1)
    a[:2] = x, v
    square, cosine, sine = np.zeros(order + 1), np.zeros(order + 1), np.zeros(order + 1)
    cosine[0], sine[0] = np.cos(t), np.sin(t)
    for k in range(order - 1):
        square[k] = a[: k + 1] @ a[k::-1]
        cube = a[: k + 1] @ square[k::-1]
        a[k + 2] = (-a[k] - cube + cosine[k]) / ((k + 1) * (k + 2))
        cosine[k + 1], sine[k + 1] = -sine[k] / (k + 1), cosine[k] / (k + 1)
    return a


def value(a: np.ndarray, u: Any) -> Any:
    """The polynomial at the times u."""
    return np.polynomial.polynomial.polyval(u, a)


def slopes(a: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative."""
    return a[1:] * np.arange(1, len(a))


def exact(times: np.ndarray) -> np.ndarray:
    """Positions by steps of series that are far shorter than needed; the times are equally spaced."""
    x, v, found = *START, []
    for t in times:
        found.append(x)
        a, short = coefficients(x, v, t, 20), times[1] - times[0]
        x, v = float(value(a, short)), float(value(slopes(a), short))
    return np.array(found)


def length(a: np.ndarray) -> float:
    """Rule 1: the last two terms are below the tolerance of the motion within the step."""
    steps = np.geomspace(1e-3, 2, 20001)
    motion = np.maximum(steps * abs(a[1]), steps**2 * abs(a[2]))
    allowed = np.all([abs(a[k]) * steps**k <= TOLERANCE * motion for k in (ORDER - 1, ORDER)], axis=0)
    return SHARE * steps[allowed][-1]


def terms(ax: Axes, a: np.ndarray, step: float, radius: float) -> None:
    """Terms of the series at the end of the step, at the radius of convergence and beyond it."""
    k = np.arange(31)
    for u, style, name in (
        (step, "o-", "step $h$"),
        (radius, "s-", r"radius $\rho$"),
        (1.5 * radius, "^-", r"$1.5 \rho$"),
    ):
        ax.semilogy(k, np.abs(a[:31]) * u**k, style, markersize=3, linewidth=0.8, label=name)
    ax.axvline(ORDER, color="0.5", linewidth=0.8)
    ax.text(ORDER - 0.5, 2e-18, "P = 16", color="0.5", ha="right")
    ax.set(xlabel="order $k$", ylabel="term $|x_k| u^k$ at $u$", ylim=(1e-19, 1e6))
    ax.legend(fontsize="small", loc="lower left")


def errors(ax: Axes, a: np.ndarray, step: float, radius: float) -> None:
    """Error of the polynomial over time."""
    times = np.linspace(0, 1.3 * radius, 1301)
    for order, style in ((ORDER, "-"), (30, "--")):
        error = np.abs(value(a[: order + 1], times) - exact(times))
        ax.semilogy(times, np.maximum(error, 1e-17), style, linewidth=1.0, label=f"order {order}")
    ax.axvline(step, color="C0", linewidth=0.8)
    ax.axvline(radius, color="C1", linewidth=0.8)
    ax.text(step, 3e-4, " $h$", color="C0")
    ax.text(radius, 1e-14, r" $\rho$", color="C1")
    ax.set(xlabel="time $u$ in the step", ylabel="error of the polynomial", ylim=(1e-17, 1e2))
    ax.legend(fontsize="small", loc="upper left")


def zero_of_a_guard(ax: Axes, a: np.ndarray, step: float) -> None:
    """First zero of the gap to a stop, found from below: parabolas beneath the polynomial, whose roots no zero precedes."""
    gap = -a[: ORDER + 1].copy()
    gap[0] += POSITION
    k = np.arange(3, ORDER + 1)
    most = np.sum(k * (k - 1) * np.abs(gap[3:]) * step ** (k - 2)) - 2 * gap[2]
    times, u = np.linspace(0, step, 2000), 0.0
    ax.semilogy(times, np.maximum(value(gap, times), 1e-20), "k-", linewidth=1.2, label="guard $g(u)$")
    for turn in range(3):
        now, slope = value(gap, u), value(slopes(gap), u)
        root = u + 2 * now / (np.sqrt(slope**2 + 2 * most * now) - slope)
        at = np.linspace(u, root, 4000)
        bound = now + slope * (at - u) - most / 2 * (at - u) ** 2
        ax.semilogy(at, np.maximum(bound, 1e-20), f"C{turn}--", linewidth=1.0, label=f"bound from $u_{turn}$")
        ax.semilogy(u, now, f"C{turn}o", markersize=4)
        print(f"u_{turn} = {u:.12f}, guard {now:.1e}")
        u = root
    print(f"u_3 = {u:.12f}, guard {value(gap, u):.1e}")
    ax.axvline(u, color="0.5", linewidth=0.8)
    ax.set(xlabel="time $u$ in the step", ylabel="guard and bounds", xlim=(0.13, 0.17), ylim=(1e-8, 1))
    ax.legend(fontsize="small", loc="lower left")


if __name__ == "__main__":
    series = coefficients(*START, 0.0, MANY)
    # Cauchy and Hadamard: the largest of the last roots, since complex singularities come in pairs.
    rate = max(abs(series[k]) ** (1 / k) for k in range(MANY - 10, MANY + 1))
    found = length(series)
    print(f"step {found:.4f}, radius {1 / rate:.4f}")
    fig, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    terms(axes[0], series, found, 1 / rate)
    errors(axes[1], series, found, 1 / rate)
    zero_of_a_guard(axes[2], series, found)
    fig.savefig(TO, dpi=110)
