"""Tables 2 and 3: the motions of both cases at eight frequencies, coexisting ones told apart."""

import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import vijax as vx

from .output import FREQUENCY, NUMBERS, save_table

# Frequency: what the paper says of mass 0 and of mass 1 (its masses 1 and 2), and what is to be said about it.
TABLE_2 = {
    0.2: ("period 1", "period 1", ""),
    0.4: ("period 1", "period 2", ""),
    0.8: ("period 1", "period 1", ""),
    1.0: ("period 1", "no impact", "the paper's columns are exchanged: mass 1 impacts, mass 0 does not"),
    1.2: ("no impact", "no impact", ""),
    1.4: ("chaotic", "chaotic", "a chaotic transient of some 100 periods, then no impact"),
    1.5: ("period 2", "period 2", "the motion repeats after five forcing periods, slowly reached"),
    1.8: ("period 1", "no impact", "two motions coexist; neither has an impact in every forcing period"),
}
TABLE_3 = {
    0.3: ("period infinity", "period infinity", "mass 0 just fails to stick: its last impact is at 0.0012"),
    0.5: ("chatter / P4", "chatter / P4", ""),
    0.8: ("period 2", "period 2", "doubled: the 2 impacts per forcing period alternate"),
    1.1: ("period 2", "period 3", "the paper's 2 and 3 impacts take two forcing periods"),
    1.4: ("period 1", "period 1", ""),
    1.7: ("P1 / chaotic", "P1 / chaotic", "both coexist"),
    2.0: ("P1 / chaotic", "P1 / chaotic", "both coexist"),
    2.1: ("chaotic / P1", "chaotic / P1", "both coexist"),
}
# The paper discards 100 forcing periods; some motions take far longer to settle.
SHORT, LONG = 100, 2000


def table2(out: Path, coarse: int = 1) -> None:
    """Case (a): the motions at eight frequencies, beside Table 2."""
    title = f"Table 2, case (a), $A_0$ = 0.3 as in the captions (Sec. 4.2 of the paper prints 0.5); {NUMBERS}"
    _table(vx.models.wagg_bishop_a(1.0), TABLE_2, title, out / "table2", 64 // coarse)


def table3(out: Path, coarse: int = 1) -> None:
    """Case (b): the motions at eight frequencies, beside Table 3."""
    title = f"Table 3, case (b), $A_0$ = 0.5; {NUMBERS}"
    _table(vx.models.wagg_bishop_b(1.0), TABLE_3, title, out / "table3", 64 // coarse)


def random_starts(system: vx.ImpactSystem, count: int) -> np.ndarray:
    """Positions at rest on the free sides of the stops, (starts, masses); the first is that without load."""
    low, high = np.full((2, system.num_masses), [[-1.0], [1.0]])
    for stop in system.stops:
        for mass in stop.coefficients:  # one, of a stop
            (high if stop.sign > 0 else low)[mass] = stop.position
    starts = np.random.default_rng(0).uniform(low, high, (count, len(low)))
    starts[0] = 0.0
    return starts


def from_many_starts(
    system: vx.ImpactSystem, frequencies: list[float], count: int, transient: int
) -> xr.Dataset:
    """A sweep over frequencies and random starts, of which the first is at rest."""
    values = {FREQUENCY: np.array(frequencies), "x0": random_starts(system, count)}
    return vx.sweep(system, values, transient=transient, progress=False)


def classes_of(ds: xr.Dataset, double_impact_within: float | None = None) -> xr.Dataset:
    """`vx.classify`; the sweep has said already how many motions have not settled."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".* motions have not settled")
        return vx.classify(ds, double_impact_within=double_impact_within)


def is_kind(motions: xr.Dataset, kind: str) -> xr.DataArray:
    """Where the motion is of a kind, "periodic", "non_periodic", ..."""
    return motions.motion == motions.motion.attrs["flag_meanings"].split().index(kind)


def words(motions: xr.Dataset) -> list[tuple[str, ...]]:
    """Describe the motion of either mass at each start of one frequency: 'm in n', 'no impact', ..."""
    kinds = motions.motion.attrs["flag_meanings"].split()
    table = zip(motions.motion.values, motions.num_periods.values, motions.num_impacts.values, strict=True)
    return [tuple(_words_of_mass(kinds[kind], n, m) for m in counts) for kind, n, counts in table]


def _words_of_mass(kind: str, num_periods: int, num_impacts: float) -> str:
    if num_periods == 0:
        return kind.replace("non_", "non-").replace("_", " ")
    return f"{num_impacts:.0f} in {num_periods}" if num_impacts else "no impact"


def _table(
    system: vx.ImpactSystem, paper: dict[float, tuple[str, str, str]], title: str, path: Path, count: int
) -> None:
    """List the motions found at each frequency with how many of the starts reach them."""
    early, late = (
        vx.classify(from_many_starts(system, list(paper), count, transient)) for transient in (SHORT, LONG)
    )
    rows = []
    for frequency, said in paper.items():
        found = Counter(words(late.sel({FREQUENCY: frequency})))
        is_early = (early.sel({FREQUENCY: frequency}).num_periods > 0).sum()
        first = (str(frequency), f"{int(is_early)}"), said
        for motion, reached in found.most_common():
            (name, settled), beside = first
            rows.append((name, settled, reached, *motion, *beside))
            first = ("", ""), ("", "", "")
    columns = ["Omega", f"repeat after {SHORT}", "starts", "mass 0", "mass 1"]
    columns += ["paper: mass 0", "paper: mass 1", "note"]
    print(f"{count} starts at each frequency, at random positions at rest, {LONG} forcing periods before 20")
    print(
        f"that are looked at; 'repeat after {SHORT}' is how many starts do so after as many periods as in the"
    )
    print(
        "paper. 'm in n' is m impacts in n forcing periods, 'inf' a complete chatter that ends in sticking."
    )
    save_table(pd.DataFrame(rows, columns=columns), title, path, left_out=[columns[1]])
