"""A chart has the boundary of one-impact motions in closed form.

x'' + x = cos(W t), x <= 0: the impact oscillator of S. W. Shaw & P. J. Holmes, J. Sound and Vibration 90 (1983)
129-155, without damping, with its stop at the rest position of the spring. Let an orbit hit the stop at speed v once
in n periods, t = 2 pi n / W. Between impacts x = B cos s + D sin s + p(s), p the response to the load, with
x(0) = x(t) = 0 and x' = -r v, v at the ends. So D = B tan(t/2), p(0) = -B, (1 + r) v = -2 B tan(t/2). The
acceleration at the impact is a = (1 - W^2) p(0), and the monodromy matrix of the flight and the impact,

    [[cos t, sin t], [-sin t, cos t]] [[-r, 0], [(1 + r) a / v, -r]],

has the determinant r^2 and the trace -2 r cos t - (1 + r)^2 (W^2 - 1) (1 + cos t) / 2, for any amplitude. The period
doubles where the trace is -(1 + r^2).
"""

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq

import vijax as vx

FREQUENCY, RESTITUTION = "forcing.frequency", "stops[0].restitution"
# For each n, frequencies between which the period doubles, at all restitutions of the chart.
WINDOWS = {1: (2.60, 2.72), 2: (4.60, 4.70)}
RESTITUTIONS = np.linspace(0.05, 0.65, 17)
CELL = 0.00125
# Motions settle this slowly one cell from the doubling, where the multiplier is near -1.
TRANSIENT = 20_000
# Error of multipliers, some hundred roundings.
ROUNDING = 1e-12


def trace(frequency, restitution, n: int):
    c = np.cos(2 * np.pi * n / frequency)
    return -2 * restitution * c - (1 + restitution) ** 2 * (frequency**2 - 1) * (1 + c) / 2


def doubling(restitution: float, n: int) -> float:
    """Frequency at which the period doubles."""
    return brentq(lambda w: trace(w, restitution, n) + 1 + restitution**2, *WINDOWS[n], xtol=1e-12)


def chart_of(n: int, **options) -> xr.Dataset:
    low, high = WINDOWS[n]
    values = {FREQUENCY: np.linspace(low, high, round((high - low) / CELL) + 1), RESTITUTION: RESTITUTIONS}
    system = vx.models.impact_oscillator(1.0)
    return vx.chart(system, values, transient=TRANSIENT, x0=[-0.5], progress=False, **options)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2])
def test_the_period_doubles_along_the_exact_curve_to_a_cell(n):
    chart = chart_of(n)
    assert chart.is_computed.mean() < 0.2
    is_simple, is_double = (
        (chart.num_periods == k * n).values & (chart.num_impacts[..., 0] == k).values for k in (1, 2)
    )
    for j, restitution in enumerate(RESTITUTIONS):
        beyond = chart[FREQUENCY].values - doubling(float(restitution), n)
        assert is_simple[beyond < -CELL, j].all()
        assert is_double[beyond > CELL, j].all()
        assert not is_simple[beyond > 0, j].any()
        assert not is_double[beyond < 0, j].any()


@pytest.mark.slow
@pytest.mark.parametrize("n", WINDOWS)
def test_the_multipliers_over_the_region_have_the_exact_trace_and_product(n):
    chart = chart_of(n, multipliers=True)
    simple = (chart.num_periods == n) & (chart.num_impacts[..., 0] == 1) & chart.is_computed
    w, r = xr.broadcast(chart[FREQUENCY], chart[RESTITUTION])
    multipliers = chart.multipliers.transpose(*w.dims, "multiplier").values[simple.values]
    assert len(multipliers) > 30
    exact = trace(w.values, r.values, n)[simple.values]
    np.testing.assert_allclose(multipliers.sum(axis=1), exact, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(multipliers.prod(axis=1), r.values[simple.values] ** 2, rtol=0, atol=ROUNDING)
