"""The command `plot`."""

import argparse
from pathlib import Path
from typing import Any

import xarray as xr

from ..._branches.branch import Branch
from ..._sections.classify import classify
from ..._system.files import look_at, machine_of_table, read_table
from ..._system.spelling import did_you_mean
from ..._system.system import AnySystem
from ...plot._labels import swept_paths
from .datasets import is_machine, open_dataset
from .forces import add_allow_forces, allowed
from .pictures import check_picture, draw_to
from .values import assignment, numbers

_ABOUT = """
Draw the content of a file: a machine, the bifurcation diagram of a sweep over one quantity, the chart of one over two, a branch
of periodic orbits, basins, shares of them.
"""
_KINDS = ("bifurcation", "regions", "lyapunov", "impact_map", "branch", "basins", "shares")


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    parser = commands.add_parser("plot", help="draw the content of a file", description=_ABOUT)
    add = parser.add_argument
    add("file", type=Path, help="a machine, .toml or .json, or a dataset, .nc or .zarr")
    add("--out", type=Path, required=True, metavar="PICTURE", help="the picture: .png, .svg or .pdf")
    add("--kind", choices=_KINDS, help="the picture of vx.plot (what fits the dataset)")
    add("--stop", type=int, metavar="J", help="the stop whose impacts are drawn (all, a panel each)")
    add("--ordinate", default="velocity", metavar="NAME", help="velocity, relative velocity or phase of the impacts, "
        "or a quantity that the file has, as max_position")  # fmt: skip
    add("--mass", type=int, default=0, metavar="I", help="the mass whose quantity is drawn (0)")
    add(
        "--at",
        metavar="PATH=VALUE",
        action="append",
        default=[],
        help="draw the points nearest to this value",
    )
    add("--style", default="default", metavar="NAME", help="a style of matplotlib, as dark_background")
    add("--dpi", type=float, default=150.0)
    add_allow_forces(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Draw and write the picture."""
    check_picture(args.out)
    draw_to(args.out, lambda: figure_of_file(args), style=args.style, dpi=args.dpi)
    print(args.out)  # noqa: T201


# Kinds of pictures of the impacts of one stop.
_OF_ONE_STOP = ("bifurcation", "impact_map", "branch")


def figure_of_file(args: argparse.Namespace) -> None:
    """Draw the requested picture in a new figure."""
    from ... import plot  # imports matplotlib

    if is_machine(args.file):
        plot.machine(_machine_of(args))
        return
    ds = open_dataset(args.file)
    for text in args.at:
        path, value = assignment(text)
        if path not in ds.dims:
            dims = [str(dim) for dim in ds.dims]
            raise ValueError(
                f"--at {text}: the dataset has {', '.join(dims)}, but no `{path}`.{did_you_mean(path, dims)}"
            )
        ds = ds.sel({path: numbers(path, value)[0]}, method="nearest")
    kind = args.kind or _kind_of(ds)
    if args.stop is not None and kind not in _OF_ONE_STOP:
        raise ValueError(
            f"--stop {args.stop}: a picture `{kind}` is of all stops. Leave it out, or choose a kind of one stop: "
            f"--kind {' or '.join(_OF_ONE_STOP)}."
        )
    pictures = {
        "bifurcation": lambda: plot.bifurcation(ds, stop=args.stop, ordinate=args.ordinate, mass=args.mass),
        "regions": lambda: plot.regions(classify(ds)),
        "lyapunov": lambda: plot.lyapunov(ds),
        "impact_map": lambda: plot.impact_map(ds, args.stop),
        "branch": lambda: plot.branch(
            Branch(ds.load()), stop=args.stop or 0, ordinate=args.ordinate, mass=args.mass
        ),
        "basins": lambda: plot.basins(ds),
        "shares": lambda: plot.shares(ds),
    }
    try:
        pictures[kind]()
    except (KeyError, AttributeError) as error:
        raise ValueError(f"{args.file} is no dataset for a picture `{kind}`: it has no {error}.") from error


def _machine_of(args: argparse.Namespace) -> AnySystem:
    """The machine of a file; of a family, whose function makes it, if the modules of that are allowed."""
    table = read_table(args.file)
    if not args.allow_forces:
        return look_at(table, args.file)
    return machine_of_table(table, args.file, allowed(args, args.file))


def _kind_of(ds: xr.Dataset) -> str:
    """Default kind of picture of a dataset."""
    for kind, name in (("branch", "arclength"), ("basins", "label"), ("shares", "successor")):
        if name in ds:
            return kind
    if "result" not in ds:
        raise ValueError(
            "The dataset is none of a sweep, a branch, basins or shares: say with --kind what to draw."
        )
    swept = swept_paths(ds["result"])
    kinds = {0: "impact_map", 1: "bifurcation", 2: "regions"}
    if len(swept) not in kinds:
        raise ValueError(f"The sweep is over {', '.join(swept)}: choose one value of some, --at PATH=VALUE.")
    return kinds[len(swept)]
