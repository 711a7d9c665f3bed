"""A machine with a full mass matrix, a contact between masses and a moving one: orbit, branch, sweep, pictures."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx

PATH, FREQUENCY, RESTITUTION = "forcing.frequency", 1.3, np.array([0.7, 0.8])
MASS = np.array([[1.5, 0.3, 0.1], [0.3, 1.2, 0.2], [0.1, 0.2, 1.0]])
DAMPING = np.array([[0.3, -0.1, 0.0], [-0.1, 0.35, -0.15], [0.0, -0.15, 0.3]])
STIFFNESS = np.array([[2.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 2.2]])
# Error of multipliers between 0.18 and 0.67, whose product agrees with the closed form to 1.3e-13.
ROUNDING = 1e-10


@pytest.fixture(scope="module")
def machine() -> vx.ImpactSystem:
    motion = vx.Harmonic([0.05], FREQUENCY, [0.4])
    contacts = [
        vx.Contact({0: 1.0, 1: -1.0}, 0.15, RESTITUTION[0]),
        vx.Contact({2: 1.0}, 0.25, RESTITUTION[1], motion),
    ]
    load = vx.Harmonic([0.9, 0.0, 0.3], FREQUENCY, [0.0, 0.0, 0.8])
    return vx.ImpactSystem(MASS, DAMPING, STIFFNESS, load, contacts)


@pytest.fixture(scope="module")
def orbit(machine) -> vx.PeriodicOrbit:
    end = vx.simulate(machine, 0.0, 100 * 2 * np.pi / FREQUENCY)
    return vx.periodic_orbit(machine, end.x1, end.v1)


@pytest.fixture(scope="module")
def swept(machine) -> xr.Dataset:
    points = {PATH: np.linspace(1.2, 1.35, 10)}
    return vx.sweep(machine, points, transient=100, record=8, carry="up", progress=False)


def loss_of_volume(period: float, impacts: np.ndarray) -> float:
    """Liouville's formula: flights contract phase-space volumes at the rate tr M^-1 C, an impact by r^2."""
    rate = np.trace(np.linalg.solve(MASS, DAMPING))
    return float(np.exp(-rate * period) * np.prod(RESTITUTION ** (2 * impacts)))


@pytest.mark.slow
def test_its_multipliers_multiply_to_the_loss_of_volume(orbit):
    assert orbit.is_admissible
    assert np.asarray(orbit.num_impacts).min() > 0
    product = np.prod(orbit.multipliers)
    expected = loss_of_volume(float(orbit.period), np.asarray(orbit.num_impacts))
    assert product.real == pytest.approx(expected, rel=ROUNDING)
    assert abs(product.imag) < ROUNDING * expected


@pytest.mark.slow
def test_its_multipliers_are_those_of_the_derivative_of_a_run(orbit):
    matrix = vx.monodromy_matrix(orbit.system, orbit.x0, orbit.v0)
    found = np.sort_complex(np.linalg.eigvals(matrix))
    np.testing.assert_allclose(found, np.sort_complex(np.asarray(orbit.multipliers)), rtol=0, atol=ROUNDING)


@pytest.mark.slow
def test_each_orbit_of_its_branch_is_what_a_run_shows_and_loses_volume_as_it_should(orbit):
    branch = vx.continuation(orbit, PATH, (1.15, 1.4), max_points=14, progress=False)
    assert len(branch) >= 20
    assert np.ptp(branch.values) > 0.05
    for k in range(len(branch)):
        found = branch.orbit(k)
        again = vx.periodic_orbit(found.system, found.x0, found.v0)
        assert again.is_admissible
        np.testing.assert_allclose(again.x0, found.x0, rtol=0, atol=ROUNDING)
        np.testing.assert_array_equal(again.num_impacts, found.num_impacts)
        expected = loss_of_volume(float(found.period), np.asarray(found.num_impacts))
        assert np.prod(found.multipliers).real == pytest.approx(expected, rel=ROUNDING)
        assert float(found.system.forcing.frequency) == pytest.approx(branch.values[k], rel=1e-15)


@pytest.mark.slow
def test_its_sweep_is_kept_in_a_file_with_the_machine_bit_for_bit(swept, tmp_path):
    assert (swept.result == 0).all()
    swept.to_netcdf(tmp_path / "sweep.nc")
    with xr.open_dataset(tmp_path / "sweep.nc") as again:
        xr.testing.assert_identical(again.load(), swept)
        read = again.isel({PATH: 4})
    one = vx.system_of(read)
    assert float(one.forcing.frequency) == float(swept[PATH][4])
    for name, matrix in (("mass", MASS), ("damping", DAMPING), ("stiffness", STIFFNESS)):
        np.testing.assert_array_equal(getattr(one, name), matrix)
    np.testing.assert_array_equal([stop.restitution for stop in one.stops], RESTITUTION)
    # The same motion, bit for bit.
    states = [vx.simulate(vx.system_of(ds.isel({PATH: 4})), 0.0, 20.0).x1 for ds in (swept, again)]
    np.testing.assert_array_equal(*states)


@pytest.mark.slow
def test_its_sweep_ends_on_its_orbit(swept, orbit):
    near = swept.isel({PATH: 4})
    found = vx.periodic_orbit(vx.system_of(near), near.x.values, near.v.values)
    np.testing.assert_allclose(found.x0, near.x, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(found.num_impacts, orbit.num_impacts)


@pytest.mark.slow
def test_its_pictures_show_every_contact(machine, swept, orbit, tmp_path):
    sol = orbit.solution()
    rows = vx.plot.bifurcation(swept, None)
    assert len(rows) == machine.num_stops
    drawn = {
        "bifurcation": rows[0],
        "relative_bifurcation": vx.plot.bifurcation(swept, 1),
        "machine": vx.plot.machine(machine, orbit.x0),
        "relative_motion": vx.plot.relative_motion(sol, 0),
        "moving": vx.plot.relative_motion(orbit, 1),
        "time_series": vx.plot.time_series(sol),
        "phase_portrait": vx.plot.phase_portrait(sol),
    }
    for name, ax in drawn.items():
        assert ax.has_data(), name
        ax.figure.savefig(tmp_path / f"{name}.png")
    # One disc for each impact.
    for contact, name in ((0, "relative_motion"), (1, "moving")):
        discs = [line for line in drawn[name].lines if line.get_marker() == "o"]
        assert sum(len(line.get_xdata()) for line in discs) == int(orbit.num_impacts[contact])
