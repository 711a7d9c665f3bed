"""Parameters of a machine by path: list, get, set."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._execution.points import LaneInput, points_of_lanes
from vijax._system.parameters import (
    axis_names,
    get_parameter,
    is_parameter,
    known_machine_at,
    machine_at,
    parameter_names,
    set_parameter,
)
from vijax._system.system import with_args

# The same sums, in another order.
ROUNDING = 1e-9


class Spring(eqx.Module):
    """A hardening spring and a damper, one of them by `args`."""

    cubic: jax.Array | float
    law: object

    def __call__(self, t, x, v, args):
        return -self.cubic * self.law(x) - args[0] * v


def cube(x):
    return x**3


def slot() -> vx.ImpactSystem:
    """Two stops with one motion, the very same arrays, and a load of two harmonics."""
    load = vx.Harmonic([[0.3, 0.0], [0.1, 0.2]], 0.9)
    motion = vx.Harmonic([0.1], 0.9)
    stops = [vx.Stop(0, -0.5, "lower", 0.6, motion), vx.Stop(0, 0.5, "upper", 0.7, motion)]
    return vx.chain([1.0, 2.0], [0.1, 0.2], [1.0, 0.5], load, stops)


def with_force() -> vx.ImpactSystem:
    load = vx.Harmonic([0.6], 0.9)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.5, "upper", 0.7)], Spring(0.2, cube))


MACHINES = {
    "no stops": vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([0.6], 0.9)),
    "two stops": vx.models.wagg_bishop_b(0.8),
    "moving stops": slot(),
    "force": with_force(),
    "force and args": with_args(with_force(), (0.05, np.arange(6.0).reshape(2, 3))),
    "a start": LaneInput(slot(), np.zeros(2), np.ones(2)),
}


def entries(path: str, shape: tuple[int, ...]) -> list[str]:
    """Path of an array, and paths of its entries."""
    return [path, *(path + "".join(f"[{i}]" for i in index) for index in np.ndindex(shape) if shape)]


@pytest.mark.parametrize("name", MACHINES)
def test_every_path_is_set_to_what_it_has_and_nothing_changes(name):
    machine = MACHINES[name]
    names = parameter_names(machine)
    assert len(names) == len(set(names)) == len(jax.tree.leaves(machine))
    for whole in names:
        for path in entries(whole, get_parameter(machine, whole).shape):
            assert is_parameter(machine, path)
            again = set_parameter(machine, path, get_parameter(machine, path))
            same = jax.tree.map(jnp.asarray, machine)
            assert eqx.tree_equal(jax.tree.map(jnp.asarray, again), same, typematch=True)


@pytest.mark.parametrize("name", MACHINES)
def test_every_leaf_is_set_alone_and_is_what_a_sweep_sets(name):
    machine = MACHINES[name]
    base = (
        machine if isinstance(machine, LaneInput) else LaneInput(machine, *np.zeros((2, machine.num_masses)))
    )
    for path in parameter_names(base):
        value = 0.9 * get_parameter(base, path)
        changed = set_parameter(base, path, value)
        np.testing.assert_array_equal(get_parameter(changed, path), value)
        if is_sound(path):
            lanes = points_of_lanes(base, {path: np.asarray(value)[None]})
            jax.tree.map(
                lambda a, b: np.testing.assert_array_equal(np.asarray(a)[..., None], b), changed, lanes
            )
        for other in parameter_names(base):
            if other != path:
                np.testing.assert_array_equal(get_parameter(changed, other), get_parameter(base, other))


def is_sound(path: str) -> bool:
    """False for a start: sweeps also check that it is not beyond a stop."""
    return path not in ("x0", "v0")


def test_the_machine_at_a_known_value_is_the_one_that_is_checked():
    machine = MACHINES["moving stops"]
    for path in ("forcing.frequency", "stops[*].restitution", "stiffness[1][0]"):
        one, other = (at(machine, path, 0.7) for at in (known_machine_at, machine_at))
        assert eqx.tree_equal(*(jax.tree.map(np.asarray, a) for a in (one, other)), typematch=True)


def test_the_names_are_those_that_users_write():
    assert parameter_names(MACHINES["force and args"]) == [
        "mass",
        "damping",
        "stiffness",
        "forcing.amplitude",
        "forcing.frequency",
        "forcing.phase",
        "forcing.mean",
        "stops[0].position",
        "stops[0].restitution",
        "force.cubic",
        "args[0]",
        "args[1]",
    ]
    assert "force.cubic" in parameter_names(MACHINES["force"])
    assert parameter_names(MACHINES["a start"])[-2:] == ["x0", "v0"]


def test_a_star_is_for_all_stops():
    machine = MACHINES["moving stops"]
    np.testing.assert_array_equal(get_parameter(machine, "stops[*].restitution"), [0.6, 0.7])
    alike = set_parameter(machine, "stops[*].restitution", 0.3)
    np.testing.assert_array_equal(get_parameter(alike, "stops[*].restitution"), [0.3, 0.3])
    each = set_parameter(alike, "stops[*].restitution", [0.6, 0.7])
    assert eqx.tree_equal(each, machine)
    faster = set_parameter(machine, "stops[*].motion.amplitude[0]", 0.2)
    np.testing.assert_array_equal(get_parameter(faster, "stops[*].motion.amplitude"), [[0.2], [0.2]])


@pytest.mark.parametrize("call", [get_parameter, lambda system, path: set_parameter(system, path, 1.0)])
@pytest.mark.parametrize("path", ["frequency", "mass[2]", "x0[0]", "stops[2].position", "force.k3", ""])
def test_a_path_that_names_nothing_is_told_what_there_is(call, path):
    sentence = (
        f"The path `{path}` names nothing that can be swept. There are mass, damping, stiffness, "
        "forcing.amplitude, forcing.frequency, forcing.phase, forcing.mean, stops[j].position, "
        "stops[j].restitution, "
    )
    with pytest.raises(ValueError, match=re.escape(sentence)):
        call(MACHINES["two stops"], path)
    assert not is_parameter(MACHINES["two stops"], path)


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        ("stops[1].restitution", 1.1, "Argument `restitution` must lie between 0 (plastic) and 1 (elastic)"),
        ("mass[0]", 0.0, "Argument `mass` must be positive and finite"),
        ("forcing.frequency", -1.0, "Argument `frequency` must be finite and not negative"),
        ("damping[0][1]", np.nan, "Argument `damping` must be finite"),
        (
            "stops[0].position",
            0.6,
            "The lower stop of mass 0 (at 0.6) must lie below its upper stop (at 0.5).",
        ),
        ("mass", 1.0, "The value of `mass` must have shape (2,), but has shape ()."),
        ("stops[*].position", [0.1] * 3, "The value of `stops[*].position` must have shape () or (2,), but"),
    ],
)
def test_a_value_that_makes_no_machine_is_refused(path, value, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        set_parameter(MACHINES["moving stops"], path, value)


def test_arrays_of_different_shapes_have_no_path_together():
    machine = with_args(with_force(), [0.05, np.ones(2)])
    with pytest.raises(
        ValueError, match=re.escape("The path `args[*]` names arrays of the shapes [(), (2,)]")
    ):
        get_parameter(machine, "args[*]")


def linear(values) -> vx.ImpactSystem:
    position, frequency, stiffness = values
    stops = [vx.Stop(0, position, "upper", 0.7)]
    return vx.ImpactSystem([1.0], [[0.1]], stiffness[None, None], vx.Harmonic([0.6], frequency), stops)


@pytest.mark.slow
def test_derivatives_pass_through_a_parameter_as_through_a_machine_that_is_built():
    machine = linear(jnp.array([0.5, 0.9, 1.0]))

    def changed(values):
        system = machine
        for path, value in zip(
            ("stops[0].position", "forcing.frequency", "stiffness[0][0]"), values, strict=True
        ):
            system = set_parameter(system, path, value)
        return system

    def slopes(build):
        end = lambda values: vx.simulate(build(values), 0.0, 6.0, max_events=64).x1[0]  # noqa: E731
        return jax.jacfwd(end)(jnp.array([0.4, 0.8, 1.2]))

    expected = slopes(linear)
    assert (jnp.abs(expected) > 1e-3).all()
    np.testing.assert_allclose(slopes(changed), expected, rtol=ROUNDING)


def test_values_may_be_traced():
    machine = MACHINES["force and args"]
    values = jnp.array([0.2, 0.4])
    for path in ("args[1][0][2]", "force.cubic", "stops[0].position"):
        round_trip = lambda value, path=path: get_parameter(set_parameter(machine, path, value), path)  # noqa: E731
        np.testing.assert_array_equal(jax.jit(round_trip)(values[0]), values[0])
        np.testing.assert_array_equal(jax.vmap(round_trip)(values), values)
        assert jax.grad(round_trip)(values[0]) == 1


def test_the_axes_of_a_parameter_have_names():
    assert axis_names("damping", 2) == ["row", "mass"]
    assert axis_names("forcing.amplitude", 2) == ["harmonic", "mass"]
    assert axis_names("mass", 1) == ["mass"]
    assert axis_names("args[1]", 2) == ["args[1].axis0", "args[1].axis1"]
