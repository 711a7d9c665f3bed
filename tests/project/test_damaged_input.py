"""Random damage to machine files, datasets, stores and command lines: a sentence, no traceback, no import, no hang.

`VIJAX_EXAMPLES=5000` tries so many new examples of each, at random.
"""

import copy
import importlib
import json
import os
import warnings

import jaxtyping
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings, strategies as st

import vijax as vx
from vijax._system.description import describe
from vijax.studio.command_line.main import main

FEW = settings(
    max_examples=int(os.environ.get("VIJAX_EXAMPLES", "60")),
    derandomize="VIJAX_EXAMPLES" not in os.environ,
    deadline=20_000,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
LOAD = vx.Harmonic([[0.3, 0.0], [0.1, 0.2]], 0.8, [[0.1, 0.2]] * 2, [0.1, 0.2])
LIMITS = [
    vx.Stop(1, 0.3, "upper", vx.FallingRestitution(0.8, 0.1)),
    vx.Stop(0, -0.5, "lower", 0.0, vx.Harmonic([[0.1], [0.2]], 0.8)),
    vx.Contact({1: -0.3, 0: 1.0}, 0.3, 0.5),
    vx.CompliantStop(0, 2.0, "upper", 100.0, 1.0, 0.1),
    vx.CompliantContact({0: 1.0, 1: -1.0}, 3.0, 10.0),
]
RUBBING = [vx.Friction({0: 1.0, 1: -1.0}, 1.0, 1.2, 0.1), vx.Friction(0, 0.3)]
MASS = [[2.0, 0.3], [0.3, 1.0]]
MACHINE = describe(
    vx.ImpactSystem(MASS, [[0.3, -0.1], [-0.1, 0.1]], np.eye(2), LOAD, LIMITS, friction=RUBBING)
)
# Values that are likely to be taken for something else.
ODD = st.one_of(
    st.sampled_from([None, True, False, 0, 1, -1, 1e308, 10**400, 2**70, float("nan"), float("inf"), 5e-324]),
    st.sampled_from(
        ["", "a", "0", "1e5", "os:system", "builtins:exec", "vijax.models:nothing", "upper", "\x00"]
    ),
    st.sampled_from(
        [[], [[]], [0], [None], [[0], [0, 1]], {}, {"0": 1.0}, {"-1": 1.0}, {"99": 1}, {"x": {}}]
    ),
    st.sampled_from(
        [{"law": "FallingRestitution"}, {"law": "os:system"}, {"law": []}, {"path": "os:system"}]
    ),
    st.floats(),
    st.text(max_size=8),
)
NAMES = st.sampled_from(
    ["x", "mass", "row", "side", "force", "args", "num_states", "stiffness", "motion", "", "law"]
)


@pytest.fixture(autouse=True)
def imported(monkeypatch):
    """Names of modules that the library asked for, which a file could have named."""
    names, original = [], importlib.import_module

    def spy(name, *rest):
        names.append(name)
        return original(name, *rest)

    monkeypatch.setattr(importlib, "import_module", spy)
    yield names
    assert not {name.split(".")[0] for name in names} & {"os", "builtins", "subprocess"}
    plt.close("all")


def message_of(function, *arguments) -> str | None:
    """Message of the `ValueError` that a call raises, None if it returns."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            function(*arguments)
    except ValueError as error:
        return str(error)
    except jaxtyping.TypeCheckError:  # these tests alone check annotations
        return "wrong type"
    return None


def is_sentence(message: str | None) -> bool:
    """True for a message in one line, or none."""
    return message is None or (bool(message.strip()) and "\n" not in message)


def places_in(tree, place=()):
    """Places of all parts of a tree of tables and lists."""
    yield place
    parts = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, part in parts:
        yield from places_in(part, (*place, key))


@st.composite
def damaged_trees(draw, tree):
    """A tree of which one to three parts are replaced, removed or added."""
    tree = copy.deepcopy(tree)
    for _ in range(draw(st.integers(1, 3))):
        *way, key = draw(st.sampled_from([place for place in places_in(tree) if place] or [("x",)]))
        inside = tree
        for step in way:
            inside = inside[step]
        what = draw(st.sampled_from(["replace", "replace", "remove", "add"]))
        if what == "remove" and (key in inside or isinstance(inside, list)):
            del inside[key]
        elif what == "add" and isinstance(inside, list):
            inside.append(copy.deepcopy(draw(ODD)))
        elif what == "add":
            inside[draw(NAMES)] = copy.deepcopy(draw(ODD))
        elif isinstance(inside, list) or key in inside:
            inside[key] = copy.deepcopy(draw(ODD))
        if not tree:
            break
    return tree


@st.composite
def damaged_bytes(draw, content: bytes):
    """Bytes of which some are changed, removed or added, or the end is cut off."""
    found = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        k = draw(st.integers(0, max(0, len(found) - 1)))
        what = draw(st.sampled_from(["change", "remove", "add", "cut"]))
        if what == "change" and found:
            found[k] = draw(st.integers(0, 255))
        elif what == "add":
            found[k:k] = draw(st.binary(min_size=1, max_size=3))
        else:
            del found[k : k + 1 if what == "remove" else None]
    return bytes(found)


@FEW
@given(tree=damaged_trees(MACHINE))
def test_machine_files_with_odd_values(tmp_path, tree):
    file = tmp_path / "machine.json"
    file.write_bytes(json.dumps(tree).encode("utf-8", "surrogatepass"))
    assert is_sentence(message_of(vx.load, file))


@pytest.mark.parametrize("ending", ["json", "toml"])
@FEW
@given(data=st.data())
def test_machine_files_with_damaged_bytes(tmp_path, ending, data):
    file = tmp_path / f"machine.{ending}"
    vx.save(vx.models.wagg_bishop_b(0.8), file)
    file.write_bytes(data.draw(damaged_bytes(file.read_bytes())))
    assert is_sentence(message_of(vx.load, file))


@pytest.fixture(scope="module")
def swept() -> xr.Dataset:
    values = {"forcing.frequency": [0.5, 0.8, 1.4]}
    return vx.sweep(vx.models.wagg_bishop_b(0.8), values, transient=4, record=3, progress=False)


@pytest.fixture(scope="module")
def followed() -> xr.Dataset:
    system = vx.models.impact_oscillator(2.3, position=-0.2, restitution=0.6, damping_ratio=0.05)
    orbit = vx.periodic_orbit(system, [-1.56766], [0.771438])
    return vx.continuation(orbit, "stops[0].restitution", (0.5, 0.65), progress=False).points


OF_SWEEPS = (
    vx.system_of,
    vx.impact_map,
    vx.stroboscopic_section,
    vx.impacts,
    vx.classify,
    vx.plot.bifurcation,
    lambda ds: vx.combine([ds, ds]),
)
OF_BRANCHES = (
    lambda points: repr(vx.Branch(points)),
    lambda points: vx.Branch(points).orbit(0),
    lambda points: vx.Branch(points).bifurcations,
    lambda points: vx.plot.branch(vx.Branch(points)),
)


@st.composite
def damaged_datasets(draw, ds):
    """A dataset with other attributes, without columns, cut, or with columns of another type."""
    ds = ds.copy(deep=True)
    what = draw(
        st.sampled_from(["attribute", "attribute", "system", "no attribute", "drop", "cut", "type", "rename"])
    )
    if what == "attribute":
        ds.attrs[draw(st.sampled_from([*ds.attrs]))] = draw(ODD)
    elif what == "system":
        ds.attrs["system"] = json.dumps(draw(damaged_trees(json.loads(ds.attrs["system"]))))
    elif what == "no attribute":
        del ds.attrs[draw(st.sampled_from([*ds.attrs]))]
    elif what == "drop":
        ds = ds.drop_vars(draw(st.sampled_from([str(name) for name in ds.variables])))
    elif what == "cut":
        part = draw(st.sampled_from([slice(0, 0), slice(0, 1), 0, slice(None, None, -1)]))
        ds = ds.isel({draw(st.sampled_from([str(dim) for dim in ds.sizes])): part})
    elif what == "rename":
        ds = ds.rename({draw(st.sampled_from([str(dim) for dim in ds.sizes])): "q"})
    else:
        name = draw(st.sampled_from([str(name) for name in ds.data_vars]))
        fill = draw(st.sampled_from([np.nan, -5, 10**9, "x", 1j, None]))
        ds[name] = (ds[name].dims, np.full(ds[name].shape, fill))
    return ds


@FEW
@given(data=st.data())
def test_datasets_of_sweeps(swept, data):
    message = message_of(data.draw(st.sampled_from(OF_SWEEPS)), data.draw(damaged_datasets(swept)))
    assert is_sentence(message)


@pytest.mark.slow
@FEW
@given(data=st.data())
def test_datasets_of_branches(followed, data):
    message = message_of(data.draw(st.sampled_from(OF_BRANCHES)), data.draw(damaged_datasets(followed)))
    assert is_sentence(message)


@pytest.mark.slow
@FEW
@given(data=st.data())
def test_stores_give_the_same_or_a_sentence(swept, tmp_path_factory, data):
    store = tmp_path_factory.mktemp("store")
    again = lambda: vx.sweep(  # noqa: E731
        vx.models.wagg_bishop_b(0.8),
        {"forcing.frequency": [0.5, 0.8, 1.4]},
        transient=4,
        record=3,
        progress=False,
        store=store,
    )
    again()
    file = data.draw(st.sampled_from(sorted(path for path in store.rglob("*") if path.is_file())))
    file.write_bytes(data.draw(damaged_bytes(file.read_bytes())))
    found = []
    message = message_of(lambda: found.append(again()))
    assert is_sentence(message)
    if message is None:
        xr.testing.assert_equal(found[0].drop_vars("steps"), swept.drop_vars("steps"))


WORDS = st.one_of(
    st.sampled_from(["machine.toml", "kept.nc", "nowhere.toml", ".", "", "-", "--", "kept.txt", "out.png"]),
    st.sampled_from(
        ["--out", "--over", "--set", "--x0", "--transient", "--record", "--along", "--periods", "--at"]
    ),
    st.sampled_from(
        ["--picture", "--stop", "--bounds", "--rng", "--no-progress", "--ordinate", "--mass", "-h"]
    ),
    st.sampled_from(
        ["forcing.frequency=0.5:0.8:3", "forcing.frequency=", "=1", "x=1:2", "0:1", "1e400", "nan", "-1"]
    ),
    st.text(max_size=6),
)


@FEW
@given(
    command=st.sampled_from(["sweep", "orbit", "branch", "attractors", "basins", "info", "plot"]),
    words=st.lists(WORDS, max_size=6),
)
def test_command_lines(swept, tmp_path, monkeypatch, capsys, command, words):
    monkeypatch.chdir(tmp_path)
    if not (tmp_path / "machine.toml").exists():
        vx.save(vx.models.wagg_bishop_b(0.8), "machine.toml")
        swept.to_netcdf("kept.nc", engine="h5netcdf")
    try:
        code = main([command, *words])
    except SystemExit as stopped:
        code = stopped.code
    told = capsys.readouterr().err
    assert code in (0, 2)
    assert "Traceback" not in told
    assert (code == 0) or told.strip()
