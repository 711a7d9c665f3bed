"""Fourier coefficients of motions with impacts against closed forms and the transfer function of the machine."""

import numpy as np
import pytest

import vijax as vx


@pytest.mark.slow
def test_a_ball_that_bounces_for_ever_has_the_coefficients_of_a_parabola():
    """x = v0 s - g s^2 / 2 between impacts: c_k = g (T / 2 pi k)^2, up to sign, and the mean is g T^2 / 12."""
    gravity, period = 2.0, 1.5
    ball = vx.models.bouncing_ball(1.0, gravity=gravity)
    driven = vx.ImpactSystem(
        ball.mass,
        ball.damping,
        ball.stiffness,
        vx.Harmonic([0.0], 2 * np.pi / period, mean=np.asarray(ball.forcing.mean)),
        ball.stops,
    )
    sol = vx.simulate(driven, 0.0, 8 * period, [0.0], [gravity * period / 2])
    spectrum = vx.power_spectrum(sol, window="none")
    k = np.arange(1, 11)
    found = spectrum.x.values[:, 0]
    assert found[0].real == pytest.approx(gravity * period**2 / 12, rel=1e-12)
    np.testing.assert_allclose(found[8 * k], -gravity * (period / (2 * np.pi * k)) ** 2, rtol=1e-10)
    between = np.ones(len(found), bool)
    between[::8] = False
    assert np.abs(found[between]).max() < 1e-13


@pytest.mark.parametrize("frequency", [pytest.param(1.6, marks=pytest.mark.thorough), 2.0])
def test_a_chaotic_motion_answers_its_load_and_impulses_by_the_transfer_function(frequency):
    """Integrated equation of motion: (K - w^2 M + i w C) X = F + sum of impulses exp(-i w t) - ends."""
    system = vx.models.wagg_bishop_b(frequency)
    period = float(system.forcing.period)
    sol = vx.simulate(system, 0.0, 30 * period, v0=[0.0, 0.05], max_events=512)
    assert (np.asarray(sol.events.kind)[: int(sol.num_events)] == vx.IMPACT).all()
    w = np.linspace(0.05, 7.0, 57)
    spectrum = vx.power_spectrum(sol, w, window="none")
    n, span = int(sol.num_events), 30 * period
    t, stop, impulse = (np.asarray(a)[:n] for a in (sol.events.t, sol.events.stop, sol.events.impulse))
    masses = np.array(sol.machine.contacts.masses)[stop]
    mass, damping, stiffness = (np.asarray(a) for a in (system.mass, system.damping, system.stiffness))
    amplitude = np.asarray(system.forcing.amplitude).reshape(2)
    ends = [
        (-1.0, 0.0, np.zeros(2), np.array([0.0, 0.05])),
        (1.0, span, np.asarray(sol.x1), np.asarray(sol.v1)),
    ]
    for k, one in enumerate(w):
        matrix = stiffness + 1j * one * damping - one**2 * np.diag(mass)
        load = amplitude * sum(
            (np.exp(1j * (s * frequency - one) * span) - 1) / (2j * (s * frequency - one)) for s in (1, -1)
        )
        jumps = np.zeros(2, complex)
        np.add.at(jumps, masses, impulse * np.exp(-1j * one * t))
        for sign, at, x, v in ends:
            jumps -= sign * np.exp(-1j * one * at) * (mass * v + damping @ x + 1j * one * mass * x)
        expected = np.linalg.solve(matrix, load + jumps) / span
        np.testing.assert_allclose(spectrum.x.values[k], expected, rtol=0, atol=1e-11)


@pytest.mark.thorough
def test_what_is_held_adds_its_place_and_a_window_keeps_the_mean_of_a_line():
    system = vx.models.wagg_bishop_b(0.25)
    period = float(system.forcing.period)
    sol = vx.simulate(system, 0.0, 12 * period, max_events=2048)
    rectangular = vx.power_spectrum(sol, last=4, window="none")
    hann = vx.power_spectrum(sol, last=4)
    at = [0, 4, 8]
    np.testing.assert_allclose(hann.x.values[at], rectangular.x.values[at], atol=1e-9)
    # Derivative of a periodic motion.
    w = rectangular.frequency.values
    np.testing.assert_allclose(rectangular.v.values, 1j * w[:, None] * rectangular.x.values, atol=1e-9)


def test_bad_input_is_refused_in_a_sentence():
    system = vx.models.wagg_bishop_b(0.25)
    sol = vx.simulate(system, 0.0, 2.5 * float(system.forcing.period), max_events=2048)
    with pytest.raises(ValueError, match="Of the 2 whole forcing periods of the motion 3 are requested"):
        vx.power_spectrum(sol, last=3)
    with pytest.raises(ValueError, match="`window` must be 'hann' or 'none'"):
        vx.power_spectrum(sol, window="flat")
    with pytest.raises(ValueError, match="`frequencies` must have shape"):
        vx.power_spectrum(sol, 2.0)
    short = vx.simulate(system, 0.0, 2.5 * float(system.forcing.period), max_events=4, throw=False)
    with pytest.raises(ValueError, match="larger `max_events`"):
        vx.power_spectrum(short)


@pytest.mark.parametrize("kind", ["linear", "previous"])
def test_the_answer_to_a_wave_form_has_its_jumps_through_the_transfer_function(kind):
    phases, values = np.array([0.0, 1.0, 2.5, 4.0]), np.array([1.0, -0.5, 0.3, -0.7])
    frequency, damping, stiffness = 0.9, 0.5, 1.3
    load = vx.Waveform(phases, values[:, None], frequency, kind)
    system = vx.ImpactSystem([1.0], [[damping]], [[stiffness]], load)
    sol = vx.simulate(system, 0.0, 60 * 2 * np.pi / frequency)
    spectrum = vx.power_spectrum(sol, last=1, window="none")
    # Integration by parts: jumps of the values where a wave is constant between knots, of the slopes where it is linear.
    slopes = (np.roll(values, -1) - values) / np.diff(np.append(phases, 2 * np.pi))
    along, order = (values, 1) if kind == "previous" else (slopes, 2)
    h = np.arange(1, spectrum.sizes["frequency"])
    waves = np.exp(-1j * np.outer(h, phases)) @ (along - np.roll(along, 1)) / (2 * np.pi * (1j * h) ** order)
    speeds = frequency * h
    expected = waves / (stiffness - speeds**2 + 1j * damping * speeds)
    np.testing.assert_allclose(spectrum.x[1:, 0], expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(spectrum.v[1:, 0], 1j * speeds * expected, rtol=0, atol=1e-13)
