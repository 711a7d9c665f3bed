"""The explorer: the motion of a point, and the page in a browser."""

import contextlib
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
import zipfile

import matplotlib
import numpy as np
import pytest
import xarray as xr
from drawings import branch_of, points
from helpers import counted

import vijax as vx
from vijax._system.parameters import get_parameter
from vijax.studio.explorer.address import query_of, shown_by
from vijax.studio.explorer.code import code_of
from vijax.studio.explorer.motion import PointMotion, motion_at, scalar_parameters
from vijax.studio.explorer.orbits import branch_through, orbit_near

FREQUENCY = "forcing.frequency"
FREQUENCIES = [0.5, 0.8, 1.3]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Difference of motions from one state, by two programs, over some tens of impacts.
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def sweep() -> xr.Dataset:
    """Two cycles and, between them, a motion that has not settled."""
    system = vx.models.wagg_bishop_b(0.8)
    return vx.sweep(system, {FREQUENCY: FREQUENCIES}, transient=100, record=20, progress=False)


def words(ds: xr.Dataset, frequency: float) -> str:
    """Text of the page about a cycle."""
    one = vx.classify(ds).sel({FREQUENCY: frequency})
    impacts, n = " | ".join(f"{m:.0f}" for m in one.num_impacts.values), int(one.num_periods)
    return f"periodic, {impacts} impacts in {n} forcing period{'s' if n > 1 else ''}"


def shown(system: vx.ImpactSystem, end: float, x0=None) -> PointMotion:
    return PointMotion(system, vx.simulate(system, 0.0, end, x0), (0.0, end), xr.Dataset(), None)


def test_the_film_of_the_page_has_the_rectangles_of_the_drawing():
    pytest.importorskip("panel")
    from vijax.studio.explorer.film import frames_of

    film = frames_of(shown(vx.models.bouncing_ball(), 0.4, [1.0]))
    assert film["looks"] == ["hatch", 0]
    floor, box = np.moveaxis(np.array(film["parts"]), 1, 0)
    # It falls straight down, onto a floor that is wider.
    assert (np.diff(box[:, 1]) <= 0).all()
    assert box[-1, 1] < box[0, 1] - 0.2
    assert np.ptp(box[:, 0]) == 0
    assert (floor == floor[0]).all()
    assert (floor[:, 2] > box[:, 2]).all()
    assert (floor[:, 1] + floor[:, 3] <= box[:, 1]).all()
    film = frames_of(shown(vx.models.impact_damper(1.0), 0.4))
    assert film["looks"] == ["hatch", 0, "cavity", 1]
    _, container, cavity, loose = np.array(film["parts"][0])
    for inner, outer in ((loose, cavity), (cavity, container)):
        assert outer[0] < inner[0]
        assert inner[0] + inner[2] < outer[0] + outer[2]


def test_arrows_of_loads_in_the_film_have_heads_that_point_along_the_load():
    pytest.importorskip("panel")
    from vijax.studio.drawing.canvas import LOAD
    from vijax.studio.explorer.film import frames_of

    film = frames_of(shown(vx.models.wagg_bishop_a(1.0), 3.0))
    for over in np.array(film["over"], dtype=float):
        x, y = over[
            :, np.abs(over[1] - LOAD) < 0.1
        ]  # root and end of the arrow, and the three points of its head
        assert x.shape == (5,)
        assert x[3] == x[1]
        assert x[2] == x[4]
        assert y[2] - LOAD == pytest.approx(LOAD - y[4])
        assert np.sign(x[3] - x[2]) == np.sign(x[1] - x[0])


@pytest.mark.thorough
def test_the_motion_of_a_point_is_that_of_the_sweep(sweep):
    found = motion_at(sweep, {FREQUENCY: 1.25})
    assert found.words == words(sweep, 1.3)
    assert found.shown == (0.0, pytest.approx(found.num_periods * 2 * np.pi / 1.3, rel=1e-12))
    point = sweep.sel({FREQUENCY: 1.3})
    np.testing.assert_allclose(found.orbit.x0, point.x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.solution.x1, point.x, rtol=0, atol=ROUNDING)
    assert motion_at(sweep, {FREQUENCY: 0.8}).orbit is None
    changed = motion_at(sweep, {FREQUENCY: 1.3}, {"stops[0].restitution": 0.6, "stops[1].position": -0.5})
    # Uneven dampers and springs also reuse the existing programs; only small programs that set numbers are compiled.
    with counted() as compilations:
        motion_at(sweep, {FREQUENCY: 1.3}, {"damping[1][1]": 0.2, "stiffness[0][0]": 2.5})
    assert not [name for name in compilations if "of_arrays" in name]
    assert float(changed.system.stops[0].restitution) == 0.6
    assert float(changed.system.stops[1].position) == -0.5
    assert (changed.solution.evaluate(np.linspace(*changed.shown, 50))[0][:, 1] <= -0.5 + ROUNDING).all()
    with pytest.raises(ValueError, match="`restitution` must lie between 0"):
        motion_at(sweep, {FREQUENCY: 1.3}, {"stops[0].restitution": 2.0})
    lost = sweep.assign(x=sweep.x * np.nan, result=sweep.result + 4)
    with pytest.raises(RuntimeError, match="The sweep has no motion here: "):
        motion_at(lost, {FREQUENCY: 1.3})


@pytest.mark.thorough
@pytest.mark.parametrize(
    "parts",
    [
        pytest.param({"stops": [vx.CompliantStop(0, -1.0, "upper", 3.0)]}, id="in a compliant stop"),
        pytest.param({"hysteresis": [vx.Jenkins(0, 0.5, 0.1)]}, id="Jenkins element"),
    ],
)
def test_a_changed_machine_goes_on_from_the_whole_state_of_the_sweep(parts):
    def system(stiffness):
        return vx.ImpactSystem([1.0], [[0.05]], [[stiffness]], vx.Harmonic([0.2], 1.1), **parts)

    ds = vx.sweep(system(1.0), {FREQUENCY: [1.1, 1.2]}, transient=3, record=8, progress=False)
    changed = motion_at(ds, {FREQUENCY: 1.1}, {"stiffness[0][0]": 1.2})
    whole = vx.simulate(system(1.2), 0.0, 11 * 2 * np.pi / 1.1, ds.x[0].values, ds.v[0].values)
    np.testing.assert_allclose(changed.solution.x1, whole.x1, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(changed.solution.sliders1, whole.sliders1, rtol=0, atol=ROUNDING)


def test_every_number_that_can_be_changed_has_a_path_and_its_value():
    system = vx.models.wagg_bishop_b(0.8)
    numbers = scalar_parameters(system)
    assert numbers["stops[1].position"] == 0.1
    assert numbers["damping[1][1]"] == 0.1
    assert "damping[0][1]" not in numbers
    assert all(float(get_parameter(system, path)) == value for path, value in numbers.items())


def test_what_is_no_sweep_cannot_be_explored():
    with pytest.raises(ValueError, match=r"shows what `vx\.sweep` returned"):
        vx.explore(xr.Dataset())


@pytest.mark.slow
def test_the_orbit_in_chaos_and_its_branch_go_through_the_point(sweep):
    motion = motion_at(sweep, {FREQUENCY: 0.8})
    assert motion.orbit is None
    found = orbit_near(motion)
    assert found.orbit.is_admissible
    assert float(found.orbit.residual) < ROUNDING
    end = found.solution.evaluate(np.array([found.shown[1]]))
    np.testing.assert_allclose(end[0][0], found.orbit.x0, rtol=0, atol=1e-7)
    branch = branch_through(found.orbit, FREQUENCY, (0.79, 0.81), "max_position")
    assert branch.values.min() <= 0.8 <= branch.values.max()
    assert np.isfinite(branch.points.max_position).any()


@pytest.mark.thorough
def test_the_code_of_what_is_shown_makes_the_same_motion(sweep, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    sweep.to_netcdf("sweep.nc", engine="h5netcdf")
    shown: dict = {}
    exec(code_of("sweep.nc", {FREQUENCY: 1.3}, {}, 1, 20, 100), shown)
    point = sweep.sel({FREQUENCY: 1.3})
    np.testing.assert_array_equal(shown["x0"], point.x)
    assert (tmp_path / "motion.png").exists()
    text = code_of("", {FREQUENCY: 1.3}, {"stops[0].restitution": 0.6}, 0, 20, 100)
    assert "{'stops[0].restitution': [0.6]}, transient=100, record=20" in text


def test_an_address_says_what_is_shown_and_nothing_else():
    query = query_of({FREQUENCY: 1.3, "direction": "down"}, {"mass[0]": 2.0}, {"stop": 1})
    shown = shown_by(query | {"mass[1]": 5, "transient": 3}, [FREQUENCY], ["mass[0]", "mass[1]"])
    assert shown.place == {FREQUENCY: 1.3, "direction": "down"}
    assert shown.changes == {"mass[0]": 2.0}
    assert shown.chosen == {"stop": 1}
    assert shown_by({FREQUENCY: "often", "direction": "left"}, [FREQUENCY], []).place == {}


@contextlib.contextmanager
def served(file):
    """Address of the page of a dataset, while it is served."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "vijax",
        "explore",
        str(file),
        "--no-show",
        "--no-keep-compiled",
        "--port",
        str(port),
    ]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        end = time.monotonic() + 120
        while server.poll() is None and time.monotonic() < end:
            with contextlib.suppress(urllib.error.URLError, ConnectionError):
                urllib.request.urlopen(f"http://localhost:{port}/", timeout=60).close()
                break
            time.sleep(0.2)
        assert server.poll() is None, server.stdout.read() if server.stdout else ""
        yield f"http://localhost:{port}/"
    finally:
        server.terminate()
        server.communicate()


@pytest.fixture
def page(sweep, tmp_path):
    """The page in a headless browser."""
    for package in ("panel", "holoviews", "datashader", "h5netcdf"):
        pytest.importorskip(package)
    playwright = pytest.importorskip("playwright.sync_api")
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"There is no browser: none of {', '.join(BROWSERS)}.")
    sweep.to_netcdf(tmp_path / "sweep.nc", engine="h5netcdf")
    with served(tmp_path / "sweep.nc") as address, playwright.sync_playwright() as started:
        window = started.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = window.new_page(viewport={"width": 1500, "height": 1000})
        page.set_default_timeout(60_000)
        page.goto(address)
        yield page
        window.close()


@pytest.mark.slow
def test_a_click_and_a_slider_show_another_motion(page, sweep):
    drawn_there = (
        "const seen = []; const look = node => { for (const one of node.querySelectorAll('*')) {"
        "if (one.tagName === 'svg' && one.innerHTML.includes('matplotlib')) seen.push(one.innerHTML);"
        "if (one.shadowRoot) look(one.shadowRoot) } }; look(document);"
    )

    def pictures() -> list[str]:
        page.wait_for_function(f"() => {{ {drawn_there} return seen.length === 4 }}")
        return page.evaluate(f"() => {{ {drawn_there} return seen }}")

    def wait_for_others(before: list[str]) -> None:
        """Wait until the first three pictures of every motion have changed."""
        page.wait_for_function(
            f"before => {{ {drawn_there}"
            "return seen.length === before.length && seen.slice(0, 3).every((a, i) => a !== before[i]) }",
            arg=before,
        )

    def click(right: float) -> None:
        box = page.locator(".bk-Figure").first.bounding_box()
        page.mouse.click(box["x"] + right * box["width"], box["y"] + 0.4 * box["height"])

    found = page.locator(".found")
    found.filter(has_text="none: no periodic orbit").wait_for()
    before = pictures()
    click(0.14)  # at the left end of the diagram
    found.filter(has_text=words(sweep, 0.5)).wait_for()
    assert "stable" in found.inner_text()
    wait_for_others(before)
    film = page.locator("svg.film > path").first
    drawn = film.get_attribute("d")
    page.wait_for_timeout(500)
    assert film.get_attribute("d") != drawn

    before = pictures()
    handle = page.locator(".noUi-handle").nth(1)  # the second of the two sliders that are there at first
    handle.focus()
    handle.press("PageDown")
    found.filter(has_text="changed: stops[0].restitution").wait_for()
    wait_for_others(before)

    number = page.locator("input[type=text]").nth(1)
    number.fill("2")
    number.press("Enter")
    page.locator(".trouble").filter(has_text="must lie between 0").wait_for()
    click(0.9)
    found.filter(has_text=words(sweep, 1.3)).wait_for()
    assert page.locator(".trouble").count() == 0

    # The address holds what is shown.
    page.wait_for_url(re.compile("frequency=1.3"))
    page.goto(page.url.replace("1.3", "0.5"))
    found.filter(has_text=words(sweep, 0.5)).wait_for()
    for width in (800, 1400, 2500):  # nothing is cut off
        page.set_viewport_size({"width": width, "height": 1000})
        page.wait_for_timeout(500)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert_all_is_saved(page)


def assert_all_is_saved(page) -> None:
    """Pictures, events and the code that makes them again."""
    with page.expect_download() as download:
        page.get_by_text("save all").click()
    names = zipfile.ZipFile(download.value.path()).namelist()
    assert {"shown.py", "events.csv", "phase_portrait.pdf"} <= set(names)
    code = zipfile.ZipFile(download.value.path()).read("shown.py").decode()
    assert "ds.sel({'forcing.frequency': 0.5})" in code


def test_a_single_one_of_many_points_is_drawn_as_nine_pixels():
    holoviews = pytest.importorskip("holoviews")
    pytest.importorskip("datashader")
    holoviews.extension("bokeh")
    from vijax.studio.explorer.diagram import _shaded

    corners = holoviews.Points(([0.0, 0.0, 0.5, 1.0, 1.0], [0.0, 1.0, 0.5, 0.0, 1.0]))
    image = _shaded(corners, "#1f5fa8")[()]
    opacity = image.dimension_values(image.vdims[3], flat=False)
    rows, columns = np.nonzero(opacity)
    middle = opacity.shape[0] // 2
    assert ((abs(rows - middle) < 5) & (abs(columns - middle) < 5)).sum() == 9


def test_bifurcations_and_labels_of_the_diagram_are_those_of_matplotlib(sweep):
    pytest.importorskip("panel")
    from vijax.plot._branch_lines import marks_of_branch
    from vijax.studio.explorer.diagram import Ordinates, branch_marks, plain_label, sign_of
    from vijax.studio.explorer.look import LIGHT
    from vijax.studio.explorer.widgets import legend_of_points

    cycles = [[(0.2, 0, speed), (0.7, 1, 0.5)] for speed in (0.4, 0.2, 0.1)]
    branch = branch_of(cycles, ["pd", "", "fold"])
    ax = vx.plot.branch(branch, stop=0)
    marks = marks_of_branch(branch, 0, "velocity")
    for kind, words in (("pd", "period doubling"), ("fold", "fold")):
        (drawn,) = (line for line in ax.lines if line.get_label() == words)
        assert set(marks[kind]) == points(drawn)
    assert [one.data.to_numpy().tolist() for one in branch_marks(marks, LIGHT)] == [
        [list(place) for place in places] for places in marks.values()
    ]
    assert f"{sign_of('pd')} period doubling" in legend_of_points(
        LIGHT, False, True, {"period doubling": sign_of("pd")}
    )
    assert Ordinates("velocity", 1, 0).label(sweep) == "Velocity v⁻ before impact at stop 1"
    assert Ordinates("section_position", 0, 1).label(sweep) == "Position x₁ at the end of each period"
    assert plain_label("forcing.amplitude[0]") == "Forcing amplitude A₀"
