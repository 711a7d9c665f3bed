"""The pictures of the benchmark."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from . import convergence
from .report import jax_of, size
from .single import SCENES

# Colour and marker of each program, in the order of the legend; those of one family share the marker.
STYLES = {
    "vijax": ("C0", "*"),
    "vijax, 1000 at once": ("C9", "*"),
    "scalar C++": ("0.3", "P"),
    "heyoka": ("C1", "o"),
    "SciPy DOP853": ("C2", "s"),
    "diffrax Tsit5": ("C3", "d"),
    "diffrax Dopri5": ("C4", "d"),
    "diffrax Dopri8": ("C5", "d"),
}
# Colours of the solvers of diffrax; by `DiffraxFlow` they are full, by `diffeqsolve` hollow.
SOLVERS = dict(zip(convergence.ORDERS, ("C2", "C1", "C3", "C5"), strict=True))
METHODS: dict[str, dict[str, Any]] = {
    convergence.OURS: {"ls": "-", "marker": "o"},
    convergence.THEIRS: {"ls": "--", "marker": "s", "mfc": "none"},
}
# Where what is infinitely wrong stands, and what is exact to the last digit.
FAILED, EXACT = 30.0, 1e-16


def draw(results: dict[str, Any], folder: Path, *others: dict[str, Any]) -> None:
    """All pictures of what was measured, in that of the number of masses beside other runs of the benchmark."""
    if results.get("work_precision"):
        work_precision(results["work_precision"], folder / "work_precision.png")
    if results.get("convergence"):
        converging(results["convergence"], folder / "diffrax_convergence.png")
    if any(results.get(name) for name in ("throughput", "masses", "stops")):
        scaling(results, folder / "scaling.png")
    if results.get("masses"):
        costs_of_masses([results, *others], folder / "masses.png")


def costs_of_masses(runs: list[dict[str, Any]], path: Path) -> None:
    """Cost of a step of a lane, and of one trajectory, by the number of masses."""
    panels = {
        "microseconds per step": "a sweep of 128 points\ntime of a step of a point / us",
        "one trajectory / ms": "one trajectory over 80 units of time\ntime / ms",
    }
    fig, axes = plt.subplots(1, len(panels), figsize=(9, 3.8), layout="constrained")
    for ax, (name, title) in zip(axes, panels.items(), strict=True):
        for run, style in zip(runs, ("o-", "s--", "d:"), strict=False):
            rows = run.get("masses") or []
            n, cost = ([row[key] for row in rows] for key in ("masses", name))
            ax.loglog(n, cost, style, label=f"JAX {jax_of(run)}")
        ax.set_xticks(n := [row["masses"] for row in runs[0]["masses"]], n)
        ax.tick_params(axis="x", labelrotation=60)
        ax.minorticks_off()
        what, unit = title.split("\n")
        ax.set(xlabel="number of masses, each with a stop", ylabel=unit)
        ax.set_title(what, fontsize=10)
        ax.grid(alpha=0.3)
    axes[0].legend()
    fig.savefig(path, dpi=150)
    plt.close(fig)


def converging(rows: list[dict], path: Path) -> None:
    """Errors by the number of constant steps above, run times by the error of adaptive steps below, if there are several."""
    constant = [row for row in rows if "length of steps" in row]
    adaptive = [row for row in rows if "tolerance" in row and row["scene"] == convergence.IMPACTS]
    count = 2 if len({row["tolerance"] for row in adaptive}) > 1 else 1
    figsize = (11, 0.6 + 3.9 * count)
    fig, axes = plt.subplots(count, 2, figsize=figsize, sharey="row", layout="constrained", squeeze=False)
    for ax, (scene, title) in zip(axes[0], convergence.SCENES.items(), strict=True):
        orders_panel(ax, [row for row in constant if row["scene"] == scene])
        ax.set(
            title=f"{title}\nsteps of constant length", xlabel="span / length of steps", ylim=(EXACT / 3, 10)
        )
    axes[0, 0].set_ylabel("largest error of x, v at the end / unit")
    for ax, lanes in zip(axes[1:].flat, (1, convergence.BATCH), strict=False):
        costs_panel(ax, [row for row in adaptive if row["at once"] == lanes])
        many = f"{lanes} trajectories at once" if lanes > 1 else "one trajectory"
        ax.set(title=f"20 impacts, adaptive steps: {many}", ylabel="run time of a trajectory / s")
        ax.label_outer()
    shown = {row["solver"] for row in constant}
    handles = [Line2D([], [], color=c, lw=4, label=s) for s, c in SOLVERS.items() if s in shown]
    handles += [Line2D([], [], color="k", **kind, label=method) for method, kind in METHODS.items()]
    handles.append(Line2D([], [], color="k", marker="x", ms=9, ls="", label="impacts missed or added"))
    handles.append(Line2D([], [], color="0.5", ls=":", label="order of the solver"))
    fig.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def solver_styles() -> dict[tuple[str, str], dict[str, Any]]:
    """How each solver is drawn in each method."""
    return {(s, m): {"color": c, "ms": 5, **kind} for m, kind in METHODS.items() for s, c in SOLVERS.items()}


def orders_panel(ax: Axes, rows: list[dict]) -> None:
    """Errors by the number of steps, and lines that fall as the order of each solver says."""
    for (solver, method), style in solver_styles().items():
        chosen = [row for row in rows if (row["solver"], row["method"]) == (solver, method)]
        points = [row | {"steps": row["span"] / row["length of steps"]} for row in chosen]
        lines(ax, points, "steps", "state error", style)
        right = [p for p in points if p["outcome"] == "right" and p["state error"] > convergence.ROUNDING]
        if method == convergence.OURS and right and right[-1]["scene"] == convergence.IMPACTS:
            last, order = right[-1], convergence.ORDERS[solver]
            steps = [points[0]["steps"], last["steps"]]
            ax.plot(
                steps, [last["state error"] * (last["steps"] / n) ** order for n in steps], ":", color="0.5"
            )


def costs_panel(ax: Axes, rows: list[dict]) -> None:
    """Run times by errors."""
    for (solver, method), style in solver_styles().items():
        chosen = [row for row in rows if (row["solver"], row["method"]) == (solver, method)]
        lines(ax, chosen, "state error", "each: min / s", style)
    ax.set(xlabel="largest error of x, v at t = 80 / unit", xlim=(1e-14, 1e-2))


def lines(ax: Axes, rows: list[dict], across: str, up: str, style: dict[str, Any]) -> None:
    """A line through results, those with other impacts than the true ones crossed."""
    ax.loglog([max(row[across], EXACT) for row in rows], [max(row[up], EXACT) for row in rows], **style)
    wrong = [row for row in rows if row["outcome"] != "right"]
    crossed = {"color": style["color"], "marker": "x", "ls": "", "ms": 9}
    ax.loglog([row[across] for row in wrong], [row[up] for row in wrong], **crossed)
    ax.grid(alpha=0.3)


def work_precision(rows: list[dict], path: Path) -> None:
    """Run time against the error of impact times above, of the state at the end below; a scene a column."""
    fig, axes = plt.subplots(2, len(SCENES), figsize=(11, 6.6), sharey=True, layout="constrained")
    for column, (scene, title) in zip(axes.T, SCENES.items(), strict=True):
        chosen = [row for row in rows if row["scene"] == scene]
        panel(column[0], chosen, "time error")
        panel(column[1], chosen, "state error")
        column[0].set(title=title, xlabel="largest error of an impact time / time unit")
        column[1].set(xlabel="largest error of x, v at t = 80 / unit")
    for ax in axes[:, 0]:
        ax.set_ylabel("run time of a trajectory / s")
    handles = {h.get_label(): h for ax in axes.flat for h in ax.get_legend_handles_labels()[0]}
    handles = [handles[name] for name in STYLES if name in handles]
    hollow = [
        Line2D([], [], color="k", marker="o", ls="", mfc="none", label="fell through a stop"),
        Line2D([], [], color="k", marker="x", ls="", label="gave up after 1000 impacts"),
    ]
    fig.legend(handles=handles + hollow, loc="outside lower center", ncols=5, frameon=False)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def panel(ax: Axes, rows: list[dict], kind: str) -> None:
    """One scene and one kind of error. What went wrong is hollow; what has no error at all is on the right."""
    for method, (colour, marker) in STYLES.items():
        found = [row for row in rows if row["method"] == method]
        place = [FAILED if row[kind] is None else max(row[kind], EXACT) for row in found]
        right = [k for k, row in enumerate(found) if row["outcome"] == "right"]
        size = 11 if marker == "*" else 6
        ax.loglog(
            [place[k] for k in right], [found[k]["min / s"] for k in right], color=colour, marker=marker,
            ms=size, label=method,
        )  # fmt: skip
        for x, row in zip(place, found, strict=True):
            if row["outcome"] != "right":
                mark = "x" if row["outcome"] == "gave up" else marker
                ax.loglog(x, row["min / s"], color=colour, marker=mark, ms=size, mfc="none")
    ax.axvspan(FAILED / 8, FAILED * 8, color="0.92", zorder=0)
    words = "impacts missed or added" if kind == "time error" else "never got there"
    ax.text(FAILED * 2, 0.97, words, rotation=90, transform=ax.get_xaxis_transform(), va="top", fontsize=8)
    ax.set_xlim(EXACT / 3, FAILED * 8)
    ax.grid(alpha=0.3)


def scaling(results: dict[str, Any], path: Path) -> None:
    """Time against points, masses and stops."""
    panels = {
        ("throughput", "points"): "sweep of 20 periods",
        ("masses", "masses"): "every mass with a stop, 128 points",
        ("stops", "stops"): "16 masses, 128 points",
    }
    fig, axes = plt.subplots(1, len(panels), figsize=(11, 4.0), layout="constrained")
    for ax, ((name, by), title) in zip(axes, panels.items(), strict=True):
        rows = results.get(name) or []
        sizes = [row[by] for row in rows]
        ax.loglog(sizes, [row["min / s"] for row in rows], "o-", label="run")
        if name != "throughput":  # most of its sizes share a compiled program
            ax.loglog(sizes, [row["compiling / s"] for row in rows], "s--", color="0.6", label="compilation")
            ax.set_xticks(sizes, sizes)
            ax.minorticks_off()
        errors = [row["error"] for row in rows]
        known = [error for error in errors if error is not None]
        worst = max(known) if known and len(known) == len(errors) else None
        ax.set(xlabel=f"number of {by}", ylabel="time / s")
        ax.set_title(f"{title}\nimpact times: {size(worst)}", fontsize=10)
        ax.grid(alpha=0.3)
    fig.legend(
        handles=axes[1].get_legend_handles_labels()[0], loc="outside lower center", ncols=2, frameon=False
    )
    fig.savefig(path, dpi=150)
    plt.close(fig)
