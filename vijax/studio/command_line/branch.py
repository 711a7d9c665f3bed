"""The command `branch`."""

import argparse
from pathlib import Path
from typing import Any

from ..._branches.branch import Branch
from ..._branches.continuation import continuation
from ..._progress import Interrupted
from .datasets import write_dataset
from .machines import check_files, command_with_machine, machine_of
from .orbit import add_search, settled_orbit
from .pictures import draw_to
from .values import assignment, bounds_of

_ABOUT = """
Follow a periodic orbit along a parameter, both ways, with its bifurcations: vx.continuation without a program.

The branch begins at the orbit on which the machine settles, as `vijax orbit` finds it.
"""
_EXAMPLES = """
examples:
  vijax branch machine.toml --along forcing.frequency=0.7:1.0 --out branch.nc --picture branch.png
  vijax branch machine.toml --along stops[0].restitution=0.3:0.9 --out branch.nc --until pd,fold --step 0.01
"""


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    parser = command_with_machine(
        commands, "branch", "follow a periodic orbit along a parameter, into a file", _ABOUT, _EXAMPLES
    )
    add = parser.add_argument
    add("--along", metavar="PATH=LOW:HIGH", required=True, help="the parameter, and between which values")
    add("--out", type=Path, required=True, metavar="FILE", help="where the branch goes, .nc or .zarr")
    add_search(parser)
    add("--max-points", type=int, default=1000, metavar="N", help="most points in each direction (1000)")
    add("--step", type=float, metavar="LENGTH", help="longest step along the parameter (5 %% of the bounds)")
    add("--tolerance", type=float, metavar="SIZE", help="of Newton's method, at most 1e-8 (rounding)")
    add(
        "--until",
        metavar="KIND,...",
        help="end at the first bifurcation of one of these kinds, as fold,pd,gr",
    )
    add("--quantities", metavar="NAME,...", default="", help="more columns, as max_position,rms_velocity")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Follow the branch, print and write it."""
    path, given = assignment(args.along)
    bounds = bounds_of(path, given)
    check_files(args)
    system, _ = machine_of(args, args.changes, {path: sum(bounds) / 2})
    orbit = settled_orbit(args, system)
    try:
        branch = continuation(
            orbit,
            path,
            bounds,
            max_points=args.max_points,
            quantities=args.quantities.split(",") if args.quantities else (),
            stop=args.until.split(",") if args.until else None,
            step=args.step,
            tolerance=args.tolerance,
            progress=args.progress,
        )
    except Interrupted as stopped:
        _write(args, stopped.result)
        raise KeyboardInterrupt(f"Stopped; the part followed until then is in {args.out}.") from None
    _write(args, branch)
    print(branch)  # noqa: T201
    if args.picture:
        draw_to(args.picture, lambda: _draw(branch), style=args.style)


def _write(args: argparse.Namespace, branch: Branch) -> None:
    write_dataset(branch.points, args.out)


def _draw(branch: Branch) -> None:
    from ...plot._branch import branch as draw  # imports matplotlib

    draw(branch, stop=None if branch.points.sizes["stop"] > 1 else 0)
