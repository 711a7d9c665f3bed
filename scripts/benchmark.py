"""Measure vijax beside what one would take instead: run time against error, throughput, size, first result.

    python scripts/benchmark.py               # quick: about five minutes on two cores
    python scripts/benchmark.py --full        # everything, all sizes: about forty
    python scripts/benchmark.py --only sweeps derivatives
    python scripts/benchmark.py --first       # where the CPU time of first results goes, call by call: about ten
    python scripts/benchmark.py --only masses --full --beside other/benchmark.json   # two releases of JAX

Writes benchmark.json, CSV files and pictures to out/, and prints the table of the README. Errors are
against scenes solved to 36 digits (tests/data/golden), never against vijax. Compilation and runs are
timed apart; of repeated runs the minimum and the median are given, and what is compared runs in turns,
because machines are noisy. Peers that are not installed are left out; `pip install '.[bench]'` brings
them, and the C++ programs are built where there is a compiler.
"""

import argparse
import json
import time
from pathlib import Path

from benchmarks import (
    accelerator,
    attractors,
    branches,
    closed_form,
    cluster,
    contacts,
    convergence,
    duffing,
    families,
    first,
    friction,
    many,
    orbits,
    pictures,
    report,
    single,
    sizes,
    waits,
)

PARTS = {
    part.__name__: part
    for part in (
        single.work_precision, many.sweeps, many.carried_sweeps, many.solver_sweeps, many.work, many.throughput,
        sizes.masses, sizes.stops, first.first_results, many.chattering_point, single.derivatives, orbits.periodic_orbits,
        branches.branches, closed_form.closed_form, attractors.exponents, attractors.basins, contacts.contacts,
        friction.friction_sweeps, friction.friction_precision, duffing.duffing_sweeps, duffing.duffing_motions, convergence.convergence,
        convergence.batch_cost, families.families, families.records, cluster.executors, accelerator.accelerator,
    )
}  # fmt: skip


def main() -> None:
    """Run what is asked for and write it down."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--full", action="store_true", help="all sizes and more repeats")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument(
        "--first",
        nargs="*",
        metavar="CALL",
        choices=list(waits.CALLS),
        help="parts of the CPU time of first results alone, and their table; of some calls, or of all",
    )
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument(
        "--beside",
        nargs="+",
        type=Path,
        default=[],
        help="benchmark.json, or with --first first.json, of other releases of JAX, each a column",
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.first is not None:
        measure_waits(options.first, options.out, options.beside)
        return
    results: dict = {"surroundings": report.surroundings(), "seconds": {}}
    for name in options.only:
        print(f"\n== {name}", flush=True)
        start = time.perf_counter()
        results[name] = PARTS[name](options.full)
        results["seconds"][name] = time.perf_counter() - start
        report.write(results, options.out)
    others = [json.loads(path.read_text()) for path in options.beside]
    pictures.draw(results, options.out, *others)
    print("\n" + report.table(results, *others))


def measure_waits(calls: list[str], out: Path, beside: list[Path]) -> None:
    """Write first.json, and print the table of first results beside other releases of JAX."""
    others = [json.loads(path.read_text()) for path in beside]
    rows = waits.waits(calls)
    (out / "first.json").write_text(json.dumps(rows, indent=1))
    print("\n" + waits.table(rows, *others))


if __name__ == "__main__":
    main()
