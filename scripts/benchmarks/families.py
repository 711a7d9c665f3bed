"""Sweeps over the values of a family beside those by path, and under many records beside one."""

from functools import partial

import jax.numpy as jnp
import numpy as np

import vijax as vx

from .many import run_sweep
from .report import say
from .timing import in_turns, repeated

POINTS, PERIODS = 20_000, 50
SAMPLES, RECORDS = 2001, 100
_STEP = 0.01


def rotor(frequency, eccentricity=0.5, clearance=0.6):
    """A rotor with an unbalance, whose load grows with the square of its speed."""
    unbalance = vx.Harmonic([eccentricity * frequency**2], frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], unbalance, [vx.Stop(0, clearance, "upper", 0.7)])


def families(full: bool) -> list[dict]:
    """Time of a sweep by the values of a family, and by the paths of its machine."""
    clearances = np.linspace(0.3, 0.9, POINTS)
    runs = {
        "by path": partial(
            run_sweep, rotor(0.8), {"stops[0].position": clearances}, transient=0, record=PERIODS
        ),
        "of a family": partial(
            run_sweep, vx.Family(rotor, frequency=0.8), {"clearance": clearances}, transient=0, record=PERIODS
        ),
    }
    return _rows(runs, dict.fromkeys(runs, POINTS * PERIODS), "periods", 9 if full else 4)


def records(full: bool) -> list[dict]:
    """Time of a sweep under many records, each of which many machines share, and under one."""
    times, values = _STEP * np.arange(SAMPLES), _random_records()

    def shaken(index, clearance=0.1):
        acceleration = vx.Tabulated(times, values[jnp.asarray(index, int)])
        load = vx.base_excitation([1.0], acceleration=acceleration)
        return vx.ImpactSystem([1.0], [[0.3]], [[40.0]], load, [vx.Stop(0, clearance, "upper", 0.7)])

    family, machines = vx.Family(shaken, index=0), 1000 if full else 100
    gaps = {
        "one record": np.linspace(0.02, 0.2, machines * RECORDS),
        f"{RECORDS} records": np.linspace(0.02, 0.2, machines),
    }
    index = {"one record": np.zeros(1), f"{RECORDS} records": np.arange(RECORDS)}
    runs = {
        name: partial(
            vx.sweep,
            family,
            {"index": index[name], "clearance": gaps[name]},
            duration=_STEP * (SAMPLES - 1),
            progress=False,
        )
        for name in gaps
    }
    return _rows(runs, dict.fromkeys(runs, machines * RECORDS * SAMPLES), "samples", 3)


def _random_records():
    noise = np.cumsum(np.random.default_rng(0).standard_normal((RECORDS, SAMPLES)), axis=1)
    noise -= np.linspace(0, 1, SAMPLES) * noise[:, -1:]
    return jnp.asarray(3 * noise / np.abs(noise).max(axis=1, keepdims=True))


def _rows(runs: dict, work: dict[str, int], what: str, rounds: int) -> list[dict]:
    for run in runs.values():
        run()  # compiles
    timed, rows = in_turns({name: repeated(run) for name, run in runs.items()}, rounds), []
    first = next(iter(timed.values()))["min / s"]
    for name, seconds in timed.items():
        least = seconds["min / s"]
        row = {"method": name, what: work[name], **seconds}
        rows.append(row | {f"nanoseconds per {what[:-1]}": 1e9 * least / work[name], "ratio": least / first})
        say(rows[-1])
    return rows
