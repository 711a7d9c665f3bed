"""What is printed and written."""

import csv
import json
import os
import platform
import shutil
import subprocess
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax

from .timing import num_cores

PACKAGES = ("vijax", "jax", "jaxlib", "equinox", "numpy", "heyoka", "scipy", "diffrax", "optimistix")


def say(row: dict[str, Any]) -> None:
    """Print one result."""
    known = {k: v for k, v in row.items() if v is not None}
    parts = (f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in known.items())
    print("  ".join(parts), flush=True)


def surroundings() -> dict[str, Any]:
    """Versions, processor, memory, and how busy the machine was."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is not None:
        done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True)
        compiler = done.stdout.splitlines()[0]
    return {
        "processor": (names or [platform.processor()])[0],
        "cores": num_cores(),
        "load before": os.getloadavg(),
        "memory / GB": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9,
        "devices": [device.device_kind for device in jax.devices()],
        "system": platform.platform(),
        "python": platform.python_version(),
        "compiler": compiler,
        "versions": versions,
    }


def write(results: dict[str, Any], folder: Path, name: str = "benchmark") -> None:
    """Everything as JSON, and every part as CSV, in files of a name."""
    (folder / f"{name}.json").write_text(json.dumps(results, indent=1, allow_nan=False))
    for part, rows in results.items():
        if not isinstance(rows, list) or not rows:
            continue
        columns = list(dict.fromkeys(k for row in rows for k in row))
        with (folder / f"{name}_{part}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(rows)


def table(*runs: dict[str, Any]) -> str:
    """The short tables of the README, of what was measured, with a column for each run of the benchmark."""
    lines = []
    if "sweeps" in runs[0]:
        lines += [*sweep_table(sweeps_beside(runs)), ""]
    facts = [dict(facts_of(run)) for run in runs]
    if facts[0]:
        names = [f"JAX {jax_of(run)}" for run in runs]
        lines += [f"| | {' | '.join(names)} |", "| --- " * (len(runs) + 1) + "|"]
        lines += [f"| {what} | {' | '.join(own.get(what, '-') for own in facts)} |" for what in facts[0]]
    return "\n".join(lines)


def jax_of(run: dict[str, Any]) -> str:
    """Release of JAX of a run."""
    return run["surroundings"]["versions"]["jax"]


def facts_of(run: dict[str, Any]) -> list[tuple[str, str]]:
    """What was measured and how large it is, in words."""
    return [fact for name, tell in FACTS.items() if run.get(name) for fact in tell(run[name])]


def sweeps_beside(runs: Sequence[dict[str, Any]]) -> list[dict]:
    """Sweeps of the first run, and those of vijax of the others under the names of their releases of JAX."""
    first, *others = runs
    more = [
        {**row, "method": f"vijax, JAX {jax_of(run)}"}
        for run in others
        for row in run.get("sweeps", [])
        if row["method"] == "vijax"
    ]
    return [*first["sweeps"], *more]


def sweep_table(rows: list[dict]) -> list[str]:
    """Time and error of the paper's sweeps, a row a case and a column a program."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    lines = [f"| | {' | '.join(methods)} |", "| --- " * (len(methods) + 1) + "|"]
    for case in dict.fromkeys(row["case"] for row in rows):
        found = {row["method"]: row for row in rows if row["case"] == case}
        cells = [
            f"{found[m]['min / s']:.2g} s, {size(found[m]['error'])}" if m in found else "-" for m in methods
        ]
        points = next(iter(found.values()))["points"]
        lines.append(f"| case ({case}), {points} frequencies | {' | '.join(cells)} |")
    return lines


def size(error: float | None) -> str:
    """An error in words."""
    if error is None:
        return "impacts missed"
    return f"error {error:.0e}" if error else "right in every digit"


def of_carried_sweeps(rows: list[dict]) -> list[tuple[str, str]]:
    """Time of carried sweeps beside the scalar program."""
    facts = []
    for case in dict.fromkeys(row["case"] for row in rows):
        own, *others = (row for row in rows if row["case"] == case)
        value = f"{own['min / s']:.2g} s, {size(own['error'])}"
        value += "".join(f"; {own['min / s'] / one['min / s']:.2g} times {one['method']}" for one in others)
        facts.append((f"case ({case}), every point from the end before it", value))
    return facts


def of_solver_sweeps(rows: list[dict]) -> list[tuple[str, str]]:
    """Time of a sweep by diffrax beside the exact motion."""
    exact, other = rows
    value = f"{other['min / s'] / exact['min / s']:.3g} times the exact motion, {size(other['error'])}"
    return [("case (a) by `DiffraxFlow`", value)]


def of_work(rows: list[dict]) -> list[tuple[str, str]]:
    """Waste, steps and distance from the peak."""
    return [
        (
            f"case ({r['case']}): lane-steps wasted, steps per impact, share of floating-point peak",
            f"{r['wasted lane-steps']:.1%}, {r['steps per impact']:.1f}, {r['share of peak']:.1%}",
        )
        for r in rows
    ]


def of_throughput(rows: list[dict]) -> list[tuple[str, str]]:
    """Time of the most points."""
    last = rows[-1]
    memory = f", at most {last['memory high-water / MB']:.0f} MB" if "memory high-water / MB" in last else ""
    value = f"{last['min / s']:.2g} s, {last['microseconds per point']:.2g} us each, {size(last['error'])}{memory}"
    return [(f"{last['points']} points, 20 periods each", value)]


def of_masses(rows: list[dict]) -> list[tuple[str, str]]:
    """Costs of machines of each size."""
    facts = []
    for row in rows:
        value = f"{row['microseconds per step']:.2g} us a lane and step, one trajectory {row['one trajectory / ms']:.2g} ms"
        facts.append((f"{row['masses']} masses with {row['stops']} stops", f"{value}, {size(row['error'])}"))
    return facts


def of_first_results(rows: list[dict]) -> list[tuple[str, str]]:
    """Wait for a first result with and without the cache on disk."""
    facts = []
    for what in dict.fromkeys(row["what"] for row in rows):
        waits = {row["cache"]: row["process / s"] for row in rows if row["what"] == what}
        value = f"{waits['none']:.2g} s"
        value += f"; with a filled cache {waits['filled']:.2g} s" if "filled" in waits else ""
        facts.append((f"first result of `{what}` in a fresh process", value))
    return facts


def of_chattering_point(rows: list[dict]) -> list[tuple[str, str]]:
    """A chattering point among quiet ones."""
    last = rows[-1]
    return [("a chattering point among 1000", f"{last['ratio']:.2f} times without it, {size(last['error'])}")]


def of_derivatives(rows: list[dict]) -> list[tuple[str, str]]:
    """Derivatives per plain run."""
    return [
        (f"{r['method']} by start, {r['by']}", f"{r['ratio']:.2g} times a plain run, {size(r['error'])}")
        for r in rows
        if r["method"] != "plain"
    ]


def of_convergence(rows: list[dict]) -> list[tuple[str, str]]:
    """Orders of solvers, as they are found."""
    return [
        (
            f"order of {r['solver']}, {r['order']}, by {r['method']}",
            f"{r['fitted to state error']:.1f} of the end state, {r['fitted to time error']:.1f} of impact times",
        )
        for r in rows
        if r.get("fitted to state error") and r.get("fitted to time error")
    ]


def of_duffing_sweeps(rows: list[dict]) -> list[tuple[str, str]]:
    """A sweep of a nonlinear machine beside heyoka and diffrax."""
    own, *others = rows
    value = f"{own['min / s']:.2g} s of one core, {size(own['error'])}"
    value += "".join(f"; {r['method']} {r['of vijax']:.2g} times that, {size(r['error'])}" for r in others)
    return [("Duffing with a stop, 1000 frequencies, 20 periods", value)]


def of_duffing_motions(rows: list[dict]) -> list[tuple[str, str]]:
    """One trajectory and one orbit of that machine."""
    return [
        (f"Duffing with a stop, {r['what']}", f"{1e3 * r['min / s']:.2g} ms, {size(r['error'])}")
        for r in rows
    ]


def of_closed_form(rows: list[dict]) -> list[tuple[str, str]]:
    """An orbit and a branch of one mass beside SciPy."""
    own, *others = rows
    facts = []
    for what in ("orbit", "branch"):
        value = f"{own[f'{what} / ms']:.2g} ms, {size(own[f'{what} error'])}"
        for row in others:
            value += f"; {row['method']} {row[f'{what} / ms']:.2g} ms, {size(row[f'{what} error'])}"
        facts.append((f"{what} of one mass, known in closed form", value))
    return facts


def of_batch_cost(rows: list[dict]) -> list[tuple[str, str]]:
    """A step in a batch, in steps of the smooth motion."""
    return [
        (
            f"a step of {r['solver']} by {r['method']} in a batch of {r['lanes']}, {r['impacts']:.0f} impacts each",
            f"{r['ratio']:.2f} times one by diffeqsolve without events, {size(r['error'])}",
        )
        for r in rows
        if r["ratio"] != 1
    ]


def of_exponents(rows: list[dict]) -> list[tuple[str, str]]:
    """Lyapunov exponents beside the sweep without them, and serial code."""
    serial = next(row["us per period"] for row in rows if row["method"] == "SciPy")
    return [
        (
            f"case ({r['case']}): all Lyapunov exponents of {r['points']} points",
            f"{r['of the sweep']:.2g} times the sweep, 1/{serial / r['us per period']:.0f} of SciPy's time, "
            f"sum {size(r['error'])}",
        )
        for r in rows
        if r["method"] == "vijax"
    ]


def of_contacts(rows: list[dict]) -> list[tuple[str, str]]:
    """A step with contacts beside one with stops."""
    own = next(row for row in rows if row["method"] == "contacts")
    value = f"{own['ratio']:.2f} times one of as many masses and stops, {size(own['error'])}"
    return [(f"a step of {own['points']} impact dampers", value)]


def of_basins(rows: list[dict]) -> list[tuple[str, str]]:
    """Basins beside the sweep of their starts."""
    own, serial = (next(row for row in rows if row["method"] == name) for name in ("vijax", "SciPy"))
    share = f"1/{serial['us per start'] / own['us per start']:.0f} of SciPy's time"
    value = f"{own['of the sweep']:.3g} times their sweep, {share}, {serial['same labels']:.0%} of its labels"
    return [(f"basins of {own['starts']} starts", value)]


FACTS = {
    "carried_sweeps": of_carried_sweeps,
    "solver_sweeps": of_solver_sweeps,
    "work": of_work,
    "throughput": of_throughput,
    "masses": of_masses,
    "first_results": of_first_results,
    "chattering_point": of_chattering_point,
    "derivatives": of_derivatives,
    "exponents": of_exponents,
    "basins": of_basins,
    "contacts": of_contacts,
    "closed_form": of_closed_form,
    "duffing_sweeps": of_duffing_sweeps,
    "duffing_motions": of_duffing_motions,
    "convergence": of_convergence,
    "batch_cost": of_batch_cost,
}
