"""Quantities of the orbits of a branch: against single cycles, and against sweeps of the same machine."""

import numpy as np
import pytest

import vijax as vx

PATH = "forcing.frequency"
NAMES = ["max_position", "min_position", "rms_velocity", "section_position", "impulse", "mean_velocity"]
# Some roundings of a run through one cycle.
ROUNDING = 1e-12
# Of the orbit that a sweep has settled on.
SETTLED = 1e-9
# Samples of a cycle: a maximum between them is flatter than the square of their distance.
SAMPLES, SAMPLED = 20_001, 1e-6


@pytest.fixture(scope="module")
def orbit() -> vx.PeriodicOrbit:
    return vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])


def energy(sol: vx.Solution) -> np.ndarray:
    return np.asarray(sol.v1) ** 2 / 2


@pytest.fixture(scope="module")
def branch(orbit) -> vx.Branch:
    own = {name: name for name in NAMES} | {"energy": energy, "hits": lambda sol: sol.num_events}
    return vx.continuation(orbit, PATH, (0.79, 0.81), progress=False, quantities=own)


@pytest.mark.thorough
def test_columns_are_those_of_single_cycles(branch):
    points = branch.points
    assert points.max_position.dims == ("point", "mass")
    assert points.impulse.dims == ("point", "period", "stop")
    assert "cycle" in points.max_position.attrs["long_name"]
    for k in (0, len(branch) // 2, len(branch) - 1):
        orbit = branch.orbit(k)
        sol, period = orbit.solution(), float(orbit.period)
        times = np.linspace(0, period, SAMPLES)
        x, v = map(np.asarray, sol.evaluate(times))
        at = points.isel(point=k)
        # Both masses turn round at their stops, and on the other side where the samples show it.
        stops = [float(stop.position) for stop in orbit.system.stops]
        np.testing.assert_allclose(at.max_position, stops, rtol=0, atol=ROUNDING)
        below = x.min(axis=0) - at.min_position.values
        assert ((below >= -ROUNDING) & (below <= SAMPLED)).all()
        np.testing.assert_allclose(
            at.rms_velocity, np.sqrt(np.trapezoid(v**2, times, axis=0) / period), rtol=1e-3
        )
        np.testing.assert_allclose(at.section_position[0], orbit.x0, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(at.impulse.sum(), np.nansum(np.abs(orbit.events.impulse)), rtol=ROUNDING)
        np.testing.assert_allclose(at.energy, np.asarray(orbit.v0) ** 2 / 2, rtol=0, atol=ROUNDING)
        assert int(at.hits) == int((orbit.events.kind >= 0).sum())
    np.testing.assert_allclose(points.mean_velocity, 0, atol=ROUNDING)


@pytest.mark.thorough
def test_a_settled_sweep_has_the_quantities_of_its_branch(branch):
    which = np.flatnonzero(branch.points.is_stable.values)[::8]
    values = branch.values[which]
    ds = vx.sweep(
        vx.models.wagg_bishop_a(0.8),
        {PATH: values},
        quantities=NAMES,
        transient=300,
        record=1 + 1,
        progress=False,
    )
    for name in ("max_position", "min_position", "rms_velocity"):
        np.testing.assert_allclose(ds[name], branch.points[name][which], rtol=0, atol=SETTLED)


@pytest.mark.slow
def test_an_orbit_that_begins_at_another_phase_has_the_same_quantities(branch):
    turned = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52], phase=1.0)
    other = vx.continuation(
        turned, PATH, (0.79, 0.81), progress=False, quantities=["max_position", "section_position"]
    )
    for k in (0, len(other) - 1):
        here = int(np.argmin(np.abs(branch.values - other.values[k])))
        assert branch.values[here] == pytest.approx(other.values[k], rel=ROUNDING)
        for name in ("max_position", "section_position"):
            np.testing.assert_allclose(
                other.points[name][k], branch.points[name][here], rtol=0, atol=1e3 * ROUNDING
            )


@pytest.mark.thorough
def test_quantities_that_are_none_are_refused(orbit):
    def follow(quantities):
        vx.continuation(orbit, PATH, (0.79, 0.81), progress=False, quantities=quantities)

    with pytest.raises(ValueError, match=r"`quantities` must be a list of some of .*, but has \"nonsense\""):
        follow(["nonsense"])
    with pytest.raises(ValueError, match="names of its own, but points of a branch have a `residual`"):
        follow({"residual": energy})
    with pytest.raises(ValueError, match="name of a quantity or a function of one cycle"):
        follow({"energy": energy, "mine": "max_position", "other": None})
