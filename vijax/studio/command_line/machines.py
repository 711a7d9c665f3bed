"""Machines on the command line: the options that all commands share which compute something of one machine."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..._jax.compilation_cache import keep_compiled
from ..._system.files import machine_of_table, read_table
from ..._system.parameters import set_parameter
from ..._system.system import AnySystem, bound
from .datasets import check_target, is_machine
from .families import family_of_file, is_function
from .forces import add_allow_forces, allowed
from .pictures import check_picture
from .values import assignment, numbers, one_or_several

MACHINE = (
    "the machine, .toml or .json, as `vijax sweep --help` describes it; or FILE.py:FUNCTION, a function of numbers by name that "
    "returns a machine (vx.Family), which runs the file"
)


def command_with_examples(
    commands: Any, name: str, words: str, about: str, examples: str, **options: Any
) -> argparse.ArgumentParser:
    """Parser of a command whose help ends with examples."""
    how = {"formatter_class": argparse.RawDescriptionHelpFormatter, **options}
    return commands.add_parser(name, help=words, description=about, epilog=examples, **how)


def command_with_machine(
    commands: Any, name: str, words: str, about: str, examples: str
) -> argparse.ArgumentParser:
    """Parser of a command on one machine, with the options of the machine and of a picture."""
    parser = command_with_examples(commands, name, words, about, examples)
    add_machine(parser)
    add = parser.add_argument
    add("--picture", type=Path, metavar="PICTURE", help="draw the result too: .png, .svg or .pdf")
    add("--style", default="default", metavar="NAME", help="a style of matplotlib for it, as dark_background")
    add_run_options(parser)
    return parser


def add_machine(parser: argparse.ArgumentParser) -> None:
    """Add the machine and its changes."""
    add, words = parser.add_argument, "change the machine first"
    add("machine", type=Path, help=MACHINE)
    add("--set", metavar="PATH=VALUE", action="append", dest="changes", default=[], help=words)


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add what says how a command computes."""
    add, words = parser.add_argument, "keep compiled programs for later commands (~/.cache/vijax)"
    add("--keep-compiled", action="store_true", help=words)
    add("--progress", action=argparse.BooleanOptionalAction, default=sys.stderr.isatty(),
        help="show a bar (if a terminal looks on)")  # fmt: skip
    add_allow_forces(parser)


def check_files(args: argparse.Namespace) -> None:
    """Raise if the result or its picture cannot be written, before anything is computed."""
    if args.out:
        check_target(args.out)
    if args.picture:
        check_picture(args.picture)


def add_start(parser: argparse.ArgumentParser) -> None:
    """Add the options of a start."""
    add = parser.add_argument
    add("--x0", metavar="X,X,...", help="positions at the start (0); --x0=-0.1,0 if the first is negative")
    add("--v0", metavar="V,V,...", help="velocities at the start (0)")


def machine_of(
    args: argparse.Namespace, changes: list[str], varied: Mapping[str, float] | None = None
) -> tuple[AnySystem, dict[str, Any]]:
    """The machine or the family of a file with the changes of `--set`, and the tables of the file.

    `varied` has values for names of a family that are varied and may have no default.
    """
    pairs = [(path, one_or_several(path, value)) for path, value in map(assignment, changes)]
    if is_function(args.machine):
        system, table = family_of_file(args.machine, dict(varied or {}) | dict(pairs)), {}
        pairs = []
    elif is_machine(args.machine):
        table = read_table(args.machine)
        system = bound(machine_of_table(table, args.machine, allowed(args, args.machine)))
    else:
        raise ValueError(f"{args.machine} must be a machine, .toml or .json, or FILE.py:FUNCTION.")
    for path, value in pairs:
        system = set_parameter(system, path, value)
    if getattr(args, "keep_compiled", False):
        keep_compiled()
    return system, table


def start_of(args: argparse.Namespace, system: AnySystem) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities at the start, (n,) each."""
    found = []
    for name in ("x0", "v0"):
        text = getattr(args, name)
        values = np.zeros(system.num_masses) if text is None else numbers(name, text)
        if values.shape != (system.num_masses,):
            raise ValueError(
                f"--{name} must have a number for each of the {system.num_masses} masses, but is {text!r}."
            )
        found.append(values)
    return found[0], found[1]
