"""Periodic stiffness and damping: their values, paths, texts and symmetries."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._system.parameters import get_parameter, parameter_names, set_parameter

K = [[0.3, -0.1], [-0.1, 0.2]]
TERMS = vx.Parametric(stiffness=[K, np.eye(2)], damping=K, phase=[0.3, 0.7])


def machine(terms: Any = TERMS, load=None, stops=(), **more) -> vx.ImpactSystem:
    load = vx.Harmonic([0.5, 0.0], 0.9) if load is None else load
    return vx.ImpactSystem(
        [1.0, 2.0], 0.1 * np.eye(2), np.eye(2), load, list(stops), parametric=terms, **more
    )


def terms_of(system: vx.ImpactSystem) -> Any:
    """Parametric terms of a machine that has some."""
    return system.parametric


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({}, "needs `stiffness` or `damping`"),
        ({"stiffness": [1.0]}, "`stiffness` must have shape"),
        ({"stiffness": np.ones((2, 3))}, "`stiffness` must have shape"),
        ({"stiffness": np.eye(2), "damping": np.eye(3)}, "same size"),
        ({"stiffness": [[np.nan]]}, "`stiffness`"),
        ({"stiffness": [[1.0]], "frequency": -1.0}, "`frequency` must be positive"),
        ({"stiffness": [[1.0]], "phase": [0.0, 1.0]}, r"`phase` must have shape \(1,\)"),
    ],
)
def test_wrong_values_are_refused(given, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.Parametric(**given)


def test_machines_refuse_terms_that_do_not_fit():
    with pytest.raises(ValueError, match="matrices of 1 masses"):
        machine(vx.Parametric([[1.0]]))
    with pytest.raises(ValueError, match="give it one"):
        vx.ImpactSystem([1.0], [[0.1]], [[1.0]], parametric=vx.Parametric([[1.0]]))
    record = vx.Tabulated([0.0, 1.0], np.zeros((2, 2)))
    with pytest.raises(ValueError, match="give it one"):
        machine(load=record)


def test_the_force_is_that_of_the_terms():
    x, v, t = np.array([0.3, -0.2]), np.array([0.5, 0.1]), 0.7
    waves = np.cos([0.9 * t + 0.3, 2 * 0.9 * t + 0.7])
    k, c = waves[0] * np.array(K) + waves[1] * np.eye(2), waves[0] * np.array(K)
    found = terms_of(machine())(jnp.asarray(t), jnp.asarray(x), jnp.asarray(v))
    np.testing.assert_allclose(found, -(k @ x) - c @ v, rtol=1e-15)


def test_the_frequency_is_that_of_the_load_unless_there_is_none():
    shared, own = machine(), machine(vx.Parametric(K, frequency=1.8))
    alone = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], parametric=vx.Parametric([[1.0]], frequency=2.0))
    assert float(terms_of(shared).frequency) == 0.9
    assert float(terms_of(set_parameter(shared, "forcing.frequency", 1.1)).frequency) == 1.1
    assert float(terms_of(set_parameter(own, "forcing.frequency", 1.1)).frequency) == 1.8
    assert float(alone.forcing.frequency) == 2.0
    assert float(set_parameter(alone, "parametric.frequency", 1.1).forcing.frequency) == 1.1


def test_numbers_have_paths():
    names = [f"parametric.{name}" for name in ("stiffness", "damping", "frequency", "phase")]
    assert set(names) <= set(parameter_names(machine()))
    np.testing.assert_array_equal(get_parameter(machine(), "parametric.stiffness[1]"), np.eye(2))
    changed = set_parameter(machine(), "parametric.stiffness[0][1][0]", 3.0)
    assert float(terms_of(changed).stiffness[0, 1, 0]) == 3.0


@pytest.mark.parametrize("frequency", [None, 1.8])
def test_files_keep_them(tmp_path, frequency):
    terms = vx.Parametric(K, phase=[0.2], frequency=frequency)
    for system in (machine(terms), machine(terms, force=vx.models.CubicSpring(np.array([0.1, 0.2])))):
        vx.save(system, tmp_path / "machine.toml")
        again = vx.load(tmp_path / "machine.toml", allow_forces=True)
        assert jax.tree.structure(again) == jax.tree.structure(system)
        assert all(map(np.array_equal, jax.tree.leaves(again), jax.tree.leaves(system)))


@pytest.mark.parametrize(("harmonic", "count"), [(1, 0), (2, 1)])
def test_symmetries_know_the_terms(harmonic, count):
    matrices = np.zeros((harmonic, 1, 1))
    matrices[-1] = 0.3
    stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 2.0), stops, parametric=vx.Parametric(matrices)
    )
    assert len(system.symmetries()) == count
