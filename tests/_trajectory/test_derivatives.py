"""Derivatives through impacts, chatter, sticking and release, by all parameters of a motion.

A ladder: against a reference of 50 digits; forward against reverse; against differences. Products of flight and
saltation matrices, and the closed form of periodic orbits, are in `test_maps.py`.
"""

import json
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import relative_errors, slow_except
from problems import one_mass

import vijax as vx

pytestmark = pytest.mark.thorough

GOLDEN = Path(__file__).parents[1] / "data" / "golden_derivatives"
# Every shape of machine takes 10 to 20 s to compile; the first two share one, and the second chatters. Of two masses one
# scene stands for all others; both come to be held.
SHORT = ("n1_critical", "n1_lowfreq_r07", "n2_two_held")
NAMES = slow_except(SHORT, sorted(path.stem for path in GOLDEN.glob("*.json")))
# Roundings of some hundred steps, 1e-15, magnified a hundred times; complete chatter adds no error.
ROUNDING = 1e-12
# Both modes add the same numbers in another order.
ORDER_OF_SUMS = 1e-12
# Error of differences over `SPACING` of a derivative that is exact to 1e-14, with weights of order one.
DIFFERENCES = 1e-11
SECOND_DIFFERENCES = 1e-10
SPACING = 0.005
# Weights of the central difference of order 8, for 1, 2, 3, 4 spacings to either side.
STENCIL = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
# The log holds the impacts that are compared, not all of them.
LOG = 64
# All scenes with the same numbers of stops and masses share a compilation.
MOST_DIRECTIONS = 36


class Start(NamedTuple):
    """Inputs of a motion: a machine and a start."""

    system: vx.ImpactSystem
    x0: jax.Array
    v0: jax.Array


class Motion(NamedTuple):
    """Results of a motion."""

    x1: jax.Array
    v1: jax.Array
    times: jax.Array
    velocities: jax.Array


def motion(start: Start, t0, t1, max_events: int = LOG) -> Motion:
    sol = vx.simulate(
        start.system, t0, t1, start.x0, start.v0, max_events=max_events, max_steps=100_000, throw=False
    )
    return Motion(sol.x1, sol.v1, sol.events.t, sol.events.velocity_minus)


value = eqx.filter_jit(motion)


@eqx.filter_jit
def _along(start: Start, t0, t1, directions: Start) -> tuple[Motion, Motion]:
    push = lambda d: jax.jvp(lambda s: motion(s, t0, t1), (start,), (d,))  # noqa: E731
    return jax.vmap(push, out_axes=(None, -1))(directions)


def along(start: Start, t0: float, t1: float, directions: list[Start]) -> tuple[Motion, Motion]:
    """Motion, and its derivatives along each of the directions, which are the last axis."""
    none = jax.tree.map(jnp.zeros_like, start)
    filled = directions + [none] * (MOST_DIRECTIONS - len(directions))
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *filled)
    found, slopes = _along(start, jnp.asarray(t0), jnp.asarray(t1), stacked)
    return found, jax.tree.map(lambda a: a[..., : len(directions)], slopes)


def direction(start: Start, name: str) -> Start:
    """Direction of the start in which a parameter of the reference acts."""
    found = jax.tree.map(jnp.zeros_like, start)
    for part in name.split("+"):
        match = re.fullmatch(r"(?:(forcing)\.|stops\[(\d+)\]\.)?(\w+?)(_scale)?(?:\[([\d,]+)\])?", part)
        leaf = leaf_named(*match.group(1, 2, 3))
        index = tuple(int(i) for i in (match[5] or "").split(",") if i)
        new = leaf(start) if match[4] else leaf(found).at[index].add(1.0)
        found = eqx.tree_at(leaf, found, new)
    return found


def leaf_named(forcing: str | None, stop: str | None, field: str):
    """Getter of a leaf."""
    if forcing:
        return lambda start: getattr(start.system.forcing, field)
    if stop:
        return lambda start: getattr(start.system.stops[int(stop)], field)
    if field in ("x0", "v0"):
        return lambda start: getattr(start, field)
    return lambda start: getattr(start.system, field)


def moved(start: Start, by: Start, step: float) -> Start:
    return jax.tree.map(lambda a, b: a + step * b, start, by)


def difference(function, spacing: float = SPACING):
    """Central difference at 0 of a function that returns an array."""
    steps = spacing * np.arange(1, len(STENCIL) + 1)
    terms = [w * (function(h) - function(-h)) for w, h in zip(STENCIL, steps, strict=True)]
    return sum(terms) / spacing


# The reference


class Reference(NamedTuple):
    """A scene with reference derivatives."""

    start: Start
    t0: float
    t1: float
    impacts: list[dict]
    derivatives: dict[str, np.ndarray]


@cache
def reference(name: str) -> Reference:
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    scene = data["scene"]
    stops = [vx.Stop(s["mass"], s["position"], s["side"], s["restitution"]) for s in scene["stops"]]
    load = vx.Harmonic(scene["A"], scene["Omega"], scene["phase"])
    system = vx.ImpactSystem(scene["M"], scene["C"], scene["K"], load, stops)
    columns = {
        parameter: np.concatenate([d["x1"], d["v1"], d["impact_times"]]) for parameter, d in data["d"].items()
    }
    start = Start(system, jnp.array(scene["x0"], float), jnp.array(scene["v0"], float))
    return Reference(start, scene["t0"], scene["t1"], data["impacts"], columns)


def rows_of_impacts(system: vx.ImpactSystem, found: Motion, impacts: list[dict]) -> list[int]:
    """Rows of the log with the impacts of the reference, found by their times."""
    rows = []
    for impact in impacts:
        near = np.abs(np.asarray(found.times) - impact["t"]) < 1e-9
        fits = np.isclose(found.velocities, impact["v_before"], rtol=1e-6, atol=0)
        (row,) = np.flatnonzero(near & fits)
        rows.append(row)
    return rows


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_by_every_parameter_are_those_of_the_reference(name):
    scene = reference(name)
    directions = [direction(scene.start, parameter) for parameter in scene.derivatives]
    found, slopes = along(scene.start, scene.t0, scene.t1, directions)
    rows = rows_of_impacts(scene.start.system, found, scene.impacts)
    assert len(rows) >= 4
    ours = np.concatenate([slopes.x1, slopes.v1, slopes.times[np.array(rows)]])
    expected = np.stack(list(scene.derivatives.values()), axis=-1)
    errors = dict(zip(scene.derivatives, relative_errors(ours, expected), strict=True))
    assert max(errors.values()) < ROUNDING, errors


@eqx.filter_jit
def pulled_back(start: Start, t0, t1, weights_x, weights_v) -> Start:
    """Gradient of a weighted sum of the end state."""

    def total(start: Start):
        end = motion(start, t0, t1, max_events=0)
        return jnp.sum(weights_x * end.x1) + jnp.sum(weights_v * end.v1)

    return jax.grad(total)(start)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["n1_lowfreq_r07", "paper_b_om140"])
def test_reverse_mode_equals_forward_mode(name):
    scene = reference(name)
    directions = [direction(scene.start, parameter) for parameter in scene.derivatives]
    _, slopes = along(scene.start, scene.t0, scene.t1, directions)
    weights_x, weights_v = (jnp.asarray(w) for w in np.random.default_rng(0).normal(size=(2, len(slopes.x1))))
    gradient = pulled_back(scene.start, jnp.asarray(scene.t0), jnp.asarray(scene.t1), weights_x, weights_v)
    reverse = [
        sum(float(jnp.sum(a * b)) for a, b in zip(*map(jax.tree.leaves, (gradient, d)), strict=True))
        for d in directions
    ]
    forward = weights_x @ slopes.x1 + weights_v @ slopes.v1
    size = np.maximum(1.0, np.abs(slopes.x1).max(axis=0) + np.abs(slopes.v1).max(axis=0))
    assert np.abs(forward).max() > 1
    np.testing.assert_array_less(np.abs(forward - np.array(reverse)) / size, ORDER_OF_SUMS)


# Differences


def swinging(*, c: float = 0.1, k: float = 1.0, w: float = 0.8, r: float = 0.7) -> Start:
    """One mass that hits its stop a few times."""
    system = one_mass(c=c, k=k, amplitude=1.0, frequency=w, stops=(vx.Stop(0, 0.4, "upper", r),))
    return Start(system, jnp.array([0.1]), jnp.array([0.2]))


def two_equal_masses() -> Start:
    """Two uncoupled masses with equal natural frequencies; the first hits a stop."""
    load = vx.Harmonic([1.0, 0.5], 0.8)
    stops = [vx.Stop(0, 0.4, "upper", 0.7)]
    system = vx.ImpactSystem([1.0, 1.0], 0.1 * np.eye(2), np.eye(2), load, stops)
    return Start(system, jnp.array([0.1, -0.2]), jnp.array([0.2, 0.3]))


# With those of the stop, the start and the load, so that no case needs its own program.
OF_ONE_MASS = (
    *("x0[0]", "v0[0]", "mass[0]", "damping[0,0]", "stiffness[0,0]", "forcing.frequency"),
    *("forcing.phase[0]", "forcing.amplitude[0]", "stops[0].position", "stops[0].restitution"),
)
# Off the diagonal, an entry and its mirror image.
OF_TWO_MASSES = (
    *("mass[0]", "mass[1]", "damping[0,0]", "damping[1,1]", "damping[0,1]+damping[1,0]"),
    *("stiffness[0,0]", "stiffness[1,1]", "stiffness[0,1]+stiffness[1,0]"),
)
END = 9.0
SPECIAL = {
    "critically_damped": (swinging(c=2.0), OF_ONE_MASS),
    "undamped_resonance": (swinging(c=0.0, w=1.0), OF_ONE_MASS),
    "repeated_frequency": (two_equal_masses(), OF_TWO_MASSES),
}


@pytest.mark.parametrize(
    "case", [pytest.param(c, marks=pytest.mark.slow) if c == "repeated_frequency" else c for c in SPECIAL]
)
def test_derivatives_stay_right_where_modes_are_special(case):
    start, names = SPECIAL[case]
    directions = [direction(start, name) for name in names]
    found, slopes = along(start, 0.0, END, directions)
    hits = int(jnp.sum(jnp.isfinite(found.times)))
    assert hits >= 1

    def ends(by: Start, step: float) -> np.ndarray:
        end = value(moved(start, by, step), jnp.asarray(0.0), jnp.asarray(END))
        return np.concatenate([end.x1, end.v1, end.times[:hits], end.velocities[:hits]])

    ours = np.concatenate([slopes.x1, slopes.v1, slopes.times[:hits], slopes.velocities[:hits]])
    expected = np.stack([difference(lambda h, d=d: ends(d, h), 1e-3) for d in directions], axis=-1)
    assert np.isfinite(ours).all()
    np.testing.assert_array_less(relative_errors(ours, expected), SECOND_DIFFERENCES)
    assert np.abs(expected).max() > 1


PARAMETERS = ("x0[0]", "v0[0]", "damping[0,0]", "forcing.frequency", "stops[0].position")


def end_of(parameters: jax.Array) -> jax.Array:
    """End state and time of the first impact, by changes of the parameters."""
    start = swinging()
    for i, name in enumerate(PARAMETERS):
        start = jax.tree.map(lambda a, b, i=i: a + parameters[i] * b, start, direction(start, name))
    end = motion(start, 0.0, 4.5, max_events=4)
    return jnp.concatenate([end.x1, end.v1, end.times[:1]])


@cache
def second_differences() -> np.ndarray:
    """Central differences of the first derivatives."""
    first = jax.jit(jax.jacfwd(end_of))
    columns = [difference(lambda h, e=e: np.asarray(first(h * e))) for e in np.eye(len(PARAMETERS))]
    return np.stack(columns, axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("inner", [jax.jacfwd, jax.jacrev])
def test_second_derivatives_are_differences_of_the_first(inner):
    start = swinging()
    end = value(start, jnp.asarray(0.0), jnp.asarray(4.5))
    assert 1 <= int(jnp.sum(jnp.isfinite(end.times))) <= 2
    hessian = np.asarray(jax.jit(jax.jacfwd(inner(end_of)))(jnp.zeros(len(PARAMETERS))))
    expected = second_differences()
    assert np.abs(expected).max() > 1
    error = np.abs(hessian - expected) / np.maximum(1.0, np.abs(expected).max(axis=(1, 2), keepdims=True))
    assert error.max() < SECOND_DIFFERENCES
    symmetry = np.abs(hessian - np.swapaxes(hessian, 1, 2)).max()
    assert symmetry < SECOND_DIFFERENCES


@pytest.mark.slow
def test_derivatives_of_a_batch_are_those_of_its_lanes():
    slope = jax.jacfwd(lambda w: vx.stroboscopic_map(vx.models.wagg_bishop_b(w), [0.0, 0.0], [0.0, 0.0], 2))
    frequencies = jnp.array([0.8, 1.1, 1.4])
    batch = jax.jit(jax.vmap(slope))(frequencies)
    alone = jax.jit(slope)
    for k, frequency in enumerate(frequencies):
        for ours, theirs in zip(batch, alone(frequency), strict=True):
            np.testing.assert_allclose(ours[k], theirs, rtol=ORDER_OF_SUMS, atol=ORDER_OF_SUMS)


# Maps and whole periods


@pytest.mark.slow
def test_the_stroboscopic_map_is_differentiable_by_the_frequency():
    @jax.jit
    def mapped(frequency):
        start = swinging(w=frequency)
        return jnp.concatenate(vx.stroboscopic_map(start.system, start.x0, start.v0, 2))

    slope = jax.jit(jax.jacfwd(mapped))(0.8)
    expected = difference(lambda h: np.asarray(mapped(0.8 + h)), 1e-3)
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(slope, expected, rtol=0, atol=SECOND_DIFFERENCES)


@pytest.mark.parametrize("periods", [1, 2])
def test_an_end_at_a_whole_number_of_periods_is_no_special_time(periods):
    """The period depends on the frequency, the end time does not."""
    end = jnp.asarray(periods * 2 * np.pi / 0.8)
    start = swinging()
    by_frequency = direction(start, "forcing.frequency")

    def ends(step: float) -> np.ndarray:
        found = value(moved(start, by_frequency, step), jnp.asarray(0.0), end)
        return np.concatenate([found.x1, found.v1])

    _, slopes = along(start, 0.0, end, [direction(start, name) for name in OF_ONE_MASS])
    column = OF_ONE_MASS.index("forcing.frequency")
    ours = np.concatenate([slopes.x1, slopes.v1])[:, column]
    expected = difference(ends, 1e-3)
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(ours, expected, rtol=0, atol=SECOND_DIFFERENCES * np.abs(expected).max())
