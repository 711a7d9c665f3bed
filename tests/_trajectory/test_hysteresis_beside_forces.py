"""Jenkins elements beside a `force` and parametric terms: a spring written as a force is the same machine."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

# Both move by series of a tolerance of 1e-12 or better; sums over 60 units of time.
ROUNDING = 1e-11
LOADS = {"forcing.frequency": [0.7, 0.8, 0.9]}


class Spring(eqx.Module):
    stiffness: jax.Array

    def __call__(self, t, x, v, args):
        return -self.stiffness * x


def machine(share: float, limit: Any = 0.2, time: float = 1.0, **more: Any) -> vx.ImpactSystem:
    """A mass with a joint that slips and a stop; a share of its spring is a force. `time` is the unit of time."""
    own = {} if share == 0 else {"force": Spring(jnp.asarray(share / time**2))}
    return vx.ImpactSystem(
        [1.0],
        [[0.05 / time]],
        [[(1 - share) / time**2]],
        vx.Harmonic([1.0 / time**2], 0.8 / time),
        [vx.Stop(0, 1.2, "upper", 0.7)],
        hysteresis=[vx.Jenkins(0, 0.5 / time**2, limit / time**2)],
        **own,
        **more,
    )


def assert_same_motion(ours: vx.Solution, theirs: vx.Solution, time: float = 1.0) -> None:
    n = int(theirs.num_events)
    assert int(ours.num_events) == n > 10
    np.testing.assert_array_equal(ours.events.kind[:n], theirs.events.kind[:n])
    np.testing.assert_array_equal(ours.events.stop[:n], theirs.events.stop[:n])
    np.testing.assert_allclose(ours.events.t[:n] / time, theirs.events.t[:n] / time, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ours.x1, theirs.x1, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ours.v1 * time, theirs.v1 * time, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(ours.sliders1, theirs.sliders1, rtol=0, atol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("time", [1.0, *(pytest.param(unit, marks=pytest.mark.slow) for unit in (1e5, 1e-5))])
def test_a_spring_by_force_and_by_stiffness_move_alike_whatever_the_unit_of_time(time):
    ours, theirs = (vx.simulate(machine(share, time=time), 0.0, 60.0 * time) for share in (0.6, 0.0))
    assert_same_motion(ours, theirs, time)
    np.testing.assert_allclose(
        ours.hysteresis_force(7.3 * time) * time**2,
        theirs.hysteresis_force(7.3 * time) * time**2,
        atol=ROUNDING,
    )
    # The steps follow the masses, not the stretch, whose unit is another one.
    assert int(ours.num_steps) <= 1.2 * int(vx.simulate(machine(0.6), 0.0, 60.0).num_steps)


@pytest.mark.slow
def test_parametric_terms_of_no_depth_change_nothing():
    terms = vx.Parametric(stiffness=[[[0.0]]])
    ours, theirs = (vx.simulate(machine(0.0, **more), 0.0, 60.0) for more in ({"parametric": terms}, {}))
    assert_same_motion(ours, theirs)


@pytest.mark.slow
def test_derivatives_by_the_limit_agree():
    end = lambda share: lambda limit: vx.simulate(machine(share, limit), 0.0, 20.0).x1[0]  # noqa: E731
    theirs = jax.jacfwd(end(0.0))(0.2)
    np.testing.assert_allclose([jax.jacfwd(end(0.6))(0.2), jax.grad(end(0.6))(0.2)], theirs, rtol=1e-9)


@pytest.mark.slow
def test_sweeps_exponents_and_orbits_agree():
    names = ["hysteresis_energy", "max_position"]
    ours, theirs = (
        vx.sweep(
            machine(share), LOADS, transient=50, record=8, lyapunov=True, quantities=names, progress=False
        )
        for share in (0.6, 0.0)
    )
    for name in ("x", "v", "lyapunov_exponents", *names):
        np.testing.assert_allclose(ours[name], theirs[name], rtol=0, atol=ROUNDING)
    start = theirs.x.values[1], theirs.v.values[1]
    found, same = (vx.periodic_orbit(machine(share), *start) for share in (0.6, 0.0))
    np.testing.assert_allclose(found.v0, same.v0, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found.multipliers, same.multipliers, rtol=0, atol=1e-9)
