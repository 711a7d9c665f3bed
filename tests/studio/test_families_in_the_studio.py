"""Families on the command line and in the explorer."""

import sys

import numpy as np
import pytest
import xarray as xr
from families import rotor

import vijax as vx
from vijax.studio.command_line.main import main

MODULE = """
import vijax as vx

def rotor_of_file(frequency, eccentricity=0.5, clearance=0.6):
    load = vx.Harmonic([eccentricity * frequency**2], frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, clearance, "upper", 0.7)])
"""
RUN = ["--transient", "20", "--record", "5", "--no-progress"]


@pytest.fixture
def file(tmp_path, monkeypatch):
    """File of a function, in the working directory, under a name that no other test has imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    name = f"machines_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(MODULE)
    yield f"{name}.py:rotor_of_file"
    sys.modules.pop(name, None)


def test_a_sweep_of_a_function_in_a_file(file, capsys):
    pytest.importorskip("h5netcdf")
    typed = ["--sweep", "frequency=0.5:1.5:5", "--set", "clearance=0.5", "--out", "s.nc"]
    assert main(["sweep", file, *typed, *RUN]) == 0
    ds = xr.load_dataset("s.nc", engine="h5netcdf")
    family = vx.Family(rotor, frequency=0.8, clearance=0.5)
    speeds = {"frequency": np.linspace(0.5, 1.5, 5)}
    expected = vx.sweep(family, speeds, transient=20, record=5, progress=False)
    np.testing.assert_array_equal(ds.x, expected.x)
    assert isinstance(vx.system_of(ds), vx.Family)
    assert main(["info", "s.nc"]) == 0
    assert "frequency" in capsys.readouterr().out
    assert main(["plot", "s.nc", "--out", "s.png"]) == 0


@pytest.mark.slow
def test_a_branch_of_a_function_in_a_file(file, capsys):
    pytest.importorskip("h5netcdf")
    typed = [
        "--along",
        "frequency=0.65:0.75",
        "--set",
        "frequency=0.7",
        "--out",
        "b.nc",
        "--picture",
        "b.png",
    ]
    assert main(["branch", file, *typed]) == 0
    assert "gr 0.74077" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "typed", "sentence"),
    [
        ("rotr_of_file", [], "has no function `rotr_of_file`"),
        ("rotor_of_file", ["--set", "frequncy=0.5"], "did you mean `frequency`"),
    ],
)
def test_what_does_not_fit_gets_a_sentence(file, capsys, name, typed, sentence):
    given = f"{file.partition(':')[0]}:{name}"
    assert main(["sweep", given, "--sweep", "frequency=0.5:1.5:5", "--out", "s.nc", *typed, *RUN]) != 0
    assert sentence in capsys.readouterr().err
    assert main(["orbit", file]) != 0
    assert "needs a value for `frequency`" in capsys.readouterr().err


def test_a_machine_of_a_family_is_drawn():
    def drawn(machine) -> list[np.ndarray]:
        ax = vx.plot.machine(machine)
        return [
            *(np.asarray(line.get_xydata()) for line in ax.lines),
            *(np.asarray(patch.get_path().vertices) for patch in ax.patches),
        ]

    of_family, of_machine = drawn(vx.Family(rotor, frequency=0.8)), drawn(rotor(frequency=0.8))
    assert of_machine
    for one, other in zip(of_family, of_machine, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.thorough
def test_the_explorer_changes_values_of_a_family():
    pytest.importorskip("holoviews")
    from vijax.studio.explorer.motion import motion_at, scalar_parameters
    from vijax.studio.explorer.orbits import branch_through

    family = vx.Family(rotor, frequency=0.7)
    ds = vx.sweep(family, {"frequency": [0.65, 0.7]}, transient=200, progress=False)
    assert scalar_parameters(vx.system_of(ds)) == {"frequency": 0.7, "eccentricity": 0.5, "clearance": 0.6}
    motion = motion_at(ds, {"frequency": 0.7})
    assert motion.orbit is not None
    np.testing.assert_allclose(motion.orbit.x0, ds.x[1], atol=1e-8)
    changed = motion_at(ds, {"frequency": 0.7}, {"clearance": 0.4})
    assert changed.kind["num_impacts"].sum() > 0
    assert len(branch_through(motion.orbit, "frequency", (0.65, 0.7), "")) > 2


def test_pictures_of_a_family():
    family = vx.Family(rotor, frequency=0.7, labels={"frequency": "Speed", "clearance": "Clearance"})
    speeds = np.linspace(0.6, 0.8, 5)
    ds = vx.sweep(family, {"frequency": speeds}, transient=200, progress=False)
    ax = vx.plot.bifurcation(
        ds, stop=0, orbits=[vx.periodic_orbit(family, ds.x.values[2], ds.v.values[2])], grazing=True
    )
    assert ax.get_xlabel() == "Speed"
    grazing = [line for line in ax.lines if line.get_label() == "grazing without impacts"]
    # The amplitude of the forced vibration, e W^2 / |1 - W^2 + 0.1 i W|, equals the clearance.
    speed = float(np.asarray(grazing[0].get_xdata())[0])
    assert 0.5 * speed**2 / abs(1 - speed**2 + 0.1j * speed) == pytest.approx(0.6, rel=1e-4)
    assert vx.plot.bifurcation(ds, stop=0, resonances=True).get_xlabel() == "Speed"
    plane = {"frequency": speeds[1:4], "clearance": [0.4, 0.5]}
    chart = vx.chart(family, plane, stride=1, progress=False)
    ax = vx.plot.regions(chart)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Speed", "Clearance")


@pytest.mark.slow
def test_the_branch_of_a_family_with_moving_stops_is_drawn():
    def shaker(frequency, travel=0.1):
        motion = vx.Harmonic([travel * frequency], frequency)
        stop = vx.Stop(0, 0.3, "upper", 0.7, motion)
        return vx.ImpactSystem([1.0], [[0.3]], [[1.0]], vx.Harmonic([0.4], frequency), [stop])

    family = vx.Family(shaker, frequency=1.0)
    sol = vx.simulate(family, 0.0, 200 * family.forcing.period, max_events=1, throw=False)
    orbit = vx.periodic_orbit(family, sol.x1, sol.v1)
    assert int(orbit.num_impacts[0]) == 1
    branch = vx.continuation(orbit, "frequency", (0.98, 1.02), progress=False)
    ax = vx.plot.branch(branch, stop=0)
    k = int(np.argmin(abs(branch.values - 1.0)))
    hit = branch.orbit(k).events
    drawn = np.concatenate([line.get_xydata() for line in ax.lines if np.size(line.get_xdata()) > 3])
    near = drawn[np.nanargmin(abs(drawn[:, 0] - branch.values[k]))]
    assert near[1] == pytest.approx(float(hit.velocity_minus[0]), rel=1e-6)


def test_the_machine_of_a_family_in_a_file_is_drawn_where_its_function_may_be_called(tmp_path, capsys):
    machine, picture = tmp_path / "rotor.toml", tmp_path / "rotor.png"
    vx.save(vx.Family(rotor, frequency=0.8), machine)
    typed = ["plot", str(machine), "--out", str(picture)]
    assert main(typed) == 2
    assert "unless its function is called, which `allow_forces=`" in capsys.readouterr().err
    assert main([*typed, "--allow-forces", "families"]) == 0
    assert picture.stat().st_size > 10_000
