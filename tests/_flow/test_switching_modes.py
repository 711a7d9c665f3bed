"""Motion mode by mode of machines whose forces switch, in sweeps."""

import numpy as np
import pytest

import vijax as vx

# Roundings of some thirty events, by another motion.
_ROUNDING = 1e-12

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("stops", "static"),
    [((), 1.0), ((), 1.2), ((vx.CompliantStop(0, 0.8, "upper", 20.0, 2.0, 0.3),), None)],
    ids=["friction", "static friction", "a damped stop with preload"],
)
def test_a_sweep_by_modes_ends_where_taylor_series_do(stops, static):
    friction = [] if static is None else [vx.Friction(0, 1.0, static=static)]
    load = vx.Harmonic(amplitude=[1.5], frequency=0.8)
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, list(stops), friction=friction)
    values = {"forcing.frequency": np.linspace(0.4, 1.6, 40)}
    own, others = (
        vx.sweep(system, values, transient=0, record=6, flow=flow, progress=False)
        for flow in (None, vx.TaylorFlow())
    )
    assert (own.attrs["flow"], others.attrs["flow"]) == ("ModalFlow", "TaylorFlow()")
    np.testing.assert_allclose(own.x, others.x, rtol=0, atol=_ROUNDING)
    np.testing.assert_allclose(own.v, others.v, rtol=0, atol=_ROUNDING)
    np.testing.assert_array_equal(own.num_sticks, others.num_sticks)
