"""Pictures of periodic orbits: stability over a sweep, and single cycles."""

import matplotlib as mpl

mpl.use("Agg")

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from drawings import SEEN, both_ways, cycle, events, grey, named, points, words_of_legend
from exact_orbits import Table
from matplotlib.collections import LineCollection
from matplotlib.colors import same_color

import vijax as vx

PATH = "forcing.frequency"
UP, DOWN = "black", "C1"
SAMPLES = 100
# A cycle closes to the rounding of its run, and impact speeds have the same error.
CLOSED = 1e-12


@pytest.fixture(scope="module")
def sticking() -> vx.PeriodicOrbit:
    """Case (b) of the paper, where both masses chatter, stick and are released in every cycle."""
    system = vx.models.wagg_bishop_b(0.25)
    # A disturbance of the cycle shrinks to a seventh in a period.
    sol = vx.simulate(system, 0.0, 24 * float(system.forcing.period), max_events=0, throw=False)
    return cycle(system, sol.x1, sol.v1)


@pytest.fixture(scope="module")
def swept() -> xr.Dataset:
    system = vx.models.wagg_bishop_b(1.0)
    return vx.sweep(system, {PATH: [0.8, 1.1, 1.4]}, transient=3, record=4, progress=False)


@pytest.fixture(scope="module")
def polished(swept) -> xr.Dataset:
    """Orbits as if every point were on a stable one."""
    yes = (PATH, np.ones(3, bool))
    return xr.Dataset({"converged": yes, "is_stable": yes}, swept.result.coords)


@pytest.fixture(scope="module")
def mixed(polished) -> xr.Dataset:
    """Orbits as if the first were unstable, and none had been found at the second value."""
    return polished.assign(converged=(PATH, [True, False, True]), is_stable=(PATH, [False, False, True]))


def impacts_of(ds: xr.Dataset, stop: int) -> set[tuple[float, float]]:
    at, velocity, of = (a.values for a in xr.broadcast(ds[PATH], ds.impact_velocity, ds.impact_stop))
    return set(zip(at[of == stop].tolist(), velocity[of == stop].tolist(), strict=True))


def drawn(ax, color: str) -> list[tuple[float, bool, set[tuple[float, float]]]]:
    """Size, ring flag and places of the points in a colour."""
    lines = [a for a in ax.lines if a.get_linestyle() == "None" and same_color(a.get_color(), color)]
    return [
        (a.get_markersize(), a.get_markerfacecolor() == "none" and a.get_markeredgewidth() > 0, points(a))
        for a in lines
        if len(a.get_xdata())
    ]


def at_stop(orbit: vx.PeriodicOrbit, stop: int, kind: int = vx.IMPACT) -> np.ndarray:
    return np.asarray((orbit.events.kind == kind) & (orbit.events.stop == stop))


@pytest.mark.parametrize("stop", [0, 1])
def test_stable_orbits_are_larger_discs_and_unstable_ones_rings(swept, mixed, stop):
    parts = [swept.isel({PATH: where}) for where in ([1], slice(2, None), [0])]
    expected = [impacts_of(part, stop) for part in parts]
    found = drawn(vx.plot.bifurcation(swept, stop, orbits=mixed), "black")
    assert all(expected[1:])
    assert [places for *_, places in found] == [places for places in expected if places]
    assert [ring for _, ring, _ in found][-2:] == [False, True]
    ((size, _, _),) = drawn(vx.plot.bifurcation(swept, stop), "black")
    assert min(larger for larger, *_ in found[-2:]) > 1.5 * size


def test_points_without_an_orbit_stay_as_they_are(swept, polished):
    none = polished.assign(converged=polished.converged & False)
    plain, marked = vx.plot.bifurcation(swept), vx.plot.bifurcation(swept, orbits=none)
    assert drawn(marked, "black") == drawn(plain, "black")
    assert marked.get_legend() is None


def test_stability_is_told_beside_the_direction(swept, mixed):
    top, _ = vx.plot.bifurcation(both_ways(swept), None, orbits=both_ways(mixed).transpose(PATH, ...))
    assert words_of_legend(top) == ["swept down", "swept up", "stable orbit", "unstable orbit"]
    alone = [places for *_, places in drawn(vx.plot.bifurcation(swept, orbits=mixed), "black")]
    up, down = drawn(top, UP), drawn(top, DOWN)
    for found in (up, down):
        assert [places for *_, places in found] == alone
        assert [ring for _, ring, _ in found] == len(found[1:]) * [False] + [True]
    # The points of the way up lie on those of the way down, and are smaller.
    assert all(a < b for (a, *_), (b, *_) in zip(up, down, strict=True))
    stable_at_once = vx.plot.bifurcation(both_ways(swept), orbits=both_ways(mixed.assign(is_stable=True)))
    assert words_of_legend(stable_at_once) == ["swept down", "swept up", "stable orbit"]


def test_the_orbits_of_a_sweep_are_those_that_are_marked(swept, polished):
    assert bool(polished.converged.all())
    found = drawn(vx.plot.bifurcation(swept, orbits=polished), "black")
    assert [places for *_, places in found] == [impacts_of(swept, 0)]
    part = slice(1, 3)
    assert vx.plot.bifurcation(swept.isel({PATH: part}), orbits=polished.isel({PATH: part})).lines


def test_the_orbits_of_another_sweep_are_refused(swept, polished):
    with pytest.raises(
        ValueError, match=r"differs from them in \['forcing.frequency'\]: select the same part"
    ):
        vx.plot.bifurcation(swept.isel({PATH: slice(2)}), orbits=polished)
    with pytest.raises(ValueError, match=r"differs from them in \['direction'\]"):
        vx.plot.bifurcation(swept, orbits=both_ways(polished))
    with pytest.raises(ValueError, match=r"differs from them in \['forcing.frequency'\]"):
        vx.plot.bifurcation(swept, orbits=polished.assign_coords({PATH: 2 * polished[PATH]}))
    with pytest.raises(
        ValueError, match=r"what `vx.periodic_orbits\(ds\)` returned, but has no \['converged'"
    ):
        vx.plot.bifurcation(swept, orbits=swept)
    with pytest.raises(ValueError, match=r"differs from them in \['x0\[1\]'\]"):
        vx.plot.bifurcation(swept.assign_coords({"x0[1]": 0.1}), orbits=polished)


def at_frequency(orbit: vx.PeriodicOrbit, frequency: float) -> vx.PeriodicOrbit:
    """Orbit as if the machine had another frequency."""
    return eqx.tree_at(lambda o: o.system.forcing.frequency, orbit, jnp.asarray(frequency))


def test_orbits_are_drawn_at_their_value_of_what_is_swept(swept, sticking):
    unstable = eqx.tree_at(lambda o: o.is_stable, at_frequency(sticking, 1.5), jnp.array(False))
    ax = vx.plot.bifurcation(swept, 1, orbits=[sticking, unstable])
    velocities = np.asarray(sticking.events.velocity_minus)[at_stop(sticking, 1)].tolist()
    _, disc, ring = drawn(ax, "black")
    assert disc[1:] == (False, {(0.25, v) for v in velocities})
    assert ring[1:] == (True, {(1.5, v) for v in velocities})
    assert ax.get_xlim() == (0.25, 1.5)
    assert words_of_legend(ax) == ["swept", "stable orbit", "unstable orbit"]
    assert drawn(vx.plot.bifurcation(swept, 1, orbits=sticking), "black")[1][1:] == disc[1:]
    assert drawn(vx.plot.bifurcation(swept, 1, orbits=[]), "black") == drawn(
        vx.plot.bifurcation(swept, 1), "black"
    )


def test_orbits_are_drawn_at_the_phase_and_relative_velocity_of_their_impacts():
    table = Table(1, 0.8, 9.81, 0.6)
    start = table.later(0.3)
    orbit = cycle(start.system, start.x, start.v)
    names = ("impact_velocity", "impact_relative_velocity", "impact_phase", "impact_stop")
    columns = {name: ((PATH, "impact"), np.array([[0.0]])) for name in names}
    ds = xr.Dataset(
        {"result": (PATH, [0]), **columns}, {PATH: [2.5], "stop": [0], "stop_mass": ("stop", [0])}
    )
    # The remaining share of the flight to the next impact is 0.7.
    expected = {"velocity": -table.fall, "relative velocity": -table.speed, "phase": 0.7 * 2 * np.pi}
    for ordinate, value in expected.items():
        (_, _, places) = drawn(vx.plot.bifurcation(ds, ordinate=ordinate, orbits=orbit), "black")[-1]
        np.testing.assert_allclose(list(places), [(table.frequency, value)], rtol=CLOSED)


def test_orbits_that_have_no_place_in_a_sweep_are_refused(swept, sticking):
    other = swept.rename({PATH: "x0[1]"})
    with pytest.raises(
        ValueError, match=r"with 2 stops, and `x0\[1\]` one number of it.* 2 stops and 0 such"
    ):
        vx.plot.bifurcation(other, orbits=sticking)
    other = swept.rename({PATH: "stops[*].position"})
    with pytest.raises(ValueError, match="here it has 2 stops and 2 such numbers"):
        vx.plot.bifurcation(other, orbits=sticking)
    other = swept.rename({PATH: "stops[*].restitution"})
    assert drawn(vx.plot.bifurcation(other, 1, orbits=sticking), "black")[1][2].pop()[0] == 0.7
    cubic = eqx.tree_at(
        lambda o: (o.system.force, o.args),
        sticking,
        (lambda t, x, v, args: -args["cubic"] * x**3, {"cubic": jnp.array(2.5)}),
        is_leaf=lambda a: a is None,
    )
    other = swept.rename({PATH: "args.cubic"})
    assert drawn(vx.plot.bifurcation(other, 1, orbits=cubic), "black")[1][2].pop()[0] == 2.5
    with pytest.raises(ValueError, match="with 1 stops"):
        vx.plot.bifurcation(swept.isel(stop=[0]), orbits=sticking)


@pytest.mark.parametrize("mass", [0, 1])
def test_the_phase_portrait_of_an_orbit_is_closed_and_shows_its_events(sticking, mass):
    ax = vx.plot.phase_portrait(sticking, mass, num_samples=SAMPLES)
    x, v = ax.lines[0].get_data()
    start, end = (x[0], v[0]), (x[-1], v[-1])
    np.testing.assert_allclose(start, [float(a[mass]) for a in (sticking.x0, sticking.v0)], rtol=0, atol=0)
    np.testing.assert_allclose(end, start, rtol=0, atol=CLOSED)
    # In case (b) stops have the numbers of their masses.
    (jumps,) = (c for c in ax.collections if isinstance(c, LineCollection))
    found = np.array([[begin[1], end[1]] for begin, end in jumps.get_segments()])
    is_hit = at_stop(sticking, mass)
    velocities = (sticking.events.velocity_minus, sticking.events.velocity_plus)
    assert is_hit.sum() > 10
    np.testing.assert_allclose(
        found, np.stack([np.asarray(a)[is_hit] for a in velocities], axis=1), atol=CLOSED
    )
    for words, kind in (("stick", vx.STICK), ("release", vx.RELEASE)):
        (mark,) = named(ax, words)
        assert points(mark) == {((-0.3, 0.1)[mass], 0.0)}
        assert len(mark.get_xdata()) == at_stop(sticking, mass, kind).sum() == 1


def test_the_other_pictures_of_an_orbit_are_those_of_one_cycle(sticking):
    one = sticking.solution()
    ours, theirs = (vx.plot.time_series(a, num_samples=SAMPLES) for a in (sticking, one))
    assert ours.get_xlim() == (0.0, float(sticking.period))
    assert [points(line) for line in ours.lines[:2]] == [points(line) for line in theirs.lines[:2]]
    ours, theirs = (vx.plot.impact_map(a, stop=1) for a in (sticking, one))
    assert points(ours.lines[0]) == points(theirs.lines[0])
    assert len(points(ours.lines[0])) == at_stop(sticking, 1).sum()
    ax = vx.plot.sticking_region([sticking], 1, num_samples=SAMPLES)
    released = [line for line in ax.lines if line.get_marker() == "o"][-1]
    at = [float(a[0]) for a in one.evaluate(events(one, vx.RELEASE, 1)[0])]
    np.testing.assert_allclose(list(points(released)), [at], rtol=0, atol=CLOSED)


def test_what_is_no_orbit_is_not_drawn(sticking):
    lost = eqx.tree_at(lambda o: o.result, sticking, vx.ORBIT_RESULTS.not_converged)
    batch = jax.tree.map(lambda a: jnp.stack([a, a]), sticking)
    pictures = [vx.plot.phase_portrait, vx.plot.time_series, vx.plot.impact_map, vx.plot.multipliers]
    for picture in pictures:
        with pytest.raises(ValueError, match=r"can be drawn\. not_converged: no cycle"):
            picture(lost)
        with pytest.raises(ValueError, match=r"this is a batch of shape \(2,\): draw its parts"):
            picture(batch)


def test_pictures_of_orbits_are_seen_on_a_dark_background(swept, mixed, sticking):
    with plt.style.context("dark_background"):
        pictures = [
            vx.plot.bifurcation(swept, orbits=mixed),
            vx.plot.bifurcation(both_ways(swept), orbits=both_ways(mixed)),
            vx.plot.bifurcation(swept, orbits=sticking),
            vx.plot.phase_portrait(sticking),
        ]
    assert min(grey(line.get_color()) for ax in pictures for line in ax.lines) > SEEN
