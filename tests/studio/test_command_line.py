"""The command `vijax`: options, results, and one-sentence errors."""

import re
import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._jax import program_store
from vijax._trajectory import one_call
from vijax.studio.command_line.main import main
from vijax.studio.command_line.values import swept_values

PLACES = "forcing.frequency"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """File of a machine with a `sweep` table, in the working directory."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "machine.toml"
    vx.save(vx.models.wagg_bishop_b(0.8), file)
    sweep = '[sweep]\ntransient = 9\nrecord = 3\nover = {"forcing.frequency" = "0.5:0.7:3"}\n'
    file.write_text(file.read_text() + sweep)
    return file


@pytest.fixture(scope="module")
def dataset() -> xr.Dataset:
    values = {PLACES: [0.5, 0.8, 1.4]}
    return vx.sweep(vx.models.wagg_bishop_b(0.8), values, transient=4, record=3, progress=False)


def test_a_sweep_is_that_of_python_and_what_is_typed_counts_more(machine, capsys):
    pytest.importorskip("h5netcdf")
    typed = [
        "--over",
        "forcing.frequency=0.5,0.8,1.4",
        "--transient",
        "4",
        "--x0=-0.1,0",
        "--set",
        "stops[1].restitution=0.6",
    ]
    assert main(["sweep", "machine.toml", "--out", "kept.nc", "--no-progress", *typed]) == 0
    assert capsys.readouterr().out == "kept.nc: 3 points\n"
    system = vx.models.wagg_bishop_b(0.8)
    stops = [system.stops[0], vx.Stop(1, system.stops[1].position, "upper", 0.6)]
    system = vx.ImpactSystem(system.mass, system.damping, system.stiffness, system.forcing, stops)
    expected = vx.sweep(
        system, {PLACES: [0.5, 0.8, 1.4]}, transient=4, record=3, x0=[-0.1, 0.0], progress=False
    )
    xr.testing.assert_identical(xr.load_dataset("kept.nc", engine="h5netcdf"), expected)


def test_info_tells_of_machines_and_sweeps(machine, dataset, capsys):
    pytest.importorskip("h5netcdf")
    dataset.to_netcdf("kept.nc", engine="h5netcdf")
    assert main(["info", "machine.toml"]) == main(["info", "kept.nc"]) == 0
    told = capsys.readouterr().out
    assert told.count("stop 0     mass 0, x >= -0.3, restitution 0.7") == 2
    assert re.search(r"forcing.frequency +3 values from 0.5 to 1.4\n +successful +3 points", told)
    assert re.search(r"transient +4\n", told)


def test_plot_draws_what_fits_the_file(machine, dataset):
    pytest.importorskip("h5netcdf")
    dataset.to_netcdf("kept.nc", engine="h5netcdf")
    assert main(["plot", "machine.toml", "--out", "machine.png"]) == 0
    assert (
        main(["plot", "kept.nc", "--out", "sweep.png", "--stop", "1", "--at", "forcing.frequency=0.6"]) == 0
    )
    for name in ("machine.png", "sweep.png"):
        assert np.ptp(plt.imread(machine.parent / name)) > 0


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.5:2:4", [0.5, 1.0, 1.5, 2.0]),
        ("1:100:3:log", [1.0, 10.0, 100.0]),
        ("0.5,-2e3", [0.5, -2e3]),
        ("7", [7.0]),
        ([1, 2.5], [1.0, 2.5]),
    ],
)
def test_values_are_written_as_ranges_or_with_commas(text, values):
    np.testing.assert_allclose(swept_values("x", text), values, rtol=1e-15)


SWEEP = ["sweep", "machine.toml", "--out", "kept.nc"]
BRANCH = ["branch", "machine.toml", "--out", "kept.nc", "--along"]


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (["sweep", "nowhere.toml", "--out", "kept.nc"], "No such file"),
        (["sweep", "machine.toml"], "Say with --out"),
        (["sweep", "kept.nc", "--out", "more.nc"], "must be a machine"),
        (["sweep", "machine.toml", "--out", "kept.txt"], "end in .nc (NetCDF) or .zarr (Zarr)"),
        (["sweep", "machine.toml", "--out", "nowhere/kept.nc"], "make the folder"),
        ([*SWEEP, "--over", "forcing.frequency"], "must be PATH=VALUES"),
        ([*SWEEP, "--over", "forcing.frequency=0:1"], "must be first:last:points"),
        ([*SWEEP, "--over", "forcing.frequency=0:1:9:log"], "only if neither is zero"),
        ([*SWEEP, "--over", "omega=1"], "The path `omega` names nothing"),
        ([*SWEEP, "--set", "stops[0].restitution=2"], "must lie between 0"),
        ([*SWEEP, "--x0", "0"], "Argument `x0` must have shape (2,)"),
        (["orbit", "machine.toml", "--periods", "0"], "--periods must be 1 or more"),
        (["orbit", "machine.toml", "--x0", "0"], "--x0 must have a number for each of the 2 masses"),
        (["orbit", "machine.toml", "--picture", "orbit.gif"], "Pictures end in .png, .svg or .pdf"),
        ([*BRANCH, "forcing.frequency"], "must be PATH=VALUES"),
        ([*BRANCH, "forcing.frequency=0.7"], "must be LOW:HIGH"),
        ([*BRANCH, "forcing.frequency=1:0.7"], "a lower and a higher number"),
        (["attractors", "machine.toml", "--bounds", "0:1"], "must hold the lowest and highest position"),
        (["attractors", "machine.toml", "--rng", "-1"], "`rng` must be a whole number"),
        (["basins", "machine.toml", "--over", "x0[0]=0:1:3"], "Say twice or more with --over"),
        (["info", "nowhere.nc"], "There is no nowhere.nc"),
        (["plot", "nowhere.nc", "--out", "kept.png"], "There is no nowhere.nc"),
    ],
)
def test_what_cannot_be_done_is_told_in_a_sentence(machine, capsys, typed, sentence):
    assert main(typed) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"vijax {typed[0]}: error: ")
    assert sentence in told
    assert len(told.splitlines()) == 1
    assert [file.name for file in machine.parent.iterdir()] == ["machine.toml"]


def test_a_table_that_is_not_known_is_told(machine, capsys):
    machine.write_text(machine.read_text().replace("transient", "transients"))
    assert main(SWEEP) == 2
    told = capsys.readouterr().err
    assert "`sweep` has `transients`, which is not known" in told
    assert "did you mean `transient`?" in told


def test_a_file_does_not_allow_itself_what_it_names(machine, capsys):
    machine.write_text(machine.read_text().replace("[sweep]", '[sweep]\nallow_forces = ["springs"]'))
    assert main(SWEEP) == 2
    assert "`sweep` has `allow_forces`, which is not known" in capsys.readouterr().err


def test_a_sweep_that_is_stopped_says_what_is_kept(machine, capsys, monkeypatch):
    def stopped(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("vijax.studio.command_line.sweep.sweep", stopped)
    assert main([*SWEEP, "--store", "kept"]) == 130
    assert "finished until then are in kept, and the same command resumes there" in capsys.readouterr().err
    assert main(SWEEP) == 130
    assert "nothing is kept" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [[], *([name] for name in "sweep orbit branch attractors basins info plot explore precompile".split())],
)
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit) as end:
        main([*command, "--help"])
    assert end.value.code == 0
    assert "usage: vijax" in capsys.readouterr().out


@pytest.mark.slow
def test_orbits_and_branches_are_those_of_python(tmp_path, monkeypatch, capsys):
    pytest.importorskip("h5netcdf")
    monkeypatch.chdir(tmp_path)
    system = vx.models.impact_oscillator(1.0, 1.0, position=1.0, restitution=0.8, damping_ratio=0.05)
    vx.save(system, "machine.toml")
    settled = vx.simulate(system, 0.0, 200 * system.forcing.period)
    orbit = vx.periodic_orbit(system, settled.x1, settled.v1)
    path, low = "forcing.amplitude[0]", 0.05
    assert main(["orbit", "machine.toml", "--out", "orbit.nc", "--picture", "orbit.png"]) == 0
    assert f"{float(orbit.v0[0]):.6g}" in capsys.readouterr().out
    kept = xr.load_dataset("orbit.nc", engine="h5netcdf")
    np.testing.assert_allclose(kept.v0, orbit.v0, rtol=1e-12)
    typed = ["--along", f"{path}={low}:1", "--out", "branch.nc", "--until", "fold", "--picture", "branch.svg"]
    assert main(["branch", "machine.toml", *typed, "--no-progress"]) == 0
    expected = vx.continuation(orbit, path, (low, 1.0), stop="fold", progress=False)
    told = capsys.readouterr().out
    assert "ends          stop:fold, bounds" in told
    branch = vx.Branch(xr.load_dataset("branch.nc", engine="h5netcdf"))
    np.testing.assert_allclose(branch.values[[0, -1]], expected.values[[0, -1]], rtol=1e-9)
    assert main(["info", "branch.nc"]) == 0
    assert capsys.readouterr().out == told
    assert np.ptp(plt.imread("orbit.png")) > 0
    assert main(["orbit", "machine.toml", "--set", f"{path}=nan"]) == 2


@pytest.mark.slow
def test_attractors_and_basins_are_those_of_python(tmp_path, monkeypatch, capsys):
    pytest.importorskip("h5netcdf")
    monkeypatch.chdir(tmp_path)
    system = vx.models.impact_oscillator(1.0, 0.0999, position=1.0, restitution=0.8, damping_ratio=0.05)
    vx.save(system, "machine.toml")
    counts = ["--transient", "150", "--record", "4", "--no-progress"]
    typed = [
        "--starts",
        "8",
        "--rng",
        "3",
        "--bounds=-0.9:0.9,-1:1",
        "--out",
        "found.nc",
        "--picture",
        "s.png",
    ]
    assert main(["attractors", "machine.toml", *typed, *counts]) == 0
    expected = vx.attractors(
        system, 8, rng=3, bounds=[[-0.9, 0.9], [-1, 1]], transient=150, record=4, progress=False
    )
    kept = xr.load_dataset("found.nc", engine="h5netcdf")
    np.testing.assert_array_equal(kept.label, expected.label)
    assert re.search(r"1 attractor of 8 starts.*\n +0 +no impact +100 % +stable", capsys.readouterr().out)
    over = ["--over", "x0[0]=-0.5:0.5:3", "--over", "v0[0]=0,0.5"]
    assert main(["basins", "machine.toml", *over, *counts, "--picture", "b.png"]) == 0
    assert "of 3 x 2 starts" in capsys.readouterr().out
    assert np.ptp(plt.imread("b.png")) > 0


@pytest.mark.thorough
def test_the_command_runs_as_a_module_and_takes_forces_from_beside_the_file(tmp_path):
    (tmp_path / "springs.py").write_text("def cubic(t, x, v, args):\n    return -args['k'] * x**3\n")
    (tmp_path / "machine.toml").write_text(
        'mass = [1.0]\ndamping = [[0.1]]\nstiffness = [[1.0]]\nforce = "springs:cubic"\nargs = {k = 1.0}\n'
        'stops = [{mass = 0, side = "upper", position = 0.5, restitution = 0.7}]\n'
        "[forcing]\namplitude = [0.6]\nfrequency = 0.9\n"
    )
    command = ["sweep", tmp_path / "machine.toml", "--out", tmp_path / "kept.nc", "--over", "args.k=0.5,1"]
    counts = ["--transient", "2", "--record", "3", "--no-progress", "--allow-forces", "springs"]
    done = subprocess.run([sys.executable, "-m", "vijax", *command, *counts], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ds = xr.load_dataset(tmp_path / "kept.nc", engine="h5netcdf")
    assert (ds.result == 0).all()
    assert ds.x.dtype == np.float64
    assert float(ds.x[0, 0]) != float(ds.x[1, 0])


def test_a_stop_is_refused_where_a_picture_is_of_all_stops(machine, dataset, capsys):
    pytest.importorskip("h5netcdf")
    dataset.to_netcdf("kept.nc", engine="h5netcdf")
    assert main(["plot", "kept.nc", "--kind", "regions", "--out", "regions.png", "--stop", "0"]) != 0
    assert "--stop 0: a picture `regions` is of all stops" in capsys.readouterr().err


@pytest.mark.thorough
@pytest.mark.usefixtures("no_other_cache")
def test_precompile_makes_programs_and_tells_what_it_cannot(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(program_store, "_active", program_store._Active())
    program_store.store_programs(tmp_path / "programs")
    one_call.call.drop()  # which other tests may have made
    vx.save(vx.models.impact_oscillator(0.8), "machine.toml")
    assert main(["precompile", "machine.toml", "simulate"]) == 0
    assert capsys.readouterr().out == "simulate: done\n"
    assert len(list((tmp_path / "programs").glob("*.program"))) == 1
    assert main(["precompile", "machine.toml", "simulations"]) == 2
    assert "has 'simulations'" in capsys.readouterr().err
    undriven = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], None, [vx.Stop(0, 1.0, "upper", 0.7)])
    vx.save(undriven, "undriven.toml")
    assert main(["precompile", "undriven.toml", "simulate", "lyapunov_exponents"]) == 2
    assert re.search("simulate: done\nlyapunov_exponents: .*frequency", capsys.readouterr().out)
