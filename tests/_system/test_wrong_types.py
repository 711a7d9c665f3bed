"""Arguments of a wrong type raise an error in one sentence, also for users, whose annotations are not checked."""

import json
import re
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

NUMBERS = "must be made of real numbers, but is"
LIST = (
    "Argument `stops` must be a list of `vx.Stop`, `vx.Contact`, `vx.CompliantStop` and `vx.CompliantContact`, "
    "also where there is one, but is"
)
LISTS = "Argument `{}` must be a list of `vx.{}`, also where there is one, but is [{}"
MACHINE = (
    "Argument `system` must be one machine, a `vx.ImpactSystem`, but is a list: call this for each machine"
)
LOAD = "vx.Harmonic([0.4], 0.8)"
ONE = f"vx.chain([1.0], [0.1], [1.0], {LOAD}, [vx.Stop(0, 0.3)])"
# The call, and the message.
WRONG = {
    'vx.Harmonic([0.4], "0.81")': f"Argument `frequency` {NUMBERS} '0.81'.",
    "vx.Harmonic([0.4], None)": f"Argument `frequency` {NUMBERS} None.",
    "vx.Harmonic([0.4], 10**400)": f"Argument `frequency` {NUMBERS} 1000",
    'vx.Harmonic(["0.4"], 0.8)': f"Argument `amplitude` {NUMBERS} ['0.4'].",
    "vx.Harmonic([[0.4], [0.1, 0.2]], 0.8)": f"Argument `amplitude` {NUMBERS} [[0.4], [0.1, 0.2]].",
    'vx.Harmonic([0.4], 0.8, phase="0")': f"Argument `phase` {NUMBERS} '0'.",
    'vx.Harmonic([0.4], 0.8, mean=["0"])': f"Argument `mean` {NUMBERS} ['0'].",
    'vx.Stop(0, "0.3")': f"Argument `position` {NUMBERS} '0.3'.",
    'vx.Stop(0, 0.3, "upper", "0.7")': f"Argument `restitution` {NUMBERS} '0.7'.",
    'vx.Stop("0", 0.3)': "Argument `mass` must be a whole number, 0 or more, but is '0'.",
    "vx.Stop({0: 1.0}, 0.3)": "Argument `mass` must be the index of one mass, but is {0: 1.0}. A row is a `vx.Contact`.",
    'vx.CompliantStop({0: 1}, 0.3, "upper", 9.0)': "Argument `mass` must be the index of one mass, but is {0: 1}. "
    "A row is a `vx.CompliantContact`.",
    'vx.Contact({0: "1"}, 0.3)': f"Argument `row` {NUMBERS} ['1'].",
    'vx.Contact({0: 1.0}, "0.3")': f"Argument `position` {NUMBERS} '0.3'.",
    'vx.Contact({0: 1.0}, 0.3, "0.7")': f"Argument `restitution` {NUMBERS} '0.7'.",
    f'vx.ImpactSystem("1", [[0.1]], [[1.0]], {LOAD})': f"Argument `mass` {NUMBERS} '1'.",
    f'vx.ImpactSystem([1.0], [["0.1"]], [[1.0]], {LOAD})': f"Argument `damping` {NUMBERS} [['0.1']].",
    f'vx.ImpactSystem([1.0], [[0.1]], b"1", {LOAD})': f"Argument `stiffness` {NUMBERS} b'1'.",
    f'vx.chain(["1"], [0.1], [1.0], {LOAD})': f"Argument `masses` {NUMBERS} ['1'].",
    f'vx.chain([1.0], ["0.1"], [1.0], {LOAD})': f"Argument `dampings` {NUMBERS} ['0.1'].",
    f'vx.chain([1.0], [0.1], "1", {LOAD})': f"Argument `stiffnesses` {NUMBERS} '1'.",
    f"vx.chain([1.0], [0.1], [1.0], {LOAD}, vx.Stop(0, 0.3))": f"{LIST} Stop of mass 0",
    f"vx.ImpactSystem([1.0], [[0.1]], [[1.0]], {LOAD}, vx.Contact({{0: 1.0}}))": f"{LIST} Contact",
    f"vx.chain([1.0], [0.1], [1.0], {LOAD}, None)": f"{LIST} None",
    f"vx.chain([1.0], [0.1], [1.0], {LOAD}, [0.3])": f"{LIST} [0.3]",
    "vx.chain([1.0], [0.1], [1.0], 0.5)": "Argument `forcing` must be a load, a `vx.Harmonic`",
    # Elements in the lists of others, and lists of machines.
    f"vx.chain([1.0], [0.1], [1.0], {LOAD}, [vx.Friction(0, 1.0)])": f"{LIST} [Friction",
    f"vx.ImpactSystem([1.0], [[0.1]], [[1.0]], {LOAD}, [vx.Jenkins(0, 1.0, 1.0)])": f"{LIST} [Jenkins",
    f'vx.ImpactSystem([1.0], [[0.1]], [[1.0]], {LOAD}, friction=[vx.CompliantStop(0, 1.0, "upper", 9.0)])': LISTS.format(
        "friction", "Friction", "Compliant stop"
    ),
    f"vx.ImpactSystem([1.0], [[0.1]], [[1.0]], {LOAD}, hysteresis=[vx.Friction(0, 1.0)])": LISTS.format(
        "hysteresis", "Jenkins", "Friction"
    ),
    f"vx.simulate([{ONE}, {ONE}], 0.0, 1.0)": MACHINE,
    f'vx.sweep([{ONE}, {ONE}], {{"forcing.frequency": [1.0]}})': MACHINE,
    f'vx.simulate({ONE}, "0", 1.0)': f"Argument `t0` {NUMBERS} '0'.",
    f'vx.simulate({ONE}, 0.0, "1")': f"Argument `t1` {NUMBERS} '1'.",
    f'vx.simulate({ONE}, 0.0, 1.0, ["0"])': f"Argument `x0` {NUMBERS} ['0'].",
    f'vx.simulate({ONE}, 0.0, 1.0, v0="0")': f"Argument `v0` {NUMBERS} '0'.",
    f'vx.simulate({ONE}, 0.0, 1.0, ts=["0"])': f"Argument `ts` {NUMBERS} ['0'].",
    f'vx.sweep({ONE}, {{"forcing.frequency": ["1"]}})': f"Argument `forcing.frequency` {NUMBERS} ['1'].",
    f'vx.sweep({ONE}, {{"forcing.frequency": [1.0]}}, x0=["0"])': f"Argument `x0` {NUMBERS} ['0'].",
    f"vx.sweep({ONE}, None)": "Argument `values` must give the values of each quantity by its path",
    'vx.base_excitation(["1"], 0.1, 0.8)': f"Argument `mass` {NUMBERS} ['1'].",
    'vx.models.bouncing_ball(gravity="9.81")': f"Argument `gravity` {NUMBERS} '9.81'.",
    'vx.models.uniform_chain(0.8, num_masses="2")': "Argument `num_masses` must be a whole number, 2 or more",
    'vx.load("m.toml", allow_forces=3)': "m.toml: Argument `allow_forces` must be True, or the names of modules",
}
RUN = """
import json, sys
import vijax as vx
told = {}
for call in json.load(sys.stdin):
    try:
        eval(call)
    except Exception as error:
        told[call] = f"{type(error).__name__}: {error}"
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Messages of all calls in a process that does not check annotations."""
    folder = tmp_path_factory.mktemp("wrong")
    force = 'force = "springs:cubic"\n[forcing]\namplitude = [0.6]\nfrequency = 0.8\n'
    (folder / "m.toml").write_text("mass = [1.0]\ndamping = [[0.1]]\nstiffness = [[1.0]]\n" + force)
    command = [sys.executable, "-W", "ignore", "-c", RUN]
    run = {"input": json.dumps(list(WRONG)), "capture_output": True, "text": True, "cwd": folder}
    return json.loads(subprocess.run(command, **run, check=True).stdout)


@pytest.mark.parametrize("call", WRONG)
def test_a_wrong_type_is_told(told, call):
    assert told.get(call, "accepted").startswith(f"ValueError: {WRONG[call]}")


def test_fractions_and_decimals_are_numbers():
    load = vx.Harmonic([Fraction(1, 3), Decimal("0.5")], np.float32(0.5))
    np.testing.assert_array_equal(load.amplitude, [1 / 3, 0.5])
    assert float(load.frequency) == 0.5


def test_numbers_of_machines_have_one_type_whatever_they_are_given_as():
    """Weak types, of Python's numbers, print differently and need another compilation."""
    given = (0.8, np.float64(0.8), np.array(0.8), jnp.asarray(0.8), jnp.array(0.8, jnp.float64))
    loads = [vx.Harmonic([0.4], one) for one in given]
    assert [load.frequency.weak_type for load in loads] == [False] * len(given)
    assert {str(jax.typeof(load.frequency)) for load in loads} == {"float64[]"}


# Misspelt names


SYSTEM = vx.models.wagg_bishop_b(0.8)


@pytest.mark.parametrize(
    ("path", "meant"),
    [
        ("amplitude", "forcing.amplitude"),
        ("amplitude[1]", "forcing.amplitude[1]"),
        ("forcing.amplitud[0]", "forcing.amplitude[0]"),
        ("frequency", "forcing.frequency"),
        ("Forcing.Frequency", "forcing.frequency"),
        ("dampng[0][1]", "damping[0][1]"),
        ("restitution", "stops[*].restitution"),
        ("stop[0].position", "stops[0].position"),
        ("stiffness[0,1]", "stiffness[0][1]"),
        ("damping[1, 1]", "damping[1][1]"),
    ],
)
def test_a_path_that_is_nearly_one_is_told_which(path, meant):
    sentence = re.escape("names nothing that can be swept. There are mass, ") + ".*"
    with pytest.raises(
        ValueError, match=sentence + re.escape(f"Instead of `{path}`, did you mean `{meant}`?")
    ):
        vx.sweep(SYSTEM, {path: [0.5]}, progress=False)


@pytest.mark.parametrize("path", ["omega", "stops[5].position", "stops[0].gap", "force.cubic", "x"])
def test_a_path_that_is_like_no_other_is_told_no_more_than_what_there_is(path):
    with pytest.raises(ValueError, match="names nothing that can be swept") as refusal:
        vx.sweep(SYSTEM, {path: [0.5]}, progress=False)
    assert "did you mean" not in str(refusal.value)


def test_a_machine_without_a_load_moves_freely_and_has_no_forcing_period():
    system = vx.ImpactSystem([1.0], [[0.0]], [[4.0]])
    sol = vx.simulate(system, 0.0, 1.0, x0=[0.5])
    assert float(sol.x1[0]) == pytest.approx(0.5 * np.cos(2.0), rel=1e-14)
    with pytest.raises(ValueError, match=r"`forcing\.frequency` must be positive"):
        vx.sweep(system, {"x0[0]": [0.5]}, progress=False)
    # Each motion of a free mass without damping repeats: none is isolated.
    with pytest.raises(vx.SimulationError, match="no cycle was found"):
        vx.periodic_orbit(system, [0.5], [0.0])
