"""Machines as functions of named values."""

import json
import pickle
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from families import rotor, tower

import vijax as vx
from vijax._system.parameters import get_parameter, machine_at, moved_arrays, parameter_names, set_parameter

STIFFNESSES = [1.0, 2.0]


def same(one: vx.ImpactSystem, other: vx.ImpactSystem) -> bool:
    return bool(eqx.tree_equal(one, other))


def test_values_are_those_given_and_the_defaults_in_the_order_of_the_function():
    family = vx.Family(rotor, clearance=0.7, frequency=0.8)
    assert list(family.values) == ["frequency", "eccentricity", "clearance"]
    assert [float(a) for a in family.values.values()] == [0.8, 0.5, 0.7]
    assert family.function is rotor


def test_its_machine_is_the_one_that_the_function_returns_to_the_bit():
    assert same(vx.Family(rotor, frequency=0.8).system, rotor(0.8))
    assert same(vx.Family(tower, stiffnesses=STIFFNESSES).system, tower(STIFFNESSES))


def test_at_other_values_the_others_stay():
    family = vx.Family(rotor, frequency=0.8, clearance=0.7).at(frequency=0.9)
    assert same(family.system, rotor(0.9, clearance=0.7))


def test_its_attributes_are_those_of_its_machine():
    family = vx.Family(rotor, frequency=0.8)
    assert family.num_masses == 1
    assert float(family.forcing.period) == pytest.approx(2 * np.pi / 0.8, rel=1e-15)
    assert family.stops[0].side == "upper"
    with pytest.raises(AttributeError, match="weight"):
        family.weight  # noqa: B018


def test_leaves_are_the_values():
    family = vx.Family(tower, stiffnesses=STIFFNESSES)
    assert [np.shape(a) for a in jax.tree.leaves(family)] == [(2,), (), ()]
    assert parameter_names(family) == ["stiffnesses", "frequency", "ratio"]
    assert float(get_parameter(family, "stiffnesses[1]")) == 2.0


def test_a_path_sets_one_value():
    family = set_parameter(vx.Family(tower, stiffnesses=STIFFNESSES), "stiffnesses[1]", 3.0)
    assert same(family.system, tower([1.0, 3.0]))
    assert same(machine_at(family, "ratio", 0.1), tower([1.0, 3.0], ratio=0.1))


def test_the_arrays_that_a_value_moves_are_read_off_the_program():
    family = vx.Family(tower, stiffnesses=STIFFNESSES)
    assert moved_arrays(family, "stiffnesses[0]") == ["damping", "stiffness"]
    assert moved_arrays(family, "ratio") == ["damping"]
    assert moved_arrays(vx.Family(rotor, frequency=0.8), "frequency") == [
        "forcing.amplitude",
        "forcing.frequency",
    ]
    assert moved_arrays(tower(STIFFNESSES), "stops[0].position") == ["stops[0].position"]


@pytest.mark.slow
def test_derivatives_pass_through_the_function():
    family = vx.Family(tower, stiffnesses=STIFFNESSES)

    def end(family):
        return vx.simulate(family, 0.0, 20.0).x1[1]

    gradient = jax.grad(end)(family)
    assert isinstance(gradient, vx.Family)
    of_machine = jax.grad(end)(family.system)
    by_hand = jax.vjp(lambda k, r: tower(k, ratio=r), jnp.asarray(STIFFNESSES), jnp.asarray(0.05))[1](
        of_machine
    )
    np.testing.assert_allclose(gradient.values["stiffnesses"], by_hand[0], rtol=1e-12)
    np.testing.assert_allclose(gradient.values["ratio"], by_hand[1], rtol=1e-12)


@pytest.mark.slow
def test_derivatives_by_one_name_are_those_of_the_family():
    family = vx.Family(tower, stiffnesses=STIFFNESSES)

    def end(family):
        return vx.simulate(family, 0.0, 20.0).x1[1]

    by_name = jax.grad(lambda ratio: end(family.at(ratio=ratio)))(0.05)
    np.testing.assert_allclose(by_name, jax.grad(end)(family).values["ratio"], rtol=1e-12)


@pytest.mark.thorough
def test_jit_and_vmap_take_a_family_like_an_array():
    family = vx.Family(rotor, frequency=0.8)
    ends = jax.jit(jax.vmap(lambda w: vx.simulate(family.at(frequency=w), 0.0, 20.0).x1))(
        jnp.array([0.7, 0.8])
    )
    alone = [vx.simulate(rotor(w), 0.0, 20.0).x1 for w in (0.7, 0.8)]
    np.testing.assert_allclose(ends, alone, rtol=1e-12)


def test_a_function_written_again_makes_an_equal_structure():
    cell = "def made(w, k=1.0):\n    return vx.ImpactSystem([1.0], [[0.0]], [[k]], vx.Harmonic([w * w], w))\n"
    first, again = {"vx": vx}, {"vx": vx}
    exec(cell, first)
    exec(cell, again)
    families = [vx.Family(one["made"], w=0.8) for one in (first, again)]
    assert first["made"] is not again["made"]
    assert jax.tree.structure(families[0]) == jax.tree.structure(families[1])


def test_the_function_is_called_once():
    calls = []

    def slow(k, w=0.8):
        calls.append(k)
        return vx.ImpactSystem([1.0], [[0.1]], [[k]], vx.Harmonic([0.3], w), [vx.Stop(0, 0.3)])

    family = vx.Family(slow, k=1.0)
    assert same(family.at(k=2.0).system, vx.Family(slow, k=2.0).at().system)
    calls.clear()
    family = vx.Family(slow, k=1.0)
    vx.sweep(family, {"k": np.linspace(0.8, 1.2, 5)}, transient=2, record=2, progress=False)
    vx.simulate(family.at(k=1.1), 0.0, 1.0)
    assert len(calls) == 1


def test_what_partial_binds_is_no_value():
    def beam(count, k=1.0, name="beam", is_free=False):
        return vx.chain(np.ones(count), np.zeros(count), k * np.ones(count))

    family = vx.Family(partial(beam, count=3), k=2.0)
    assert list(family.values) == ["k"]
    assert family.num_masses == 3


def test_a_family_can_be_pickled():
    family = pickle.loads(pickle.dumps(vx.Family(rotor, frequency=0.8)))
    assert same(family.system, rotor(0.8))


def test_its_text_names_function_and_values():
    assert (
        repr(vx.Family(rotor, frequency=0.8))
        == "Family(rotor, frequency=0.8, eccentricity=0.5, clearance=0.6)"
    )


class Cubic(eqx.Module):
    k: jax.Array

    def __call__(self, t, x, v, args):
        return -self.k * x**3


def test_a_force_may_have_values_as_its_fields():
    def duffing(k, w=1.0):
        return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.3], w), force=Cubic(k))

    family = vx.Family(duffing, k=0.2)
    end = vx.simulate(family, 0.0, 5.0).x1
    np.testing.assert_array_equal(end, vx.simulate(duffing(jnp.asarray(0.2)), 0.0, 5.0).x1)
    assert isinstance(family.system.force, Cubic)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: vx.Family(rotor, frequncy=0.8), "no value `frequncy`.*did you mean `frequency`"),
        (lambda: vx.Family(rotor), "needs a value for `frequency`"),
        (lambda: vx.Family(lambda k: k, k=1.0), "must return a machine"),
        (lambda: vx.Family(rotor, frequency=0.8).at(clearence=1.0), "did you mean `clearance`"),
        (
            lambda: vx.Family(tower, stiffnesses=STIFFNESSES).at(stiffnesses=[1.0, 1.0, 1.0]),
            "must have one entry per mass",
        ),
        (lambda: vx.Family(rotor, frequency=0.8, clearance=np.nan), "`position` must be finite"),
        (lambda: vx.Family(rotor, frequency="fast"), "real numbers"),
        (lambda: vx.Family(7, k=1.0), "must be a function"),
        (lambda: vx.Family(lambda x0: rotor(x0), x0=1.0), "`x0` is no name"),
        (lambda: vx.Family(rotor, frequency=0.8, labels={"speed": "Speed"}), "no value `speed`"),
        (lambda: vx.Family(lambda: rotor(0.8)), "at least one number"),
    ],
)
def test_bad_input_gets_a_sentence(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()


def test_another_kind_of_machine_at_other_values_is_refused():
    def grown(masses):
        n = len(masses)
        return vx.chain(masses, np.zeros(n), np.ones(n))

    with pytest.raises(ValueError, match="machines of one kind"):
        vx.Family(grown, masses=[1.0, 1.0]).at(masses=[1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    "function",
    [
        lambda k: rotor(k) if k > 0 else rotor(-k),
        lambda k: rotor(float(k)),
        lambda k: vx.ImpactSystem(np.ones(1), np.zeros((1, 1)), np.array([[k]]) @ np.ones((1, 1))),
        lambda k: vx.chain(np.ones(int(k)), np.zeros(2), np.ones(2)),
    ],
    ids=["if", "float", "numpy", "int"],
)
def test_what_cannot_be_traced_gets_the_error_of_jax_with_a_sentence(function):
    with pytest.raises(
        (TypeError, jax.errors.JAXTypeError), match=r"The function of a family is traced: use `jnp.where`"
    ):
        vx.Family(function, k=0.8)


def test_a_force_that_encloses_values_is_refused():
    def duffing(k):
        return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], force=lambda t, x, v, args: -k * x**3)

    with pytest.raises(ValueError, match="encloses values of the family"):
        vx.Family(duffing, k=0.2)


def test_a_traced_number_that_is_no_value_is_refused():
    def objective(e):
        return vx.Family(lambda w: rotor(w, e), w=0.8).system.forcing.amplitude[0]

    with pytest.raises(ValueError, match="none of its values"):
        jax.grad(objective)(0.5)


def test_paths_into_the_machine_are_refused_with_the_names():
    family = vx.Family(rotor, frequency=0.8)
    with pytest.raises(ValueError, match=r"frequency, eccentricity, clearance.*let the function take it"):
        vx.sweep(family, {"stops[0].position": [0.1]}, progress=False)
    with pytest.raises(ValueError, match="did you mean `frequency`"):
        vx.sweep(family, {"forcing.frequency": [0.1]}, progress=False)


def test_a_file_gives_the_family_back(tmp_path):
    family = vx.Family(tower, stiffnesses=STIFFNESSES, labels={"ratio": "Damping ratio"})
    for name in ("family.toml", "family.json"):
        vx.save(family, tmp_path / name)
        found = vx.load(tmp_path / name, allow_forces=["families"])
        assert isinstance(found, vx.Family)
        assert found.labels == {"ratio": "Damping ratio"}
        assert same(found.system, family.system)
    table = json.loads((tmp_path / "family.json").read_text())
    assert table["family"]["function"] == "families:tower"


@pytest.mark.parametrize(
    "table",
    [
        {"values": {"stiffnesses": [1.0, 2.0]}},
        {"function": "families:tower", "values": [1.0]},
        {"function": "families:tower", "values": {"stiffnesses": "stiff"}},
        {"function": "families:tower", "values": {"stiffnesses": [1.0, 2.0], "labels": 1.0}},
        {"function": "families:tower", "values": {"stiffnesses": [1.0, 2.0]}, "labels": {"ratio": 1.0}},
        {"function": "families:tower", "values": {"ratio": 1.0}},
        {"function": "tower", "values": {"stiffnesses": [1.0, 2.0]}},
        {"function": "families:none", "values": {"stiffnesses": [1.0, 2.0]}},
    ],
    ids=str,
)
def test_a_damaged_table_gets_a_sentence(table, tmp_path):
    file = tmp_path / "family.json"
    file.write_text(json.dumps({"family": table}))
    with pytest.raises(ValueError, match=r"family\.json: "):
        vx.load(file, allow_forces=["families"])


def with_cubic(factor):
    def force(t, x, v, args):
        return -factor * x**3

    return vx.Family(
        lambda w: vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.3], w), force=force), w=0.8
    )


@pytest.mark.thorough
def test_families_that_differ_in_their_force_alone_are_told_apart():
    first, second = with_cubic(0.1), with_cubic(0.2)
    assert first.program.digest != second.program.digest == with_cubic(0.2).program.digest
    ds = vx.sweep(first, {"w": [0.8]}, transient=2, record=1, progress=False)
    vx.sweep(second, {"w": [0.8]}, transient=2, record=1, progress=False)
    found = vx.system_of(ds)
    np.testing.assert_array_equal(vx.simulate(found, 0.0, 5.0).x1, vx.simulate(first, 0.0, 5.0).x1)


def test_a_file_needs_permission_and_an_import_path(tmp_path):
    file = tmp_path / "family.json"
    file.write_text(json.dumps({"family": {"function": "os:system", "values": {"command": 1.0}}}))
    with pytest.raises(ValueError, match="function of the family os:system is not imported"):
        vx.load(file)
    file.write_text(json.dumps({"family": {"function": "families:tower", "values": {}, "value": {}}}))
    with pytest.raises(ValueError, match=r"`value`, which is not known.*did you mean `values`"):
        vx.load(file, allow_forces=["families"])
    with pytest.raises(ValueError, match="cannot be imported"):
        vx.save(vx.Family(lambda k: rotor(k), k=0.8), file)
