"""The woodpecker toy and its published figures."""

import numpy as np
import pytest

import vijax as vx

_START = [0.0, -0.1034, -0.2788], [-0.3411, 0.0, -7.4583]
_BEAK = 0


def _times(sol: vx.Solution, stop: int, kind: int) -> np.ndarray:
    log = sol.events
    return np.asarray(log.t)[(np.asarray(log.stop) == stop) & (np.asarray(log.kind) == kind)]


@pytest.fixture(scope="module")
def fall() -> vx.Solution:
    return vx.simulate(vx.models.woodpecker(), 0.0, 16.0, *_START, max_events=4096)


def test_its_free_frequency_is_the_published_one():
    toy = vx.models.woodpecker()
    frequencies = np.sqrt(np.linalg.eigvals(np.linalg.solve(toy.mass, toy.stiffness)).real.clip(0))
    np.testing.assert_allclose(frequencies.max() / (2 * np.pi), 72.9085, rtol=1e-6)


@pytest.mark.slow
def test_its_cycle_has_the_published_period_fall_and_swing(fall):
    beats = _times(fall, _BEAK, vx.IMPACT)
    np.testing.assert_allclose(beats[-1] - beats[-2], 0.145976065144, rtol=1e-10)
    (x_before, _), (x_after, _) = fall.evaluate(beats[-2]), fall.evaluate(beats[-1])
    np.testing.assert_allclose(x_before[0] - x_after[0], 0.01944537, rtol=1e-6)
    x, _ = fall.evaluate(np.linspace(beats[-2], beats[-1], 20001))
    np.testing.assert_allclose(np.asarray(x)[:, 2].min(), -0.529471967111, rtol=1e-6)


@pytest.mark.slow
def test_its_cycle_contracts_by_the_known_factor(fall):
    gaps = np.diff(_times(fall, _BEAK, vx.IMPACT)) - 0.145976065144
    # The first cycles are far from the limit, the last are rounding.
    shares = gaps[21:31] / gaps[20:30]
    np.testing.assert_allclose(shares[-1], -0.839156, rtol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("coefficient", "jams"), [(0.2853, True), (0.2850, False)])
def test_it_hangs_on_the_pole_if_friction_is_large_enough(coefficient, jams):
    toy = vx.models.woodpecker(coefficient=coefficient)
    sleeve = -(3.1e-3 - 2.5e-3) / 5.8e-3
    hanging = sleeve - 4.5e-3 * 9.81 * 0.015 / 5.6e-3
    np.testing.assert_allclose(hanging, -0.22169, atol=1e-5)
    sol = vx.simulate(toy, 0.0, 0.05, [0.0, sleeve, hanging], max_events=4096)
    assert bool(sol.sticking1[1]) is jams
    assert (sol.x1[0] > -1e-12) == jams


@pytest.mark.slow
@pytest.mark.parametrize(("restitution", "period"), [(0.3, 0.195519), (0.6, 0.132810)])
def test_other_beaks_have_other_periods(restitution, period):
    toy = vx.models.woodpecker(restitution=restitution)
    sol = vx.simulate(toy, 0.0, 30.0, *_START, max_events=8192)
    beats = _times(sol, _BEAK, vx.IMPACT)
    np.testing.assert_allclose(beats[-1] - beats[-2], period, atol=1e-6)
