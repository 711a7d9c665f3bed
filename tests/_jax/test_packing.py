"""A packed tree has the numbers, shapes, types and other leaves of the tree."""

import copy
import pickle

import jax
import jax.core
import numpy as np
import pytest

import vijax as vx
from vijax._jax.packing import Packed, layout_of, pack

TREE = {
    "reals": (np.arange(6.0).reshape(2, 3), np.float32(0.1)),
    "wholes": [np.arange(3), np.array([True, False]), np.int8(-3)],
    "empty": np.zeros((0, 4)),
    "others": ("a word", 2.5, None),
}


def assert_same(found, expected) -> None:
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        if isinstance(b, np.ndarray | np.generic):
            assert (a.shape, a.dtype) == (b.shape, b.dtype)
        np.testing.assert_array_equal(a, b)


def test_what_is_packed_is_unpacked_unchanged():
    packed = pack(TREE)
    assert (packed.reals.shape, packed.wholes.shape) == ((7,), (6,))
    assert_same(packed.unpacked(), TREE)


def test_a_program_unpacks_what_numpy_packed_and_packs_what_numpy_unpacks():
    again = jax.jit(lambda packed: pack(packed.unpacked()))(pack(TREE))
    assert again.layout == pack(TREE).layout
    assert_same(jax.tree.map(np.asarray, again).unpacked(), TREE)


def test_numbers_on_the_device_are_unpacked_to_arrays_of_jax_even_while_a_program_is_traced():
    packed = jax.device_put(pack(TREE))
    kinds = []

    def traced(x: jax.Array) -> jax.Array:
        kinds.extend(type(a) for a in jax.tree.leaves(packed.unpacked()["reals"]))
        return x

    jax.jit(traced)(1.0)
    assert kinds
    assert not any(issubclass(kind, jax.core.Tracer) for kind in kinds)
    assert_same(packed.unpacked(), jax.tree.map(lambda a: a, TREE))


def test_a_batch_has_its_axes_first():
    doubled = jax.tree.map(lambda a: np.stack([a, 2 * a.astype(a.dtype)]), pack(TREE))
    found = doubled.unpacked()
    np.testing.assert_array_equal(found["reals"][0][1], 2 * TREE["reals"][0])
    assert found["wholes"][0].shape == (2, 3)


def test_layouts_of_equal_trees_are_one_object_and_of_others_differ():
    assert layout_of(TREE) is layout_of(copy.deepcopy(TREE))
    for other in (TREE | {"others": ("a word", 2.0, None)}, TREE | {"empty": np.zeros((4, 0))}):
        assert layout_of(other) != layout_of(TREE)


@pytest.mark.parametrize("through", [copy.deepcopy, lambda a: pickle.loads(pickle.dumps(a))])
def test_a_packed_machine_is_copied_and_pickled(through):
    packed = pack(vx.models.wagg_bishop_a(0.8))
    other = through(packed)
    assert isinstance(other, Packed)
    assert other.layout == packed.layout
    np.testing.assert_array_equal(other.reals, packed.reals)


def test_a_batch_of_trees_is_packed_row_by_row():
    rng = np.random.default_rng(0)
    tree = {
        "matrix": rng.normal(size=(3, 2, 2)),
        "number": rng.normal(size=3),
        "nothing": np.zeros((3, 0)),
        "flags": rng.random((3, 4)) < 0.5,
        "roots": rng.normal(size=(3, 2)) + 1j,
    }
    tree["roots"][0, 0] = complex(np.inf, -np.inf)
    rows = pack(tree, has_rows=True)
    assert (rows.reals.shape, rows.wholes.shape) == ((3, 9), (3, 4))
    again, second = rows.unpacked(), rows.at(1).unpacked()
    for name, a in tree.items():
        np.testing.assert_array_equal(again[name], a)
        np.testing.assert_array_equal(second[name], a[1])
        assert again[name].dtype == a.dtype
    traced = jax.jit(jax.vmap(lambda row: row.unpacked()))(rows)
    for name, a in tree.items():
        np.testing.assert_array_equal(traced[name], a)


def test_a_batch_without_whole_numbers_has_rows_all_the_same():
    rows = pack({"a": np.ones((3, 2))}, has_rows=True)
    assert rows.wholes.shape == (3, 0)
    np.testing.assert_array_equal(rows.at(np.array([0, 2])).unpacked()["a"], np.ones((2, 2)))
