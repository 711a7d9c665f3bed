"""Films of machines show their trajectories."""

import matplotlib as mpl

mpl.use("Agg")

import subprocess

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from drawn_machines import MODELS, axes_of, boxes, called, displacements, middle, picture_of, shaken, wall_at
from matplotlib.animation import FFMpegWriter
from PIL import Image

import vijax as vx
from vijax.studio.drawing.machine import poses_of
from vijax.studio.drawing.reading import scheme_of_solution, scheme_of_system

# Positions in a drawing are sums and products of a few numbers of size 10.
ROUNDING = 1e-13


# Loads derived from a machine in the frame of its stops are differences of forces.
RECOVERED = 1e-12


END = 12.0


@pytest.fixture(scope="module")
def sol() -> vx.Solution:
    """Motion with chatter of mass 1, which then sticks."""
    return vx.simulate(shaken(), 0.0, END)


@pytest.mark.slow
def test_a_film_of_a_pendulum_is_beside_its_angles():
    system = vx.models.impacting_pendulum(0.7)
    sol = vx.simulate(system, 0.0, 6.0, x0=[-2.0])
    film = vx.plot.animate(sol, np.linspace(0.0, 6.0, 4))
    left, right = axes_of(film)
    (rod,) = called(left, "rod")
    for frame, x in enumerate(np.asarray(sol.evaluate(np.linspace(0.0, 6.0, 4))[0])):
        film._draw_frame(frame)
        across, down = (np.asarray(a)[1] for a in rod.get_data())
        assert np.arctan2(across, -down) == pytest.approx(x[0], abs=ROUNDING)
    assert left.get_position().x1 < right.get_position().x0


def test_a_film_of_a_ball_moves_it_upwards_beside_its_heights():
    sol = vx.simulate(vx.models.bouncing_ball(), 0.0, 1.0, x0=[1.0])
    film = vx.plot.animate(sol, [0.0, 0.3])
    left, right = axes_of(film)
    heights = []
    for frame in range(2):
        film._draw_frame(frame)
        heights.append(picture_of(left, boxes(left)[0])[1])
    assert heights[1] < heights[0]
    assert left.get_position().x1 < right.get_position().x0
    level = axes_of(vx.plot.animate(sol, [0.0, 0.3], positive="right"))
    assert level[0].get_position().y0 > level[1].get_position().y1


def test_a_trajectory_tells_the_same_machine(sol):
    places = np.asarray(sol.evaluate_stops(np.linspace(2.0, 9.0, 6))[0])
    of_system, of_solution = scheme_of_system(shaken()), scheme_of_solution(sol, places)
    for name in ("stiffness", "damping", "mean", "rows", "limit", "restitution", "is_moving", "signs"):
        np.testing.assert_array_equal(getattr(of_solution, name), getattr(of_system, name))
    assert of_solution.masses == of_system.masses
    for ours, theirs in ((w.waves.cosine, w.waves.sine) for w in (of_solution, of_system)):
        assert ours.shape == theirs.shape
    # In the frame of the stops the first mass, and through its spring the second, also feel the inertia of the frame.
    np.testing.assert_allclose(of_solution.waves.cosine, of_system.waves.cosine, rtol=0, atol=RECOVERED)
    np.testing.assert_allclose(of_solution.waves.sine, of_system.waves.sine, rtol=0, atol=RECOVERED)
    assert of_solution.load_in_words(1) == of_system.load_in_words(1) == "$0.5$"


def test_the_frames_of_a_film_are_the_motion(sol):
    t = np.linspace(2.0, 9.0, 6)
    film = vx.plot.animate(sol, t)
    top, bottom = axes_of(film)
    x, places = np.asarray(sol.evaluate(t)[0]), np.asarray(sol.evaluate_stops(t)[0])
    drawn, gaps = [], []
    for frame in range(6):
        film._draw_frame(frame)
        drawn.append(displacements(top))
        gaps.append([wall_at(top, j) - boxes(top)[j].get_x() - 1 for j in (0, 1)])
        assert set(bottom.lines[-2].get_xdata()) == {t[frame]}
        np.testing.assert_array_equal(bottom.lines[-1].get_ydata(), x[frame])
    scale = drawn[0][0] / x[0, 0]
    np.testing.assert_allclose(drawn, scale * x, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(gaps, scale * (places - x), rtol=0, atol=ROUNDING)
    assert np.ptp(places[:, 0]) > 0.1
    assert np.min(gaps) > -ROUNDING


def test_a_film_flashes_at_impacts_and_fills_the_boxes_that_are_held(sol):
    log = sol.events
    when = float(np.asarray(log.t)[np.asarray(log.kind) == vx.STICK][0])
    stop = int(np.asarray(log.stop)[np.asarray(log.kind) == vx.STICK][0])
    is_impact = (np.asarray(log.kind) == vx.IMPACT) & (np.asarray(log.stop) == stop)
    first = float(np.asarray(log.t)[is_impact][0])
    t = [0.5 * first, first + 1e-3, 0.5 * (first + when), when + 1e-3]
    # At one frame a second, a flash lasts for one frame.
    film = vx.plot.animate(sol, t, fps=1)
    top, _ = axes_of(film)
    flashes = [line for line in top.lines if isinstance(line.get_marker(), tuple)]
    seen, colors = [], []
    for frame in range(4):
        film._draw_frame(frame)
        seen.append(flashes[stop].get_alpha() > 0)
        assert flashes[stop].get_xdata() == [wall_at(top, stop)]
        colors.append(mpl.colors.to_hex(boxes(top)[stop].get_facecolor()))
    assert seen[:2] == [False, True]
    assert colors[0] == colors[1] == "#ffffff" != colors[3]


def test_a_film_has_the_frames_asked_for(sol, tmp_path):
    file = tmp_path / "motion.gif"
    film = vx.plot.animate(sol, span=(4.0, 6.0), speed=2.0, fps=5, file=file)
    with Image.open(file) as picture:
        assert picture.n_frames == 5
        assert picture.info["duration"] == 200
    assert film._interval == 200


@pytest.mark.thorough
@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="films in .mp4 need the program ffmpeg")
def test_a_film_goes_to_a_video(sol, tmp_path):
    file = tmp_path / "motion.mp4"
    vx.plot.animate(sol, span=(4.0, 6.0), duration=1.0, fps=4, file=file)
    asked = ["ffprobe", "-v", "error", "-show_entries", "stream=nb_frames,duration", "-of", "csv=p=0", file]
    duration, frames = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split(",")
    assert (float(duration), int(frames)) == (1.0, 4)


def test_a_film_is_shown_by_a_notebook_and_goes_to_a_page(sol, tmp_path):
    file = tmp_path / "motion.html"
    film = vx.plot.animate(sol, span=(4.0, 6.0), duration=1.0, fps=2, file=file)
    text = film._repr_html_()
    assert text.count("data:image/png") == 2
    assert text.count("frames[") == file.read_text(encoding="utf-8").count("frames[")
    assert not plt.fignum_exists(film._fig.number)


def test_what_nothing_ties_to_a_place_is_seen_from_its_middle():
    gears, damper = (scheme_of_system(MODELS[name]()) for name in ("gear_pair", "impact_damper"))
    x = np.array([[0.0, 0.0], [70.04, 70.0], [90.0, 90.02]])
    for scheme, is_followed in ((gears, True), (damper, False)):
        assert scheme.is_followed is is_followed
        poses, gaps = poses_of(scheme, x, np.tile(scheme.limit, (3, 1)))
        middles = np.array([pose.x.mean() for pose in poses])
        assert (np.abs(middles).max() < RECOVERED) == is_followed
        # Their relative motion fills the drawing only if their common motion does not.
        drawn = poses[1].x[0] - poses[1].x[1]
        assert (drawn > 0.1) == is_followed
        np.testing.assert_allclose(gaps, scheme.limit - x @ scheme.rows.T, rtol=0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["impact_damper", "gear_pair", "bead_column"])
def test_a_film_never_shows_a_contact_passed(name):
    system = MODELS[name]()
    motion = vx.simulate(system, 0.0, 6.0)
    film = vx.plot.animate(motion, np.linspace(0.0, 6.0, 7))
    top, _ = axes_of(film)
    limits = scheme_of_system(system).limits
    assert limits
    for frame in range(7):
        film._draw_frame(frame)
        for limit in limits:
            box = boxes(top)[limit.mass]
            face = middle(box) + box.get_width() / 2 * limit.side
            assert limit.side * (wall_at(top, limit.number) - face) > -1e-9


def test_films_are_refused_with_what_to_do(sol, monkeypatch):
    with pytest.raises(ValueError, match=r"`file` must end in one of .gif, .html, .mp4, but is 'a.avi'"):
        vx.plot.animate(sol, file="a.avi")
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(RuntimeError, match="need the program ffmpeg, which is not found"):
        vx.plot.animate(sol, file="a.mp4")
    with pytest.raises(ValueError, match="Give one of `speed` and `duration`"):
        vx.plot.animate(sol, speed=1.0, duration=1.0)
    with pytest.raises(ValueError, match="Argument `fps` must be positive, but is 0"):
        vx.plot.animate(sol, fps=0)
    with pytest.raises(ValueError, match="Argument `t` gives the time of every frame: leave out `speed`"):
        vx.plot.animate(sol, [0.0, 1.0], speed=1.0)
    with pytest.raises(ValueError, match="Argument `t` must be two or more times in order"):
        vx.plot.animate(sol, [1.0, 0.0])
    with pytest.raises(ValueError, match=r"must be two times in order within \[0.0, 12.0\]"):
        vx.plot.animate(sol, span=(0.0, 13.0))


def test_batches_are_refused(sol):
    batch = jax.tree.map(lambda a: a[None], eqx.filter(sol, eqx.is_array))
    with pytest.raises(ValueError, match=r"one by one, but this is a batch of shape \(1,\)"):
        vx.plot.animate(eqx.combine(batch, sol))
    machines = jax.tree.map(lambda a: jnp.stack([a, a], axis=-1), shaken())
    with pytest.raises(ValueError, match=r"one by one, but this is a batch of shape \(2,\)"):
        vx.plot.machine(machines)


def test_a_film_does_not_go_past_what_is_known(sol):
    short = eqx.tree_at(lambda s: s.known_until, sol, jnp.array(5.0))
    with pytest.raises(ValueError, match=r"The motion is not known after t = 5: show an earlier `span`"):
        vx.plot.animate(short, [0.0, 6.0])
