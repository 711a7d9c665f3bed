"""The command `explore`."""

import argparse
from pathlib import Path
from typing import Any

from ..._jax.compilation_cache import keep_compiled
from ..._sweep.provenance import system_of
from .datasets import open_dataset
from .forces import add_allow_forces, allowed

_ABOUT = """
Look at a sweep in a browser: a click on its bifurcation diagram, or chart, shows the motion there, sliders change numbers of
the machine, buttons find the orbit there and follow its branch. The address of the page is printed, and holds what it shows. Needs the extra: pip install 'vijax[studio]'. Ctrl-C ends it.
"""


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    parser = commands.add_parser("explore", help="look at a sweep in a browser", description=_ABOUT)
    add = parser.add_argument
    add("file", type=Path, help="a dataset, .nc or .zarr")
    add("--port", type=int, default=0, help="of the page, http://localhost:PORT (any that is free)")
    add("--show", action=argparse.BooleanOptionalAction, default=True, help="open the browser")
    add("--ordinate", default="velocity", metavar="NAME", help="what the diagram shows at first: velocity of the impacts, or "
        "a quantity that the file has, as max_position")  # fmt: skip
    add("--dark", action="store_true", help="light on dark")
    add("--keep-compiled", action=argparse.BooleanOptionalAction, default=True,
        help="keep compiled programs for later (~/.cache/vijax)")  # fmt: skip
    add_allow_forces(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C."""
    from ..explorer.serve import serve  # imports Panel

    if args.keep_compiled:
        keep_compiled()
    ds = open_dataset(args.file).load()
    if args.allow_forces:
        system_of(ds, allow_forces=allowed(args, args.file))  # allows the force in this process
    serve(ds, port=args.port, show=args.show, dark=args.dark, ordinate=args.ordinate, file=str(args.file))
