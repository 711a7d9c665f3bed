"""The command `precompile`."""

import argparse
from typing import Any

from ..._precompile.precompile import CALLS, checked_calls, writable_store
from ..._precompile.rehearsals import rehearse
from .forces import add_allow_forces
from .machines import add_machine, command_with_examples, machine_of

_ABOUT = """
Compile ahead of time what calls will need for a kind of machine: vx.precompile without a program.

Programs are kept in the user's folder for caches, or where VIJAX_PROGRAMS says, and found by all later processes, commands and
notebooks. The command returns when all is done.
"""
_EXAMPLES = """
examples:
  vijax precompile machine.toml
  vijax precompile machine.toml simulate sweep
  nice vijax precompile machines.py:rotor continuation &
"""


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    words = "compile ahead of time what calls will need"
    parser = command_with_examples(commands, "precompile", words, _ABOUT, _EXAMPLES)
    add_machine(parser)
    parser.add_argument("calls", nargs="*", metavar="CALL", help=f"{', '.join(CALLS)} (all of them)")
    add_allow_forces(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Make the programs in this process, and say which could not be made."""
    calls = checked_calls(args.calls or CALLS)
    writable_store()
    system, _ = machine_of(args, args.changes)
    failed = rehearse(system, calls)
    for call in calls:
        print(f"{call}: {failed.get(call, 'done')}")  # noqa: T201
    if failed:
        raise RuntimeError("Not all programs are made: see above.")
