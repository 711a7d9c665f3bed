"""Pictures of contacts between masses: names, jumps and sticking phases of every mass that they act on."""

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pytest
from drawings import PATH, branch_of, cycle, events, named, points, words_of_legend
from matplotlib.collections import LineCollection

import vijax as vx

pytestmark = pytest.mark.thorough

END, HALF, RESTITUTION = 40.0, 0.3, 0.4
MASSES = 1.0, 0.3
SAMPLES = 200
# A distance is a difference of two positions, a velocity after an impact a sum of a few products.
ROUNDING = 1e-14
# In the spacing of times before an impact, 7e-15, the acceleration changes the velocity.
BEFORE = 1e-13


def box(wall, motion: vx.Harmonic | None = None) -> vx.ImpactSystem:
    """A free mass 1 in the container, mass 0, which has a spring, and another limit."""
    load = vx.Harmonic([0.6, 0.0], 0.8)
    ends = [vx.Contact({1: a, 0: -a}, HALF, RESTITUTION, motion) for a in (1.0, -1.0)]
    springs, dampers = [[1.0, 0.0], [0.0, 0.0]], [[0.1, 0.0], [0.0, 0.0]]
    return vx.ImpactSystem(MASSES, dampers, springs, load, [*ends, wall])


WALL = vx.Stop(0, 1.2, "upper", 0.6)
BREATHING = vx.Harmonic([0.1], 0.8)


@pytest.fixture(scope="module")
def sol() -> vx.Solution:
    """Motion with impacts at both contacts, and sticking at the second."""
    return vx.simulate(box(WALL), 0.0, END)


@pytest.fixture(scope="module")
def breathing() -> vx.Solution:
    """The same, with an oscillating clearance."""
    return vx.simulate(box(WALL, BREATHING), 0.0, END)


def held_spans(sol: vx.Solution, stop: int) -> list[tuple[float, float]]:
    return list(zip(events(sol, vx.STICK, stop), events(sol, vx.RELEASE, stop), strict=True))


def drawn_spans(t: np.ndarray, x: np.ndarray) -> list[tuple[float, float]]:
    runs = np.ma.clump_unmasked(np.ma.masked_invalid(x))
    return [(t[run][0], t[run][-1]) for run in runs]


@pytest.mark.slow
def test_the_scene_has_impacts_and_holds_of_both_kinds(sol):
    assert all(len(events(sol, vx.IMPACT, j)) > 3 for j in range(3))
    assert len(held_spans(sol, 1)) > 2


@pytest.mark.slow
def test_a_time_series_draws_where_a_contact_holds_on_the_lines_of_both_masses(sol):
    ax = vx.plot.time_series(sol, num_samples=SAMPLES)
    assert words_of_legend(ax) == [
        "$x_{0}$",
        "$x_{1}$",
        "$x_{0}$, $x_{1}$ held",
        "stop 2, of $x_{0}$",
        "impact",
    ]
    thick = [line for line in ax.lines if line.get_linewidth() > 2]
    assert len(thick) == 2
    for i, line in enumerate(thick):
        t, x = line.get_data()
        assert drawn_spans(t, x) == held_spans(sol, 1)
        np.testing.assert_array_equal(line.get_color(), ax.lines[i].get_color())
        is_held = ~np.isnan(x)
        np.testing.assert_array_equal(x[is_held], sol.evaluate(t)[0][is_held, i])


@pytest.mark.slow
def test_a_contact_of_one_mass_has_a_place_on_its_axis():
    one = vx.simulate(box(vx.Contact({0: 2.0}, 2.4, 0.6)), 0.0, END)
    ax = vx.plot.time_series(one, num_samples=SAMPLES)
    (line,) = named(ax, "contact 2, of $x_{0}$")
    np.testing.assert_array_equal(line.get_ydata(), 1.2)
    portrait = vx.plot.phase_portrait(one, 0, num_samples=SAMPLES)
    (line,) = named(portrait, "contact 2")
    assert list(line.get_xdata()) == [1.2, 1.2]
    # It equals the stop of the other scene, so its jumps are equal, although its log is along the row.
    assert vx.plot.impact_map(one, 2).get_ylabel().startswith("Speed of approach before impact at contact 2")
    t = events(one, vx.IMPACT, 2)
    segments = np.array(jumps(portrait))
    ours = segments[np.abs(segments[:, 0, 0] - 1.2) < ROUNDING]
    assert len(ours) == len(t) > 3
    np.testing.assert_allclose(ours[:, 1, 1], -0.6 * ours[:, 0, 1], rtol=0, atol=BEFORE)


def jumps(ax) -> list[np.ndarray]:
    (lines,) = (c for c in ax.collections if isinstance(c, LineCollection))
    return lines.get_segments()


def test_a_phase_portrait_has_the_jumps_of_both_masses_of_a_contact(sol):
    times = np.asarray(sol.events.t)[np.asarray(sol.events.kind) == vx.IMPACT]
    stop = np.asarray(sol.events.stop)[np.asarray(sol.events.kind) == vx.IMPACT]
    found = [np.array(jumps(vx.plot.phase_portrait(sol, i, num_samples=SAMPLES))) for i in (0, 1)]
    assert [len(one) for one in found] == [len(times), (stop < 2).sum()]
    of_first = found[0][stop < 2]
    lost = MASSES[0] * (of_first[:, 1, 1] - of_first[:, 0, 1])
    won = MASSES[1] * (found[1][:, 1, 1] - found[1][:, 0, 1])
    assert np.abs(won).max() > 0.1
    np.testing.assert_allclose(lost, -won, rtol=0, atol=BEFORE)
    # They separate by the restitution; the last, lightest bounce before a stick absorbs the rest of its chatter.
    meet, part = (found[1][:, k, 1] - of_first[:, k, 1] for k in (0, 1))
    is_bounce = np.abs(meet) > 1e-5
    np.testing.assert_allclose(part[is_bounce], -RESTITUTION * meet[is_bounce], rtol=0, atol=BEFORE)
    side = np.where(stop[stop < 2] == 0, 1, -1)
    np.testing.assert_allclose(found[1][:, 0, 0] - of_first[:, 0, 0], side * HALF, rtol=0, atol=ROUNDING)


def test_a_phase_portrait_marks_what_a_contact_holds_on_the_motion_itself(sol):
    for mass in (0, 1):
        ax = vx.plot.phase_portrait(sol, mass, num_samples=SAMPLES)
        assert ("stop 2" in words_of_legend(ax)) == (mass == 0)
        assert "contact 1" not in words_of_legend(ax)
        (held,) = named(ax, "held by contact 1")
        x, v = (np.asarray(a) for a in held.get_data())
        motion = points(ax.lines[0])
        drawn = [(a, b) for a, b in zip(x.tolist(), v.tolist(), strict=True) if not np.isnan(a)]
        assert len(drawn) > 10
        assert set(drawn) <= motion
        for words, kind in (("stick", vx.STICK), ("release", vx.RELEASE)):
            (mark,) = named(ax, words)
            expected = [np.asarray(a)[:, mass] for a in sol.evaluate(events(sol, kind, 1))]
            np.testing.assert_array_equal(mark.get_data(), expected)


def test_relative_motion_is_the_distance_along_the_row(sol):
    ax = vx.plot.relative_motion(sol, 1, num_samples=SAMPLES)
    name = "$x_{0} - x_{1}$"
    assert words_of_legend(ax) == [name, "contact 1", "held by contact 1", "impact"]
    assert ax.get_ylabel() == f"Relative position {name}"
    line, limit, held, impacts = ax.lines
    t, x = line.get_data()
    at = np.asarray(sol.evaluate(t)[0])
    np.testing.assert_allclose(x, at[:, 0] - at[:, 1], rtol=0, atol=ROUNDING)
    assert x.max() < HALF + ROUNDING
    np.testing.assert_array_equal(limit.get_ydata(), HALF)
    assert drawn_spans(*held.get_data()) == held_spans(sol, 1)
    np.testing.assert_array_equal(impacts.get_xdata(), events(sol, vx.IMPACT, 1))
    np.testing.assert_array_equal(impacts.get_ydata(), HALF)


def test_relative_motion_to_a_stop_is_the_position_of_its_mass(sol):
    ax = vx.plot.relative_motion(sol, 2, span=(20.0, END), num_samples=SAMPLES)
    t, x = ax.lines[0].get_data()
    np.testing.assert_array_equal(x, sol.evaluate(t)[0][:, 0])
    (impacts,) = named(ax, "impact")
    hits = events(sol, vx.IMPACT, 2)
    np.testing.assert_array_equal(impacts.get_xdata(), hits[hits >= 20.0])
    assert (t[0], t[-1]) == ax.get_xlim() == (20.0, END)
    assert len(hits) > len(impacts.get_xdata()) > 0


@pytest.mark.slow
def test_relative_motion_follows_a_contact_that_moves(breathing):
    ax = vx.plot.relative_motion(breathing, 0, num_samples=SAMPLES)
    line, limit, *_ = ax.lines
    t, x = line.get_data()
    place = HALF + 0.1 * np.cos(0.8 * t)
    np.testing.assert_allclose(limit.get_ydata(), place, rtol=0, atol=10 * ROUNDING)
    assert (x <= place + 10 * ROUNDING).all()
    (impacts,) = named(ax, "impact")
    when, where = impacts.get_data()
    assert np.ptp(where) > 0.05
    np.testing.assert_allclose(where, HALF + 0.1 * np.cos(0.8 * when), rtol=0, atol=10 * ROUNDING)


def test_relative_motion_shows_both_ends_of_a_container(sol):
    """Along the row of the first: the other end stands at minus its own position."""
    ax = vx.plot.relative_motion(sol, [1, 0], num_samples=SAMPLES)
    line, *_ = ax.lines
    np.testing.assert_array_equal(
        line.get_ydata(), vx.plot.relative_motion(sol, 1, num_samples=SAMPLES).lines[0].get_ydata()
    )
    for number, place in ((1, HALF), (0, -HALF)):
        np.testing.assert_array_equal(named(ax, f"contact {number}")[0].get_ydata(), place)
        marks = [
            one
            for one in ax.lines
            if one.get_marker() == "o" and (np.asarray(one.get_ydata()) == place).all()
        ]
        assert [one.get_xdata().tolist() for one in marks] == [events(sol, vx.IMPACT, number).tolist()]
    with pytest.raises(ValueError, match=r"must name limits of one distance, but 0 limits .* and 2"):
        vx.plot.relative_motion(sol, [0, 2])
    with pytest.raises(ValueError, match="`contact` is empty"):
        vx.plot.relative_motion(sol, [])


def test_relative_motion_refuses_a_contact_that_is_not_there(sol):
    with pytest.raises(ValueError, match="Argument `contact` must lie in 0 to 2, but is 3"):
        vx.plot.relative_motion(sol, 3)


def test_an_impact_map_tells_contacts_from_stops(sol):
    ax = vx.plot.impact_map(sol, None)
    assert words_of_legend(ax) == ["contact 0", "contact 1", "stop 2"]
    assert ax.get_ylabel() == "Velocity $v^-$ before impact"
    ax = vx.plot.impact_map(sol, 0)
    assert ax.get_ylabel() == "Speed of approach before impact at contact 0"
    is_hit = np.asarray((sol.events.kind == vx.IMPACT) & (sol.events.stop == 0))
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), np.asarray(sol.events.velocity_minus)[is_hit])


@pytest.mark.slow
def test_a_bifurcation_diagram_of_a_contact_has_its_speeds_of_approach(breathing):
    system = box(WALL, BREATHING)
    ds = vx.sweep(system, {PATH: [0.7, 0.8, 0.9]}, transient=3, record=2, progress=False)
    top, middle, bottom = vx.plot.bifurcation(ds, None, ordinate="relative velocity")
    words = "Speed of approach before\nimpact at contact {}"
    assert [ax.get_ylabel() for ax in (top, middle)] == [words.format(0), words.format(1)]
    assert bottom.get_ylabel() == "Velocity before impact,\nrelative to stop 2"
    phases = vx.plot.bifurcation(ds, 0, ordinate="phase")
    assert phases.get_ylabel() == "Phase $\\varphi$ of impact\nat contact 0 (rad)"
    # Orbits drawn over it: speeds of approach are already relative to the contact.
    orbit = cycle(system, breathing.x1, breathing.v1)
    is_hit = np.asarray((orbit.events.kind == vx.IMPACT) & (orbit.events.stop == 0))
    speeds = np.asarray(orbit.events.velocity_minus)[is_hit]
    assert len(speeds)
    ax = vx.plot.bifurcation(ds, 0, ordinate="relative velocity", orbits=orbit)
    over = [set(np.asarray(line.get_ydata()).tolist()) for line in ax.lines]
    assert set(speeds.tolist()) in over


def test_a_branch_of_orbits_has_the_speeds_of_approach_of_a_contact():
    cycles = [[(0.2, 0, 0.5 + 0.1 * k), (0.6, 1, 0.9)] for k in range(3)]
    branch = branch_of(cycles, system=box(WALL, BREATHING))
    ax = vx.plot.branch(branch, stop=0)
    assert ax.get_ylabel() == "Speed of approach before impact\nat contact 0"
    (line,) = (line for line in ax.lines if len(line.get_xdata()) >= 3)
    drawn = np.asarray(line.get_ydata())
    np.testing.assert_allclose(drawn[~np.isnan(drawn)], [0.5, 0.6, 0.7], rtol=0, atol=ROUNDING)
    with pytest.raises(ValueError, match="There are no impacts at stop 2 to draw"):
        vx.plot.branch(branch, stop=2)


def test_the_motion_while_a_contact_holds_is_drawn_without_a_boundary(sol):
    ax = vx.plot.sticking_region(sol, 1, 0)
    assert not any("boundary" in words for words in words_of_legend(ax))
    assert sum(len(line.get_xdata()) > 10 for line in ax.lines) == len(held_spans(sol, 1))
    with pytest.raises(ValueError, match=r"Argument `mass` must be one of \[0, 1\]"):
        vx.plot.sticking_region(sol, 1)
    with pytest.raises(ValueError, match="Contact 0 holds its mass at no time"):
        vx.plot.sticking_region(sol, 0, 0)


def test_a_phase_portrait_has_the_jumps_that_friction_makes_in_impacts():
    # A ball hits the floor, and its friction slows the sled under it.
    load = vx.Harmonic([0.0, 0.0], 1.0, mean=[0.0, -1.0])
    floor = vx.Contact({1: -1.0}, 0.0, restitution=0.5)
    rub = vx.Friction({0: 1.0}, coefficient=0.2, contact=0)
    system = vx.ImpactSystem([1.0, 1.0], 0 * np.eye(2), 0 * np.eye(2), load, [floor], friction=[rub])
    one = vx.simulate(system, 0.0, 1.9, [0.0, 0.5], [2.0, 0.0])
    (hit,) = np.flatnonzero(np.asarray(one.events.kind) == vx.IMPACT)
    found = np.array(jumps(vx.plot.phase_portrait(one, 0, num_samples=SAMPLES)))
    # The ball comes with the speed 1 and leaves with 1/2: the sled loses 0.2 * 1.5.
    np.testing.assert_allclose(found[:, :, 1], [[2.0, 1.7]], rtol=0, atol=BEFORE)
    assert abs(float(one.events.friction_impulse[hit])) == pytest.approx(0.3)
