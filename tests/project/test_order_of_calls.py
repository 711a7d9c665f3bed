"""Every analysis gives the same bits a second time, and after all the others in another order."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.slow

FREQUENCY, POSITION = "forcing.frequency", "stops[0].position"
MACHINE = vx.models.wagg_bishop_a(0.8)
TWO_SIDED = vx.models.two_sided_oscillator(3.0, damping_ratio=0.025)


def numbers_of(ds) -> list[np.ndarray]:
    """All columns of numbers of a dataset."""
    return [np.asarray(column) for column in ds.data_vars.values() if np.asarray(column).dtype.kind in "fiub"]


def trajectory() -> list[np.ndarray]:
    sol = vx.simulate(MACHINE, 0.0, 50.0)
    return [np.asarray(a) for a in (sol.x1, sol.v1, sol.events.t, sol.events.velocity_minus, sol.num_steps)]


def swept() -> list[np.ndarray]:
    return numbers_of(vx.sweep(MACHINE, {FREQUENCY: np.linspace(0.7, 0.9, 5)}, record=3, progress=False))


def found() -> vx.PeriodicOrbit:
    return vx.periodic_orbit(MACHINE, [0.18, 0.09], [0.33, 0.52])


def orbit() -> list[np.ndarray]:
    return [np.asarray(a) for a in (found().x0, found().v0, found().multipliers, found().events.t)]


def branch() -> list[np.ndarray]:
    own = vx.continuation(found(), FREQUENCY, (0.79, 0.81), max_points=8, progress=False)
    return numbers_of(own.points)


def curve() -> list[np.ndarray]:
    system = vx.models.impact_oscillator(1.0649, position=0.2, damping_ratio=0.05, restitution=0.8)
    sol = vx.simulate(system, 0.0, 400 * system.forcing.period)
    own = vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, (1.06, 1.07), progress=False)
    (point,) = (point for point in own.bifurcations if point.kind == "pd")
    bounds = {FREQUENCY: (1.05, 1.08), POSITION: (0.18, 0.22)}
    return [
        np.array([point.value]),
        *numbers_of(vx.bifurcation_curve(point, POSITION, bounds, progress=False)),
    ]


def basins() -> list[np.ndarray]:
    grid = {"x0[0]": np.linspace(-0.9, 0.9, 7), "v0[0]": np.linspace(-2, 2, 5)}
    return numbers_of(vx.basins(TWO_SIDED, grid, progress=False))


ANALYSES = {call.__name__: call for call in (trajectory, swept, orbit, branch, curve, basins)}


def test_no_result_hangs_on_the_calls_before_it():
    first = {name: (call(), call()) for name, call in ANALYSES.items()}
    later = {name: ANALYSES[name]() for name in reversed(ANALYSES)}
    for name, (once, twice) in first.items():
        assert any(a.size for a in once), name
        for a, b, c in zip(once, twice, later[name], strict=True):
            np.testing.assert_array_equal(a, b, err_msg=f"{name}, at once again")
            np.testing.assert_array_equal(a, c, err_msg=f"{name}, after all others")
