"""Branches of machines with a user-defined force, whose cycles are followed by a solver of diffrax."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import xarray as xr

import vijax as vx
from vijax._system.parameters import get_parameter

# These programs are compiled for this file alone, in a minute: one test stands for all before a change goes in.
AMPLITUDE, FREQUENCY, DAMPING, RESTITUTION = "forcing.amplitude[0]", 0.84091, 0.04, 0.9
# The solver's tolerance.
SOLVED = 1e-10


class Spring(eqx.Module):
    linear: jax.Array
    cubic: jax.Array

    def __call__(self, t, x, v, args):
        return -self.linear * x - self.cubic * x**3


def oscillator(amplitude, cubic, position=1.0):
    load, stop = vx.Harmonic([amplitude], frequency=FREQUENCY), vx.Stop(0, position, restitution=RESTITUTION)
    spring = Spring(jnp.array([1.0]), jnp.array([cubic]))
    return vx.ImpactSystem([1.0], [[DAMPING]], [[0.0]], load, [stop], force=spring)


def branch_of(cubic, start, num_periods, bounds):
    system = oscillator(start, cubic)
    sol = vx.simulate(system, 0.0, 400 * system.forcing.period, max_events=4000)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1, num_periods)
    return vx.continuation(orbit, AMPLITUDE, bounds, progress=False)


@pytest.mark.slow
def test_a_linear_spring_written_as_a_force_has_the_published_doubling():
    # M. Ghosh & B. Simpson, arXiv 2510.16218: their points with more digits.
    branch = branch_of(0.0, 0.34, 2, (0.28, 0.36))
    (doubling,) = [point for point in branch.bifurcations if point.kind == "pd"]
    assert doubling.value == pytest.approx(0.32561956758361, abs=SOLVED)
    assert float(doubling.orbit.events.velocity_minus[0]) == pytest.approx(0.27433182278456, abs=SOLVED)
    # The branch begins where the oscillation without impacts touches the stop.
    grazing = next(point.value for point in branch.bifurcations if point.kind == "gr")
    exact = np.sqrt((1 - FREQUENCY**2) ** 2 + (DAMPING * FREQUENCY) ** 2)
    assert grazing == pytest.approx(exact, abs=SOLVED)


@pytest.mark.slow
def test_bifurcations_of_a_linear_spring_written_as_a_force_move_with_the_stop():
    # All lengths of a linear machine scale with the load.
    branch = branch_of(0.0, 0.34, 2, (0.3, 0.36))
    (doubling,) = [point for point in branch.bifurcations if point.kind == "pd"]
    amplitude = lambda position: vx.bifurcation_value(doubling, oscillator(0.34, 0.0, position))  # noqa: E731
    value, slope = jax.value_and_grad(amplitude)(1.01)
    assert value == pytest.approx(1.01 * doubling.value, abs=SOLVED)
    assert slope == pytest.approx(doubling.value, abs=1e3 * SOLVED)
    with pytest.raises(ValueError, match="with 1 masses, a `force`"):
        vx.bifurcation_value(doubling, vx.models.wagg_bishop_a(0.8))


@pytest.mark.slow
def test_orbits_of_a_duffing_oscillator_are_those_that_scipy_follows():
    branch = branch_of(0.2, 0.4, 1, (0.1, 0.6))
    assert [point.kind for point in branch.bifurcations] == ["gr", "pd"]
    # The multiplier is as exact as the solver times its rate along the branch; the parameter is as exact as the solver.
    k = branch.bifurcations[1].index
    (before, at, after) = branch.points.multipliers.values[k - 1 : k + 2, 0].real
    rate = (after - before) / (branch.values[k + 1] - branch.values[k - 1])
    assert abs(at + 1) < SOLVED * abs(rate)
    for k in [0, len(branch) // 2, -1, *(point.index for point in branch.bifurcations)]:
        orbit = branch.orbit(k)
        start = np.concatenate([orbit.x0, orbit.v0])
        np.testing.assert_allclose(by_scipy(orbit, 0.2), start, rtol=0, atol=SOLVED)


def by_scipy(orbit, cubic):
    """State after one cycle."""
    amplitude = float(orbit.system.forcing.amplitude[0])

    def field(t, y):
        x, v = y
        return [v, amplitude * np.cos(FREQUENCY * t) - DAMPING * v - x - cubic * x**3]

    def touch(t, y):
        return 1.0 - y[0]

    touch.terminal, touch.direction = True, -1
    t, end, y = 0.0, float(orbit.period), np.array([orbit.x0[0], orbit.v0[0]], float)
    while t < end:
        sol = scipy.integrate.solve_ivp(field, (t, end), y, "DOP853", events=touch, rtol=1e-12, atol=1e-13)
        t, y = sol.t[-1], sol.y[:, -1]
        if sol.status == 1:
            y = np.array([1.0, -RESTITUTION * y[1]])
    return y


@pytest.mark.slow
def test_a_branch_in_a_file_tells_a_force_that_can_be_imported(tmp_path):
    system = vx.models.duffing_oscillator(0.84091, 0.2, position=1.0, damping=0.04, cubic_stiffness=0.2)
    sol = vx.simulate(system, 0.0, 400 * system.forcing.period)
    branch = vx.continuation(
        vx.periodic_orbit(system, sol.x1, sol.v1), "force.stiffness", (0.1, 0.3), progress=False
    )
    assert branch.values.min() == pytest.approx(0.1, rel=1e-15)
    assert branch.values.max() == pytest.approx(0.3, rel=1e-15)
    branch.points.to_netcdf(tmp_path / "branch.nc", engine="h5netcdf")
    again = vx.Branch(xr.open_dataset(tmp_path / "branch.nc")).orbit(0)
    np.testing.assert_array_equal(again.x0, branch.orbit(0).x0)
    assert get_parameter(again.system, "force.stiffness") == pytest.approx(branch.values[0])

    # As if text could not hold the force.
    told = json.loads(branch.points.attrs["system"]) | {"force": {"name": "<lambda>"}}
    kept = branch.points.assign_attrs(system=json.dumps(told))
    with pytest.raises(ValueError, match="which no text can hold"):
        vx.Branch(kept).orbit(0)
    for again in (vx.Branch(kept, force=system.force), vx.Branch(kept, system)):
        np.testing.assert_array_equal(again.orbit(0).x0, branch.orbit(0).x0)
        assert get_parameter(again.orbit(0).system, "force.stiffness") == pytest.approx(branch.values[0])
    with pytest.raises(ValueError, match=r"Give `vx\.Branch` the machine, or its force, not both"):
        vx.Branch(kept, system, force=system.force)
