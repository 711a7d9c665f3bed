"""An error is raised for every use of a result, and under every transformation of JAX."""

import logging
from collections.abc import Callable
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

MACHINE = vx.chain([1.0], [0.1], [1.0], vx.Harmonic([0.5], 0.8), [vx.Stop(0, 0.3, "upper", 0.7)])
END = 40.0
FLOW = vx.TaylorFlow()  # fastest to compile
# A program that XLA runs raises a RuntimeError of JAX, or a ValueError in some versions.
ERRORS = (RuntimeError, ValueError)
ASKED = {
    "ts": lambda sol: sol.ts,
    "xs": lambda sol: sol.xs,
    "vs": lambda sol: sol.vs,
    "x1": lambda sol: sol.x1,
    "v1": lambda sol: sol.v1,
    "stuck1": lambda sol: sol.stuck1,
    "events": lambda sol: sol.events,
    "event times": lambda sol: sol.events.t,
    "event kinds": lambda sol: sol.events.kind,
    "num_events": lambda sol: sol.num_events,
    "num_steps": lambda sol: sol.num_steps,
    "grazing": lambda sol: sol.grazing.clearance,
    "result": lambda sol: sol.result,
    "evaluate": lambda sol: sol.evaluate(1.0),
}
# One program for each. It calls back, so it is compiled again in every run: floats, and whole numbers of the end and
# of the log. The others are thorough.
ASKED_FIRST = ("x1", "num_steps", "event kinds")


@pytest.fixture(autouse=True)
def quiet():
    """Silence JAX's log of errors in callbacks."""
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def follow(max_steps, end=END, x0=0.0, **options) -> vx.Solution:
    """A trajectory of about 60 steps and 8 events."""
    start = jnp.reshape(jnp.asarray(x0, float), (1,))
    return vx.simulate(MACHINE, 0.0, end, start, max_steps=max_steps, max_events=64, flow=FLOW, **options)


@cache
def program(asked: str) -> Callable:
    """A requested result as a function of the bound on steps."""
    return jax.jit(lambda k: ASKED[asked](follow(k)))


def test_the_trajectory_is_as_long_as_these_tests_suppose():
    sol = follow(None)
    assert 20 < sol.num_steps < 1000
    assert 2 < sol.num_events < 64


@pytest.mark.parametrize(
    "asked",
    [name if name in ASKED_FIRST else pytest.param(name, marks=pytest.mark.thorough) for name in ASKED],
)
def test_too_few_steps_are_told_whatever_is_asked_for(asked):
    jax.block_until_ready(jax.tree.leaves(program(asked)(1000)))
    with pytest.raises(ERRORS, match="max_steps_reached: "):
        jax.block_until_ready(jax.tree.leaves(program(asked)(20)))


def test_the_last_line_of_an_error_under_jit_is_its_sentence():
    with pytest.raises(ERRORS) as caught:
        jax.block_until_ready(program("x1")(20))
    last = str(caught.value).strip().splitlines()[-1]
    assert "SimulationError: max_steps_reached: " in last
    assert "equinox" not in last


def test_a_cut_log_is_told_by_its_times_alone():
    times = jax.jit(lambda end, k: follow(k, end).events.t)
    jax.block_until_ready(times(np.float64(END), 100_000))
    with pytest.raises(ERRORS, match="max_events_reached: "):
        jax.block_until_ready(times(np.float64(20 * END), 100_000))


def test_a_start_that_is_not_finite_is_told_by_the_end_alone():
    with pytest.raises(ERRORS, match=r"Argument `x0` must be finite\."):
        jax.block_until_ready(jax.jit(lambda x, k: follow(k, x0=x).x1)(np.nan, 1000))
    with pytest.raises(ValueError, match=r"Argument `x0` must be finite\."):
        follow(None, x0=np.nan)


@jax.jit
def end_between(t0, t1) -> jax.Array:
    return vx.simulate(MACHINE, t0, t1, flow=FLOW).x1


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [((0.0, np.inf), "`t1` must be finite"), ((np.nan, 1.0), "`t0` must be finite")],
)
def test_times_that_are_not_finite_are_refused(wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.simulate(MACHINE, *wrong)
    with pytest.raises(ERRORS, match=sentence):
        jax.block_until_ready(end_between(*wrong))


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [jax.grad, jax.value_and_grad, jax.jacfwd])
def test_derivatives_alone_depend_on_the_check(derivative):
    slope = jax.jit(lambda x, k: jax.tree.leaves(derivative(lambda x: follow(k, x0=x).x1[0])(x))[-1])
    with pytest.raises(ERRORS, match="max_steps_reached: "):
        jax.block_until_ready(slope(0.1, 20))


@pytest.mark.slow
def test_one_lane_of_a_batch_is_enough():
    batch = jax.vmap(lambda k: follow(k).x1)
    with pytest.raises(vx.SimulationError, match="max_steps_reached: "):
        batch(jnp.array([1000, 20]))
    with pytest.raises(ERRORS, match="max_steps_reached: "):
        jax.block_until_ready(jax.jit(batch)(jnp.array([1000, 20])))
    assert np.isfinite(batch(jnp.array([1000, 2000]))).all()


def test_without_throw_nothing_is_raised():
    sol = jax.jit(lambda k: follow(k, throw=False))(20)
    assert sol.result == vx.RESULTS.max_steps_reached


@pytest.mark.parametrize("make", [vx.stroboscopic_map, vx.monodromy_matrix])
@pytest.mark.slow
def test_maps_depend_on_the_check_too(make):
    run = jax.jit(lambda k: jax.tree.leaves(make(MACHINE, [0.0], [0.0], 5, flow=FLOW, max_steps=k))[0])
    jax.block_until_ready(run(1000))
    with pytest.raises(ERRORS, match="max_steps_reached: "):
        jax.block_until_ready(run(20))


@pytest.mark.parametrize("make", [vx.stroboscopic_map, vx.monodromy_matrix])
def test_a_load_without_a_frequency_has_no_map(make):
    constant = eqx.tree_at(lambda s: s.forcing.frequency, MACHINE, jnp.asarray(0.0))
    with pytest.raises(ValueError, match="The load has no frequency"):
        make(constant, [0.0], [0.0])


COUNTS = {
    "max_events": lambda n: vx.simulate(MACHINE, 0.0, 1.0, max_events=n),
    "max_steps": lambda n: vx.simulate(MACHINE, 0.0, 1.0, max_steps=n),
    "max_reverse_steps": lambda n: vx.simulate(MACHINE, 0.0, 1.0, max_reverse_steps=n),
    "num_periods": lambda n: vx.stroboscopic_map(MACHINE, [0.0], [0.0], n),
    "transient": lambda n: vx.sweep(MACHINE, {"x0[0]": [0.0]}, transient=n),
    "record": lambda n: vx.sweep(MACHINE, {"x0[0]": [0.0]}, record=n),
    "max_impacts": lambda n: vx.sweep(MACHINE, {"x0[0]": [0.0]}, max_impacts=n),
    "mass": lambda n: vx.Stop(n),
}


@pytest.mark.parametrize("name", COUNTS)
@pytest.mark.parametrize("value", [2.0, 10.5, np.inf, -1, True, "2"])
def test_counts_are_whole_numbers(name, value):
    with pytest.raises(ValueError, match=rf"Argument `{name}` must be a whole number, \d or more, but is "):
        COUNTS[name](value)


def test_counts_may_be_those_of_numpy():
    assert vx.Stop(np.int64(1)).mass == 1
    assert vx.simulate(MACHINE, 0.0, 1.0, flow=FLOW, max_steps=np.int32(1000)).num_steps < 1000
