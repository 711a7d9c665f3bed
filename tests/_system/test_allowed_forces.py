"""No file or dataset runs code by itself: forces are imported only where the caller allows it, and only fit objects."""

import json
import re
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._sections.record import has_full_mass, is_linear, machines
from vijax._system.description import describe
from vijax._system.system import with_args
from vijax.studio.command_line.main import main

# A module that writes a mark beside itself whenever any of its code runs.
SPRINGS = """
from pathlib import Path
from subprocess import Popen, call

import equinox as eqx
import numpy as np


def leave(mark):
    (Path(__file__).parent / mark).write_text("")


leave("imported.mark")


class Spring(eqx.Module):
    cubic: float
    part: object = None

    def __call__(self, t, x, v, args):
        return -self.cubic * x**3


class Plain:
    def __init__(self, *args, **fields):
        leave("made.mark")

    def __call__(self, t, x, v, args):
        return -x

    def __repr__(self):
        leave("printed.mark")
        return ""

    @property
    def force(self):
        leave("asked.mark")
        return call


class Answering(type):
    def __getattr__(cls, name):
        leave("answered.mark")


class Asked(metaclass=Answering):
    pass


class Refusing(eqx.Module):
    cubic: float

    def __post_init__(self):
        raise KeyError("what it likes")


class Group:
    @staticmethod
    def linear(t, x, v, args):
        return -x


def cubic(t, x, v, args):
    return -args["k"] * x**3


def __getattr__(name):
    leave("answered.mark")
    raise AttributeError(name)


one = Plain.__new__(Plain)
ready = Spring(2.0)
"""
LOAD = {"amplitude": [0.6], "frequency": 0.8}
MACHINE = {"mass": [1.0], "damping": [[0.1]], "stiffness": [[1.0]], "forcing": LOAD}
OPENED = {"path": "subprocess:Popen", "args": "touch opened.mark", "shell": True}
CUBIC = {"path": "vijax.models:CubicSpring", "stiffness": 1.0}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a package of forces that this process has neither imported nor described."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("vijax._system.forces_by_path._known", set())
    for name in (
        "springs",
        "springs.inner",
        "springs_of_others",
    ):  # other tests may have modules of these names
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name in ("springs/__init__.py", "springs/inner.py", "springs_of_others.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(SPRINGS)
    yield tmp_path
    for name in ("springs", "springs.inner", "springs_of_others"):
        sys.modules.pop(name, None)


def marks(place):
    return {file.stem for file in place.rglob("*.mark")}


def written(force, args=None):
    """File of a machine with a force."""
    told = MACHINE | {"force": force} | ({} if args is None else {"args": args})
    with open("machine.json", "w", encoding="utf-8") as file:
        json.dump(told, file)
    return "machine.json"


def dataset(force, args=None):
    """Attributes of a sweep dataset of a machine with a force, as far as `system_of` needs them."""
    told = MACHINE | {"force": force} | ({} if args is None else {"args": args})
    return xr.Dataset(attrs={"system": json.dumps(told), "dtype": "float64"})


NOT_ALLOWED = {
    "a function": ("springs:cubic", None),
    "a class": ({"path": "springs:Spring", "cubic": 1.0}, None),
    "a command": (OPENED, None),
    "a command as a field": (CUBIC | {"stiffness": OPENED}, None),
    "a command as args": (CUBIC, {"tuple": [OPENED]}),
    "a command within args": (CUBIC, {"a": {"list": [1.0, {"b": OPENED}]}}),
    "a module of Python": ("os:system", None),
    "through modules": ("json:codecs.builtins.exec", None),
}
NO_FORCE = {
    "through ready-made ones": ("vijax.models._nonlinear:jnp.linalg.norm", "cannot be imported"),
    "beside ready-made ones": (
        "vijax.models._nonlinear:as_float",
        "vijax._jax.arrays:as_float is not imported",
    ),
    "no path": (".x:y", "must be \"package.module:function\", but is '.x:y'"),
    "within a function": ("springs:f.<locals>.g", 'must be "package.module:function"'),
    "another line": ("springs:cubic\n", 'must be "package.module:function"'),
    "a number": ({"path": 3.0}, '`force` must be "package.module:function"'),
    "a number within": (CUBIC | {"stiffness": {"path": 3.0}}, "but is 3.0"),
}


@pytest.mark.parametrize("name", NOT_ALLOWED)
@pytest.mark.parametrize("door", ["load", "system_of", "orbit", "another is allowed"])
def test_nothing_is_imported_that_is_not_allowed(place, name, door):
    force, args = NOT_ALLOWED[name]
    doors = {
        "load": lambda: vx.load(written(force, args)),
        "system_of": lambda: vx.system_of(dataset(force, args)),
        "orbit": lambda: vx.Branch(dataset(force, args).assign(x0=("point", [0.0]))).orbit(0),
        "another is allowed": lambda: vx.load(written(force, args), allow_forces=["spring", "springs.inner"]),
    }
    with pytest.raises(
        ValueError, match=r"is not imported, for .* say `allow_forces=\['\w+'\]` to `vx.load`"
    ):
        doors[door]()
    assert not sys.modules.keys() & {"springs", "springs.inner"}
    assert not marks(place)


@pytest.mark.parametrize("name", NO_FORCE)
def test_what_names_no_force_is_told(place, name):
    force, sentence = NO_FORCE[name]
    with pytest.raises(ValueError, match=re.escape(sentence)):
        vx.load(written(force))
    assert not marks(place)


@pytest.mark.parametrize(
    ("allow", "sentence"),
    [
        (["springs:cubic"], "must be True, or the names of modules"),
        ([3], "must be True, or the names of modules"),
    ],
)
def test_what_is_allowed_are_modules(place, allow, sentence):
    with pytest.raises(Exception, match=f"{sentence}|Expected type"):
        vx.load(written("springs:cubic"), allow_forces=allow)
    assert not marks(place)


@pytest.mark.parametrize(
    ("module", "allow"),
    [
        ("springs", True),
        ("springs", ["springs"]),
        ("springs", "springs"),
        ("springs.inner", ["other", "springs"]),
    ],
)
def test_a_module_that_is_allowed_is_imported_with_what_is_in_it(place, module, allow):
    force = vx.load(written({"path": f"{module}:Spring", "cubic": 2.0}), allow_forces=allow).force
    assert type(force).__module__ == module
    np.testing.assert_array_equal(force(0.0, jnp.array([0.5]), jnp.zeros(1), None), [-0.25])
    again = vx.load(written({"path": f"{module}:Spring", "cubic": 3.0})).force  # allowed from now on
    assert float(again.cubic) == 3.0
    with pytest.raises(ValueError, match=f"{module}:cubic is not imported"):
        vx.load(written(f"{module}:cubic"))


def test_a_name_stands_for_no_other_module_that_begins_alike(place):
    with pytest.raises(ValueError, match="springs_of_others:cubic is not imported"):
        vx.load(written("springs_of_others:cubic"), allow_forces=["springs"])
    assert not marks(place)


@pytest.mark.parametrize("path", ["Group.linear", "ready", "cubic", "Spring.__call__"])
def test_functions_and_modules_of_equinox_are_taken_as_they_stand(place, path):
    system = vx.load(written(f"springs:{path}", {"k": 1.0}), allow_forces=["springs"])
    assert callable(system.force.force)
    assert marks(place) == {"imported"}


@pytest.mark.parametrize(
    ("force", "sentence"),
    [
        ({"path": "springs:Plain", "k": 1.0}, "but springs:Plain is the class Plain"),
        ("springs:one", "but springs:one is of type Plain"),
        ("springs:one.force", "in a module or a class"),
        ("springs:Asked.x", "in a module or a class"),
        ("springs:nothing", "'springs:nothing' cannot be imported"),
        ("springs:np.linalg.norm", "in a module or a class"),
        ("springs:Popen", "but springs:Popen is the class Popen"),
        ("springs:call", "subprocess:call is not imported"),
        ({"path": "springs:Spring", "cubic": 1.0, "part": OPENED}, "subprocess:Popen is not imported"),
        (
            {"path": "springs:Spring", "cubic": 1.0, "part": {"path": "springs:Plain"}},
            "springs:Plain is the class Plain",
        ),
        ({"path": "springs:Spring", "cubic": 1.0, "cubik": 2.0}, "did you mean `cubic`?"),
        ({"path": "springs:Refusing", "cubic": 1.0}, "cannot be made of the fields cubic: 'what it likes'"),
    ],
)
def test_of_a_module_that_is_allowed_nothing_else_is_run(place, force, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        vx.load(written(force), allow_forces=["springs"])
    assert marks(place) <= {"imported"}


@pytest.mark.parametrize("path", ["subprocess:Popen", "os:system", "builtins:exec", "builtins:open"])
def test_what_is_no_force_is_not_called_whatever_is_allowed(place, path):
    with pytest.raises(ValueError, match=r"A force is made of functions and classes of `eqx\.Module`, but"):
        vx.load(written(OPENED | {"path": path}), allow_forces=True)
    assert not marks(place)


def test_ready_made_forces_are_always_allowed(place):
    for system in (vx.models.duffing_oscillator(0.8), vx.models.impacting_pendulum(0.8)):
        vx.save(system, place / "machine.toml")
        assert eqx.tree_equal(vx.load(place / "machine.toml"), system, typematch=True)
    assert float(vx.load(written(CUBIC)).force.stiffness) == 1.0


# Datasets


def test_attributes_that_are_none_of_a_machine_are_told():
    for attributes in ({"system": "{"}, {"system": 3}, {"system": "[" * 99999}, {"system": "[]"}):
        with pytest.raises(ValueError, match=r"The attribute `system`|Datasets of vijax have attributes"):
            vx.system_of(xr.Dataset(attrs=attributes | {"dtype": "float64"}))
    with pytest.raises(ValueError, match="but `dtype` is 'object'"):
        vx.system_of(xr.Dataset(attrs={"system": json.dumps(MACHINE), "dtype": "object"}))


def linear(t, x, v, args):
    return -args["k"] * x


@pytest.mark.parametrize("force", [lambda t, x, v, args: -args["k"] * x, linear])
def test_a_force_that_is_given_has_the_args_and_the_swept_values_of_the_dataset(place, force):
    load, stops = vx.Harmonic([0.6], 0.9), [vx.Stop(0, 0.5, "upper", 0.7)]
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, stops, force)
    attributes = {"system": json.dumps(describe(with_args(system, {"k": 1.0}))), "dtype": "float64"}
    ds = xr.Dataset(coords={"args.k": ("args.k", [0.5, 1.5])}, attrs=attributes).isel({"args.k": 1})
    found = vx.system_of(ds, force=force)
    assert eqx.tree_equal(found, with_args(system, {"k": 1.5}), typematch=True)
    assert found.force.force.rest is force
    with pytest.raises(ValueError, match="Argument `force` replaces the force of a machine"):
        vx.system_of(dataset(None), force=force)


def test_numbers_are_printed_alike_wherever_a_machine_is_from(place):
    system = vx.models.duffing_oscillator(0.8)
    vx.save(system, "machine.toml")
    attributes = {"system": json.dumps(describe(system)), "dtype": "float64"}
    others = [vx.load("machine.toml"), vx.system_of(xr.Dataset(attrs=attributes))]
    assert not any(leaf.weak_type for one in (system, *others) for leaf in jax.tree.leaves(one))
    assert {repr(one.force) for one in others} == {repr(system.force)} == {"CubicSpring(stiffness=f64[])"}


def test_impacts_of_a_machine_are_known_without_its_force():
    told = {"mass": [[2.0, 0.5], [0.5, 1.0]], "damping": np.eye(2).tolist(), "stiffness": np.eye(2).tolist()}
    told |= {"forcing": LOAD | {"amplitude": [0.6, 0.0]}, "force": {"name": "<lambda>"}}
    told |= {"stops": [{"mass": 0, "side": "upper", "position": 0.5, "restitution": 0.7}]}
    points = {"result": ("force.cubic", np.zeros(2, int))}
    ds = xr.Dataset(points, {"force.cubic": [0.5, 1.0]}, {"system": json.dumps(told), "dtype": "float64"})
    assert has_full_mass(ds)
    assert not is_linear(ds)
    machine, _ = machines(ds, np.arange(2))
    np.testing.assert_allclose(machine.inverse_mass[..., 0], np.linalg.inv(told["mass"]), rtol=1e-15)
    assert machine.contacts.num == 1


@pytest.mark.slow
def test_what_is_swept_here_is_known_here_and_elsewhere_once_it_is_allowed(place, monkeypatch):
    system = vx.load(written("springs:cubic", {"k": 1.0}), allow_forces=["springs"])
    ds = vx.sweep(system, {"args.k": [0.5, 1.0]}, transient=60, record=10, progress=False)
    monkeypatch.setattr("vijax._system.forces_by_path._known", set())
    kinds = vx.classify(ds)
    with pytest.raises(ValueError, match="springs:cubic is not imported"):
        vx.periodic_orbits(ds, progress=False)
    allowed = vx.system_of(ds.isel({"args.k": 0}), allow_forces=["springs"])
    assert float(allowed.force.args["k"]) == 0.5
    xr.testing.assert_identical(vx.classify(ds), kinds)
    assert vx.periodic_orbits(ds, progress=False).converged.all()
    monkeypatch.setattr("vijax._system.forces_by_path._known", set())
    vx.sweep(system, {"args.k": [0.5]}, transient=1, record=1, progress=False)
    assert vx.system_of(ds).force is not None  # the sweep has described it


# The command line


@pytest.fixture
def files(place):
    """A machine with a force, and the dataset of a sweep of it."""
    pytest.importorskip("h5netcdf")
    written("springs:cubic", {"k": 1.0})
    points = {
        "result": ("args.k", np.array([0, 0]), {"flag_values": [0, 1], "flag_meanings": "successful other"}),
        "num_impacts": (("args.k", "stop"), np.zeros((2, 0), int)),
    }
    ds = xr.Dataset(points, {"args.k": [0.5, 1.0], "impact": np.arange(1)})
    ds.attrs = dataset("springs:cubic", {"k": 1.0}).attrs
    ds.to_netcdf("kept.nc", engine="h5netcdf")
    return place


@pytest.mark.parametrize("file", ["machine.json", "kept.nc"])
def test_info_prints_the_name_of_a_force_and_imports_nothing(files, capsys, file):
    before = list(sys.path)
    assert main(["info", file]) == 0
    assert "force      springs:cubic with args {'k': 1.0}" in capsys.readouterr().out
    assert not marks(files)
    assert sys.path == before


def test_info_prints_no_signs_that_a_terminal_obeys(files, capsys):
    assert main(["info", written({"name": "\x1b[2J"})]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_plot_draws_a_machine_with_a_force_and_imports_nothing(files):
    assert main(["plot", "machine.json", "--out", "machine.png"]) == 0
    assert (files / "machine.png").stat().st_size
    assert not marks(files)


SWEEP = ["sweep", "machine.json", "--out", "more.nc", "--over", "args.k=1"]


@pytest.mark.parametrize("typed", [SWEEP, pytest.param(["explore", "kept.nc"], marks=pytest.mark.thorough)])
def test_other_commands_import_no_force_unless_it_is_allowed(files, capsys, typed):
    if typed[0] == "explore":
        pytest.importorskip("panel")
    assert main(typed) == 2
    assert "or `--allow-forces springs` on the command line" in capsys.readouterr().err
    assert not marks(files)
    assert not (files / "more.nc").exists()


def test_a_package_that_lies_beside_a_file_is_not_taken_for_one_that_is_missing(tmp_path):
    """The folder of a received file is not on Python's path."""
    file, away = tmp_path / "machine.json", tmp_path / "elsewhere"
    file.write_text(json.dumps(MACHINE))
    away.mkdir()
    code = f"import sys; from vijax.studio.command_line.main import main; main(['info', {str(file)!r}]); print(sys.path)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=away, check=True)
    assert str(tmp_path) not in done.stdout.splitlines()[-1].replace(str(away), "")
