"""Ctrl-C raises in every long call; continuations return what they have."""

import signal
import threading
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import xarray as xr
from helpers import slow_except
from test_store import interruptible  # noqa: F401

import vijax as vx
from vijax._branches import branches, continuation
from vijax._branches.codim2_continuation import Curve
from vijax._progress import tqdm
from vijax._sections import classify

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("interruptible")]
AMPLITUDE, FREQUENCY = "forcing.amplitude[0]", "forcing.frequency"
STARTS = np.random.default_rng(0).uniform(-0.4, 0.4, (40, 2))
GRID = {"x0[0]": np.linspace(-0.4, 0.4, 5), "v0[0]": np.linspace(-0.4, 0.4, 5)}
# `BOUNDS` contain a grazing and a period doubling of the branch.
BOUNDS = (0.1, 0.5)


def oscillator() -> vx.ImpactSystem:
    """One mass with a stop, which it hits once in two periods."""
    stop = vx.Stop(0, 1.0, "upper", 0.9)
    return vx.ImpactSystem([1.0], [[0.04]], [[1.0]], vx.Harmonic([0.4], 0.84091), [stop])


@cache
def orbit() -> vx.PeriodicOrbit:
    """Periodic orbit of the oscillator."""
    return vx.periodic_orbit(oscillator(), [0.43252758], [0.148], 2, max_events=32)


@cache
def swept() -> xr.Dataset:
    """Motions of the oscillator at three amplitudes."""
    how = {"x0": [0.43], "v0": [0.15], "transient": 400, "progress": False}
    return vx.sweep(oscillator(), {AMPLITUDE: [0.36, 0.38, 0.4]}, **how)


@cache
def orbits() -> xr.Dataset:
    """Periodic orbits of the sweep."""
    return vx.periodic_orbits(swept(), progress=False)


@cache
def doubling() -> vx.Bifurcation:
    """Period doubling of the branch."""
    branch = vx.continuation(orbit(), AMPLITUDE, BOUNDS, progress=False)
    return next(point for point in branch.bifurcations if point.kind == "pd")


def stop() -> None:
    """Send the signal of Ctrl-C to the main thread, from any thread."""
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def stopping(function: Callable, at: int = 1) -> Callable:
    """Wrap a function so that Ctrl-C comes before its call number `at`."""
    calls = []

    def called(*args, **kwargs):
        calls.append(None)
        if len(calls) == at:
            stop()
        return function(*args, **kwargs)

    return called


LONG = {
    "sweep": lambda: vx.sweep(oscillator(), {AMPLITUDE: np.linspace(0.3, 0.4, 200)}, transient=1000),
    "periodic_orbits": lambda: vx.periodic_orbits(swept()),
    "find_periodic_orbits": lambda: vx.find_periodic_orbits(oscillator(), STARTS, 1),
    "attractors": lambda: vx.attractors(oscillator(), 40),
    "basins": lambda: vx.basins(oscillator(), GRID),
    "follow_attractors": lambda: vx.follow_attractors(oscillator(), AMPLITUDE, [0.36, 0.38], 40),
    "chart": lambda: vx.chart(oscillator(), {AMPLITUDE: [0.3, 0.4], FREQUENCY: [0.8, 0.9]}),
    "lyapunov_exponents": lambda: vx.lyapunov_exponents(oscillator(), num_periods=100_000),
    "continuation": lambda: vx.continuation(orbit(), AMPLITUDE, BOUNDS),
    "branches": lambda: vx.branches(orbits()),
    "bifurcation_curve": lambda: vx.bifurcation_curve(
        doubling(), FREQUENCY, {AMPLITUDE: BOUNDS, FREQUENCY: (0.83, 0.85)}
    ),
}


@pytest.mark.parametrize("name", slow_except(["sweep", "periodic_orbits", "continuation"], LONG))
def test_ctrl_c_is_raised_by_every_long_call(name, monkeypatch):
    for made in (orbit, orbits, doubling):
        made()
    monkeypatch.setattr(tqdm, "update", stopping(tqdm.update))
    with pytest.raises(KeyboardInterrupt, match=r"^Stopped; .*(kept|`result`)"):
        LONG[name]()


def test_ctrl_c_is_raised_while_motions_are_classified(monkeypatch):
    monkeypatch.setattr(classify, "recurrence", stopping(classify.recurrence))
    ds = swept()
    with pytest.raises(
        KeyboardInterrupt, match=r"^Stopped; nothing is kept, and the same call begins anew.$"
    ):
        vx.classify(ds)


def is_part_of(branch: vx.Branch, whole: vx.Branch) -> bool:
    """Test whether the points of a branch are points of another."""
    num_same = np.isclose(branch.values[:, None], whole.values, rtol=1e-12).any(axis=1).sum()
    return bool(1 <= num_same == len(branch) < len(whole))


@pytest.fixture
def stopped_after_rounds(monkeypatch):
    """Send Ctrl-C after some rounds of the scheduler of branches."""

    def after(num_rounds: int) -> None:
        drive, rounds = continuation.drive, stopping(lambda: None, num_rounds)

        def patient(families, tasks, tell):
            return drive(families, tasks, lambda: (rounds(), tell()))

        monkeypatch.setattr(continuation, "drive", patient)

    return after


def test_a_branch_comes_along_as_far_as_it_was_followed(stopped_after_rounds):
    whole = vx.continuation(orbit(), AMPLITUDE, BOUNDS, progress=False)
    stopped_after_rounds(3)
    with pytest.raises(vx.Interrupted, match=r"the `result` of this error") as stopped:
        vx.continuation(orbit(), AMPLITUDE, BOUNDS, progress=False)
    branch = stopped.value.result
    assert branch.ends == ("interrupted", "interrupted")
    assert is_part_of(branch, whole)
    # The partial branch can be continued.
    rest = vx.continuation(branch.orbit(-1), AMPLITUDE, BOUNDS, max_points=3, progress=False)
    assert rest.values.max() > branch.values.max()


def test_of_a_list_of_orbits_a_list_of_branches_comes_along(stopped_after_rounds):
    stopped_after_rounds(4)
    with pytest.raises(vx.Interrupted) as stopped:
        vx.continuation([orbit(), orbit()], AMPLITUDE, BOUNDS, progress=False)
    assert [branch.ends for branch in stopped.value.result] == [("interrupted", "interrupted")] * 2


@pytest.mark.slow
def test_of_all_branches_those_that_were_found_come_along(monkeypatch, stopped_after_rounds):
    monkeypatch.setattr(branches, "switch_branch", stopping(branches.switch_branch))
    with pytest.raises(vx.Interrupted) as stopped:
        vx.branches(orbits(), BOUNDS, progress=False)
    (first,) = stopped.value.result
    assert "interrupted" not in first.ends
    stopped_after_rounds(6)
    with pytest.raises(vx.Interrupted) as stopped:
        vx.branches(orbits(), BOUNDS, progress=False)
    (part,) = stopped.value.result
    assert is_part_of(part, first)


def test_a_curve_comes_along_as_far_as_it_was_followed(monkeypatch):
    point, bounds = doubling(), {AMPLITUDE: BOUNDS, FREQUENCY: (0.83, 0.85)}
    whole = vx.bifurcation_curve(point, FREQUENCY, bounds, progress=False)
    monkeypatch.setattr(Curve, "_at_bound", stopping(Curve._at_bound, 4))
    with pytest.raises(vx.Interrupted) as stopped:
        vx.bifurcation_curve(point, FREQUENCY, bounds, progress=False)
    part = stopped.value.result
    assert part.attrs["ends"] == '["interrupted", "interrupted"]'
    assert 1 < part.sizes["point"] < whole.sizes["point"]
    assert np.isclose(part[FREQUENCY].values[:, None], whole[FREQUENCY].values, rtol=1e-12).any(axis=1).all()


def test_whoever_catches_the_interrupt_catches_this_one():
    with pytest.raises(KeyboardInterrupt):
        raise vx.Interrupted([])
