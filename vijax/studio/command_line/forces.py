"""Which modules of forces a command may import."""

import argparse
import os
import sys
from pathlib import Path


def add_allow_forces(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--allow-forces",
        metavar="MODULE",
        action="append",
        default=[],
        help="import the force of the machine from this module, or one in it, found beside the file, where the command is "
        "called, or installed; it runs what stands there. Without it no file has anything imported but vijax.models",
    )


def allowed(asked: argparse.Namespace, file: Path) -> list[str]:
    """The modules that are allowed, found beside the file and where the command is called as well.

    Unless there are some, these folders stay out of Python's path: anything may lie there under the name of a package that is
    looked for and not installed.
    """
    for folder in (os.getcwd(), str(file.resolve().parent)) if asked.allow_forces else ():
        if folder not in sys.path:
            sys.path.append(folder)
    return asked.allow_forces
