"""The command `vijax`: its subcommands, and the report of errors.

Errors of arguments or files end in one sentence and exit code 2, without a traceback. A traceback, with exit code 1, is
a defect of this program.
"""

import argparse
import sys
import warnings
from collections.abc import Sequence

import jax

from ..._dataset_attributes import version
from . import attractors, branch, explore, info, orbit, plot, precompile, sweep

_ABOUT = """
Vibro-impact machines: sweeps over parameters, periodic orbits, their branches, attractors and basins, pictures, an explorer, and programs compiled ahead of time, for files of machines (.toml, .json) and datasets
(.nc, .zarr). All is computed in 64-bit numbers.
"""
_WRONG, _STOPPED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: arguments after the name of the command; those of this process if omitted.

    Returns:
        The exit code: 0, 2 for an error of arguments or files, or 130 after Ctrl-C.
    """
    args = _parser().parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *rest: _report(args, f"warning: {message}")
        try:
            args.run(args)
        except (ValueError, OSError, RuntimeError) as error:
            _report(args, f"error: {error}")
            return _WRONG
        except KeyboardInterrupt as stopped:
            _report(args, str(stopped) or "Stopped.")
            return _STOPPED
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("vijax", description=_ABOUT)
    parser.add_argument("--version", action="version", version=f"vijax {version('vijax')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for command in (sweep, orbit, branch, attractors, info, plot, explore, precompile):
        command.add_to(commands)
    return parser


def _report(args: argparse.Namespace, sentence: str) -> None:
    print(f"vijax {args.command}: {sentence}", file=sys.stderr)  # noqa: T201
