"""Transformations that leave the motion unchanged, or change it in a known way."""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import Event, log_of, paired

import vijax as vx

MASS = np.array([1.0, 1.4, 0.7])
DAMPING = np.array([[0.3, -0.1, 0.0], [-0.1, 0.25, -0.05], [0.0, -0.05, 0.1]])
STIFFNESS = np.array([[2.0, -0.8, 0.0], [-0.8, 1.5, -0.5], [0.0, -0.5, 0.9]])
AMPLITUDE = np.array([[0.5, 0.0, 0.3], [0.0, 0.2, 0.0]])
PHASE = np.array([[0.3, 0.0, 1.0], [0.0, 2.0, 0.0]])
MEAN = np.array([0.1, 0.0, -0.1])
FREQUENCY = 0.7
PERIOD = 2 * np.pi / FREQUENCY
STOPS = [(0, 0.25, "upper", 0.7), (2, -0.3, "lower", 0.2), (0, -0.3, "lower", 0.0)]
X0 = np.array([0.0, 0.1, -0.05])
V0 = np.array([0.2, 0.0, -0.1])
END = 30.0
TIMES = np.linspace(0.0, END, 61)
LOG = 256
# Some hundred roundings, magnified by some dozen impacts (measured: 1e-14).
ROUNDING = 1e-11
# A rounding of the position moves a light impact of 1e-6 by a time of that over its velocity.
LIGHT_TIME = 1e-7


def build(mass=MASS, damping=DAMPING, stiffness=STIFFNESS, stops=STOPS, **load):
    load = {"amplitude": AMPLITUDE, "frequency": FREQUENCY, "phase": PHASE, "mean": MEAN} | load
    stops = [vx.Stop(*stop) for stop in stops]
    return vx.ImpactSystem(mass, damping, stiffness, vx.Harmonic(**load), stops)


def run(system, x0=X0, v0=V0, t0=0.0, t1=END, ts=TIMES):
    return vx.simulate(system, t0, t1, x0, v0, ts=ts, max_events=LOG)


@pytest.fixture(scope="module")
def motion():
    sol = run(build())
    kinds = {event.kind for event in log_of(sol)}
    assert kinds == {"impact", "stick", "release"}
    return sol


def assert_same(found, expected, *, shift=0.0, time=1.0, length=1.0, sign=1, order=slice(None), stops=None):
    """Compare two motions, the first converted to the units and the order of the second."""
    velocity = length / time
    close = {"rtol": 0, "atol": ROUNDING}
    np.testing.assert_allclose(
        np.asarray(found.xs) / (sign * length), np.asarray(expected.xs)[:, order], **close
    )
    np.testing.assert_allclose(
        np.asarray(found.vs) / (sign * velocity), np.asarray(expected.vs)[:, order], **close
    )
    number = range(len(STOPS)) if stops is None else stops
    brought_back = [
        Event((e.t - shift) / time, e.kind, number[e.stop], e.velocity / (sign * velocity))
        for e in log_of(found)
    ]
    pairs = paired(log_of(expected), brought_back)
    assert len(pairs) > 20
    for theirs, ours in pairs:
        if theirs.kind != "stick":
            assert ours.t == pytest.approx(theirs.t, rel=0, abs=LIGHT_TIME)
            assert ours.velocity == pytest.approx(theirs.velocity, rel=0, abs=LIGHT_TIME)


@pytest.mark.parametrize("periods", [1, -3, 1000])
def test_a_start_whole_periods_later_gives_the_same_motion_later(motion, periods):
    shift = periods * PERIOD
    late = run(build(), t0=shift, t1=shift + END, ts=np.clip(shift + TIMES, shift, shift + END))
    assert_same(late, motion, shift=shift)


def test_permuted_masses_give_the_permuted_motion(motion):
    order = np.array([2, 0, 1])
    place = np.argsort(order)
    stops = [(int(place[i]), *rest) for i, *rest in STOPS]
    square = np.ix_(order, order)
    system = build(
        MASS[order],
        DAMPING[square],
        STIFFNESS[square],
        stops,
        amplitude=AMPLITUDE[:, order],
        phase=PHASE[:, order],
        mean=MEAN[order],
    )
    assert_same(run(system, X0[order], V0[order]), motion, order=order)


@pytest.mark.slow
def test_permuted_stops_give_the_same_motion(motion):
    order = [1, 2, 0]
    system = build(stops=[STOPS[j] for j in order])
    assert_same(run(system), motion, stops=order)


def test_a_mirrored_machine_gives_the_mirrored_motion(motion):
    other = {"upper": "lower", "lower": "upper"}
    stops = [(i, -s, other[side], r) for i, s, side, r in STOPS]
    system = build(stops=stops, amplitude=-AMPLITUDE, mean=-MEAN)
    assert_same(run(system, -X0, -V0), motion, sign=-1)


@pytest.mark.parametrize(
    ("time", "length", "mass"),
    [
        (3.0, 1.0, 1.0),
        (1e4, 1.0, 1.0),
        (1.0, 1e6, 1.0),
        (1.0, 1e-6, 1.0),
        (1.0, 1.0, 1e-2),
        (1e-3, 1e-4, 7.0),
    ],
)
def test_other_units_give_the_same_motion_in_those_units(motion, time, length, mass):
    force = mass * length / time**2
    stops = [(i, s * length, side, r) for i, s, side, r in STOPS]
    system = build(
        MASS * mass,
        DAMPING * mass / time,
        STIFFNESS * mass / time**2,
        stops,
        amplitude=AMPLITUDE * force,
        frequency=FREQUENCY / time,
        mean=MEAN * force,
    )
    scaled = run(system, X0 * length, V0 * length / time, t1=END * time, ts=TIMES * time)
    assert_same(scaled, motion, time=time, length=length)


@pytest.mark.parametrize("time", [1e5, 1e9])
def test_a_mass_rests_on_its_stop_in_any_unit_of_time(time):
    """Damping in proportion: the motion is one of modes, and one mode less while a mass rests."""
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.5]])

    def end(time):
        load = vx.Harmonic([0.1 / time**2, 0.0], 1.6 / time, mean=[-0.6 / time**2, 0.0])
        stops = [vx.Stop(0, 0.0, "lower", 0.5)]
        system = vx.ImpactSystem([1.0, 1.0], 0.01 / time * stiffness, stiffness / time**2, load, stops)
        sol = vx.simulate(system, 0.0, 40 * time, [0.5, 0.0], max_events=LOG)
        assert sol.stuck1[0]
        return np.concatenate([sol.x1, sol.v1 * time])

    np.testing.assert_allclose(end(time), end(1.0), rtol=0, atol=ROUNDING)


@pytest.mark.thorough
def test_friction_ends_bounces_on_a_cushion_alike_in_small_units():
    """Bounces fall below 1e-8, and go on: the pull on the mass is as small."""

    def machine(length, time):
        force = length / time**2
        return vx.ImpactSystem(
            [2.83138],
            [[0.0186494 / time]],
            [[1.98979 / time**2]],
            vx.Harmonic([0.670464 * force], 1.15664 / time, [1.38459], [-0.422206 * force]),
            [
                vx.CompliantStop(
                    0,
                    -0.0435625 * length,
                    "lower",
                    stiffness=527.959 / time**2,
                    damping=0.0609642 / time,
                    preload=0.749068 * force,
                )
            ],
            friction=[vx.Friction({0: 1.0}, 0.20317 * force, 0.396366 * force)],
        )

    one = vx.simulate(machine(1.0, 1.0), 0.0, 60.0, [0.0], [0.25], max_events=LOG)
    length, time = 2.0**-7, 2.0**3
    other = vx.simulate(
        machine(length, time), 0.0, 60.0 * time, [0.0], [0.25 * length / time], max_events=LOG
    )
    assert one.num_events == other.num_events
    np.testing.assert_array_equal(other.events.kind, one.events.kind)
    np.testing.assert_allclose(other.events.t / time, one.events.t, rtol=ROUNDING)


@pytest.mark.thorough
@pytest.mark.parametrize("has_friction", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_mass_sticks_to_one_of_two_stops_in_lengths_of_a_millionth(has_friction):
    """Gaps are as small as bounces are light, in those units: the other stop is not near for all that."""

    def kinds(size):
        stops = [
            vx.Stop(0, 0.2 * size, "upper", 0.5),
            vx.Stop(0, -0.2 * size, "lower", 0.5),
            vx.Contact({0: 1.0, 1: -1.0}, 5.0 * size, 0.5),
        ]
        # Lengths and times are both scaled: velocities are the same.
        load = vx.Harmonic([1.0 / size, 0.0], 0.2 / size)
        friction = [vx.Friction({1: 1.0}, 0.1 / size)] if has_friction else []
        matrix = np.eye(2)
        system = vx.ImpactSystem(
            [1.0, 1.0], 0.1 / size * matrix, matrix / size**2, load, stops, friction=friction
        )
        sol = vx.simulate(system, 0.0, 40.0 * size, v0=[0.0, 0.3], max_events=LOG)
        count = int(sol.num_events)
        return [
            (int(k), int(j)) for k, j in zip(sol.events.kind[:count], sol.events.stop[:count], strict=True)
        ]

    expected = kinds(1.0)
    assert (vx.STICK, 0) in expected
    assert kinds(2.0**-26) == expected


@pytest.mark.slow
def test_a_motion_taken_up_again_from_its_end_goes_on_unchanged(motion):
    held = np.asarray([motion.contact_force(t).any() for t in TIMES])
    assert held.any()
    # Once while a mass sticks, once while none does.
    for k in (np.flatnonzero(held)[0], np.flatnonzero(~held)[len(TIMES) // 4]):
        first = run(build(), t1=TIMES[k], ts=np.minimum(TIMES, TIMES[k]))
        rest = np.maximum(TIMES, TIMES[k])
        second = run(build(), first.x1, first.v1, t0=TIMES[k], ts=rest)
        assert bool(first.stuck1.any()) == bool(held[k])
        np.testing.assert_allclose(second.xs[k:], motion.xs[k:], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(second.vs[k:], motion.vs[k:], rtol=0, atol=ROUNDING)
        joined = [e.kind for e in log_of(first) if e.t <= TIMES[k]] + [e.kind for e in log_of(second)]
        assert joined == [e.kind for e in log_of(motion)]


@pytest.mark.slow
def test_elastic_stops_without_damping_keep_the_energy():
    stops = [(i, s, side, 1.0) for i, s, side, _ in STOPS]
    silent = {"amplitude": np.zeros((2, 3)), "mean": np.zeros(3)}
    system = build(damping=np.zeros((3, 3)), stops=stops, **silent)
    ts = np.linspace(0.0, 100.0, 101)
    sol = run(system, X0, 5 * V0, t1=100.0, ts=ts)
    assert sol.num_events > 50
    x, v = np.asarray(sol.xs), np.asarray(sol.vs)
    energy = (v * v @ MASS + np.einsum("ti,ij,tj->t", x, STIFFNESS, x)) / 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)


@pytest.mark.thorough
def test_however_fine_the_samples_none_lies_beyond_a_stop(motion):
    events = np.array([0.0, *sorted(e.t for e in log_of(motion)), END])
    inside = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(events)])
    for t in (np.linspace(0.0, END, 20_001), inside):
        x, v = motion.evaluate(jnp.asarray(t))
        assert np.isfinite(x).all()
        assert np.isfinite(v).all()
        for i, position, side, _ in STOPS:
            gap = (position - x[:, i]) * (1 if side == "upper" else -1)
            assert gap.min() >= -1e-15
