"""Every analysis on every kind of machine: it gives the numbers of the same machine written in another way, or says why not.

The table of `docs/explanation/combinations.md` is what these tests hold.
"""

import functools
import inspect
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from combinations import FREQUENCY, KINDS, POSITION

import vijax as vx
from vijax.studio.command_line.main import main

mpl.use("Agg")

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "combinations.md"
# Errors of a step with a force, of a trajectory, of what Newton's method finds, and of maxima and means of samples.
STEP, ROUNDING, FOUND, SAMPLED = 1e-12, 1e-10, 1e-9, 1e-6
QUIET = {"progress": False}
# A position that the mass passes.
PLACE = -0.05
# Bounds within which the orbit doubles its period, and loses its impact.
BOUNDS = 2.1, 2.5


class Asked:
    """A kind of machine, its twin, and the answers that others are held against."""

    def __init__(self, name):
        self.kind = KINDS[name]
        self.machine = self.of(FREQUENCY, POSITION)
        system = self.machine.system if isinstance(self.machine, vx.Family) else self.machine
        self.num_masses = system.num_masses
        self.period = 1.0 if system.forcing.why_not_periodic else float(system.forcing.period)

    def of(self, frequency, position):
        return self.kind.of(frequency, position)

    def twin_run(self, duration, frequency=FREQUENCY, position=POSITION):
        return vx.simulate(self.kind.twin(frequency, position), 0.0, duration, max_events=1024)

    def twin_orbit(self, orbit, frequency=FREQUENCY, position=POSITION):
        """The orbit of the twin near the start of an orbit, whose sliders it finds."""
        x0, v0 = self.masses_of(orbit)
        return vx.periodic_orbit(self.kind.twin(frequency, position), x0, v0, orbit.num_periods)

    def masses_of(self, orbit):
        """Start of the masses on an orbit, without Jenkins elements."""
        return tuple(np.asarray(a)[: self.num_masses] for a in (orbit.x0, orbit.v0))

    @functools.cached_property
    def orbit(self):
        sol = vx.simulate(self.machine, 0.0, 200 * self.period, max_events=4096)
        return vx.periodic_orbit(self.machine, sol.x1, sol.v1)

    @functools.cached_property
    def branch(self):
        return vx.continuation(self.orbit, self.kind.frequency, BOUNDS, **QUIET)

    def check_doubling(self, frequency, position=POSITION):
        """The twin has a multiplier of -1 there."""
        orbit = self.twin_orbit(self.branch.orbit(self.point("pd").index), frequency, position)
        close(np.min(np.abs(np.asarray(orbit.multipliers) + 1)), 0.0, 1e-7)

    def point(self, kind):
        return next(one for one in self.branch.bifurcations if one.kind == kind)


def close(one, other, tolerance=ROUNDING):
    np.testing.assert_allclose(one, other, rtol=0, atol=tolerance)


def multipliers_of(orbit):
    """The two multipliers of the first mass: those of others, and of friction at rest, are 0 or decay."""
    return np.sort(np.abs(orbit.multipliers))[::-1][:2]


def frequency_of(orbit):
    """Frequency of the load of an orbit's machine."""
    system = orbit.system.system if isinstance(orbit.system, vx.Family) else orbit.system
    return 2 * np.pi / float(system.forcing.period)


def ask_simulate(asked):
    sol, twin = vx.simulate(asked.machine, 0.0, 20.0), asked.twin_run(20.0)
    close(sol.x1, twin.x1)
    close(sol.v1, twin.v1)
    for t in (3.3, 17.0):
        close(sol.evaluate(t)[0], twin.evaluate(t)[0])


def ask_derivatives(asked):
    def end(position):
        return vx.simulate(asked.of(FREQUENCY, position), 0.0, 10.0).x1[0]

    slope, step = jax.jit(jax.jacfwd(end))(POSITION), 1e-6
    close(jax.grad(end)(POSITION), slope, 1e-9)
    ends = jax.vmap(end)(jnp.asarray([POSITION - step, POSITION + step]))
    close(slope, (ends[1] - ends[0]) / (2 * step), 1e-5)


def check_quantities(asked, found, twin, begin, parts=1):
    """Quantities of one point of a sweep are those of the twin since a time, summed in `parts`."""
    end = float(twin.t1)
    log, hits = twin.events, np.asarray(twin.events.t)
    is_late = (hits > begin) & (hits < end)
    ts = np.sort(np.concatenate([np.linspace(begin, end, 20001), hits[is_late]]))
    x = np.asarray(twin.evaluate(ts)[0])
    n = asked.num_masses
    close(found.max_position[:n], x.max(axis=0), SAMPLED)
    close(found.rms_position[:n] ** 2, np.trapezoid(x**2, ts, axis=0) / (end - begin), SAMPLED)
    is_ours = is_late & (np.asarray(log.kind) == vx.IMPACT) & (np.asarray(log.stop) == 0)
    close(found.impact_rate[0], np.count_nonzero(is_ours) / (end - begin))
    first = twin.evaluate(begin + (end - begin) / parts if parts > 1 else begin)[0]
    span = (end - begin) * ((parts - 1) / parts if parts > 1 else 1)
    close(found.mean_velocity[:n], (twin.x1 - first) / span)
    if "impulse" in found:
        close(found.impulse[..., 0].sum(), np.abs(np.asarray(log.impulse)[is_ours]).sum())


def quantities_of(asked):
    """Quantities that every machine has, and the impulse where no rigid contact joins masses."""
    machine = asked.machine.system if isinstance(asked.machine, vx.Family) else asked.machine
    has_contact = any(isinstance(stop, vx.Contact) for stop in machine.stops)
    names = ["max_position", "rms_position", "impact_rate", "mean_velocity"]
    return names if has_contact else [*names, "impulse"]


def ask_sweep(asked):
    values = {asked.kind.frequency: [2.0, FREQUENCY]}
    found = vx.sweep(asked.machine, values, transient=20, record=2, quantities=quantities_of(asked), **QUIET)
    for k, frequency in enumerate(values[asked.kind.frequency]):
        period = 2 * np.pi / frequency
        twin = asked.twin_run(22 * period, frequency)
        close(found.x.values[k, : asked.num_masses], twin.x1)
        check_quantities(asked, found.isel({asked.kind.frequency: k}), twin, 20 * period, 2)


def ask_duration(asked):
    values = {asked.kind.position: [POSITION, 0.2]}
    found = vx.sweep(
        asked.machine, values, duration=10.0, ts=[5.0, 10.0], quantities=quantities_of(asked), **QUIET
    )
    for k, position in enumerate(values[asked.kind.position]):
        twin = asked.twin_run(10.0, position=position)
        close(found.xs.values[k, :, : asked.num_masses], [twin.evaluate(5.0)[0], twin.x1])
        check_quantities(asked, found.isel({asked.kind.position: k}), twin, 0.0)


def ask_ensemble(asked):
    spread = {asked.kind.position: scipy.stats.uniform(0.08, 0.04)}
    found = vx.ensemble(asked.machine, spread, samples=4, rng=1, duration=10.0, ts=[10.0], **QUIET)
    for k in range(4):
        twin = asked.twin_run(10.0, position=float(found[asked.kind.position][k]))
        close(found.xs.values[k, -1, : asked.num_masses], twin.x1)


def ask_maps(asked):
    rest = np.zeros(asked.num_masses)
    twin = asked.twin_run(20.0)
    is_hit = (np.asarray(twin.events.kind) == vx.IMPACT) & (np.asarray(twin.events.stop) == 0)
    for number in (1, 2):
        t, _, v = vx.next_impact(asked.machine, 0.0, rest, rest, 0, number, t1=20.0)
        k = np.flatnonzero(is_hit)[number - 1]
        close([t, v[0]], [twin.events.t[k], twin.events.velocity_minus[k]])
    ts = np.linspace(0.0, 20.0, 2001)
    is_above = np.asarray(twin.evaluate(ts)[0])[:, 0] > PLACE
    k = np.flatnonzero(is_above[:-1] & ~is_above[1:])[0]
    passed = scipy.optimize.brentq(lambda t: twin.evaluate(t)[0][0] - PLACE, *ts[k : k + 2], xtol=1e-14)
    t, _, v = vx.next_crossing(asked.machine, 0.0, rest, rest, 0, PLACE, "down", t1=20.0)
    close([t, v[0]], [passed, twin.evaluate(passed)[1][0]])


def ask_exponents(asked):
    found = vx.lyapunov_exponents(asked.machine, transient=100, num_periods=50, **QUIET)
    close(np.sum(found[:2]), np.sum(np.log(multipliers_of(asked.orbit))) / asked.period, 1e-6)


def ask_orbit(asked):
    twin = asked.twin_orbit(asked.orbit)
    close(twin.x0[0], asked.orbit.x0[0], FOUND)
    close(multipliers_of(asked.orbit), multipliers_of(twin), 1e-8)


def ask_search(asked):
    starts = np.zeros((2, asked.num_masses)), 0.1 * np.eye(2)[:, : asked.num_masses]
    found = vx.find_periodic_orbits(asked.machine, starts, 1, **QUIET)
    assert any(np.allclose(one.x0[0], asked.orbit.x0[0], atol=FOUND) for one in found)


def ask_branch(asked):
    assert asked.branch.ends == ("bounds", "bounds")
    assert bool(asked.branch.points["is_admissible"].all())
    doubling, grazing = asked.point("pd"), asked.point("gr")
    asked.check_doubling(doubling.value)
    # Where the stop is out of reach the twin goes on near the orbit, and just reaches the place of the stop.
    free, period = asked.kind.twin(grazing.value, 100 * POSITION), 2 * np.pi / grazing.value
    x0, v0 = asked.masses_of(asked.branch.orbit(grazing.index))
    ts = period * np.linspace(300.0, 301.0, 4001)
    sol = vx.simulate(free, 0.0, ts[-1], x0, v0, ts=ts, max_events=4096)
    close(np.max(sol.xs[:, 0]), POSITION, 1e-6)


def ask_switch(asked):
    doubling = asked.point("pd")
    (doubled,) = vx.switch_branch(doubling)
    assert doubled.num_periods == 2
    # As near to the bifurcation rounding is divided by the distance of the multiplier from 1.
    tolerance = STEP / np.min(np.abs(np.asarray(doubled.multipliers) - 1))
    close(asked.twin_orbit(doubled, frequency_of(doubled)).x0[0], doubled.x0[0], tolerance)


def ask_grazing(asked):
    others = vx.switch_branch(asked.point("gr"))
    assert 2 in {one.num_periods for one in others}
    for one in others:
        sol = one.solution()
        close(sol.x1, one.x0[: asked.num_masses])
        if (
            sol.sliders1.size
        ):  # their place is no part of the start from which the twin is searched, and multipliers are 1e4
            continue
        close(asked.twin_orbit(one, frequency_of(one)).x0[0], one.x0[0], FOUND)


def ask_curve(asked):
    bounds = {asked.kind.frequency: BOUNDS, asked.kind.position: (0.09, 0.11)}
    curve = vx.bifurcation_curve(asked.point("pd"), asked.kind.position, bounds, max_points=5, **QUIET)
    frequency, position = (float(curve[name][-1]) for name in (asked.kind.frequency, asked.kind.position))
    assert abs(position - POSITION) > 1e-4
    asked.check_doubling(frequency, position)


def ask_value(asked):
    doubling, step = asked.point("pd"), 1e-5

    def value(position):
        return vx.bifurcation_value(doubling, asked.of(FREQUENCY, position))

    close(value(POSITION), doubling.value)
    difference = (value(POSITION + step) - value(POSITION - step)) / (2 * step)
    close(jax.grad(value)(POSITION), difference, 1e-6)


def ask_basins(asked):
    grid = {"x0[0]": [-0.5, 0.0], "v0[0]": [-0.5, 0.5]}
    found = vx.basins(asked.machine, grid, transient=60, record=4, **QUIET)
    assert not found.num_failed
    assert np.all(found.label == 0)
    close(found.x0.values[0, 0], asked.orbit.x0[0], FOUND)


def ask_files(asked, folder):
    file, picture = folder / "machine.toml", str(folder / "machine.png")
    vx.save(asked.machine, file)
    again = vx.load(file, allow_forces=["combinations"])
    sol = vx.simulate(again, 0.0, 20.0)
    np.testing.assert_array_equal(sol.x1, vx.simulate(asked.machine, 0.0, 20.0).x1)
    for draw in (vx.plot.time_series, vx.plot.phase_portrait, vx.plot.impact_map):
        draw(sol)
        mpl.pyplot.close("all")
    assert main(["plot", str(file), "--out", picture, "--allow-forces", "combinations"]) == 0


def ask_command_line(asked, folder, capsys):
    file = folder / "machine.toml"
    vx.save(asked.machine, file)
    if main(["orbit", str(file), "--allow-forces", "combinations"]):
        raise ValueError(capsys.readouterr().err)
    assert "stable" in capsys.readouterr().out


# Columns of the page.
COLUMNS = {
    "simulate": ask_simulate,
    "jit, vmap, grad": ask_derivatives,
    "sweep": ask_sweep,
    "duration=": ask_duration,
    "ensemble": ask_ensemble,
    "maps": ask_maps,
    "exponents": ask_exponents,
    "orbit": ask_orbit,
    "search": ask_search,
    "branch": ask_branch,
    "switch": ask_switch,
    "at grazing": ask_grazing,
    "curve": ask_curve,
    "value": ask_value,
    "basins": ask_basins,
    "files": ask_files,
    "command line": ask_command_line,
}


def rows_of_page():
    """Cells of the table of the page, by kind of machine and column."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {cells[0]: dict(zip(head[1:], cells[1:], strict=True)) for cells in rows}


def sentences_of_page():
    """What the numbers in the cells say, by number."""
    return dict(re.findall(r'^(\d+)\. "(.*)"$', PAGE.read_text(), re.M))


def test_the_page_has_all_kinds_and_analyses():
    rows = rows_of_page()
    assert list(rows) == list(KINDS)
    assert {tuple(cells) for cells in rows.values()} == {tuple(COLUMNS)}
    told = {cell for cells in rows.values() for cell in cells.values()} - {"yes", "-"}
    assert told == set(sentences_of_page())


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_machine_has_the_analyses_of_the_page(name, tmp_path, capsys):
    asked, wrong = Asked(name), {}
    for column, ask in COLUMNS.items():
        cell = rows_of_page()[name][column]
        if cell == "-":
            continue
        given = {"folder": tmp_path, "capsys": capsys}
        wanted = {key: given[key] for key in inspect.signature(ask).parameters if key in given}
        try:
            ask(asked, **wanted)
            said = "yes"
        except ValueError as error:
            said = str(error)
        except AssertionError as error:
            said = f"wrong: {error}"
        if not (said == "yes" if cell == "yes" else sentences_of_page()[cell] in said):
            wrong[column] = said
    assert not wrong
