"""Shocks off an attractor: against long runs of starts beside it, each judged by where it ends."""

import numpy as np
import pytest
import scipy.stats
from coexisting_motions import QUIET, found, section, states

import vijax as vx

# Cycles are polished by a program that takes long to compile.
pytestmark = pytest.mark.thorough
# Relative width of the bracket of a size, which is told.
BRACKET = 1e-5
# The boundary is layered: layers of the other basin before that which is found are thinner than this part of the size.
LAYERS = 1e-3
WHICH = pytest.mark.parametrize("number", [0, 1])


def ends(ds, number: int, dx, dv) -> np.ndarray:
    """True where the motion of each start, a product grid beside an attractor, ends on another after 600 periods."""
    x, v = states(ds)[number]
    values = {"x0[0]": x + np.atleast_1d(dx), "v0[0]": v + np.atleast_1d(dv)}
    run = vx.sweep(QUIET, values, transient=600, record=1, max_impacts=0, progress=False)
    end = np.stack([run.x[..., 0], run.v[..., 0]], axis=-1)
    away = [np.abs(end[..., None, :] - section(ds, k)).max(axis=-1).min(axis=-1) for k in range(2)]
    assert (np.minimum(*away) < 1e-5).all()
    return np.argmin(away, axis=0) != number


@WHICH
def test_the_smallest_shock_of_a_velocity_is_the_first_that_leads_elsewhere(number):
    ds = found(QUIET)
    shock = vx.critical_shock(ds, number, direction="v0[0]", progress=False)
    size, kick = float(shock["size"]), float(shock.kick_v[0])
    assert abs(kick) == pytest.approx(size)
    assert float(shock.size_error) < BRACKET * size
    assert int(shock.goes_to) == 1 - number
    np.testing.assert_allclose(shock.v0 - shock.kick_v, states(ds)[number][1:])
    tried = size * np.linspace(0, 1 - LAYERS, 200)
    assert not ends(ds, number, 0.0, np.concatenate([tried, -tried])).any()
    assert ends(ds, number, 0.0, kick).all()
    back = kick * (1 - float(shock.size_error) / size)
    assert not ends(ds, number, 0.0, back).any()
    along = vx.critical_shock(ds, number, direction=[0.0, kick], progress=False)
    assert float(along["size"]) == pytest.approx(size, rel=LAYERS)


@pytest.mark.slow
@WHICH
def test_no_smaller_shock_of_all_states_leads_elsewhere(number):
    ds = found(QUIET)
    shock = vx.critical_shock(ds, number, progress=False)
    size, w = float(shock["size"]), float(QUIET.forcing.frequency)
    one = vx.critical_shock(ds, number, direction="v0[0]", progress=False)
    assert size <= float(one["size"]) * (1 + LAYERS)
    np.testing.assert_allclose(np.hypot(w * shock.kick_x, shock.kick_v), size)
    assert ends(ds, number, shock.kick_x, shock.kick_v).all()
    side = size * np.linspace(-1.02, 1.02, 80)
    room = 0.5 - abs(states(ds)[number][0])  # there are no states beyond the stops
    dx = side[np.abs(side / w) < room] / w
    is_away = ends(ds, number, dx, side)
    norm = np.hypot(w * dx[:, None], side[None])
    assert is_away.any()
    assert norm[is_away].min() > size * (1 - LAYERS)


@pytest.mark.slow
@WHICH
def test_the_probability_of_tipping_is_that_of_the_quantiles_that_lead_elsewhere(number):
    ds, deviation = found(QUIET), 0.4
    tipping = vx.tipping_probability(ds, [[deviation**2]], number, progress=False)
    quantiles = scipy.stats.norm(0, deviation).ppf((np.arange(1000) + 0.5) / 1000)
    exact = ends(ds, number, 0.0, quantiles).mean()
    assert abs(float(tipping.tipping) - exact) < 3 * float(tipping.tipping_error) + 1e-3
    assert float(tipping.probability[1 - number]) == float(tipping.tipping)
    assert float(tipping.probability.sum()) == pytest.approx(1)
    assert float(tipping.unknown) == 0


def test_no_shock_up_to_a_small_size_leads_elsewhere():
    shock = vx.critical_shock(found(QUIET), 1, largest=0.1, direction="v0[0]", progress=False)
    assert np.isnan(shock["size"])
    assert int(shock.goes_to) == -1


def test_wrong_arguments_are_refused():
    ds = found(QUIET)
    for options, said in (
        ({"attractor": 2}, "less than 2"),
        ({"direction": "v0[1]"}, "one of x0"),
        ({"direction": [0.0, 0.0]}, "not zero"),
        ({"largest": -1.0}, "`largest`"),
    ):
        with pytest.raises(ValueError, match=said):
            vx.critical_shock(ds, **options)
    with pytest.raises(ValueError, match="`found`"):
        vx.critical_shock(ds[["share"]])
    for wrong in ([[-1.0]], [[0.0]], np.ones((3, 3))):
        with pytest.raises(ValueError, match="`covariance`"):
            vx.tipping_probability(ds, wrong)
    with pytest.raises(ValueError, match="smaller `covariance`"):
        vx.tipping_probability(ds, np.diag([1e20, 1.0]))
