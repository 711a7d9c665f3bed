"""A force of another period than the load's is rejected wherever forcing periods are counted."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._system import periodicity
from vijax._system.periodicity import is_off_period

W = 0.9
SENTENCE = "The force does not have the period of the load"


def machine(force) -> vx.ImpactSystem:
    load = vx.Harmonic([0.6, 0.0], W)
    return vx.ImpactSystem(
        [1.0, 2.0], 0.1 * np.eye(2), np.eye(2), load, [vx.Stop(0, 0.5, "upper", 0.7)], force
    )


def is_refused(force, x=(0.0, 0.0), v=(0.0, 0.0), **parts) -> bool:
    """Verdict on one machine, by default at rest."""
    system = vx._system.system.with_args(machine(force), None)
    for name, value in parts.items():
        system = eqx.tree_at(lambda s, name=name: getattr(s, name), system, value)
    one_lane = jax.tree.map(lambda a: np.asarray(a)[..., None], system)
    return is_off_period(one_lane, np.array(x)[:, None], np.array(v)[:, None])


def wave(t):
    return jnp.cos(0.37 * t)


OFF = {
    "of the position": lambda t, x, v, args: x * wave(t),
    "of the velocity": lambda t, x, v, args: v * wave(t),
    "of a difference": lambda t, x, v, args: (x[0] - x[1]) * wave(t) * jnp.ones(2),
    "of one mass": lambda t, x, v, args: jnp.stack([jnp.zeros(()), x[1] * v[1] * wave(t)]),
    "far on one side": lambda t, x, v, args: jnp.where(x > 0.3, 1.0, 0.0) * wave(t),
    "far on the other": lambda t, x, v, args: jnp.where(x < -0.3, 1.0, 0.0) * wave(t),
    "half the frequency": lambda t, x, v, args: x * jnp.cos(W / 2 * t),
    "infinite at one mass": lambda t, x, v, args: jnp.stack([jnp.inf, x[1] * wave(t)]),
}
ON = {
    "of no time": lambda t, x, v, args: -(x**3),
    "of the period": lambda t, x, v, args: x * jnp.cos(W * t) - v,
    "of a third of it": lambda t, x, v, args: jnp.cos(3 * W * t) * jnp.ones(2),
    "infinite at the stop": lambda t, x, v, args: jnp.cos(W * t) / (x - 0.5),
    "not a number on one side": lambda t, x, v, args: jnp.log(x) * jnp.cos(W * t),
    "nowhere a number": lambda t, x, v, args: jnp.nan * x,
    "beyond the stop": lambda t, x, v, args: jnp.where(x[0] > 0.5, x * wave(t), 0.0),
    "nothing": lambda t, x, v, args: 0 * x,
}


@pytest.mark.parametrize("name", OFF)
def test_a_force_of_another_period_is_found_from_rest(name):
    assert is_refused(OFF[name])


@pytest.mark.parametrize("name", ON)
def test_a_force_of_the_period_of_the_load_is_none(name):
    assert not is_refused(ON[name])


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_size_of_the_machine_tells_where_a_force_is_asked(scale):
    """A force that acts only near the size of the motion, which a weak or strong load sets."""
    weak = vx.Harmonic([0.6 * scale, 0.0], W)
    near = lambda t, x, v, args: jnp.where((abs(x) > 0.1 * scale) & (abs(x) < scale), wave(t), 0.0)  # noqa: E731
    assert is_refused(near, stops=(), forcing=weak)


def test_a_machine_without_load_and_stops_is_asked_at_one():
    still = vx.Harmonic([0.0, 0.0], W)
    assert is_refused(OFF["of the position"], stops=(), forcing=still)


@pytest.mark.parametrize("name", ["of the position", "of the velocity"])
def test_sweep_and_stroboscopic_map_refuse_it(name):
    system = machine(OFF[name])
    with pytest.raises(ValueError, match=f"{SENTENCE}.*, at every point: a sweep, which counts"):
        vx.sweep(system, {"forcing.amplitude[0]": [0.5, 0.6]}, progress=False)
    for run in (vx.stroboscopic_map, vx.monodromy_matrix):
        with pytest.raises(ValueError, match=f"{SENTENCE}.*: the stroboscopic map, which counts"):
            run(system, [0.0, 0.0], [0.0, 0.0])
    with pytest.raises(ValueError, match=SENTENCE):
        jax.jit(lambda x: vx.stroboscopic_map(system, x, [0.0, 0.0]))(jnp.zeros(2))


@pytest.mark.slow
def test_what_is_traced_is_not_looked_at():
    force = lambda t, x, v, args: x * jnp.cos(args * t)  # noqa: E731
    # Steps of two programs may be accepted differently: they agree to the tolerance of the flow.
    flow = vx.DiffraxFlow(stepsize_controller=diffrax.PIDController(rtol=1e-13, atol=1e-14))
    run = lambda w: vx.stroboscopic_map(machine(force), [0.1, 0.0], [0.0, 0.0], args=w, flow=flow)[0]  # noqa: E731
    np.testing.assert_allclose(jax.jit(run)(W), run(W), rtol=1e-12)
    assert np.isfinite(jax.jit(run)(0.37)).all()
    with pytest.raises(ValueError, match=SENTENCE):
        run(0.37)


def test_a_force_is_compiled_once_for_the_question():
    force = ON["of the period"]
    is_refused(force)
    size = periodicity._changes._cache_size()
    is_refused(force, x=(0.1, 0.2))
    assert periodicity._changes._cache_size() == size
