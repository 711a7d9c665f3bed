"""Machines on a moving base, and long chains, against SciPy's integrator in the fixed frame."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers import Event, log_of
from scipy.integrate import solve_ivp

import vijax as vx

# Error of DOP853 at its tightest tolerance over some twenty impacts (measured: 6e-14).
SCIPY = 1e-12
# One or two roundings.
EXACT = 1e-15


def test_a_machine_on_a_moving_base_moves_as_in_the_frame_at_rest():
    mass, w, weight = [1.0, 2.0], 0.8, [0.05, 0.1]
    travel, phase, order = np.array([0.4, 0.15]), np.array([0.5, -1.0]), np.array([1, 2])
    load = vx.base_excitation(mass, travel, w, phase, weight)
    stops = [vx.Stop(0, 0.3, "upper", 0.7), vx.Stop(1, 0.25, "upper", 0.6)]
    system = vx.chain(mass, [0.1, 0.2], [1.0, 1.5], load, stops)

    def base(t: float) -> tuple[float, float]:
        angle = order * w * t + phase
        return float(travel @ np.cos(angle)), float(-(travel * order * w) @ np.sin(angle))

    x, v = np.array([0.1, -0.2]), np.array([0.0, 0.3])
    seen = _by_scipy(system, lambda t: np.array(weight), base, x, v, 40.0)
    assert {event.stop for event in seen[0]} == {0, 1}
    _assert_agrees(vx.simulate(system, 0.0, 40.0, x, v), *seen)


def test_a_base_of_one_harmonic_is_the_first_of_several():
    one = vx.base_excitation([1.0, 2.0], 0.4, 0.8, 0.5)
    two = vx.base_excitation([1.0, 2.0], [0.4, 0.1], 0.8, [0.5, 0.0])
    np.testing.assert_allclose(one.amplitude, 0.4 * 0.64 * np.array([1.0, 2.0]), rtol=EXACT)
    np.testing.assert_array_equal(one.amplitude, two.amplitude[0])
    np.testing.assert_allclose(two.amplitude[1], 0.1 * 2.56 * np.array([1.0, 2.0]), rtol=EXACT)
    assert one.phase.tolist() == two.phase[0].tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((1.0, 0.4, 0.8), r"`mass` must have shape \(n,\), but has shape \(\)"),
        (([1.0], [[0.4]], 0.8), r"`amplitude` must be a number or have shape \(harmonics,\)"),
        (([1.0], [0.4, 0.1], 0.8, 0.0), r"`phase` must have the shape of `amplitude`, \(2,\)"),
        (([1.0], 0.4, 0.8, 0.0, [1.0, 2.0]), r"`mean` must have shape \(n,\) = \(1,\)"),
        (([1.0], 0.4, -0.8), r"`frequency` must be finite and not negative"),
    ],
)
def test_a_base_that_makes_no_sense_is_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.base_excitation(*arguments)


@pytest.mark.thorough
def test_ten_masses_hit_their_stops_as_in_scipy():
    system, rest = vx.models.uniform_chain(0.8, 3.0), np.zeros(10)
    load = np.eye(10)[0] * 3.0
    seen = _by_scipy(system, lambda t: load * np.cos(0.8 * t), None, rest, rest, 60.0)
    assert {event.stop for event in seen[0]} == {0, 1}
    _assert_agrees(vx.simulate(system, 0.0, 60.0, rest, rest), *seen)


Base = Callable[[float], tuple[float, float]]


def _by_scipy(
    system: vx.ImpactSystem,
    load: Callable[[float], np.ndarray],
    base: Base | None,
    x0: np.ndarray,
    v0: np.ndarray,
    t1: float,
) -> tuple[list[Event], np.ndarray, np.ndarray]:
    """Impacts and end state, relative to the base, integrated in the fixed frame."""
    moves = (lambda t: (0.0, 0.0)) if base is None else base
    n, stops = system.num_masses, system.stops
    mass, c, k = (np.asarray(a) for a in (system.mass, system.damping, system.stiffness))

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        y, dy = moves(t)
        return np.append(z[n:], (load(t) - c @ (z[n:] - dy) - k @ (z[:n] - y)) / mass)

    def gap_of(stop: vx.Stop):
        def gap(t: float, z: np.ndarray) -> float:
            return stop.sign * (float(stop.position) + moves(t)[0] - z[stop.mass])

        gap.terminal, gap.direction = True, -1
        return gap

    gaps = [gap_of(stop) for stop in stops]
    t, events = 0.0, []
    y, dy = moves(t)
    z = np.append(x0 + y, v0 + dy)
    while t < t1:
        flight = solve_ivp(rates, (t, t1), z, "DOP853", events=gaps, rtol=3e-14, atol=1e-15, max_step=0.05)
        t, z = float(flight.t[-1]), flight.y[:, -1]
        y, dy = moves(t)
        for j, hits in enumerate(flight.t_events):
            if hits.size:
                i = n + stops[j].mass
                events.append(Event(t, "impact", j, float(z[i] - dy)))
                z[i] = dy - float(stops[j].restitution) * (z[i] - dy)
    return events, z[:n] - y, z[n:] - dy


def _assert_agrees(solution: vx.Solution, events: list[Event], x: np.ndarray, v: np.ndarray) -> None:
    ours = log_of(solution)
    assert [(event.kind, event.stop) for event in ours] == [(event.kind, event.stop) for event in events]
    assert len(events) > 8
    for name in ("t", "velocity"):
        mine, theirs = ([getattr(event, name) for event in log] for log in (ours, events))
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=SCIPY)
    np.testing.assert_allclose(solution.x1, x, rtol=0, atol=SCIPY)
    np.testing.assert_allclose(solution.v1, v, rtol=0, atol=SCIPY)
