"""A finite-element beam against the exact beam."""

import numpy as np
import pytest
from helpers import log_of
from model_roundings import EXACT
from scipy.linalg import eigh

import vijax as vx

# Order of the elements: the error of a frequency falls with the fourth power of their length.
ORDER = 4


@pytest.mark.parametrize("num_elements", [1, 3])
def test_a_cantilever_bends_as_the_beam_does(num_elements):
    length, stiffness, force = 1.3, 2.0, 0.4
    beam = vx.models.cantilever(1.0, num_elements=num_elements, length=length, bending_stiffness=stiffness)
    load = np.zeros(2 * num_elements)
    load[-2] = force
    nodes = length * np.arange(1, num_elements + 1) / num_elements
    shape = np.linalg.solve(np.asarray(beam.stiffness), load)
    exact = force * nodes**2 * (3 * length - nodes) / (6 * stiffness)
    np.testing.assert_allclose(shape[::2], exact, rtol=100 * EXACT)
    np.testing.assert_allclose(
        shape[1::2], force * nodes * (2 * length - nodes) / (2 * stiffness), rtol=100 * EXACT
    )


def test_the_frequencies_of_a_cantilever_tend_to_those_of_the_beam_from_above():
    length, stiffness, mass = 1.3, 2.0, 0.7
    exact = (np.array([1.8751040687119611, 4.694091132974175]) / length) ** 2 * np.sqrt(stiffness / mass)
    errors = []
    for num_elements in (8, 16):
        beam = vx.models.cantilever(
            1.0,
            num_elements=num_elements,
            length=length,
            bending_stiffness=stiffness,
            mass_per_length=mass,
            damping_ratio=0.07,
        )
        back = np.linalg.inv(np.linalg.cholesky(beam.mass))
        squares = np.linalg.eigvalsh(back @ np.asarray(beam.stiffness) @ back.T)
        errors.append(np.sqrt(squares[:2]) / exact - 1)
        ratio = np.asarray(beam.damping)[0, 0] / np.asarray(beam.stiffness)[0, 0] * exact[0] / 2
        assert ratio == pytest.approx(0.07, rel=EXACT)
    assert (errors[1] > 0).all()
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), ORDER, atol=0.1)


@pytest.mark.slow
def test_a_beam_that_loses_nothing_keeps_its_energy_through_impacts():
    beam = vx.models.cantilever(1.0, 0.0, num_elements=2, restitution=1.0, damping_ratio=0.0, position=0.05)
    start = np.array([-0.1, -0.3, -0.3, -0.5])
    sol = vx.simulate(beam, 0.0, 6.0, x0=start)
    assert int((sol.events.kind == vx.IMPACT).sum()) > 5
    mass, stiffness = np.asarray(beam.mass), np.asarray(beam.stiffness)
    at_first = start @ stiffness @ start / 2
    for t in (1.0, 3.0, 6.0):
        x, v = (np.asarray(a) for a in sol.evaluate(t))
        assert (v @ mass @ v + x @ stiffness @ x) / 2 == pytest.approx(at_first, rel=100 * EXACT)
    assert np.asarray(sol.evaluate(np.linspace(0, 6, 500))[0])[:, -2].max() < 0.05 + EXACT


def first_impacts(num_elements: int, position: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and velocities of four impacts of a lossless beam that starts in its first mode with tip speed 1."""
    beam = vx.models.cantilever(
        1.0, 0.0, num_elements=num_elements, position=position, restitution=0.6, damping_ratio=0.0
    )
    mode = eigh(np.asarray(beam.stiffness), np.asarray(beam.mass))[1][:, 0]
    # The log has room for four.
    sol = vx.simulate(beam, 0.0, 1.0, 0 * mode, mode / mode[-2], max_events=4, throw=False)
    events = log_of(sol)
    assert [event.kind for event in events] == ["impact"] * 4
    return np.array([event.t for event in events]), np.array([event.velocity for event in events])


@pytest.mark.slow
def test_a_finer_beam_meets_its_stop_as_the_beam_does_and_its_bounces_keep_their_form():
    """The first impact is that of the exact beam, sin(w t) / w = position, to the fourth order.

    Then the velocity of the tip alone is reversed, and the tip bounces as its element vibrates, in times proportional
    to the square of the element length: a limit in that scale, in which the rest of the beam is at rest to the second
    order.
    """
    position, w, counts = 0.1, 1.8751040687119611**2, np.array([4, 8, 16])
    t, v = (np.array(a) for a in zip(*(first_impacts(int(n), position) for n in counts), strict=True))
    exact = np.arcsin(position * w) / w
    for found, expected in ((t[:, 0], exact), (v[:, 0], np.cos(w * exact))):
        errors = np.abs(found / expected - 1)
        assert errors[0] < 1e-5
        np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), ORDER, atol=0.1)
    # Measured: factors of 3.8 to 5.3 for times, of 4.3 and 6.6 for the velocities of the third and fourth impacts.
    gaps, ratios = np.diff(t, axis=1) * counts[:, None] ** 2, v[:, 2:] / v[:, :1]
    for scaled in (gaps, ratios):
        steps = np.abs(np.diff(scaled, axis=0))
        assert (steps[0] > 3.5 * steps[1]).all()
    # The velocity of the second impact changes no more than this.
    np.testing.assert_allclose(v[1:, 1] / v[1:, 0], v[0, 1] / v[0, 0], rtol=2e-4)
