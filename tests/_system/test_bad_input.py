"""Bad input raises an error that describes the fault and the remedy."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

LOAD = vx.Harmonic([0.5, 0.0], 0.8)
EYE = np.eye(2)
MASSES = np.ones(2)
ONE = vx.chain([1.0], [0.1], [1.0], vx.Harmonic([0.5], 0.8), [vx.Stop(0, 0.3, "upper", 0.7)])
# Unbounded motion: a negative stiffness makes it overflow.
UNSTABLE = eqx.tree_at(lambda s: s.stiffness, ONE, jnp.array([[-400.0]]))


def says(sentence: str) -> str:
    """Pattern that matches the message literally."""
    return re.escape(sentence)


BAD_MACHINES = {
    "contacts without room": (
        lambda: vx.ImpactSystem(
            MASSES, EYE, EYE, LOAD, [vx.Contact({0: 1.0, 1: -1.0}, 0.1), vx.Contact({0: -2.0, 1: 2.0}, -0.2)]
        ),
        "Contacts 0 and 1 act against each other and leave no room between them",
    ),
    "contact and lower stop without room": (
        lambda: vx.ImpactSystem(
            [1.0], [[0.0]], [[1.0]], None, [vx.Contact({0: 1.0}, -0.1), vx.Stop(0, 0.1, "lower")]
        ),
        "Contacts 0 and 1 act against each other and leave no room between them",
    ),
    "mass of two axes": (
        lambda: vx.ImpactSystem(np.ones((2, 1)), EYE, EYE, LOAD),
        "Argument `mass` must have shape (n,) or (n, n), but has shape (2, 1).",
    ),
    "no mass": (
        lambda: vx.ImpactSystem(np.ones(0), EYE, EYE, LOAD),
        "Argument `mass` must have shape (n,) or (n, n), but has shape (0,).",
    ),
    "damping too small": (
        lambda: vx.ImpactSystem(MASSES, np.eye(1), EYE, LOAD),
        "Argument `damping` must have shape (2, 2), but has shape (1, 1).",
    ),
    "stiffness too large": (
        lambda: vx.ImpactSystem(MASSES, EYE, np.eye(3), LOAD),
        "Argument `stiffness` must have shape (2, 2), but has shape (3, 3).",
    ),
    "mass of zero": (
        lambda: vx.ImpactSystem([1.0, 0.0], EYE, EYE, LOAD),
        "Argument `mass` must be positive and finite",
    ),
    "negative mass": (
        lambda: vx.ImpactSystem([1.0, -1.0], EYE, EYE, LOAD),
        "Argument `mass` must be positive and finite",
    ),
    "mass of NaN": (
        lambda: vx.ImpactSystem([1.0, np.nan], EYE, EYE, LOAD),
        "Argument `mass` must be positive and finite",
    ),
    "columns of a state": (
        lambda: vx.ImpactSystem(MASSES, EYE, EYE, LOAD, num_states=1),
        "The last 1 columns of `stiffness` must be zero: of a first-order state the velocity alone counts.",
    ),
    "stop of a state": (
        lambda: vx.ImpactSystem(MASSES, EYE, [[1.0, 0.0], [1.0, 0.0]], LOAD, [vx.Stop(1, 1.0)], num_states=1),
        "`stops[0]` acts on coordinate 1, which is a state.",
    ),
    "states alone": (
        lambda: vx.ImpactSystem(MASSES, EYE, 0 * EYE, LOAD, num_states=2),
        "Argument `num_states` is 2, but of 2 coordinates one at least must be a mass.",
    ),
    "dynamics of a state": (
        lambda: vx.with_states(vx.ImpactSystem(MASSES, EYE, EYE, LOAD), [[1.0, 0.0]], [[1.0]]),
        "Argument `dynamics` must have shape (1, 1), but has shape (1, 2).",
    ),
    "feedback of a state": (
        lambda: vx.with_states(vx.ImpactSystem(MASSES, EYE, EYE, LOAD), [[1.0]], [[1.0]]),
        "Argument `feedback` must have shape (2, 1), but has shape (1, 1).",
    ),
    "damping of NaN": (
        lambda: vx.ImpactSystem(MASSES, np.nan * EYE, EYE, LOAD),
        "Argument `damping` must be finite",
    ),
    "load for three masses": (
        lambda: vx.ImpactSystem(MASSES, EYE, EYE, vx.Harmonic(np.ones(3), 0.8)),
        "`forcing.amplitude` must end in the number of masses, 2, but has shape (3,).",
    ),
    "stop of a mass that is not there": (
        lambda: vx.ImpactSystem(MASSES, EYE, EYE, LOAD, [vx.Stop(2, 0.3)]),
        "`stops[0].mass` is 2, but the machine has masses 0 to 1.",
    ),
    "two upper stops": (
        lambda: vx.ImpactSystem(MASSES, EYE, EYE, LOAD, [vx.Stop(1, 0.3), vx.Stop(1, 0.4)]),
        "`stops[0]` and `stops[1]` are both upper stops of mass 1: keep the nearer one.",
    ),
    "lower stop above upper": (
        lambda: vx.ImpactSystem(MASSES, EYE, EYE, LOAD, [vx.Stop(0, 0.3, "upper"), vx.Stop(0, 0.4, "lower")]),
        "The lower stop of mass 0 (at 0.4) must lie below its upper stop (at 0.3).",
    ),
    "lower stop at upper": (
        lambda: vx.ImpactSystem(MASSES, EYE, EYE, LOAD, [vx.Stop(0, 0.3, "upper"), vx.Stop(0, 0.3, "lower")]),
        "must lie below its upper stop",
    ),
    "chain of unequal lengths": (
        lambda: vx.chain([1.0, 1.0], [0.1], [1.0, 1.0], LOAD),
        "Argument `dampings` must have one entry per mass, shape (2,), but has shape (1,).",
    ),
    "stop in the air": (lambda: vx.Stop(0, np.inf), "Argument `position` must be finite, but is inf."),
    "restitution above one": (
        lambda: vx.Stop(0, 0.3, "upper", 1.1),
        "Argument `restitution` must lie between 0 (plastic) and 1 (elastic), but is 1.1.",
    ),
    "negative restitution": (
        lambda: vx.Stop(0, 0.3, "upper", -0.1),
        "Argument `restitution` must lie between 0 (plastic) and 1 (elastic), but is -0.1.",
    ),
    "restitution of NaN": (
        lambda: vx.Stop(0, 0.3, "upper", np.nan),
        "Argument `restitution` must lie between 0 (plastic) and 1 (elastic)",
    ),
    "restitution per mass": (
        lambda: vx.Stop(0, 0.3, "upper", np.array([0.7, 0.7])),
        "Argument `restitution` must be a number, but has shape (2,).",
    ),
    "negative mass index": (
        lambda: vx.Stop(-1, 0.3),
        "Argument `mass` must be a whole number, 0 or more, but is -1.",
    ),
    "amplitude without axis": (
        lambda: vx.Harmonic(0.5, 0.8),
        "Argument `amplitude` must have shape (n,) or (harmonics, n), but has shape ().",
    ),
    "phase of another shape": (
        lambda: vx.Harmonic([0.5, 0.0], 0.8, phase=[0.0]),
        "Argument `phase` must have the shape of `amplitude`, (2,), but has shape (1,).",
    ),
    "mean of another shape": (
        lambda: vx.Harmonic([0.5, 0.0], 0.8, mean=[0.0]),
        "Argument `mean` must have shape (n,) = (2,), but has shape (1,).",
    ),
    "negative frequency": (
        lambda: vx.Harmonic([0.5], -0.8),
        "Argument `frequency` must be finite and not negative, but is -0.8.",
    ),
    "frequency of NaN": (
        lambda: vx.Harmonic([0.5], np.nan),
        "Argument `frequency` must be finite and not negative",
    ),
    "a frequency per mass": (
        lambda: vx.Harmonic([0.5, 0.5], np.array([0.8, 0.9])),
        "Argument `frequency` must be a number, but has shape (2,).",
    ),
    "infinite amplitude": (lambda: vx.Harmonic([np.inf], 0.8), "Argument `amplitude` must be finite"),
}


@pytest.mark.parametrize("name", BAD_MACHINES)
def test_a_bad_machine_is_refused_with_a_sentence(name):
    build, sentence = BAD_MACHINES[name]
    with pytest.raises(ValueError, match=says(sentence)):
        build()


BAD_RUNS = {
    "x0 too long": (
        lambda: vx.simulate(ONE, 0.0, 1.0, np.zeros(2)),
        "Argument `x0` must have shape (1,), but has shape (2,).",
    ),
    "v0 a number": (
        lambda: vx.simulate(ONE, 0.0, 1.0, np.zeros(1), 0.0),
        "Argument `v0` must have shape (1,), but has shape ().",
    ),
    "ts of two axes": (
        lambda: vx.simulate(ONE, 0.0, 1.0, ts=np.zeros((2, 2))),
        "Argument `ts` must have shape (times,), but has shape (2, 2).",
    ),
    "negative log": (
        lambda: vx.simulate(ONE, 0.0, 1.0, max_events=-1),
        "Argument `max_events` must be a whole number, 0 or more, but is -1.",
    ),
    "end before start": (
        lambda: vx.simulate(ONE, 1.0, 0.0),
        "Argument `t1` must not lie before `t0`.",
    ),
    "ts out of order": (
        lambda: vx.simulate(ONE, 0.0, 1.0, ts=np.array([0.5, 0.4])),
        "Argument `ts` must be in increasing order, within [t0, t1].",
    ),
    "ts after the end": (
        lambda: vx.simulate(ONE, 0.0, 1.0, ts=np.array([0.5, 1.5])),
        "Argument `ts` must be in increasing order, within [t0, t1].",
    ),
    "ts before the start": (
        lambda: vx.simulate(ONE, 0.0, 1.0, ts=np.array([-0.5, 0.5])),
        "Argument `ts` must be in increasing order, within [t0, t1].",
    ),
    "start beyond an upper stop": (
        lambda: vx.simulate(ONE, 0.0, 1.0, np.array([0.4])),
        "The start lies beyond a stop: `x0[0]` is past `stops[0]`. "
        "Start mass 0 on its free side (upper stop), or on the stop.",
    ),
    "start beyond a lower stop": (
        lambda: vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 1.0, np.array([-0.4, 0.0])),
        "The start lies beyond a stop: `x0[0]` is past `stops[0]`. "
        "Start mass 0 on its free side (lower stop), or on the stop.",
    ),
}


@pytest.mark.parametrize("name", BAD_RUNS)
def test_a_bad_run_is_refused_with_a_sentence(name):
    run, sentence = BAD_RUNS[name]
    with pytest.raises(ValueError, match=says(sentence)):
        run()


def test_an_unknown_side_is_refused():
    # In tests the annotation is checked and may raise first; without that check the message does.
    with pytest.raises(Exception, match=r"upper|side"):
        vx.Stop(0, 0.3, "left", 0.7)


def test_complex_numbers_are_refused():
    with pytest.raises(ValueError, match=says("Expected real numbers, but got complex ones.")):
        vx.ImpactSystem([1.0 + 1j], [[0.0]], [[1.0]], vx.Harmonic([0.5], 0.8))


def run(system=ONE, t1=30.0, x0=None, v0=None, *, log=64, **knobs):
    """A run with one of a few log lengths, so that few programs are compiled."""
    return vx.simulate(system, 0.0, t1, x0, v0, max_events=log, **knobs)


def test_a_start_past_the_stop_by_one_rounding_is_taken_as_on_it():
    sol = run(t1=0.1, x0=np.array([np.nextafter(0.3, 1.0)]), v0=np.array([-1.0]))
    assert sol.num_events == 0
    with pytest.raises(ValueError, match="beyond a stop"):
        run(t1=0.1, x0=np.array([0.3 + 1e-13]), v0=np.array([-1.0]))


def test_a_start_is_checked_while_the_stiffness_alone_is_traced():
    def end(stiffness, x0):
        load, stop = vx.Harmonic([0.3], 0.6), vx.Stop(0, 0.3, "upper", 0.5)
        system = vx.ImpactSystem([1.0], [[0.1]], jnp.reshape(stiffness, (1, 1)), load, [stop])
        return vx.simulate(system, 0.0, 1.0, [x0], max_events=64).x1[0]

    assert np.isfinite(jax.jit(lambda k: end(k, 0.0))(1.0))
    with pytest.raises(ValueError, match="beyond a stop"):
        jax.jit(lambda k: end(k, 0.4))(1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("row", [pytest.param(0, marks=pytest.mark.slow), {0: 1.0, 1: -1.0}])
def test_a_run_goes_on_from_masses_at_rest_on_a_stop_at_zero(row):
    """What rounding left of their motion is far below the smallest length of the machine."""
    rubbing = vx.Friction(row, 1.5)
    stops, load = [vx.Stop(0, 0.0, "lower", 0.0)], vx.Harmonic([0.3, 0.0], 0.6)
    system = vx.ImpactSystem([1.0, 1.0], np.eye(2), np.eye(2), load, stops, friction=[rubbing])
    run = lambda x: vx.simulate(system, 0.0, 5.0, [x, 0.0], ts=[5.0], max_events=64).x1  # noqa: E731
    np.testing.assert_allclose(run(-1e-84), run(0.0), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(jax.jit(run)(-1e-84), run(-1e-84))
    with pytest.raises(ValueError, match="beyond a stop"):
        run(-1e-13)


@jax.jit
def end_state(t1, x, save):
    return vx.simulate(ONE, 0.0, t1, x[None], ts=save[None]).x1


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        ({"x": 0.4}, "The start lies beyond a stop: `x0[0]` is past `stops[0]`."),
        ({"t1": -1.0}, "Argument `t1` must not lie before `t0`."),
        ({"save": 3.0}, "Argument `ts` must be in increasing order, within [t0, t1]."),
    ],
)
def test_under_jit_the_same_sentence_comes_at_run_time(bad, sentence):
    good = {"t1": 1.0, "x": 0.0, "save": 0.5}
    assert jnp.isfinite(end_state(**jax.tree.map(jnp.asarray, good))).all()
    # JAX turns an error inside a plain `jit` into a RuntimeError or a ValueError, depending on the version.
    with pytest.raises((RuntimeError, ValueError), match=says(sentence)):
        end_state(**jax.tree.map(jnp.asarray, good | bad)).block_until_ready()


def test_a_full_log_is_an_error_that_names_its_code_and_the_remedy():
    with pytest.raises(RuntimeError, match=r"max_events_reached: .*Increase `max_events`"):
        run(log=3)


def test_with_throw_off_a_full_log_is_a_code_and_the_motion_goes_on():
    cut, whole = run(log=3, throw=False), run()
    assert cut.result == vx.RESULTS.max_events_reached
    assert whole.num_events > 3
    assert cut.num_events == 3
    for name in ("t", "stop", "kind", "velocity_minus", "velocity_plus", "impulse"):
        np.testing.assert_array_equal(getattr(cut.events, name), getattr(whole.events, name)[:3])
    np.testing.assert_array_equal(cut.x1, whole.x1)
    np.testing.assert_array_equal(cut.v1, whole.v1)


def test_running_out_of_steps_names_its_code_and_the_remedy():
    with pytest.raises(RuntimeError, match=r"max_steps_reached: .*Increase `max_steps`"):
        run(max_steps=5)


def test_after_the_last_step_the_saved_states_repeat_the_last_one():
    sol = run(ts=np.linspace(0.0, 30.0, 7), max_steps=12, throw=False)
    assert sol.result == vx.RESULTS.max_steps_reached
    assert np.isfinite(sol.xs).all()
    assert not np.array_equal(sol.xs[0], sol.x1)
    np.testing.assert_array_equal(sol.xs[-1], sol.x1)
    np.testing.assert_array_equal(sol.vs[-1], sol.v1)


def test_a_motion_that_overflows_names_its_code_and_the_remedy():
    with pytest.raises(RuntimeError, match=r"non_finite: .*Check that"):
        run(UNSTABLE, 100.0, np.array([-1.0]))


CODES = ["successful", "max_events_reached", "max_impacts_reached", "max_steps_reached", "non_finite"]


@pytest.mark.parametrize("name", CODES)
def test_every_code_is_named_in_its_message(name):
    assert vx.RESULTS[getattr(vx.RESULTS, name)].startswith(f"{name}: ")
