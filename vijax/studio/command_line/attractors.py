"""The commands `attractors` and `basins`."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..._attractors.attractors import attractors
from ..._attractors.basins import basins
from ..._execution.settings import ExecutionSettings
from .datasets import write_dataset
from .machines import add_start, check_files, command_with_machine, machine_of, start_of
from .pictures import draw_to
from .values import RANGES, assignment, bounds_of, swept_values

_ATTRACTORS = """
Find the coexisting attractors of a machine, and how many random starts lead to each: vx.attractors without a program.
"""
_BASINS = """
Find which attractor each start of a grid leads to: vx.basins without a program.
"""
_EXAMPLES = {
    "attractors": """
examples:
  vijax attractors machine.toml --starts 500
  vijax attractors machine.toml --starts 500 --rng 1 --bounds=-0.3:0.3,-1:1 --out attractors.nc --picture section.png
""",
    "basins": """
examples:
  vijax basins machine.toml --over x0[0]=-0.3:0.3:100 --over v0[0]=-1:1:100 --out basins.nc --picture basins.png
""",
}


def add_to(commands: Any) -> None:
    """Add both commands and their options."""
    words = "find coexisting attractors from random starts"
    parser = command_with_machine(commands, "attractors", words, _ATTRACTORS, _EXAMPLES["attractors"])
    add = parser.add_argument
    add("--starts", type=int, default=200, metavar="N", help="number of random starts (200)")
    add(
        "--rng",
        type=int,
        default=0,
        metavar="NUMBER",
        help="a whole number, another one for other starts (0)",
    )
    add("--bounds", metavar="LOW:HIGH,...", help="bounds of the starts: of every position, then of every velocity "
        "(twice the motion from rest)")  # fmt: skip
    _add_common(parser)
    parser.set_defaults(run=run_attractors)
    words = "find the basins of attraction over a grid of starts"
    parser = command_with_machine(commands, "basins", words, _BASINS, _EXAMPLES["basins"])
    parser.add_argument("--over", metavar="PATH=VALUES", action="append", default=[],
        help=f"start quantities, x0[I] or v0[I], two or more: {RANGES}")  # fmt: skip
    add_start(parser)
    _add_common(parser)
    parser.set_defaults(run=run_basins)


def _add_common(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--out", type=Path, metavar="FILE", help="where the dataset goes, .nc or .zarr")
    add("--transient", type=int, default=100, metavar="N", help="forcing periods before recording (100)")
    add("--record", type=int, default=20, metavar="N", help="forcing periods that are recorded (20)")
    add("--cores", type=int, metavar="N", help="cores to use (all)")


def run_attractors(args: argparse.Namespace) -> None:
    """Find attractors, print and write them."""
    check_files(args)
    box = None if args.bounds is None else [bounds_of("--bounds", one) for one in args.bounds.split(",")]
    system, _ = machine_of(args, args.changes)
    found = attractors(system, args.starts, bounds=box, rng=args.rng, **_options(args))
    _write(args, found, f"{args.starts} starts")
    if args.picture:
        draw_to(args.picture, lambda: _draw_section(found), style=args.style)


def run_basins(args: argparse.Namespace) -> None:
    """Find basins, print the shares of the attractors, and write them."""
    check_files(args)
    if len(args.over) < 2:
        raise ValueError(
            "Say twice or more with --over over which starts: --over x0[0]=-0.3:0.3:100 --over v0[0]=-1:1:100."
        )
    grid = {path: swept_values(path, given) for path, given in map(assignment, args.over)}
    system, _ = machine_of(args, args.changes)
    x0, v0 = start_of(args, system)
    found = basins(system, grid, x0=x0, v0=v0, **_options(args))
    _write(args, found, " x ".join(str(len(values)) for values in grid.values()) + " starts")
    if args.picture:
        draw_to(args.picture, lambda: _draw_basins(found), style=args.style)


def _options(args: argparse.Namespace) -> dict[str, Any]:
    return {
        "transient": args.transient,
        "record": args.record,
        "settings": ExecutionSettings(cores=args.cores),
        "progress": args.progress,
    }


def _write(args: argparse.Namespace, found: xr.Dataset, of: str) -> None:
    """Print a line for each attractor, and write the dataset."""
    from ...plot._motions import label_of_motion, legend_title  # imports matplotlib
    from ...plot._percent import percent

    title = " ".join(legend_title(found).split())
    count = found.sizes["attractor"]
    print(f"{count} attractor{'' if count == 1 else 's'} of {of}; {title}")  # noqa: T201
    for k in range(count):
        one = found.isel(attractor=k)
        state = "stable" if one.is_stable else f"largest exponent {float(np.max(one.exponents)):.2g}"
        share = percent(float(one.share), float(one.share_error))
        print(f"  {k}  {label_of_motion(one):20}  {share:>14}  {state}")  # noqa: T201
    if args.out:
        write_dataset(found, args.out)


def _draw_section(found: xr.Dataset) -> None:
    from ...plot._section import section  # imports matplotlib

    section(found)


def _draw_basins(found: xr.Dataset) -> None:
    from ...plot._basins import basins as draw  # imports matplotlib

    draw(found)
