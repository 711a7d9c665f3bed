"""Drawings and films of machines show the matrices, stops and trajectories."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawings import SEEN, grey
from drawn_machines import (
    LINKS,
    MODELS,
    boxes,
    called,
    cavity_with,
    displacements,
    middle,
    picture_of,
    ring,
    wall_at,
    words,
)

import vijax as vx
from vijax.studio.drawing.arrangement import arrangement_of
from vijax.studio.drawing.reading import scheme_of_solution, scheme_of_system

# Positions in a drawing are sums and products of a few numbers of size 10.
ROUNDING = 1e-13
# Loads derived from a machine in the frame of its stops are differences of forces.
RECOVERED = 1e-12
END = 12.0


@pytest.mark.parametrize(("name", "num_springs", "num_dampers"), LINKS)
def test_every_mass_and_coupling_is_drawn_and_no_words_overlap(name, num_springs, num_dampers):
    system = MODELS[name]()
    ax = vx.plot.machine(system)
    ax.figure.draw_without_rendering()
    assert len(called(ax, "spring")) == num_springs
    assert len(called(ax, "damper")) == num_dampers
    assert len(boxes(ax)) == system.num_masses
    home = arrangement_of(scheme_of_system(system)).home
    np.testing.assert_allclose([middle(box) for box in boxes(ax)], home, rtol=0, atol=ROUNDING)
    assert words(ax)[: system.num_masses] == [str(i) for i in range(system.num_masses)]
    extents = [text.get_window_extent() for text in ax.texts]
    overlapping = [
        (ax.texts[i].get_text(), ax.texts[j].get_text())
        for i in range(len(extents))
        for j in range(i)
        if extents[i].overlaps(extents[j])
    ]
    assert overlapping == []
    whole = ax.figure.bbox
    assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 for box in extents)


def test_springs_join_the_boxes_and_the_wall():
    ax = vx.plot.machine(vx.models.wagg_bishop_a(0.8), x=[0.1, -0.2])
    ends = [np.asarray(line.get_xdata())[[0, -1]] for line in called(ax, "spring")]
    left, right = (box.get_x() for box in boxes(ax))
    assert ends[0][0] < left
    np.testing.assert_allclose(ends[0][1], left, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ends[1], [left + 1, right], rtol=0, atol=ROUNDING)


def test_a_negative_spring_is_dashed_and_said_to_be():
    system = vx.ImpactSystem(
        [1.0, 1.0], np.zeros((2, 2)), [[2.0, 1.0], [1.0, 2.0]], vx.Harmonic([0.0, 0.0], 1.0)
    )
    ax = vx.plot.machine(system)
    assert [line.get_linestyle() for line in called(ax, "spring")] == ["-", "-", "--"]
    assert "dashed: negative stiffness or damping" in words(ax)


def test_boxes_walls_and_gaps_have_one_scale():
    x, positions = np.array([0.2, -0.25]), (-0.4, 0.3)
    load = vx.Harmonic([0.5, 0.0], 0.8)
    stops = [vx.Stop(0, positions[0], "lower", 0.7), vx.Stop(1, positions[1], "upper", 0.5)]
    ax = vx.plot.machine(vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops), x)
    scale = displacements(ax)[0] / x[0]
    assert scale > 1
    np.testing.assert_allclose(displacements(ax), scale * x, rtol=0, atol=ROUNDING)
    lower, upper = boxes(ax)
    gaps = [lower.get_x() - wall_at(ax, 0), wall_at(ax, 1) - upper.get_x() - 1]
    np.testing.assert_allclose(gaps, scale * np.array([0.6, 0.55]), rtol=0, atol=ROUNDING)
    assert "stop 0\ngap 0.6\n$r$ = 0.7" in words(ax)
    assert "stop 1\ngap 0.55\n$r$ = 0.5" in words(ax)
    # Hatched behind the face, away from the mass.
    behind = [called(ax, f"wall {j}")[0] for j in (0, 1)]
    assert behind[0].get_x() + behind[0].get_width() == pytest.approx(wall_at(ax, 0))
    assert behind[1].get_x() == pytest.approx(wall_at(ax, 1))


def test_a_stop_that_moves_stands_where_it_is_at_the_time_and_has_an_arrow():
    table = vx.models.ball_on_table(2.0, 0.1)
    walls, arrows = [], []
    for t in (0.0, np.pi / 4, 3 * np.pi / 4):  # in the middle, at the top and at the bottom
        ax = vx.plot.machine(table, x=[0.2], t=t)
        walls.append(wall_at(ax, 0))
        arrows.append(
            [line for line in ax.lines if line.get_marker() in "<>^v" and len(line.get_xdata()) == 2]
        )
        scale = displacements(ax)[0] / 0.2
    np.testing.assert_allclose(np.diff(walls), scale * np.array([0.1, -0.2]), rtol=0, atol=ROUNDING)
    assert [len(pair) for pair in arrows] == [2, 2, 2]


WEIGHTS = {
    "bouncing_ball": (lambda: vx.models.bouncing_ball(), "up"),
    "ball_on_table": (lambda: vx.models.ball_on_table(2.0, 0.1), "up"),
    "beads of different mass": (lambda: vx.models.bead_column(mass=[1.0, 2.0, 0.5]), "up"),
    "multi_piston": (lambda: vx.models.multi_piston(), "up"),
    "beads without weight": (lambda: vx.models.bead_column(gravity=0.0), "right"),
    "percussive_drill": (lambda: vx.models.percussive_drill(0.9, 0.8), "right"),
    "a spring holds the mass": (
        lambda: vx.chain([1.0], [0.0], [1.0], vx.Harmonic([0.0], 1.0, mean=[-1.0])),
        "right",
    ),
    "weight of positive sign": (
        lambda: vx.ImpactSystem(
            np.array([[2.0, 1.0], [1.0, 2.0]]),
            np.zeros((2, 2)),
            np.zeros((2, 2)),
            vx.Harmonic([0.0, 0.0], 1.0, mean=[3.0, 3.0]),
            [vx.Stop(1, 20.0)],
        ),
        "down",
    ),
}


LONG_TO_COMPILE = ("beads of different mass", "multi_piston", "percussive_drill")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name in LONG_TO_COMPILE else []) for name in WEIGHTS],
)
def test_weight_acts_downwards_in_the_picture(name):
    build, positive = WEIGHTS[name]
    system = build()
    assert scheme_of_system(system).positive == positive
    sol = vx.simulate(system, 0.0, 0.0, x0=5.0 * np.arange(1.0, 1 + system.num_masses))
    assert scheme_of_solution(sol, np.zeros((1, system.num_stops))).positive == positive


@pytest.mark.parametrize(("positive", "axis", "sign"), [("right", 0, 1), ("up", 1, 1), ("down", 1, -1)])
def test_positions_grow_in_the_direction_that_is_asked_for(positive, axis, sign):
    ax = vx.plot.machine(vx.models.percussive_drill(0.9, 0.8), positive=positive)
    step = picture_of(ax, boxes(ax)[1]) - picture_of(ax, boxes(ax)[0])
    assert sign * step[axis] > 0.1
    assert abs(step[1 - axis]) < ROUNDING
    drawn = {line.get_marker() for line in ax.lines} & set("<>^v")
    assert drawn == {{"right": ">", "up": "^", "down": "v"}[positive]}


@pytest.mark.parametrize("positive", ["up", "down"])
@pytest.mark.parametrize("name", ["wagg_bishop_a", "impact_damper", "bead_column", "ring"])
def test_words_of_a_vertical_drawing_do_not_overlap(name, positive):
    ax = vx.plot.machine(MODELS[name](), positive=positive)
    ax.figure.draw_without_rendering()
    extents = [text.get_window_extent() for text in ax.texts]
    assert not any(extents[i].overlaps(extents[j]) for i in range(len(extents)) for j in range(i))
    whole = ax.figure.bbox
    assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 for box in extents)


def test_a_floor_is_below_its_ball_and_wider():
    ax = vx.plot.machine(vx.models.bouncing_ball(), x=[0.1])
    ax.figure.draw_without_rendering()
    ball, floor = (artist.get_window_extent() for artist in (boxes(ax)[0], called(ax, "wall 0")[0]))
    assert floor.y1 < ball.y0
    assert floor.x0 < ball.x0 < ball.x1 < floor.x1


@pytest.mark.parametrize("angle", [-0.4, 0.3])
def test_a_pendulum_hangs_at_its_angle_and_touches_its_stop_there(angle):
    ax = vx.plot.machine(vx.models.impacting_pendulum(0.7, position=0.3), x=[angle])
    (rod,) = called(ax, "rod")
    x, y = (np.asarray(a)[1] for a in rod.get_data())
    assert np.arctan2(x, -y) == pytest.approx(angle, abs=ROUNDING)
    (bob,) = boxes(ax)
    (line,) = called(ax, "limit 0")
    start, end = np.transpose(line.get_data())
    along = (end - start) / np.hypot(*(end - start))
    beside = start - np.array(bob.center)
    away = abs(beside[0] * along[1] - beside[1] * along[0])
    assert (away == pytest.approx(bob.radius, abs=ROUNDING)) == (angle == 0.3)
    assert f"gap {0.3 - angle:.3g}" in words(ax)[1]
    assert "moment $0.5\\,\\cos(0.7\\,t)$" in words(ax)


def test_a_contact_is_a_plate_at_its_gap_on_an_arm_of_the_other_mass():
    x = np.array([0.1, 0.4])
    ends = [vx.Contact({0: -1.0, 1: 1.0}, 1.0, 0.6), vx.Contact({0: 1.0, 1: -1.0}, 1.0, 0.6)]
    load = vx.Harmonic([1.0, 0.0], 1.0)
    ax = vx.plot.machine(vx.chain([1.0, 1.0], [0.0, 0.0], [1.0, 1.0], load, ends), x)
    scale = displacements(ax)[1] / x[1]
    container, free = boxes(ax)
    # Contact 0 keeps x1 - x0 below 1, contact 1 keeps x0 - x1 below it.
    gaps = [wall_at(ax, 0) - free.get_x() - 1, free.get_x() - wall_at(ax, 1)]
    np.testing.assert_allclose(gaps, scale * np.array([1 - 0.3, 1 + 0.3]), rtol=0, atol=ROUNDING)
    for number in (0, 1):
        (arm,) = called(ax, f"limit {number}")
        root = np.asarray(arm.get_xdata())[0]
        assert container.get_x() < root <= container.get_x() + 1 + ROUNDING
    assert "contact 1\ngap 1.3\n$r$ = 0.6" in words(ax)


@pytest.mark.parametrize("pair", [(0, 1), (1, 2), (2, 0)])
@pytest.mark.parametrize("positive", ["right", "up"])
def test_friction_between_masses_is_a_pad_between_two_plates(pair, positive):
    rubbing = [vx.Friction({pair[0]: 1.0, pair[1]: -1.0}, force=0.1)]
    chain = vx.chain([1.0] * 3, [0.0] * 3, [1.0] * 3, vx.Harmonic([1.0, 0, 0], 1.0), [], friction=rubbing)
    ax = vx.plot.machine(chain, positive=positive)
    (pad,), (plates,) = called(ax, "friction 0"), called(ax, "slider 0")
    centre = pad.get_xy()[:4].mean(axis=0)
    home = [middle(boxes(ax)[i]) for i in pair]
    assert min(home) + 0.4 < centre[0] < max(home) - 0.4
    x = np.asarray(plates.get_xdata())
    assert min(home) < np.nanmin(x) < np.nanmax(x) < max(home)
    assert (centre[1] > 1.0) == (abs(pair[0] - pair[1]) > 1)


@pytest.mark.thorough
def test_a_compliant_end_of_a_mass_or_wall_has_its_spring_damper_and_preload():
    law = {"stiffness": 20.0, "damping": 0.5, "preload": 0.2}
    row, back = {1: 1.0, 0: -1.0}, {0: 1.0, 1: -1.0}
    bare = vx.CompliantContact(back, 0.5, stiffness=30.0)
    cavity = cavity_with([vx.CompliantContact(row, 0.5, **law), bare], [])
    joined = vx.chain([1.0, 1.0], [0.0] * 2, [1.0] * 2, stops=[vx.CompliantContact(back, 0.5, **law)])
    wall = vx.chain([1.0], [0.0], [1.0], stops=[vx.CompliantStop(0, 0.5, "upper", **law)])
    for system in (cavity, joined, wall):
        ax = vx.plot.machine(system)
        assert all(called(ax, f"{name} 0") for name in ("spring of limit", "damper of limit", "preload"))
        assert [text for text in words(ax) if text.endswith("$k$ = 20\n$c$ = 0.5\n$N_0$ = 0.2")]
        (spring,) = called(ax, "spring of limit 0")
        assert np.asarray(spring.get_xdata())[0] == pytest.approx(wall_at(ax, 0))
    ax = vx.plot.machine(cavity)
    assert called(ax, "spring of limit 1")
    assert not called(ax, "damper of limit 1")
    assert not called(ax, "preload 1")
    sol = vx.simulate(cavity, 0.0, 0.0)
    assert scheme_of_solution(sol, np.zeros((1, 2))).restitution == scheme_of_system(cavity).restitution


def test_what_has_no_place_in_the_row_is_told_in_words():
    ax = vx.plot.machine(ring())
    assert words(ax)[-2:] == [
        "contact 3: $x_{0} + x_{3} - 2 x_{1} \\leq 0.5$, $r$ = 0.3",
        "force: function push",
    ]
    assert not called(ax, "limit 3")
    assert words(ax)[-3] == r"base: $\ddot y$ = $- 0.064\,\cos(0.8\,t)$"
    assert {r"$- 1$", r"$2$"} <= set(words(ax))  # the mean load is none of the base


WAVE = vx.Waveform([0.0, 2.0, 4.0], [1.0, -0.5, 0.2], 1.3)


@pytest.mark.parametrize(
    ("base", "formula"),
    [
        (vx.base_excitation([1.0, 2.0], 0.1, 0.8), r"$- 0.064\,\cos(0.8\,t)$"),
        (vx.base_excitation([1.0, 2.0], acceleration=WAVE), "$a(t)$"),
        (vx.base_excitation([1.0, 2.0], acceleration=vx.Tabulated([0.0, 1.0], [1.0, 2.0])), "$a(t)$"),
    ],
    ids=["harmonic", "wave form", "record"],
)
def test_a_base_that_moves_is_drawn_as_a_base_and_other_loads_as_arrows(base, formula):
    links = np.array([[2.0, -1.0], [-1.0, 1.0]])
    for load, arrows in ((base, []), (base + vx.Harmonic([0.3, 0.0], 1.1), ["load 0"])):
        system = vx.ImpactSystem([1.0, 2.0], 0.1 * links, links, load)
        sol = vx.simulate(system, 0.0, 1.0)
        film = vx.plot.animate(sol, [0.2, 0.8])
        for ax in (vx.plot.machine(system), film._fig.axes[0]):  # pyright: ignore[reportAttributeAccessIssue]
            assert words(ax)[-1] == rf"base: $\ddot y$ = {formula}"
            assert [line.get_gid() for line in ax.lines if str(line.get_gid()).startswith("load")] == arrows
            assert len([line for line in ax.lines if line.get_gid() == "base"]) == 2
        acceleration = 0.3 * np.cos(1.1 * 0.8) if arrows else 0.0
        np.testing.assert_allclose(
            scheme_of_solution(sol, np.zeros((1, 0))).load_at(0.8), [acceleration, 0.0], atol=1e-6
        )
        film._draw_was_started = True  # pyright: ignore[reportAttributeAccessIssue]


def test_of_a_full_mass_matrix_it_is_said_that_boxes_are_coordinates():
    ax = vx.plot.machine(vx.models.cantilever(1.0))
    assert len(called(ax, "spring")) == len(called(ax, "damper")) == 9 + 5
    assert words(ax)[-2:] == [
        "full mass matrix: boxes are coordinates",
        "dashed: negative stiffness or damping",
    ]


def test_only_masses_that_are_driven_have_an_arrow():
    load = vx.Harmonic([[0.0, 1.0], [0.0, 0.5]], 2.0, phase=[[0.0, np.pi], [0.0, 0.25]])
    ax = vx.plot.machine(vx.chain([1.0, 1.0], [0.0, 0.0], [1.0, 1.0], load))
    assert [bool(called(ax, f"load {i}")) for i in (0, 1)] == [False, True]
    assert r"$- \cos(2\,t) + 0.5\,\cos(4\,t + 0.25)$" in words(ax)


def test_a_drawing_goes_into_the_axes_given_and_its_words_fit():
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 3))
    assert vx.plot.machine(ring(), ax=left) is left
    assert not right.patches
    figure.draw_without_rendering()
    extents = [text.get_window_extent() for text in left.texts]
    assert not any(extents[i].overlaps(extents[j]) for i in range(len(extents)) for j in range(i))


def test_a_drawing_is_seen_on_black():
    with plt.style.context("dark_background"):
        ax = vx.plot.machine(ring())
        assert all(grey(text.get_color()) > 1 - SEEN for text in ax.texts)
        assert all(grey(line.get_color()) > SEEN for line in ax.lines)
        assert all(grey(box.get_edgecolor()) > SEEN for box in boxes(ax))
        assert all(grey(box.get_facecolor()) == 0 for box in boxes(ax))


def test_machines_are_refused_with_what_to_do():
    system = vx.models.wagg_bishop_a(0.8)
    with pytest.raises(ValueError, match=r"Argument `x` must have shape \(2,\), but has shape \(3,\)"):
        vx.plot.machine(system, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="Arguments `x` and `t` must be finite"):
        vx.plot.machine(system, [0.0, np.nan])
    with pytest.raises(ValueError, match='`positive` must be "right", "up" or "down", but is \'left\''):
        vx.plot.machine(system, positive="left")


@pytest.mark.parametrize("size", [(8.0, 3.0), (6.5, 2.6)])
def test_words_shrink_in_small_panels_and_the_machine_does_not_vanish(size):
    ends = [vx.Contact({i: 1.0, 1 - i: -1.0}, 0.4, restitution=0.6) for i in (1, 0)]
    bumper = vx.CompliantStop(0, 0.6, "upper", stiffness=50.0, damping=1.0, preload=2.0)
    rubbing = [vx.Friction(0, force=0.1), vx.Friction({1: 1.0, 0: -1.0}, force=0.02)]
    spring = np.diag([1.0, 0.0])
    load = vx.Harmonic([1.0, 0.0], frequency=1.2)
    machine = vx.ImpactSystem([1.0, 0.2], 0 * spring, spring, load, [*ends, bumper], friction=rubbing)
    ax = plt.subplots(figsize=size)[1]
    vx.plot.machine(machine, ax=ax)
    ax.figure.draw_without_rendering()
    frame = ax.get_window_extent()
    widest = max(patch.get_window_extent().width for patch in ax.patches)
    assert widest > 0.2 * frame.width
    boxes = [text.get_window_extent() for text in ax.texts if "=" in text.get_text()]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    assert all(frame.y0 - 1 <= box.y0 and box.y1 <= frame.y1 + 1 for box in boxes)
