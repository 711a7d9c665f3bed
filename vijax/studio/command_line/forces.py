"""Modules of forces that a command may import."""

import argparse
import os
import sys
from pathlib import Path


def add_allow_forces(parser: argparse.ArgumentParser) -> None:
    """Add the option `--allow-forces`."""
    parser.add_argument(
        "--allow-forces",
        metavar="MODULE",
        action="append",
        default=[],
        help="import the force of the machine from this module, or one in it, found beside the file, where the command is "
        "called, or installed; it runs what stands there. Without it no file has anything imported but vijax.models",
    )


def allowed(args: argparse.Namespace, file: Path) -> list[str]:
    """The allowed modules; if any, the folders of the file and of the call are added to Python's path.

    Otherwise they stay out of it: they may contain anything under the name of a package that is not installed.
    """
    for folder in (os.getcwd(), str(file.resolve().parent)) if args.allow_forces else ():
        if folder not in sys.path:
            sys.path.append(folder)
    return args.allow_forces
