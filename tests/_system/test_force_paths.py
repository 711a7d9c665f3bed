"""Parameters of a force, and of its args, are swept by path."""

import json
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._execution.points import LaneInput, points_of_lanes
from vijax._system.parameters import force_parameters, set_parameter
from vijax._system.system import with_args

# Difference of two computations that add in another order in a batch.
ROUNDING = 1e-9
CUBICS = np.array([0.5, 1.0, 1.5])


class Spring(eqx.Module):
    """A hardening spring with a nested part and a leaf that is not a number."""

    cubic: jax.Array | float
    parts: dict[str, jax.Array | float]
    law: object

    def __call__(self, t, x, v, args):
        return -self.cubic * self.law(x) - self.parts["drag"] * v


class Magnet(eqx.Module):
    """Args with names."""

    pull: jax.Array | float


def cube(x):
    return x**3


def by_args(t, x, v, args):
    return -args["cubic"] * x**3 - args["drag"][0] * v


def of_pair(t, x, v, args):
    return -args[0] * x**3 - args[1][0] * v


def machine(force) -> vx.ImpactSystem:
    load = vx.Harmonic([0.6], 0.9)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.5, "upper", 0.7)], force)


def spring(cubic=1.0, drag=0.05) -> Spring:
    return Spring(cubic, {"drag": drag}, cube)


def sweep(force, values, **options) -> xr.Dataset:
    return vx.sweep(machine(force), values, transient=2, record=3, progress=False, **options)


@pytest.fixture(scope="module")
def by_force() -> xr.Dataset:
    return sweep(spring(), {"force.cubic": CUBICS})


@pytest.mark.slow
def test_a_parameter_of_a_force_is_swept_by_its_name(by_force):
    assert by_force.result.dims == ("force.cubic",)
    assert (by_force.result == 0).all()
    assert len(np.unique(by_force.x)) == 3
    for cubic in CUBICS:
        one = machine(spring(cubic))
        sol = vx.simulate(one, 0.0, 5 * float(one.forcing.period), max_events=64)
        point = by_force.sel({"force.cubic": cubic})
        np.testing.assert_allclose(point.x, sol.x1, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(point.v, sol.v1, rtol=0, atol=ROUNDING)
        late = np.asarray((sol.events.kind == vx.IMPACT) & (sol.events.t > 2 * one.forcing.period))
        assert int(point.num_impacts.sum()) == late.sum() > 0
        found = point.impact_velocity.dropna("impact")
        np.testing.assert_allclose(found, sol.events.velocity_minus[late], rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("force", "args", "path"),
    [
        (by_args, {"cubic": 1.0, "drag": [0.05]}, "args.cubic"),
        pytest.param(
            by_args, {"cubic": 1, "drag": np.array([0.05])}, "args['cubic']", marks=pytest.mark.slow
        ),
        pytest.param(of_pair, (1.0, jnp.array([0.05])), "args[0]", marks=pytest.mark.slow),
    ],
    ids=["dict", "dict as in Python", "tuple"],
)
@pytest.mark.thorough
def test_a_number_of_args_is_swept_by_its_name(force, args, path, by_force):
    ds = sweep(force, {path: CUBICS}, args=args)
    assert ds.result.dims == (path,)
    np.testing.assert_allclose(ds.x, by_force.x, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(ds.impact_stop, by_force.impact_stop)
    last = set_parameter(with_args(machine(force), args), path, CUBICS[-1])
    assert eqx.tree_equal(vx.system_of(ds.isel({path: -1})), last, typematch=True)


SYSTEM = with_args(
    machine(spring()), {"k": (1.0, jnp.arange(6.0).reshape(2, 3)), "two words": 3.0, "z": Magnet(4.0)}
)
BASE = LaneInput(SYSTEM, np.zeros(1), np.zeros(1))
PLACES = {
    "force.cubic": (2.0, lambda s: s.force.force.numbers.cubic),
    "force.parts.drag": (2.0, lambda s: s.force.force.numbers.parts["drag"]),
    'force.parts["drag"]': (2.0, lambda s: s.force.force.numbers.parts["drag"]),
    "args.k[0]": (2.0, lambda s: s.force.args["k"][0]),
    "args.k[1][1][2]": (2.0, lambda s: s.force.args["k"][1][1, 2]),
    "args.k[1][0]": (np.array([7.0, 8.0, 9.0]), lambda s: s.force.args["k"][1][0]),
    "args['two words']": (2.0, lambda s: s.force.args["two words"]),
    "args.z.pull": (2.0, lambda s: s.force.args["z"].pull),
    "stops[*].restitution": (0.2, lambda s: s.stops[0].restitution),
    "forcing.amplitude[0]": (0.2, lambda s: s.forcing.amplitude[0]),
}


@pytest.mark.parametrize("path", PLACES)
def test_a_path_sets_what_it_names_and_nothing_else(path):
    value, place = PLACES[path]
    points = points_of_lanes(BASE, {path: np.array([value, value])})
    np.testing.assert_array_equal(place(points.system), np.stack([value, value], -1))
    before, after = (jax.tree.leaves(a) for a in (BASE, points))
    changed = sum((np.asarray(a)[..., None] != b).sum() for a, b in zip(before, after, strict=True))
    assert changed == 2 * np.size(value)


@pytest.mark.parametrize(
    "path", ["force", "force.k3", "force.law", "args.k", "args.k[2]", "args.k[1][2]", "args.k[1][0][3]"]
)
def test_a_path_that_names_no_number_of_a_force_is_told_what_there_is(path):
    names = (
        "stiffness, forcing.amplitude, forcing.frequency, forcing.phase, forcing.mean, force.cubic, "
        "force.parts.drag, args.k[0], args.k[1], args['two words'], args.z.pull, x0, v0, stops[j].position"
    )
    sentence = f"The path `{path}` names nothing that can be swept. There are mass, damping, {names}, "
    with pytest.raises(ValueError, match=re.escape(sentence)) as refusal:
        points_of_lanes(BASE, {path: np.array([1.0])})
    assert "write 1.0 in it, not 1" in str(refusal.value)


def test_a_machine_without_a_force_has_no_paths_of_one():
    with pytest.raises(ValueError, match=r"There are mass, damping, stiffness, .* x0, v0, stops\[j\]"):
        sweep(None, {"force.cubic": CUBICS})


def test_values_of_the_wrong_shape_are_refused():
    sentence = re.escape("The values of `args.k[1][0]` must have shape (points, 3), one value per point")
    with pytest.raises(ValueError, match=sentence):
        points_of_lanes(BASE, {"args.k[1][0]": np.ones(2)})


# The dataset


def test_the_dataset_says_what_is_swept_and_gives_the_force_back(by_force):
    assert by_force["force.cubic"].attrs == {"long_name": "parameter of the force"}
    found = vx.system_of(by_force.isel({"force.cubic": 2}))
    assert eqx.tree_equal(found, machine(spring(CUBICS[2])), typematch=True)


def test_the_dataset_tells_the_numbers_of_the_force(by_force):
    told = json.loads(by_force.attrs["force_parameters"])
    assert told == {"force.cubic": 1.0, "force.parts.drag": 0.05}
    many = with_args(machine(spring()), jnp.ones((3, 6)))
    assert force_parameters(LaneInput(many, np.zeros(1), np.zeros(1)))["args"] == "shape (3, 6)"


def test_a_swept_array_has_axes_of_its_own_and_survives_a_file(tmp_path):
    arrays = np.array([[0.05], [0.1], [0.2]])
    ds = sweep(of_pair, {"args[1]": arrays}, args=(1.0, jnp.array([0.05])))
    np.testing.assert_array_equal(ds["args[1]"], [0, 1, 2])
    assert ds["args[1].values"].dims == ("args[1]", "args[1].axis0")
    assert ds["args[1].values"].attrs == {"long_name": "argument of the force"}
    np.testing.assert_array_equal(ds["args[1].values"], arrays)
    ds.to_netcdf(tmp_path / "kept.nc", engine="h5netcdf")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "kept.nc", engine="h5netcdf"), ds)


@pytest.mark.slow
def test_a_sweep_of_a_force_goes_along_and_is_kept_as_any_other(tmp_path):
    run = lambda values: sweep(  # noqa: E731
        spring(), {"force.cubic": values}, carry="both", store=tmp_path / "kept"
    )
    ds = run(CUBICS)
    before, after = (
        ds.sel(direction="up").isel({"force.cubic": 0}),
        ds.sel(direction="up").isel({"force.cubic": 1}),
    )
    one = machine(spring(CUBICS[1]))
    end = vx.simulate(
        one, 0.0, 5 * float(one.forcing.period), before.x.values, before.v.values, max_events=64
    )
    np.testing.assert_allclose(after.x, end.x1, rtol=0, atol=ROUNDING)
    xr.testing.assert_identical(run(CUBICS), ds)
    with pytest.raises(ValueError, match=r"holds another sweep: `values\.force\.cubic`"):
        run(2 * CUBICS)


def test_the_machine_of_a_sweep_is_built_again_where_only_its_start_is_clear_of_the_stops():
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([0.3], 0.8), [vx.Stop(0, 0.2, "lower", 0.7)]
    )
    ds = vx.sweep(system, {"stops[0].position": [0.2, 0.3]}, x0=[0.3], transient=1, record=1, progress=False)
    again = vx.system_of(ds.isel({"stops[0].position": 1}))
    assert float(again.stops[0].position) == 0.3


@pytest.mark.slow
def test_a_store_knows_a_force_whose_body_was_changed(tmp_path):
    def of_power(power):
        def force(t, x, v, args):
            return -args * jnp.abs(x) ** power * jnp.sign(x)

        return force

    run = lambda power: sweep(of_power(power), {"args": CUBICS}, args=1.0, store=tmp_path / "kept")  # noqa: E731
    xr.testing.assert_identical(run(3), run(3))
    with pytest.raises(ValueError, match="holds another sweep: `program of the force`"):
        run(5)


@pytest.mark.parametrize(
    "force",
    [
        lambda t, x, v: x,
        lambda t, x, v, args: x if x[0] > 0 else v,
        lambda t, x, v, args: args["k"] * x,
        lambda t, x, v, args: None,
    ],
    ids=["three arguments", "if", "without args", "returns nothing"],
)
def test_a_force_that_cannot_be_called_is_told_how_to_be_written(force):
    with pytest.raises(ValueError, match=r"Argument `force` failed as force\(t, x, v, args\) .* `jnp.where`"):
        vx.simulate(machine(force), 0.0, 1.0)


@pytest.mark.slow
def test_a_force_without_the_period_of_the_load_is_not_swept():
    push = lambda t, x, v, args: 0.1 * jnp.cos(args * t) * jnp.ones_like(x)  # noqa: E731
    w = float(machine(push).forcing.frequency)
    for other in (w / 2, 1.1 * w):
        with pytest.raises(ValueError, match="does not have the period of the load"):
            sweep(push, {"args": [w, other]}, args=w)
    assert (sweep(push, {"args": [w, 2 * w]}, args=w).result == 0).all()
