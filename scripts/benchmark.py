"""Measure vijax beside what one would take instead: run time against error, throughput, cost of derivatives.

    python scripts/benchmark.py               # quick: a few minutes
    python scripts/benchmark.py --full        # everything, all sizes
    python scripts/benchmark.py --only sweeps derivatives

Writes benchmark.json, CSV files and pictures to out/. Errors are against scenes solved to 36 digits
(tests/data/golden), never against vijax. Compilation and runs are timed apart; of repeated runs the
minimum and the median are given, and what is compared runs in turns, because machines are noisy.
Peers that are not installed are left out; `pip install '.[bench]'` brings them, and the scalar C++
program is built where there is a compiler.
"""

import argparse
import json
import os
import platform
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import peers

import vijax as vx

jax.config.update("jax_enable_x64", True)

ROOT = Path(__file__).parent
GOLDEN = ROOT.parent / "tests" / "data" / "golden"
SWEEPS = {
    "a": (vx.models.wagg_bishop_a, np.linspace(0.2, 2.0, 721), (0.3, 0.3, 0.3)),
    "b": (vx.models.wagg_bishop_b, np.linspace(0.1, 2.5, 961), (-0.3, 0.1, 0.5)),
}
# Light, several impacts, chatter and sticking: the peers that know no sticking fail in the last.
SCENES = {
    "paper_a_om080": "light: case (a), W = 0.8",
    "paper_b_om110": "many impacts: case (b), W = 1.1",
    "paper_b_om030": "chatter and sticking: case (b), W = 0.3",
}
TOLERANCES = {"scipy": (1e-6, 1e-9, 1e-12), "diffrax": (1e-6, 1e-9, 1e-12), "heyoka": (1e-6, 1e-10, 1e-15)}
LIGHT = 1e-5  # impacts at which scenes are not compared: what is left of a chatter when it ends


def seconds(function: Callable, repeats: int = 5) -> dict[str, float]:
    """Minimum and median of repeated runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return {"min": min(times), "median": float(np.median(times))}


def in_turns(functions: dict[str, Callable], repeats: int) -> dict[str, dict[str, float]]:
    """Like `seconds`, of several functions, one after another in every round."""
    times = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            times[name].append(seconds(function, 1)["min"])
    return {name: {"min": min(t), "median": float(np.median(t))} for name, t in times.items()}


def work_precision(full: bool) -> list[dict]:
    """Run time against the largest error of an impact time, of single trajectories."""
    rows = []
    for name in SCENES:
        scene = json.loads((GOLDEN / f"{name}.json").read_text())
        exact = [(e["t"], e["stop"], abs(e["v_before"])) for e in scene["events"] if e["kind"] == "impact"]
        runs: dict[tuple[str, float | None], Callable] = {("vijax", None): vijax_run(scene)}
        for peer, tolerances in TOLERANCES.items():
            for tolerance in tolerances:
                run = installed(lambda: getattr(peers, peer)(scene, tolerance))  # noqa: B023
                if run is not None:
                    runs[peer, tolerance] = run
        for (method, tolerance), run in runs.items():
            error = impact_error(run(), exact)
            timed = seconds(run, 5 if full else 3)
            rows.append({"scene": name, "method": method, "tolerance": tolerance, "error": error, **timed})
            say(rows[-1])
    return rows


def vijax_run(scene: dict) -> Callable[[], list[tuple[float, int]]]:
    """One trajectory by `simulate`."""
    load = vx.Harmonic(scene["A"], scene["Omega"], scene["phase"])
    stops = [vx.Stop(s["mass"], s["position"], s["side"], s["restitution"]) for s in scene["stops"]]
    system = vx.ImpactSystem(scene["M"], scene["C"], scene["K"], load, stops)

    def run() -> list[tuple[float, int]]:
        log = vx.simulate(system, scene["t0"], scene["t1"], scene["x0"], scene["v0"]).events
        kept = np.asarray((log.kind == vx.IMPACT) & (jnp.abs(log.velocity_minus) > LIGHT))
        return list(zip(np.asarray(log.t)[kept].tolist(), np.asarray(log.stop)[kept].tolist(), strict=True))

    return run


def impact_error(found: list[tuple[float, int]], exact: list[tuple[float, int, float]]) -> float:
    """The largest error of the time of an impact, or infinite if one is missed, added or of another stop."""
    wanted = [(t, stop) for t, stop, speed in exact if speed > LIGHT]
    if len(found) != len(wanted) or [s for _, s in found] != [s for _, s in wanted]:
        return float("inf")
    return max((abs(a - b) for (a, _), (b, _) in zip(found, wanted, strict=True)), default=0.0)


def sweeps(full: bool) -> list[dict]:
    """The paper's sweeps, 100 + 20 periods, from the call to the dataset, in turns with the peers."""
    rows, cores = [], len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder:
        program = peers.build_scalar(Path(folder))
        for case, (build, frequencies, stops) in SWEEPS.items():
            run = lambda: vx.sweep(build(1.0), {"forcing.frequency": frequencies}, progress=False)  # noqa: B023, E731
            functions: dict[str, Callable] = {"vijax": run}
            if program is not None:
                functions["scalar C++"] = lambda: peers.scalar_sweep(program, stops, frequencies, cores)  # noqa: B023
            ds = run()
            for method, timed in in_turns(functions, 15 if full else 7).items():
                rows.append({"case": case, "method": method, "points": len(frequencies), **timed})
                say(rows[-1])
            steps, impacts = int(ds.steps.sum()), int(ds.num_impacts.sum())
            rows[-1]["wasted lane-steps"] = 1 - steps / ds.steps.attrs["lane_steps"]
            rows[-1]["steps per period"] = steps / len(frequencies) / 120
            rows[-1]["impacts per recorded period"] = impacts / len(frequencies) / 20
            say(rows[-1])
            few = frequencies[:: 1 if full else 4]
            taken = installed(lambda: peers.heyoka_sweep(stops, few, 1e-13)) if case == "a" else None  # noqa: B023
            if taken is not None:
                taken *= len(frequencies) / len(few) / cores
                rows.append({"case": case, "method": "heyoka 1e-13, all cores by proportion", "min": taken})
                say(rows[-1])
    return rows


def throughput(full: bool) -> list[dict]:
    """Time against the number of points, 20 forcing periods each, room for 16 impacts."""
    rows = []
    for points in [1, 10, 100, 1000, 10_000, *([200_000, 1_000_000] if full else [])]:
        values = {"forcing.frequency": np.linspace(0.6, 1.4, points)}
        system = vx.models.wagg_bishop_a(1.0)
        run = lambda: vx.sweep(system, values, transient=15, record=5, max_impacts=16, progress=False)  # noqa: B023, E731
        run()
        timed = seconds(run, 3 if points <= 10_000 else 1)
        rows.append({"points": points, **timed, "microseconds per point": 1e6 * timed["min"] / points})
        say(rows[-1])
    return rows


def sizes(full: bool) -> list[dict]:
    """Time and compile time of a chain against its number of masses, every other one with a stop."""
    rows = []
    for n in [1, 2, 4, 8, 16, *([32, 64] if full else [])]:
        load = vx.Harmonic([0.5] + [0.0] * (n - 1), 0.8)
        stops = [vx.Stop(i, 0.3, "upper", 0.7) for i in range(0, n, 2)]
        system = vx.chain([1.0] * n, [0.1] * n, [1.0] * n, load, stops)
        values = {"forcing.frequency": np.linspace(0.6, 1.4, 96)}
        run = lambda: vx.sweep(system, values, transient=8, record=2, progress=False)  # noqa: B023, E731
        first = seconds(run, 1)["min"]
        rows.append({"masses": n, "stops": len(stops), **seconds(run, 3), "first call": first})
        say(rows[-1])
    return rows


def derivatives(full: bool) -> list[dict]:
    """The Jacobian of an end state by the start and three parameters, and a gradient, per plain run."""
    lanes, rows = 1000, []

    def by_load(p):
        stops = [vx.Stop(i, 0.3, "upper", p[6]) for i in range(2)]
        return vx.chain(
            [1.0, 1.0], [0.1, 0.1], [1.0, 1.0], vx.Harmonic(jnp.array([1.0, 0.0]) * p[5], p[4]), stops
        )

    def by_matrices(p):
        stops = [vx.Stop(i, 0.3, "upper", 0.7) for i in range(2)]
        mass, stiffness = jnp.stack([p[4], 1.0]), jnp.stack([p[6] + 0.4, 1.0])
        return vx.chain(mass, [0.1, 0.1], stiffness, vx.Harmonic(jnp.array([1.0, 0.0]) * p[5], 0.8), stops)

    first = jnp.zeros((lanes, 4))
    last = jnp.stack([jnp.linspace(0.6, 1.4, lanes), jnp.full(lanes, 0.3), jnp.full(lanes, 0.7)], axis=1)
    points = jnp.concatenate([first, last], axis=1)
    for name, build in (
        ("frequency, amplitude, restitution", by_load),
        ("mass, amplitude, stiffness", by_matrices),
    ):

        def end(p, build=build):
            sol = vx.simulate(build(p), 0.0, 60.0, p[:2], p[2:4], max_events=0, throw=False)
            return jnp.concatenate([sol.x1, sol.v1])

        functions = {"plain": end, "jacfwd": jax.jacfwd(end), "grad": jax.grad(lambda p, f=end: f(p).sum())}
        compiled = {k: jax.jit(jax.vmap(f)) for k, f in functions.items()}
        first_calls = {k: seconds(lambda f=f: f(points), 1)["min"] for k, f in compiled.items()}
        timed = in_turns({k: lambda f=f: f(points) for k, f in compiled.items()}, 9 if full else 5)
        for method, t in timed.items():
            ratio = t["min"] / timed["plain"]["min"]
            rows.append(
                {"by": name, "method": method, **t, "ratio": ratio, "first call": first_calls[method]}
            )
            say(rows[-1])
    return rows


def chattering_lane(full: bool) -> list[dict]:
    """What one point that chatters costs among 999 that do not."""
    rows, system = [], vx.models.wagg_bishop_b(1.0)
    quiet = np.linspace(2.2, 2.5, 1000)
    for name, values in (("quiet", quiet), ("one chatters", np.append(quiet[1:], 0.2))):
        run = lambda: vx.sweep(system, {"forcing.frequency": values}, transient=20, record=5, progress=False)  # noqa: B023, E731
        run()
        rows.append({"points": name, **seconds(run, 9 if full else 5)})
        say(rows[-1])
    return rows


def draw_work_precision(rows: list[dict], path: Path) -> None:
    """Run time against error; what misses an impact stands on the right edge."""
    markers = dict(zip(("vijax", "heyoka", "scipy", "diffrax"), "*osd", strict=True))
    fig, axes = plt.subplots(1, len(SCENES), figsize=(11, 3.6), sharey=True, layout="constrained")
    for ax, scene in zip(axes, SCENES, strict=True):
        for method, marker in markers.items():
            chosen = [r for r in rows if r["scene"] == scene and r["method"] == method]
            error = [min(max(r["error"], 1e-16), 10.0) for r in chosen]
            ax.loglog(
                error, [r["min"] for r in chosen], marker, ls="-", label=method, ms=9 if marker == "*" else 5
            )
        ax.axvspan(1.0, 30.0, color="0.9")
        ax.text(2.0, 0.04, "an impact missed", rotation=90, transform=ax.get_xaxis_transform(), va="bottom")
        ax.set(title=SCENES[scene], xlabel="largest error of an impact time", xlim=(3e-17, 30.0))
    axes[0].set_ylabel("run time / s")
    axes[-1].legend(loc="lower left")
    fig.savefig(path, dpi=150)
    plt.close(fig)


def installed(make: Callable):
    """What `make` returns, or None where a peer is not installed."""
    try:
        return make()
    except ImportError:
        return None


def say(row: dict) -> None:
    """Print one result."""
    print(
        "  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True
    )


def surroundings() -> dict:
    """Versions and processor."""
    packages = {}
    for name in ("vijax", "jax", "jaxlib", "numpy", "heyoka", "scipy", "diffrax"):
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = None
    model = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line][:1]
    cores = len(os.sched_getaffinity(0))
    return {"versions": packages, "processor": model, "cores": cores, "python": platform.python_version()}


PARTS = {f.__name__: f for f in (work_precision, sweeps, throughput, sizes, derivatives, chattering_lane)}


def main() -> None:
    """Run what is asked for and write it down."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--full", action="store_true", help="all sizes and more repeats")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--out", type=Path, default=Path("out"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results: dict = {"surroundings": surroundings()}
    for name in options.only:
        print(f"\n== {name}", flush=True)
        results[name] = PARTS[name](options.full)
        (options.out / "benchmark.json").write_text(json.dumps(results, indent=1))
        keys = list(dict.fromkeys(k for row in results[name] for k in row))
        lines = [",".join(keys), *(",".join(str(row.get(k, "")) for k in keys) for row in results[name])]
        (options.out / f"benchmark_{name}.csv").write_text("\n".join(lines) + "\n")
    if "work_precision" in results:
        draw_work_precision(results["work_precision"], options.out / "work_precision.png")


if __name__ == "__main__":
    main()
