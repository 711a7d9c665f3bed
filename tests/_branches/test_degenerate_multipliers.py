"""Degenerate period doublings and Neimark-Sacker points: where the orbits that branch off turn from stable to unstable."""

import json

import numpy as np
import pytest

import vijax as vx

AMPLITUDE, FREQUENCY = "forcing.amplitude[0]", "forcing.frequency"
BOUNDS = {FREQUENCY: (0.9, 1.0), AMPLITUDE: (0.36, 0.4)}


def machine(frequency: float, amplitude: float) -> vx.ImpactSystem:
    load = vx.Harmonic([amplitude], frequency)
    return vx.ImpactSystem([1.07], [[0.074]], [[1.07]], load, [vx.Stop(0, 0.58, "upper", 0.87)])


def branch_at(frequency: float, amplitude: float, x0, v0, low: float, high: float) -> vx.Branch:
    orbit = vx.periodic_orbit(machine(frequency, amplitude), x0, v0)
    return vx.continuation(orbit, FREQUENCY, (low, high), progress=False)


def special(curve) -> list[tuple[str, float, float]]:
    rows = curve.isel(point=curve.special.values != "")
    return list(zip(rows.special.values, rows[FREQUENCY].values, rows[AMPLITUDE].values, strict=True))


def chain(frequency: float, position: float) -> vx.ImpactSystem:
    load, stop = vx.Harmonic([1.0, 0.0], frequency), vx.Stop(0, position, "upper", 0.8)
    return vx.chain([1.0, 1.29], [0.02, 0.02], [1.0, 1.1], load, [stop])


@pytest.mark.slow
def test_a_curve_of_folds_ends_where_the_doubling_is_degenerate():
    system = machine(0.99, 0.38)
    end = vx.simulate(system, 0.0, 300 * float(system.forcing.period), max_events=4096)
    branch = branch_at(0.99, 0.38, end.x1, end.v1, *BOUNDS[FREQUENCY])
    doubling = max((p for p in branch.bifurcations if p.kind == "pd"), key=lambda p: p.value)
    curve = vx.bifurcation_curve(doubling, AMPLITUDE, BOUNDS, progress=False)
    ((name, frequency, amplitude),) = special(curve)
    assert name == "degenerate_pd"

    # The doubled orbits are stable on one side, and unstable on the other.
    k = int(np.flatnonzero(curve.special.values != "")[0])
    found = set()
    for j in (k - 4, k + 4):
        at, load = (float(curve[path].values[j]) for path in (FREQUENCY, AMPLITUDE))
        beside = branch_at(at * 1.001, load, curve.x0.values[j], curve.v0.values[j], at * 0.999, at * 1.002)
        (again,) = [p for p in beside.bifurcations if p.kind == "pd"]
        assert again.value == pytest.approx(at, rel=1e-11)
        found.add(again.normal_form.criticality)
    assert found == {"supercritical", "subcritical"}

    # Where they are unstable they turn in a fold, whose curve ends at that point.
    doubled = vx.continuation(vx.switch_branch(doubling)[0], FREQUENCY, BOUNDS[FREQUENCY], progress=False)
    fold = max((p for p in doubled.bifurcations if p.kind == "fold"), key=lambda p: p.value)
    folds = vx.bifurcation_curve(fold, AMPLITUDE, BOUNDS, progress=False)
    assert "degenerate_pd" in json.loads(folds.attrs["ends"])
    ((name, *place),) = special(folds)
    assert name == "degenerate_pd"
    np.testing.assert_allclose(place, (frequency, amplitude), rtol=1e-11)
    last = folds.isel(point=folds.special.values != "")
    assert float(last.impact_speed[0, 0]) == pytest.approx(float(last.impact_speed[0, 1]), rel=1e-12)


@pytest.mark.slow
def test_tori_turn_from_stable_to_unstable_where_the_neimark_sacker_point_is_degenerate():
    """Normal forms on branches across the curve; at the resonance 1:3 the cubic changes its sign at infinity, which is no such point."""
    path, system = "stops[0].position", chain(1.6, 0.11)
    run = vx.simulate(system, 0.0, 500 * system.forcing.period)
    branch = vx.continuation(vx.periodic_orbit(system, run.x1, run.v1), FREQUENCY, (1.5, 1.7), progress=False)
    (point,) = (p for p in branch.bifurcations if p.kind == "ns")
    curve = vx.bifurcation_curve(point, path, {FREQUENCY: (1.37, 1.8), path: (0.0, 0.4)}, progress=False)
    names = curve.special.values
    assert sorted(str(name) for name in names if name) == ["1:3", "degenerate_ns"]
    k = int(np.flatnonzero(names == "degenerate_ns")[0])
    found = set()
    for j in (k - 2, k + 2):
        at, position = float(curve[FREQUENCY][j]), float(curve[path][j])
        orbit = vx.periodic_orbit(chain(at * 1.0005, position), curve.x0.values[j], curve.v0.values[j])
        beside = vx.continuation(orbit, FREQUENCY, (at * 0.999, at * 1.001), progress=False)
        (again,) = (p for p in beside.bifurcations if p.kind == "ns")
        assert again.value == pytest.approx(at, rel=1e-11)
        found.add(again.normal_form.criticality)
    assert found == {"supercritical", "subcritical"}
