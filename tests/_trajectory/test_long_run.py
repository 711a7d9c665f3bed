"""Ten thousand forcing periods: no drift, no memory growth, and constant work per period."""

import numpy as np
import pytest

import vijax as vx
from vijax._trajectory import chunked

FREQUENCY = 0.2
PERIOD = 2 * np.pi / FREQUENCY
# Error of a periodic motion: the roundings of one period.
REPEATS = 1e-12
# Save times are rounded, to half a spacing each; velocities and accelerations stay below 2.
RATE = 2.0


def run(periods: int, saved: int) -> vx.Solution:
    """Case (b) from rest, saved at the starts of the last periods."""
    ts = PERIOD * np.arange(periods - saved, periods + 1)
    system = vx.models.wagg_bishop_b(FREQUENCY)
    return vx.simulate(system, 0.0, ts[-1], ts=ts, max_events=0, throw=False)


@pytest.mark.parametrize("periods", [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_the_stroboscopic_state_repeats_after_many_periods(periods):
    sol = run(periods, 50)
    # A log of length zero overflows immediately, which does not stop the motion.
    assert sol.result == vx.RESULTS.max_events_reached
    tolerance = REPEATS + RATE * np.spacing(periods * PERIOD)
    for states in (np.asarray(sol.xs), np.asarray(sol.vs)):
        assert np.abs(states).max() > 1e-2
        assert np.abs(states - states[:1]).max() <= tolerance
    # The same orbit as after a transient of a hundred periods.
    early = run(100, 50)
    np.testing.assert_allclose(sol.xs[-1], early.xs[-1], rtol=0, atol=tolerance)
    np.testing.assert_allclose(sol.vs[-1], early.vs[-1], rtol=0, atol=tolerance)


@pytest.mark.parametrize("periods", [100, pytest.param(5_000, marks=pytest.mark.slow)])
def test_the_number_of_steps_grows_in_proportion(periods):
    steps = [int(run(k * periods, 50).num_steps) for k in (1, 2, 3)]
    assert steps[2] - steps[1] == pytest.approx(steps[1] - steps[0], rel=0.01)


def test_calls_that_find_nothing_take_no_memory(monkeypatch):
    """Ten million periods took 500 MB, as every one of thousands of calls kept its empty arrays with their padding."""
    kept, original = [], chunked._joined
    monkeypatch.setattr(chunked, "_joined", lambda *given: kept.append(given[2]) or original(*given))
    calls, one = [], chunked.KnownMachine.follow
    monkeypatch.setattr(chunked.KnownMachine, "follow", lambda *given: calls.append(1) or one(*given))
    run(10_000, 4)
    assert len(calls) > 4
    assert len(kept[0]) == 2  # the first, and that with the saved states
    assert all(a.base is None for taken in kept[0] for a in (taken.xs, taken.vs, taken.restarts.t))
