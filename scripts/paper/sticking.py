"""Figs. 10 to 12: sticking, impacts during sticking, and the exit boundary of the sticking region."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import vijax as vx
from vijax import plot

from .output import FREQUENCY, FREQUENCY_STEP, NUMBERS, announce, colors_of_the_paper, compare, ranges, save

# The paper prints neither frequency nor amplitude of Fig. 11. Least squares on the four times below gives
# this pair and others that meet them to 0.2 as well, with frequencies from 0.12 to 0.27: the times alone do
# not decide. Of those found in which mass 0 stays stuck through both impacts of mass 1, this fits best.
FIG_11 = {"frequency": 0.23257, "amplitude": 0.6763}
# Kind and stop of the events of Fig. 11: the paper's time, and the time after which to look for ours.
FIG_11_EVENTS = {
    "chatter of mass 0 starts": (vx.IMPACT, 0, "806.5", 805.5),
    "mass 0 sticks": (vx.STICK, 0, "approximately 810", 808.0),
    "impact of mass 1": (vx.IMPACT, 1, "just after 810", 809.0),
    "impact of mass 1 again": (vx.IMPACT, 1, "813.5", 812.0),
}
# Seven, as in Fig. 12; the paper prints the first and the last.
FIG_12_FREQUENCIES = (0.1, 0.15, 0.2, 0.25, 0.3, 0.33, 0.36)
_TRANSIENT = 30  # forcing periods


def fig10(out: Path, coarse: int = 1) -> None:
    """Case (b) at 0.2: both masses stick in each forcing period; close-up of mass 0."""
    sol = _settled(0.2, 2.0)
    stick, release = (_times(sol, 0, kind) for kind in (vx.STICK, vx.RELEASE))
    begin, end = stick[0], release[release > stick[0]][0]
    title = f"Fig. 10, case (b): stops at -0.3 and 0.1, $A_0$ = 0.5, $\\Omega$ = 0.2; {NUMBERS}"
    announce(title)
    both = [_both(sol, j) for j in range(2)]
    compare(
        [
            ("mass 0 in a forcing period", "complete chatter, then sticking", both[0]),
            ("mass 1 in a forcing period", "complete chatter, then sticking", both[1]),
            (
                "the close-up",
                "the motion of mass 1 is smooth",
                f"mass 0 is held from {begin:.4f} to {end:.4f}",
            ),
        ]
    )
    fig, axes = plt.subplots(2, figsize=(9, 6.5), layout="constrained")
    with colors_of_the_paper():
        plot.time_series(sol, ax=axes[0])
        plot.time_series(sol, span=(begin - 4.5, end + 2.0), ax=axes[1])
    for t in (begin, end):
        axes[1].axvline(t, color=plt.rcParams["text.color"], linestyle="--", linewidth=1.0)
    axes[1].get_legend().remove()
    axes[0].set_title("(a) both masses chatter and stick", loc="left")
    axes[1].set_title("(b) close-up; dashed: mass 0 sticks and is released", loc="left")
    fig.suptitle(title)
    save(fig, _curves(sol, 4001 // coarse), out / "fig10")


def fig11(out: Path, coarse: int = 1) -> None:
    """Stops at 0.31 and 0.31: impacts of mass 1 while mass 0 sticks."""
    stops = [vx.Stop(mass, 0.31, "upper", restitution=0.7) for mass in (0, 1)]
    load = vx.Harmonic([FIG_11["amplitude"], 0.0], FIG_11["frequency"])
    system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops)
    before = vx.simulate(system, 0.0, 800.0, max_events=0, throw=False)
    sol = vx.simulate(system, 800.0, 820.0, before.x1, before.v1)
    numbers = "$A_0$ = {amplitude}, $\\Omega$ = {frequency}".format(**FIG_11)
    title = f"Fig. 11: stops at 0.31 and 0.31, {numbers};\n{NUMBERS}"
    announce(title)
    print(
        "The paper does not print amplitude and frequency: they are fitted to its four times, one of several"
    )
    print("solutions")
    rows = []
    for name, (kind, stop, paper, after) in FIG_11_EVENTS.items():
        t = _times(sol, stop, kind)
        rows.append((name, f"t = {paper}", f"t = {t[t > after][0]:.2f}"))
    compare(rows)
    fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
    with colors_of_the_paper():
        plot.time_series(sol, ax=ax)
    ax.set_title(title, loc="left")
    save(fig, _curves(sol, 2001 // coarse), out / "fig11")


def fig12(out: Path, coarse: int = 1) -> None:
    """Case (b): the motion of mass 0 while mass 1 sticks, up to the exit boundary."""
    sols = [_from_release(frequency) for frequency in FIG_12_FREQUENCIES]
    fig, ax = plt.subplots(figsize=(9, 6), layout="constrained")
    plot.sticking_region(sols, stop=1, ax=ax)
    title = f"Fig. 12, case (b): motion of mass 0 while mass 1 sticks; {NUMBERS}"
    announce(title)
    boundary = [_line(sol) for sol in sols]
    compare(
        [
            ("at every release x_0' + 10 x_0 - 1 is", "0", f"0 to {max(map(abs, boundary)):.0e}"),
            ("mass 1 sticks", "Omega = 0.1 ... 0.36, not beyond", f"Omega = {_where_mass_1_sticks(coarse)}"),
        ]
    )
    print(
        "Sec. 4.5 says that sticking ends at Omega = 0.5, Sec. 4.6.2 at 0.36; the paper takes a mass as held"
    )
    print("once two impacts are closer than four time steps.")
    ax.set_title(title, loc="left")
    save(fig, pd.concat([_held_curve(sol) for sol in sols]), out / "fig12")


def _settled(frequency: float, num_periods: float) -> vx.Solution:
    """Case (b) on its attractor, from the start of a forcing period."""
    system, period = vx.models.wagg_bishop_b(frequency), 2 * np.pi / frequency
    begin = _TRANSIENT * period
    before = vx.simulate(system, 0.0, begin, max_events=0, throw=False)
    return vx.simulate(system, begin, begin + num_periods * period, before.x1, before.v1)


def _from_release(frequency: float) -> vx.Solution:
    """A forcing period of case (b) that starts where mass 1 is released."""
    sol = _settled(frequency, 1.5)
    begin = _times(sol, 1, vx.RELEASE)[0]
    x, v = sol.evaluate(begin)
    return vx.simulate(vx.models.wagg_bishop_b(frequency), begin, begin + 2 * np.pi / frequency + 1e-3, x, v)


def _times(sol: vx.Solution, stop: int, kind: int) -> np.ndarray:
    """When events of a kind happen at a stop."""
    log = sol.events
    return np.asarray(log.t)[(np.asarray(log.kind) == kind) & (np.asarray(log.stop) == stop)]


def _both(sol: vx.Solution, stop: int) -> str:
    """How often a mass chatters and sticks."""
    count = len(_times(sol, stop, vx.STICK))
    return f"sticks {count} times in 2 forcing periods, after {len(_times(sol, stop, vx.IMPACT))} impacts"


def _line(sol: vx.Solution) -> float:
    """How far from the paper's exit boundary mass 1 is released."""
    x, v = (float(a[0]) for a in sol.evaluate(_times(sol, 1, vx.RELEASE)[-1]))
    return v + 10 * x - 1


def _where_mass_1_sticks(coarse: int) -> str:
    """The frequencies at which it does, started from rest."""
    values = {FREQUENCY: FREQUENCY_STEP * np.arange(40, 881, coarse)}
    ds = vx.sweep(vx.models.wagg_bishop_b(1.0), values, progress=False)
    return ranges(ds.num_sticks.sel(stop=1) > 0)


def _curves(sol: vx.Solution, count: int) -> pd.DataFrame:
    """Positions and velocities at evenly spaced times and at those of the events."""
    # The padding of the log is kept until the end: one shape, so one compilation.
    events = np.nan_to_num(np.asarray(sol.events.t), nan=float(sol.t1))
    t = np.sort(np.append(np.linspace(float(sol.t0), float(sol.t1), count), events))
    x, v = (np.asarray(a) for a in sol.evaluate(t))
    curves = pd.DataFrame({"t": t, "x0": x[:, 0], "x1": x[:, 1], "v0": v[:, 0], "v1": v[:, 1]})
    return curves.drop_duplicates("t")


def _held_curve(sol: vx.Solution) -> pd.DataFrame:
    """What is drawn of one trajectory: mass 0 from the stick of mass 1 to its release."""
    begin, end = (float(_times(sol, 1, kind)[-1]) for kind in (vx.STICK, vx.RELEASE))
    curve = _curves(sol, 2001).query(f"{begin!r} <= t <= {end!r}")
    return curve.assign(frequency=float(sol.machine.frequency)).filter(["frequency", "t", "x0", "v0"])
