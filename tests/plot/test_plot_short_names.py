"""Pictures of datasets with short names are those of datasets by path."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import vijax as vx

FREQUENCY, AMPLITUDE = "forcing.frequency", "forcing.amplitude[0]"
SYSTEM = vx.models.wagg_bishop_a(0.8)
FREQUENCIES, AMPLITUDES = np.linspace(0.75, 0.85, 3), np.array([0.25, 0.3])


def both_forms(values: dict) -> tuple[dict, dict]:
    names = {FREQUENCY: "W", AMPLITUDE: "A", "x0[0]": "x", "v0[0]": "v"}
    return {names[path]: (path, a) for path, a in values.items()}, values


def sweeps(values: dict, **options) -> list[xr.Dataset]:
    options = {"transient": 60, "record": 4, "progress": False} | options
    return [vx.sweep(SYSTEM, form, **options) for form in both_forms(values)]


def content(ax) -> tuple:
    """All that is drawn, and the words on the axes."""
    lines = [np.asarray(line.get_xydata()).tolist() for line in ax.lines]
    meshes = [np.asarray(mesh.get_array()).ravel().tolist() for mesh in ax.collections]
    legend = ax.get_legend()
    words = [] if legend is None else [text.get_text() for text in legend.get_texts()]
    return lines, meshes, words, ax.get_xlabel(), ax.get_ylabel(), ax.get_xlim()


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def lines() -> list[xr.Dataset]:
    return sweeps({FREQUENCY: FREQUENCIES}, lyapunov=True)


@pytest.fixture(scope="module")
def planes() -> list[xr.Dataset]:
    return sweeps({FREQUENCY: FREQUENCIES, AMPLITUDE: AMPLITUDES})


def assert_same_picture(draw, datasets: list[xr.Dataset]):
    named, by_path = (content(draw(ds)) for ds in datasets)
    np.testing.assert_equal(named, by_path)
    assert any(named[0]) or any(named[1])
    return named


def test_bifurcation_diagrams(lines):
    drawn = assert_same_picture(vx.plot.bifurcation, lines)
    assert drawn[3] == r"Forcing frequency $\Omega$"


@pytest.mark.slow
def test_orbits_of_either_form_mark_either_form(lines):
    orbits = [vx.periodic_orbits(ds, progress=False) for ds in lines]
    assert int(orbits[0].converged.sum()) > 0
    assert_same_picture(vx.plot.multipliers, orbits)
    for one in orbits:
        assert_same_picture(lambda ds, one=one: vx.plot.bifurcation(ds, orbits=one), lines)


def test_lyapunov_exponents(lines):
    assert_same_picture(vx.plot.lyapunov, lines)


def test_regions_and_planes(planes):
    assert_same_picture(lambda ds: vx.plot.regions(vx.classify(ds)), planes)
    assert_same_picture(lambda ds: vx.plot.plane(ds.num_impacts.sum("stop")), planes)


@pytest.mark.thorough
def test_basins_and_sections():
    values = {"x0[0]": np.linspace(-0.2, 0.2, 3), "v0[0]": np.linspace(-0.5, 0.5, 2)}
    options = {"transient": 30, "record": 4, "progress": False}
    assert_same_picture(vx.plot.basins, [vx.basins(SYSTEM, form, **options) for form in both_forms(values)])
    starts = {"a": ("x0[0]", [0.0, 0.1])}, {"x0[0]": [0.0, 0.1]}
    assert_same_picture(vx.plot.section, [vx.sweep(SYSTEM, form, **options) for form in starts])


@pytest.mark.slow
def test_branches_over_a_sweep(lines):
    (branch, *_) = vx.branches(lines[1], progress=False)
    assert_same_picture(lambda ds: vx.plot.branch(branch, ds), lines)
