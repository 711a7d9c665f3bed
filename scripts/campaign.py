"""Make random machines over all that the library describes, check each without another code, and keep a tally.

    python scripts/campaign.py --hours 1 --out out/campaign

Rounds are numbered; each draws a shape of machine and the numbers of many machines of it, see `random_machines/`. A round
that is done is a line of `tally.jsonl` in the folder: the same command goes on where it was stopped or killed, and
several at once, with other `--first` and `--stride`, share the work. A failure is repeated by
`--round K`. With `--symmetric` the machines of a round are made symmetric. Half of the rounds, or the share `--degenerate`,
have machines with coincidences: equal masses, gaps of zero, starts at rest, see `random_machines/degenerate.py`. From round
10000 on machines may have wave forms, records, parametric stiffness and cubic springs as well, see `random_machines/extras.py`, from
round 20000 on they are rows of bodies in touch, with friction and compliant stops, see `random_machines/touching.py`. With
`--curves` bifurcations of that many machines of a round are followed in two parameters, and branches across the curves compared.
"""

import argparse
import json
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path

import jax
import numpy as np
from random_machines.curves import check_curves
from random_machines.degenerate import degenerate
from random_machines.extras import degenerate_extras, with_extras
from random_machines.families import check_family, check_sweep
from random_machines.machines import draw_numbers, own_numbers
from random_machines.motions import check_alone, check_motions
from random_machines.orbits import check_orbits, settled_orbits
from random_machines.other_ways import symmetric
from random_machines.runs import Failure
from random_machines.shapes import Shape, draw_shape
from random_machines.touching import touching_numbers, touching_shape

# Seed of all rounds.
SEED = 20261124
# Runs of a machine.
RUNS = 16
# Machines of a round whose orbits are searched for.
ORBITS = 64
# Machines of every fourth round of which derivatives are checked.
ALONE = 4
# First round of machines that may have wave forms, records, parametric and nonlinear forces as well.
EXTRAS = 10_000
# First round of rows of bodies in touch, whose motions alone are checked.
TOUCHING = 20_000
# Machines of a round that are swept and whose branches are followed, in every fourth round: their programs compile longest.
FAMILIES = 4


def draw(
    number: int, machines: int, most_masses: int, degenerates: float = 0.5
) -> tuple[Shape, dict[str, np.ndarray], np.random.Generator, bool]:
    """Machines of a round, the source of its further random numbers, and whether the machines have coincidences."""
    rng = np.random.default_rng([SEED, number])
    if number >= TOUCHING:
        shape = touching_shape(rng, most_masses)
        return shape, touching_numbers(rng, shape, machines), rng, True
    shape = draw_shape(rng, most_masses)
    numbers = draw_numbers(rng, shape, machines)
    is_degenerate = bool(rng.random() < degenerates)
    if is_degenerate:
        numbers = degenerate(rng, shape, numbers)
    if number >= EXTRAS:
        its_rng = np.random.default_rng([SEED, number, EXTRAS])
        shape, numbers = with_extras(its_rng, shape, numbers)
        if is_degenerate:
            numbers = degenerate_extras(its_rng, shape, numbers)
    return shape, numbers, rng, is_degenerate


def play(
    number: int,
    machines: int,
    most_masses: int,
    families: int = FAMILIES,
    sweeps: int = 0,
    curves: int = 0,
    *,
    is_symmetric: bool = False,
    degenerates: float = 0.5,
) -> dict:
    """One round: what it is, and what failed."""
    shape, numbers, rng, is_degenerate = draw(number, machines, most_masses, degenerates)
    if is_symmetric:
        shape, numbers = symmetric(shape, numbers)
    start = time.process_time()
    failures, compared = check_motions(shape, numbers, rng)
    if number % 4 == 0:
        failures += check_alone(shape, numbers, rng.integers(machines, size=ALONE).tolist())
    has_orbits = number < TOUCHING
    orbits = settled_orbits(shape, numbers, list(range(min(machines, ORBITS) if has_orbits else 0)))
    failures += check_orbits(shape, numbers, orbits)
    counts = Counter(orbits=len(orbits))
    has_branches = number % 4 == 3 and shape.is_periodic and has_orbits
    for k in range(min(machines, max(families, sweeps)) if has_branches else 0):
        given, its_rng = own_numbers(numbers, k), np.random.default_rng([SEED, number, k])
        faults, own = check_family(shape, given, its_rng) if k < families else check_sweep(shape, given)
        for name, excess in faults:
            failures.append(Failure(name, k, excess))
            print(f"round {number}, lane {k}: {name}", file=sys.stderr, flush=True)
        counts += own
    for k in range(min(machines, curves) if shape.is_periodic and has_orbits else 0):
        faults, own = check_curves(shape, own_numbers(numbers, k), np.random.default_rng([SEED, number, k]))
        for name, excess in faults:
            failures.append(Failure(name, k, excess))
            print(f"round {number}, lane {k}: {name}", file=sys.stderr, flush=True)
        counts += own
    return {
        "round": number,
        "symmetric": is_symmetric,
        "degenerate": is_degenerate,
        "shape": shape._asdict(),
        "machines": machines,
        "runs": RUNS * machines,
        "compared": compared,
        **counts,
        "failures": [failure._asdict() for failure in failures],
        "cpu_seconds": round(time.process_time() - start, 1),
    }


def summary(lines: list[dict]) -> str:
    """The tally in words."""
    kinds = Counter(failure["check"] for line in lines for failure in line["failures"])
    counted = (
        *("machines", "runs", "compared", "swept", "orbits", "branches", "points"),
        *("curves", "curve_points", "crossed", "cpu_seconds"),
    )
    total = {key: sum(line.get(key, 0) for line in lines) for key in counted}
    found = ", ".join(f"{kind}: {count}" for kind, count in kinds.most_common()) or "none"
    return (
        f"{len(lines)} shapes, {total['machines']} machines, {total['runs']} runs, {total['compared']} compared motions, "
        f"{total['swept']} points of sweeps, {total['orbits']} orbits, {total['branches']} branches of {total['points']} points, {total['curves']} curves of {total['curve_points']} points, {total['crossed']} crossed, {total['cpu_seconds'] / 3600:.2f} CPU hours; failures: {found}"
    )


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--hours", type=float, default=0.1, help="time after which no round begins")
    parser.add_argument("--machines", type=int, default=256, help="machines of a round")
    parser.add_argument("--masses", type=int, default=6, help="most masses of a machine")
    parser.add_argument(
        "--families",
        type=int,
        default=FAMILIES,
        help="machines of every fourth round whose branches are followed",
    )
    parser.add_argument(
        "--sweeps", type=int, default=0, help="machines of every fourth round that are swept, if more"
    )
    parser.add_argument(
        "--curves", type=int, default=0, help="machines of every round whose bifurcations are followed"
    )
    parser.add_argument("--symmetric", action="store_true", help="make the machines symmetric")
    parser.add_argument(
        "--degenerate", type=float, default=0.5, help="share of the rounds whose machines have coincidences"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--stride", type=int, default=1, help="step between the rounds of this process")
    parser.add_argument("--round", type=int, help="play this round alone, and print it")
    parser.add_argument("--out", type=Path, default=Path("out/campaign"), help="folder of the tally")
    return parser.parse_args(words)


def main() -> None:
    """Play rounds until the time is over."""
    options = arguments()
    jax.config.update("jax_enable_x64", True)
    play_round = partial(
        play,
        machines=options.machines,
        most_masses=options.masses,
        families=options.families,
        sweeps=options.sweeps,
        curves=options.curves,
        is_symmetric=options.symmetric,
        degenerates=options.degenerate,
    )
    if options.round is not None:
        print(json.dumps(play_round(options.round), indent=1))
        return
    options.out.mkdir(parents=True, exist_ok=True)
    tally = options.out / "tally.jsonl"
    lines = [json.loads(line) for line in tally.read_text().splitlines()] if tally.exists() else []
    done = {line["round"] for line in lines if line.get("symmetric", False) == options.symmetric}
    number, until = options.first, time.time() + 3600 * options.hours
    while time.time() < until:
        if number not in done:
            lines.append(play_round(number))
            with tally.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
            print(summary(lines), flush=True)
            jax.clear_caches()
        number += options.stride
    print(summary(lines))


if __name__ == "__main__":
    main()
