"""Run one machine for ten million periods, and a hundred thousand machines in one process: no drift, no growth of memory.

python scripts/long_runs.py --periods 10000000 --machines 100000
"""

import argparse
import gc
import time

import jax
import numpy as np
import psutil
from random_machines.machines import draw_numbers, machine
from random_machines.shapes import draw_shape

import vijax as vx

# Forcing periods saved at the end of a run, over which its motion repeats, and those after which it is settled.
SAVED, SETTLED = 8, 1000
# Numbers of machines of one shape that are drawn at once, and of shapes.
AT_ONCE, SHAPES = 500, 12


def memory() -> float:
    """Memory of this process, in MiB."""
    gc.collect()
    return psutil.Process().memory_info().rss / 2**20


def long_run(system: vx.ImpactSystem, periods: int) -> None:
    """Compare the state after many periods with that after few, of a motion that repeats every period."""
    period = float(system.forcing.period)

    def states(count: int) -> tuple[np.ndarray, int]:
        ts = period * np.arange(count - SAVED, count + 1)
        sol = vx.simulate(system, 0.0, ts[-1], ts=ts, max_events=0, throw=False)
        return np.concatenate([sol.xs, sol.vs], axis=1), int(sol.num_steps)

    early, _ = states(SETTLED)
    before, start = memory(), time.perf_counter()
    late, steps = states(periods)
    # A saved time is rounded to half a spacing; velocities and accelerations are below 2.
    away, rounded = np.abs(late - early).max(), 2 * np.spacing(periods * period)
    print(
        f"{periods} periods, {steps} steps, {time.perf_counter() - start:.0f} s: the state differs by {away:.1e} from that after "
        f"{SETTLED} periods; rounding of the times {rounded:.1e}; memory {memory() - before:+.1f} MiB"
    )
    assert away <= 1e-11 + rounded


def many_machines(count: int) -> None:
    """Simulate machines of several shapes, each with numbers of its own, and print the memory as it goes."""
    start = time.perf_counter()
    for done in range(0, count, AT_ONCE):
        number = done // AT_ONCE
        shape = draw_shape(np.random.default_rng([11, number % SHAPES]), 2)
        numbers = draw_numbers(np.random.default_rng([12, number]), shape, AT_ONCE)
        for k in range(AT_ONCE):
            own = {name: value[k] for name, value in numbers.items()}
            end = 2 * np.pi / own["frequency"]
            vx.simulate(
                machine(shape, own),
                0.0,
                end,
                own["x0"],
                own["v0"],
                max_events=32,
                max_steps=5000,
                throw=False,
            )
        if (done // AT_ONCE + 1) % max(1, count // AT_ONCE // 10) == 0:
            seconds = time.perf_counter() - start
            print(f"{done + AT_ONCE} machines, {seconds:.0f} s, {memory():.0f} MiB", flush=True)


def main() -> None:
    """Both."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--periods", type=int, default=100_000)
    parser.add_argument("--machines", type=int, default=10_000)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    long_run(vx.models.wagg_bishop_b(0.2), options.periods)
    many_machines(options.machines)


if __name__ == "__main__":
    main()
