"""Measure vijax on a graphics card: sweeps of 10^4 to 10^7 points, and the errors of the golden scenes there.

    python scripts/accelerator.py                              # everything
    python scripts/accelerator.py --sizes 10000 --scenes none  # one size

Every line has a figure, its error against scenes solved to 36 digits, and the hardware; systems a second stand beside
what MPGOS publishes. Without a card it runs on the processor: `JAX_PLATFORMS=cpu` asks for that. Writes accelerator.json
and CSV files to out/.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks import accelerator, report


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument(
        "--sizes", nargs="+", type=count, default=list(accelerator.SIZES), help="numbers of points"
    )
    parser.add_argument("--lanes", type=count, help="trajectories at a time, in sweeps")
    parser.add_argument("--scenes", nargs="+", default=["all"], help='golden scenes, "all" or "none"')
    parser.add_argument("--out", type=Path, default=Path("out"))
    return parser.parse_args(given)


def count(text: str) -> int:
    """A whole number, one or more, as 10000 or 1e4."""
    number = float(text)
    if not number.is_integer() or number < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number, one or more, but is {text}")
    return int(number)


def main(given: Sequence[str] | None = None) -> dict:
    """Run what is asked for and write it down."""
    options = arguments(given)
    options.out.mkdir(parents=True, exist_ok=True)
    results: dict = {"surroundings": report.surroundings()}
    with accelerator.first_device():
        results["throughput"] = accelerator.throughput(options.sizes, options.lanes)
        if options.scenes != ["none"]:
            results["scenes"] = accelerator.scenes(None if options.scenes == ["all"] else options.scenes)
    report.write(results, options.out, "accelerator")
    return results


if __name__ == "__main__":
    main()
