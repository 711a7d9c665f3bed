"""The command `sweep`."""

import argparse
from pathlib import Path
from typing import Any

from ..._execution.settings import ExecutionSettings
from ..._progress import interrupt_with_word_of
from ..._sweep.sweep import sweep
from ..._system.spelling import did_you_mean
from .datasets import check_target, open_dataset, write_dataset
from .machines import add_machine, add_run_options, add_start, command_with_examples, machine_of
from .values import RANGES, assignment, numbers, swept_values

_ABOUT = """
Run a machine over a grid of parameter values, and keep the dataset in a file: vx.sweep without a program.

What is swept, and how, stands on the command line, or in a table `sweep` of the machine's file; the command line counts
more. The computation is in 64-bit numbers, on all cores.
"""
_EXAMPLES = """
a machine, machine.toml:                        vx.save(system, "machine.toml") writes one
  mass = [1.0]
  damping = [[0.1]]
  stiffness = [[1.0]]
  stops = [{mass = 0, side = "upper", position = 0.3, restitution = 0.7}]
  # force = "package.module:function"           with args = [...] for what it is passed, and --allow-forces package
  [forcing]
  amplitude = [0.6]
  frequency = 0.8
  [sweep]                                       may be left out; every option below by its name
  carry = "both"
  over = {"forcing.frequency" = "0.5:2:1000"}

examples:
  vijax sweep machine.toml --out sweep.nc
  vijax sweep machine.toml --out sweep.nc --over forcing.frequency=0.5:2:1000 --over 'forcing.amplitude[0]=0.2,0.3'
  vijax sweep machine.toml --out sweep.zarr --store kept --transient 1000   # killed and called again, it goes on
  vijax sweep machines.py:rotor --out sweep.nc --sweep frequency=0.5:1.5:1000   # rotor(frequency, ...) returns a machine
"""
_STARTS = ("x0", "v0")
_TIMES = "ts"


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    words = "run a machine over a grid of parameter values, into a file"
    only_given = {"argument_default": argparse.SUPPRESS}
    parser = command_with_examples(commands, "sweep", words, _ABOUT, _EXAMPLES, **only_given)
    add_machine(parser)
    add = parser.add_argument
    add("--out", metavar="FILE", help="where the dataset goes, .nc or .zarr; replaced if it is there")
    add(
        "--over",
        "--sweep",
        dest="over",
        metavar="PATH=VALUES",
        action="append",
        help=f"what is swept: {RANGES}; several make a grid",
    )
    add("--transient", type=int, metavar="N", help="forcing periods before recording (100)")
    add("--record", type=int, metavar="N", help="forcing periods that are recorded (20)")
    add("--duration", type=float, metavar="TIME", help="follow motions from their start for this time, "
        "in place of --transient and --record")  # fmt: skip
    add("--ts", metavar="VALUES", help=f"with --duration, times at which states are saved: {RANGES}")
    add("--carry", choices=("up", "down", "both"), help="start every point where the one before it ended")
    add("--carry-from", metavar="FILE", help="go on from the end states of an earlier sweep")
    add_start(parser)
    add("--lyapunov", action="store_true", help="compute all Lyapunov exponents too")
    add("--quantities", metavar="NAME,...", help="more variables, as max_position,rms_velocity")
    add("--max-impacts", type=int, metavar="N", help="room for the recorded impacts of one point (2048)")
    add("--max-steps", type=int, metavar="N", help="bound on the steps of one point")
    add("--store", metavar="FOLDER", help="keep finished points there: the same command goes on from them, and "
        "several at once share the work")  # fmt: skip
    add("--cores", type=int, metavar="N", help="cores to use (all)")
    add_run_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Sweep and write the dataset."""
    typed = dict(assignment(text) for text in getattr(args, "over", []))
    first = {path: float(swept_values(path, given).flat[0]) for path, given in typed.items()}
    system, table = machine_of(args, args.changes, first)
    options = _options(table.get("sweep", {}), vars(args), str(args.machine))
    if "out" not in options:
        raise ValueError("Say with --out in which file the dataset goes, .nc or .zarr.")
    out = Path(options.pop("out"))
    check_target(out)
    settings = ExecutionSettings(cores=options.pop("cores", None))
    with interrupt_with_word_of(options.get("store"), "--store FOLDER", "command"):
        ds = sweep(system, options.pop("over"), **options, settings=settings, progress=args.progress)
    write_dataset(ds, out)
    print(f"{out}: {' x '.join(str(n) for n in ds['result'].shape)} points")  # noqa: T201


def _options(table: Any, typed: dict[str, Any], file: str) -> dict[str, Any]:
    """Arguments of `vx.sweep`: those of the file, overridden by those of the command line."""
    known = (
        "over",
        "transient",
        "record",
        "duration",
        _TIMES,
        "carry",
        *_STARTS,
        "lyapunov",
        "quantities",
        "max_impacts",
        "max_steps",
        "out",
        "store",
        "carry_from",
        "cores",
    )
    if not isinstance(table, dict) or not isinstance(table.get("over", {}), dict):
        raise ValueError(f"{file}: `sweep` and `sweep.over` must be tables.")
    unknown = [name for name in table if name not in known]
    if unknown:
        raise ValueError(
            f"{file}: `sweep` has `{unknown[0]}`, which is not known: there are {', '.join(known)}."
            f"{did_you_mean(unknown[0], known)}"
        )
    over = table.get("over", {}) | dict(assignment(text) for text in typed.get("over", []))
    if not over:
        raise ValueError(
            "Say what is swept: --over forcing.frequency=0.5:2:1000, or a table `sweep.over` in the file."
        )
    options = table | {name: typed[name] for name in known if name in typed}
    options["over"] = {path: swept_values(path, given) for path, given in over.items()}
    for name in _STARTS:
        if name in options:
            given = options[name]
            options[name] = numbers(name, given) if isinstance(given, str) else swept_values(name, given)
    if _TIMES in options:
        options[_TIMES] = swept_values(_TIMES, options[_TIMES])
    if isinstance(options.get("quantities"), str):
        options["quantities"] = options["quantities"].split(",")
    if "carry_from" in options:
        options["carry_from"] = open_dataset(Path(options["carry_from"]))
    if not isinstance(options.get("lyapunov", False), bool):
        raise ValueError(f"{file}: `sweep.lyapunov` must be true or false.")
    return options
