"""The command `orbit`, and the search for the orbit on which a machine settles."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ..._orbits.orbit import PeriodicOrbit
from ..._orbits.periodic_orbit import periodic_orbit
from ..._system.system import AnySystem
from ..._trajectory.simulate import simulate_all
from .datasets import write_dataset
from .machines import add_start, check_files, command_with_machine, machine_of, start_of
from .pictures import draw_to

_ABOUT = """
Find a periodic orbit of a machine: vx.periodic_orbit without a program.

The machine runs from its start until it settles. The orbit there is solved to rounding and printed, with its stability
and its events.
"""
_EXAMPLES = """
examples:
  vijax orbit machine.toml
  vijax orbit machine.toml --set forcing.frequency=0.9 --picture orbit.png
  vijax orbit machine.toml --periods 2 --transient 0 --x0=0.18,0.09 --v0=0.33,0.52 --out orbit.nc   # near a guess
"""
# Numbers of periods that are tried unless one is requested.
_MOST_PERIODS = 8


def add_to(commands: Any) -> None:
    """Add the command and its options."""
    parser = command_with_machine(
        commands, "orbit", "find the periodic orbit on which a machine settles", _ABOUT, _EXAMPLES
    )
    add_search(parser)
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="where the orbit goes as a dataset, .nc or .zarr"
    )
    parser.set_defaults(run=run)


def add_search(parser: argparse.ArgumentParser) -> None:
    """Add the options of the search for an orbit."""
    add_start(parser)
    parser.add_argument("--periods", type=int, metavar="N", help="forcing periods after which it repeats "
        f"(the fewest of 1 to {_MOST_PERIODS} with a stable orbit)")  # fmt: skip
    parser.add_argument(
        "--transient", type=int, default=200, metavar="N", help="forcing periods before the search (200)"
    )


def run(args: argparse.Namespace) -> None:
    """Find the orbit, print it, and write what is requested."""
    check_files(args)
    system, _ = machine_of(args, args.changes)
    orbit = settled_orbit(args, system)
    print(orbit)  # noqa: T201
    if args.out:
        write_dataset(orbit.to_xarray(), args.out)
    if args.picture:
        draw_to(args.picture, lambda: _draw(orbit), style=args.style)


def settled_orbit(args: argparse.Namespace, system: AnySystem) -> PeriodicOrbit:
    """The orbit on which a machine settles from its start.

    Raises:
        ValueError: if there is none of so many periods.
    """
    if args.transient < 0:
        raise ValueError(f"--transient must be 0 or more, but is {args.transient}.")
    if args.periods is not None and args.periods < 1:
        raise ValueError(f"--periods must be 1 or more, but is {args.periods}.")
    x, v = start_of(args, system)
    if args.transient:
        # The log is not needed; that it is full says nothing of the motion.
        span = args.transient * system.forcing.period
        sol = simulate_all(system, 0.0, span, x, v, max_events=1, throw=False)
        x, v = np.asarray(sol.x1), np.asarray(sol.v1)
        if not np.isfinite([x, v]).all():
            raise ValueError(f"The machine does not run through {args.transient} periods from this start.")
    if args.periods is not None:
        return periodic_orbit(system, x, v, args.periods)
    for num_periods in range(1, _MOST_PERIODS + 1):
        orbit = periodic_orbit(system, x, v, num_periods, throw=False)
        if orbit.is_stable and orbit.is_admissible:
            return orbit
    raise ValueError(
        f"The machine settles on no stable orbit of 1 to {_MOST_PERIODS} periods after {args.transient} periods: raise "
        "--transient, choose another start, or say with --periods which orbit is wanted, stable or not."
    )


def _draw(orbit: PeriodicOrbit) -> None:
    import matplotlib.pyplot as plt

    from ...plot._trajectories import phase_portrait  # imports matplotlib

    count = orbit.system.num_masses
    _, panels = plt.subplots(1, count, figsize=(4.2 * count, 3.6), squeeze=False, layout="constrained")
    for mass, ax in enumerate(panels[0]):
        phase_portrait(orbit, mass, ax=ax)
