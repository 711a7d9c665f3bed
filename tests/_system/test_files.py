"""Machine files return every bit, and errors in a file are reported."""

import json
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._system.description import describe

THIRD = 1 / 3
LOAD = vx.Harmonic([[THIRD, 0.0], [1e-300, -0.0]], np.pi, [[0.1, 0.2]] * 2, [THIRD, 1e22])
MOTION = vx.Harmonic([[0.1], [THIRD]], np.pi, [[0.0], [1.0]], [5e-324])
LIMITS = [
    vx.Stop(1, THIRD, "upper", 0.7),
    vx.Stop(0, -np.sqrt(2), "lower", 0.0, MOTION),
    vx.Contact({1: -THIRD, 0: 1.0}, 0.3, THIRD, MOTION),
]
MASS = [[2.0, THIRD], [THIRD, 1.0]]
TEXT = """
mass = [1]
damping = [[0.1]]
stiffness = [[1.0]]
stops = [{mass = 0, position = 0.3, side = "upper", restitution = 0.7}]
[forcing]
amplitude = [0.6]
frequency = 0.8
"""


class Spring(eqx.Module):
    """A number, an array, parts in a dict, a function, and a static integer."""

    cubic: jax.Array | float
    table: jax.Array | np.ndarray
    parts: dict[str, jax.Array | float]
    law: object
    power: int = eqx.field(static=True, default=3)

    def __call__(self, t, x, v, args):
        return -self.cubic * self.law(x) - self.parts["drag"] * v


def cube(x):
    return x**3


def by_args(t, x, v, args):
    return -args["cubic"] * x - args["pair"][0] * args["rows"][0, 0]


ARGS = {"cubic": THIRD, "pair": (1.0, [2.0]), "rows": np.array([[0.5, THIRD]])}
FORCES = {
    "none": (None, None),
    "function": (by_args, ARGS),
    "module": (Spring(THIRD, np.array([THIRD, 1.0]), {"drag": 0.5}, cube), None),
}


def machine(force=None) -> vx.ImpactSystem:
    return vx.ImpactSystem(MASS, [[0.3, -0.1], [-0.1, 0.1]], [[1.0, 0.0], [0.0, np.e]], LOAD, LIMITS, force)


@pytest.mark.parametrize("ending", ["toml", "json"])
@pytest.mark.parametrize("kind", FORCES)
def test_a_machine_comes_back_from_a_file_bit_for_bit(tmp_path, ending, kind):
    force, args = FORCES[kind]
    file, system = tmp_path / f"machine.{ending}", machine(force)
    vx.save(system, file, args=args)
    found = vx.load(file)
    if args is not None:
        assert eqx.tree_equal(found.force.args, jax.tree.map(jnp.asarray, args), typematch=True)
        assert found.force.force is not None
        found = eqx.tree_at(lambda s: s.force, found, found.force.force)
    assert eqx.tree_equal(found, system, typematch=True)
    again = tmp_path / f"again.{ending}"
    vx.save(vx.load(file), again)
    assert again.read_text() == file.read_text()


def test_a_machine_is_written_by_hand_with_few_words(tmp_path):
    file = tmp_path / "machine.toml"
    file.write_text(TEXT)
    plain = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.6], 0.8), [vx.Stop(0, 0.3, "upper", 0.7)])
    assert eqx.tree_equal(vx.load(file), plain, typematch=True)


def test_a_force_is_found_by_its_path_and_has_its_args(tmp_path, monkeypatch):
    (tmp_path / "springs.py").write_text("def cubic(t, x, v, args):\n    return -args[0] * x**3\n")
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "machine.toml"
    file.write_text('force = "springs:cubic"\nargs = [2.0]\n' + TEXT)
    force = vx.load(file, allow_forces=["springs"]).force
    found = force(jnp.asarray(0.0), jnp.asarray([0.5]), jnp.asarray([0.0]))
    np.testing.assert_allclose(found, [-0.25], rtol=1e-15)
    monkeypatch.delitem(sys.modules, "springs")


def local_force():
    def inside(t, x, v, args):
        return -x

    return inside


@pytest.mark.parametrize(
    "force",
    [lambda t, x, v, args: -x, local_force(), Spring(1.0, np.ones(1), {"drag": 0.5}, lambda x: x)],
)
def test_a_force_that_no_import_finds_is_refused(tmp_path, force):
    with pytest.raises(ValueError, match=r"which no text can hold\. Define it at the top of a module"):
        vx.save(machine(force), tmp_path / "machine.toml")
    assert not any(tmp_path.iterdir())
    ds = xr.Dataset(attrs={"system": json.dumps(describe(machine(force))), "dtype": "float64"})
    with pytest.raises(ValueError, match="which no text can hold"):
        vx.system_of(ds)


def with_line(line: str) -> str:
    return f"{line}\n{TEXT}"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("mass = [1.0", "cannot be read as TOML"),
        ("mass = [1.0]", r"The machine has no `damping`"),
        (with_line("masses = [1.0]"), r"The machine has `masses`, which is not known: there are `mass`, "),
        (TEXT.replace("[1]", '["1"]'), r"`mass` must be a number, or lists of numbers of one length, but is"),
        (TEXT.replace("[[0.1]]", "[[0.1], [0.1, 0.2]]"), r"`damping` must be a number, or lists"),
        (TEXT.replace("[1]", "[-1]"), "mass"),
        (TEXT.replace("position", "postion"), r"`stops\[0\]` has no `position`"),
        (TEXT.replace("0.7", "1.7"), r"In `stops\[0\]`: .*`restitution`"),
        (
            TEXT.replace("mass = 0", "row = [1.0]").replace(', side = "upper"', ""),
            r"`stops\[0\].row` must be a table",
        ),
        (with_line('force = "nowhere_at_all:f"'), "'nowhere_at_all:f' cannot be imported"),
        (with_line('force = "math:pie"'), "'math:pie' cannot be imported"),
        (with_line('force = "math:pi"'), "classes of `eqx.Module`, but math:pi is of type float"),
        (with_line("force = 3.0"), '`force` must be "package.module:function"'),
        (with_line("args = [2.0]"), "`args` are passed to `force`, but there is no `force`"),
        (
            with_line('force = {path = "json:loads", k = 1.0}'),
            "json:loads is no class, so it has no fields k",
        ),
        (with_line('force = {path = "vijax.models:CubicSpring"}'), "cannot be made of the fields none"),
        (
            with_line('force = {path = "vijax.models:CubicSpring", stifness = 1.0}'),
            "CubicSpring has no field `stifness`: it has stiffness",
        ),
        (with_line('force = ".x:y"'), r"must be \"package.module:function\", but is '.x:y'"),
        (with_line('force = "vijax.models:CubicSpring"\nargs = {path = 1}'), 'function", but is 1'),
        (
            with_line('force = {path = "vijax.models:CubicSpring", stiffness = 1.0}\nargs = ["1.0"]'),
            r"A list in `force` or `args` must be an array of numbers, but is \['1.0'\]",
        ),
        (TEXT.replace("damping", "dampng"), "no `damping`: .* Instead of `dampng`, did you mean `damping`?"),
        (with_line("force = " + "[" * 50 + "]" * 50), "is nested more than 40 deep"),
        (with_line("force = " + "[" * 99999 + "]" * 99999), "is nested more than 40 deep"),
    ],
)
def test_what_is_wrong_with_a_file_is_told(tmp_path, text, sentence):
    file = tmp_path / "machine.toml"
    file.write_text(text)
    with pytest.raises(ValueError, match=sentence) as refusal:
        vx.load(file, allow_forces=True)
    assert str(file) in str(refusal.value)


def test_a_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"end in \.toml or \.json"):
        vx.load(tmp_path / "machine.yaml")
    (tmp_path / "list.json").write_text("[]")
    with pytest.raises(ValueError, match="must hold a machine, a table, but holds list"):
        vx.load(tmp_path / "list.json")
    (tmp_path / "deep.json").write_text('{"mass": ' + "[" * 99999)
    with pytest.raises(ValueError, match="is nested more than 40 deep"):
        vx.load(tmp_path / "deep.json")


def test_a_file_without_end_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr("vijax._system.files._LARGEST", 1 << 20)
    (tmp_path / "machine.json").write_text(" " * (1 << 21))
    with pytest.raises(ValueError, match="has more than 1 MiB, which no machine needs"):
        vx.load(tmp_path / "machine.json")


@pytest.mark.parametrize("make", [True, False])
def test_a_place_where_nothing_can_be_written_is_told(tmp_path, make):
    (tmp_path / "taken").write_text("")
    file = tmp_path / ("taken" if make else "nowhere") / "machine.toml"
    with pytest.raises(
        ValueError, match=r"Argument `file` must name a place that can be written to, but .* is none"
    ):
        vx.save(machine(), file)
