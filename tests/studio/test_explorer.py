"""The explorer: the motion of a point, and the page in a browser."""

import contextlib
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
import xarray as xr
from helpers import counted

import vijax as vx
from vijax._system.parameters import get_parameter
from vijax.studio.explorer.motion import motion_at, scalar_parameters

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


@pytest.mark.thorough
def test_a_click_and_a_slider_show_another_motion(page, sweep):
    def pictures() -> list[str]:
        return [image.get_attribute("src") for image in page.locator("img").all()]

    def wait_for_others(before: list[str]) -> None:
        """Wait until the first three pictures of every motion have changed."""
        page.wait_for_function(
            "before => { const seen = []; const look = node => { for (const one of node.querySelectorAll('*')) {"
            "if (one.tagName === 'IMG') seen.push(one.src); if (one.shadowRoot) look(one.shadowRoot) } };"
            "look(document); return seen.length === before.length && seen.slice(0, 3).every((a, i) => a !== before[i]) }",
            arg=before,
        )

    def click(right: float) -> None:
        box = page.locator(".bk-Figure").first.bounding_box()
        page.mouse.click(box["x"] + right * box["width"], box["y"] + 0.4 * box["height"])

    found = page.locator(".found")
    found.filter(has_text="none: no periodic orbit").wait_for()
    before = pictures()
    assert len(before) == 4
    click(0.14)  # at the left end of the diagram
    found.filter(has_text=words(sweep, 0.5)).wait_for()
    assert "stable" in found.inner_text()
    wait_for_others(before)
    film = page.locator("svg.film > path")
    drawn = film.get_attribute("d")
    page.wait_for_timeout(500)
    assert film.get_attribute("d") != drawn

    before = pictures()
    page.locator("select").filter(has_text="stops[0].restitution").select_option("stops[0].restitution")
    handle = page.locator(".noUi-handle")
    handle.focus()
    handle.press("PageDown")
    found.filter(has_text="changed: stops[0].restitution").wait_for()
    wait_for_others(before)

    page.locator("select").filter(has_text="mass[0]").last.select_option("mass[0]")
    number = page.locator("input[type=text]").last
    number.fill("-1")
    number.press("Enter")
    page.locator(".trouble").filter(has_text="must be positive").wait_for()
    click(0.9)
    found.filter(has_text=words(sweep, 1.3)).wait_for()
    assert page.locator(".trouble").count() == 0
