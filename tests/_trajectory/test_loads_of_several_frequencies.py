"""Motions under harmonics of several frequencies: closed forms, the same load as harmonics of one frequency, other ways to run."""

from typing import Any

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import vijax as vx

# A few hundred roundings of motions of size one.
ROUNDING = 2e-13
# Central differences of fourth order with a step of 1e-4.
DIFFERENCES = 1e-9

# Amplitude, frequency and phase of each harmonic of a load on one mass.
TERMS = ((1.0, 1.0, 0.4), (0.3, 2.3, 0.0), (0.1, 4.6, 0.0))
LOAD = vx.Harmonic([1.0], 1.0, [0.4], [0.2]) + vx.Harmonic([[0.3], [0.1]], 2.3)
START = [0.1], [-0.2]


def closed_form(t: Any, damping: Any, square: Any) -> tuple[float, float]:
    """Position and velocity at a time of a mass of 1 under `LOAD`, to 40 digits; undamped modes may be at resonance."""
    with mp.workdps(40):
        t, a, square = mp.mpf(t), mp.mpf(damping) / 2, mp.mpf(square)
        w = mp.sqrt(square - a * a)
        steady = [mp.mpf(0.2) / square, mp.mpf(0)]
        first = list(steady)
        for amplitude, speed, phase in TERMS:
            size, speed, phase = mp.mpf(amplitude), mp.mpf(speed), mp.mpf(phase)
            impedance = square - speed**2 + 2j * a * speed
            for state, at in ((steady, t), (first, mp.mpf(0))):
                turn = mp.expj(speed * at + phase)
                if impedance == 0:  # A t sin(W t + phase) / (2 W)
                    way, rate = (
                        size * at * turn / (2j * speed),
                        size * turn * (1 + 1j * speed * at) / (2j * speed),
                    )
                else:
                    way, rate = size * turn / impedance, size * turn * 1j * speed / impedance
                state[0] += mp.re(way)
                state[1] += mp.re(rate)
        x, v = mp.mpf(START[0][0]) - first[0], mp.mpf(START[1][0]) - first[1]
        c, s, fade = mp.cos(w * t), mp.sin(w * t) / w, mp.exp(-a * t)
        found = (
            steady[0] + fade * (x * (c + a * s) + v * s),
            steady[1] + fade * (v * (c - a * s) - square * x * s),
        )
        return float(found[0]), float(found[1])


@pytest.mark.parametrize("square", [2.0, pytest.param(1.0, marks=pytest.mark.thorough)])
def test_an_undamped_mass_has_its_closed_form_at_resonance_too(square: float):
    ts = np.array([0.5, 7.0, 60.3])
    far = [vx.Stop(0, 100.0, "upper", 0.7)]
    sol = vx.simulate(vx.ImpactSystem([1.0], [[0.0]], [[square]], LOAD, far), 0.0, 60.3, *START, ts=ts)
    exact = np.array([closed_form(t, 0.0, square) for t in ts])
    np.testing.assert_allclose(np.stack([sol.xs[:, 0], sol.vs[:, 0]], 1), exact, rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_a_million_periods_keep_the_phase_of_each_frequency():
    system = vx.ImpactSystem([1.0], [[0.2]], [[2.0]], LOAD, [vx.Stop(0, 100.0, "upper", 0.7)])
    t = 2.0**23 * 0.75  # 1001295 periods
    sol = vx.simulate(system, 0.0, t, *START, max_steps=10**8)
    # The time has half a rounding of 5e-10.
    np.testing.assert_allclose([sol.x1[0], sol.v1[0]], closed_form(t, 0.2, 2.0), rtol=0, atol=4e-9)


def harmonics(unit: float = 0.3) -> tuple[Any, Any]:
    """One load on two masses: harmonics 3, 4 and 8 of one frequency, and the sum of two loads of other frequencies."""
    rows, phases = np.zeros((8, 2)), np.zeros((8, 2))
    rows[2], phases[2] = [1.0, 0.2], [0.4, 0.0]
    rows[3], rows[7] = [0.0, 0.7], [0.1, 0.2]
    two = vx.Harmonic(rows[2], 3 * unit, phases[2]) + vx.Harmonic(rows[[3, 7]], 4 * unit)
    return vx.Harmonic(rows, unit, phases), two


STIFFNESS = np.array([[2.0, -1.0], [-1.0, 1.5]])
STOPS = [vx.Stop(0, 0.8, "upper", 0.7), vx.Stop(1, -0.9, "lower", 0.5)]
RECORD = vx.Tabulated([0.0, 1.0, 5.0, 9.0], [[0.0, 0.0], [1.0, 0.0], [0.0, 0.5], [0.2, 0.0]], "cubic")
OTHER = vx.Waveform([0.0, 1.0, 2.0], [[0.0, 0.0], [0.3, 0.1], [-0.2, 0.4]], 1.7)
MACHINES = {
    "plastic stops": {"stops": [vx.Stop(0, 0.5, "upper", 0.0), vx.Stop(1, -0.6, "lower", 0.3)]},
    "general damping": {"damping": [[0.1, 0.02], [0.02, 0.3]], "stops": STOPS},
    "rigid mode": {"damping": np.zeros((2, 2)), "stiffness": [[1.0, -1.0], [-1.0, 1.0]], "stops": STOPS},
    "resonance": {
        "damping": np.zeros((2, 2)),
        "stiffness": np.diag([0.81, 1.44]),
        "mass": [1.0, 1.0],
        "stops": STOPS,
    },
    "contact": {"stops": [vx.Contact({0: 1.0, 1: -1.0}, 0.5, 0.5), STOPS[0]]},
    "friction": {"stops": [], "friction": [vx.Friction(0, 0.3)]},
    "friction and stop": {"stops": STOPS[:1], "friction": [vx.Friction(1, 0.3)]},
    "compliant stop": {"stops": [vx.CompliantStop(0, 0.3, "upper", 20.0, 0.1)]},
    "Jenkins element": {"stops": STOPS[:1], "hysteresis": [vx.Jenkins({0: 1.0}, 2.0, 0.3)]},
    "force": {"stops": STOPS, "force": lambda t, x, v, args: -0.1 * x**3},
    "record": {"stops": STOPS, "more": RECORD},
    "wave form": {"stops": STOPS, "more": OTHER},
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.thorough if name == "plastic stops" else pytest.mark.slow)
        for name in MACHINES
    ],
)
def test_harmonics_of_one_frequency_may_be_written_as_two(name: str):
    parts = {"mass": [1.0, 1.2], "damping": 0.05 * STIFFNESS, "stiffness": STIFFNESS} | MACHINES[name]
    more, ts = parts.pop("more", None), np.linspace(0.5, 40.0, 9)
    loads = [load if more is None else load + more for load in harmonics()]
    one, two = (
        vx.simulate(vx.ImpactSystem(forcing=load, **parts), 0.3, 40.0, [0.1, 0.0], [0.0, 0.2], ts=ts)
        for load in loads
    )
    count = int(one.num_events)
    assert int(two.num_events) == count > 5
    assert (two.events.kind == one.events.kind).all()
    np.testing.assert_allclose(two.events.t[:count], one.events.t[:count], rtol=0, atol=ROUNDING)
    for name in ("xs", "vs", "accelerations"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(two.evaluate(17.7), one.evaluate(17.7), rtol=0, atol=ROUNDING)


def system_of(w: jax.Array, a: jax.Array) -> vx.ImpactSystem:
    load = vx.Harmonic(a[:1], w[0]) + vx.Harmonic(a[1:], w[1], [0.3])
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, [vx.Stop(0, 0.5, "upper", 0.7)])


def end_of(numbers: jax.Array) -> jax.Array:
    """End of a run of several periods with impacts."""
    sol = vx.simulate(system_of(numbers[:2], numbers[2:]), 0.0, 33.0)
    return jnp.concatenate([sol.x1, sol.v1])


NUMBERS = jnp.array([0.8, 1.7, 0.6, 0.4])


@pytest.mark.slow
def test_derivatives_by_frequencies_and_amplitudes_are_differences():
    step = 1e-4 * jnp.eye(4)
    ends = jax.jit(jax.vmap(end_of))
    near, far = (ends(NUMBERS[None] + k * step) - ends(NUMBERS[None] - k * step) for k in (1, 2))
    differences = (8 * near - far).T / 12e-4
    scale = np.abs(differences).max()
    for derivative in (jax.jacfwd, jax.jacrev):
        found = jax.jit(derivative(end_of))(NUMBERS)
        np.testing.assert_allclose(found, differences, rtol=0, atol=DIFFERENCES * scale)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "path", ["forcing[0].frequency", pytest.param("forcing[1].frequency", marks=pytest.mark.slow)]
)
def test_points_of_a_sweep_are_runs(path: str):
    system = system_of(NUMBERS[:2], NUMBERS[2:])
    values = np.array([0.8, 1.1, 1.7, 2.9])  # frequencies of the other too
    ds = vx.sweep(
        system,
        {path: values},
        duration=33.0,
        ts=[11.0, 33.0],
        quantities=["rms_acceleration"],
        progress=False,
    )
    for k in range(len(values)):
        sol = vx.simulate(vx.system_of(ds.isel({path: k})), 0.0, 33.0, ts=[11.0, 33.0])
        np.testing.assert_allclose(ds.xs.values[k], sol.xs, rtol=0, atol=ROUNDING)
        assert int(ds.num_impacts[k].sum()) == int((sol.events.kind == vx.IMPACT).sum())
