"""Machines under turning, shaking, recorded and pulsed loads: against closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq

import vijax as vx

# Roundings of a settled motion, and of a few flights.
SETTLED, ROUNDING = 1e-10, 1e-12


def test_an_unbalanced_rotor_has_the_amplitude_of_its_speed():
    speeds = np.array([0.4, 0.9, 1.8])
    rotor = vx.models.unbalanced_rotor(0.8, clearance=1.0)
    ds = vx.sweep(rotor, {"frequency": speeds}, transient=200, quantities=["max_position"], progress=False)
    size = np.sqrt((1 - speeds**2) ** 2 + (0.1 * speeds) ** 2)
    np.testing.assert_allclose(ds.max_position[:, 0], 0.01 * speeds**2 / size, rtol=SETTLED)
    assert list(rotor.values) == ["frequency", "eccentricity", "clearance", "damping_ratio", "restitution"]
    # The stop is hit from the speed at which this amplitude is the clearance.
    touching = brentq(lambda w: 0.01 * w**2 / np.hypot(1 - w**2, 0.1 * w) - 0.02, 0.5, 0.95)
    for factor, hits in ((1 - 1e-4, False), (1 + 1e-4, True)):
        w = touching * factor
        z = (
            0.01 * w**2 / (1 - w**2 + 0.1j * w)
        )  # from the response itself: from rest the motion hits the stop
        start = {"x0": [z.real], "v0": [-w * z.imag]} if not hits else {}
        near = vx.sweep(rotor.at(clearance=0.02), {"frequency": [w]}, progress=False, **start)
        assert bool(near.num_impacts[0, 0] > 0) == hits


def test_a_shaken_oscillator_moves_in_space_by_the_transmission_of_its_base():
    w = np.array([0.4, 0.9, 1.8])
    shaken = vx.models.shaken_oscillator(0.8, clearance=5.0)
    quantities = ["max_absolute_acceleration", "max_position"]
    ds = vx.sweep(shaken, {"frequency": w}, transient=200, quantities=quantities, progress=False)
    size = np.hypot(1 - w**2, 0.1 * w)
    np.testing.assert_allclose(ds.max_position[:, 0], 0.1 * w**2 / size, rtol=SETTLED)
    in_space = 0.1 * w**2 * np.hypot(1, 0.1 * w) / size
    np.testing.assert_allclose(ds.max_absolute_acceleration[:, 0], in_space, rtol=SETTLED)


@pytest.mark.slow
def test_buildings_on_a_ground_of_constant_acceleration_meet_where_their_gap_is_closed():
    """Undamped, from rest: x_i = -a (1 - cos w_i t) / w_i^2 up to the first blow, which shares momentum."""
    a, gap, masses, r = 2.0, 0.01, np.array([1.0, 3.0]), 0.65
    system = vx.models.pounding_buildings(
        [0.0, 9.0], [a, a], kind="previous", damping_ratio=0.0, gap=gap, masses=masses
    )
    sol = vx.simulate(system, 0.0, 0.25)
    w = 2 * np.pi / np.array([0.6, 1.2])
    x = lambda t: -a / w**2 * (1 - np.cos(w * t))  # noqa: E731
    hit = brentq(lambda t: x(t)[0] - x(t)[1] - gap, 0.1, 0.3, xtol=1e-15)
    v = -a / w * np.sin(w * hit)
    assert float(sol.events.t[0]) == pytest.approx(hit, rel=ROUNDING)
    assert float(sol.events.velocity_minus[0]) == pytest.approx(v[0] - v[1], rel=1e-10)
    reduced = masses.prod() / masses.sum()
    assert float(sol.events.impulse[0]) == pytest.approx((1 + r) * reduced * (v[0] - v[1]), rel=1e-10)
    ds = vx.sweep(
        system,
        {"stops[0].position": [9.0]},
        duration=0.25,
        quantities=["max_absolute_acceleration"],
        progress=False,
    )
    # Without a blow x'' + a = a (1 - cos w t).
    np.testing.assert_allclose(ds.max_absolute_acceleration[0], a * (1 - np.cos(w * 0.25)), rtol=1e-12)


@pytest.mark.slow
def test_a_gear_whose_flanks_stay_in_mesh_is_a_linear_oscillator_under_its_wave():
    """The periodic response to a square wave by its Fourier sum, whose terms fall as h^-3."""
    w, size, mean = 0.37, 0.03, 0.2
    system = vx.models.gear_mesh(w, [0.0, np.pi], [size, -size], kind="previous", mean=mean)
    ds = vx.sweep(system, {"forcing.frequency": [w]}, x0=[1.2], transient=300, record=1, progress=False)
    h = np.arange(1, 200_001, 2)
    response = 4 * size / (np.pi * h) * np.imag(1 / (1 - (h * w) ** 2 + 0.1j * h * w))
    assert float(ds.x[0, 0]) == pytest.approx(1 + mean + response.sum(), abs=1e-12)
    assert int(ds.num_impacts.sum()) == 0
    with pytest.raises(ValueError, match="inertias"):
        vx.models.gear_pair(1.0, 1.0, inertias=[1.0])


@pytest.mark.slow
def test_a_ram_falls_under_its_pulse_and_then_freely():
    force, span, g, r = 30.0, 0.2, 9.81, 0.3
    system = vx.models.drop_hammer(force, span, restitution=r)
    sol = vx.simulate(system, 0.0, 0.4)
    u = (force + g) * span
    v = np.sqrt(u**2 + 2 * g * (1.0 - u * span / 2))
    assert float(sol.events.t[0]) == pytest.approx(span + (v - u) / g, rel=ROUNDING)
    assert float(sol.events.velocity_minus[0]) == pytest.approx(v, rel=ROUNDING)
    # The anvil, at rest, takes the momentum (1 + r) m_0 m_1 / (m_0 + m_1) v.
    gained = (1 + r) * v / 21
    after = np.asarray(sol.evaluate(sol.events.t[0])[1])
    np.testing.assert_allclose(after, [v - 20 * gained, gained], rtol=1e-11)
    ds = vx.sweep(
        system, {"stops[0].restitution": [r]}, duration=0.3, quantities=["max_position"], progress=False
    )
    assert int(ds.num_impacts.sum()) == 1


@pytest.mark.parametrize(
    ("model", "name"),
    [
        (lambda: vx.models.pounding_buildings([0.0, 1.0], [0.0, 1.0], masses=[1.0]), "masses"),
        (lambda: vx.models.pounding_buildings([0.0, 1.0], [0.0, 1.0], periods=[1.0]), "periods"),
        (lambda: vx.models.drop_hammer(masses=[1.0]), "masses"),
    ],
)
def test_wrong_arguments_of_models_are_refused(model, name):
    with pytest.raises(ValueError, match=name):
        model()
