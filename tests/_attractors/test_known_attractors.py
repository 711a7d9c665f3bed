"""Attractors of one mass with one stop arise, double and end at published values; long periods are not called chaos."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

AMPLITUDE, POSITION = "forcing.amplitude[0]", "stops[0].position"
# R. Ghosh & D. J. W. Simpson, arXiv 2510.16218, c = 0.04, r = 0.9, one impact in two periods, at W: folds and a
# doubling, by the amplitude.
FOLDS = {0.79: 0.35564119904136, 0.7995: 0.36218601300675}
DOUBLING = 0.90, 0.35421999760770
# The fold is bracketed to five digits: nearer, motions settle too slowly. At a doubling the multiplier is -1 too.
NEAR_FOLD, NEAR_DOUBLING = 1e-5, 1e-3
STARTS = np.random.default_rng(0).uniform([-1.5, -1.5], [1.0, 1.5], (48, 2))


def machine(frequency: float, amplitude: float = 0.36, phase: float = 0.0) -> vx.ImpactSystem:
    return vx.models.impact_oscillator(
        frequency, amplitude, phase=phase, position=1.0, restitution=0.9, damping_ratio=0.02
    )


def around(value: float, by: float) -> list[float]:
    return [value * (1 - by), value * (1 + by)]


@pytest.mark.slow
def test_an_orbit_begins_at_the_published_fold():
    values = np.array(around(FOLDS[0.79], NEAR_FOLD))
    ds = vx.follow_attractors(
        machine(0.79), AMPLITUDE, values, STARTS, transient=400, threshold=1.0, progress=False
    )
    one = (ds.num_impacts[..., 0] == 1) & (ds.num_periods == 2)
    assert one.sum("attractor").values.tolist() == [0, 1]
    born = int(one.values[1].argmax())
    assert float(ds.birth[born]) == values[1]
    # The multiplier at a fold is 1, and its distance from 1 goes as the square root of the distance from the fold.
    assert 0.99 < float(ds.multipliers[1, born].real.max()) < 1


@pytest.mark.slow
def test_a_motion_doubles_at_the_published_value_and_goes_on_as_one_attractor():
    frequency, doubling = DOUBLING
    values = around(doubling, NEAR_DOUBLING)
    ds = vx.follow_attractors(
        machine(frequency), AMPLITUDE, values, STARTS, transient=400, threshold=1.0, progress=False
    )
    assert ds.num_periods.values.tolist() == [[4], [2]]
    assert ds.num_impacts.values.ravel().tolist() == [2, 1]
    assert np.isnan(ds.birth).all()
    assert np.isnan(ds.death).all()
    assert -1 < float(ds.multipliers[1, 0, 0].real) < -0.99


@pytest.mark.slow
def test_a_chart_counts_one_attractor_more_beyond_the_published_fold():
    plane = {
        "forcing.frequency": [*FOLDS],
        AMPLITUDE: np.array([a for fold in FOLDS.values() for a in around(fold, NEAR_FOLD)]),
    }
    chart = vx.chart(
        machine(1.0), plane, stride=1, transient=400, starts=STARTS, multipliers=True, progress=False
    )
    # At the other frequency a grazing follows the fold immediately.
    before, after = chart.num_attractors.values[0, :2]
    assert after == before + 1
    assert chart.num_not_settled.values[0, :2].tolist() == chart.num_failed.values[0, :2].tolist() == [0, 0]
    # Loss of volume in n periods and m impacts.
    n, m = chart.num_periods, chart.num_impacts[..., 0]
    exact = 0.9 ** (2 * m) * np.exp(-0.04 * n * 2 * np.pi / chart["forcing.frequency"])
    is_cycle = chart.num_periods.values > 0
    product = chart.multipliers.values.prod(axis=-1).real
    np.testing.assert_allclose(product[is_cycle], exact.values[is_cycle], rtol=1e-9)


# Periods 2^k succeed each other up to -0.02519, where chaos begins: r = 0.8, W = 2.8, c = 0.
CASCADE = {-0.0262: 8, -0.0258: 8, -0.02534: 16, -0.02522: 32, -0.025193: 64, -0.02508: 0}


@pytest.fixture(scope="module")
def cascade():
    return vx.sweep(
        vx.models.impact_oscillator(2.8),
        {POSITION: [*CASCADE]},
        transient=3000,
        record=1280,  # errors of exponents are from 20 blocks, of whole cycles each
        max_impacts=0,
        x0=[-0.5],
        carry="up",
        lyapunov=True,
        progress=False,
    )


@pytest.mark.slow
def test_a_cascade_of_doublings_is_told_from_the_chaos_behind_it(cascade):
    short, long = vx.classify(cascade, last=15), vx.classify(cascade, last=256)
    names = short.motion.flag_meanings.split()
    assert long.num_periods.values.tolist() == [*CASCADE.values()]
    assert short.num_periods.values.tolist() == [0] * 6
    assert [names[k] for k in short.motion.values] == ["not_settled"] * 5 + ["non_periodic"]
    assert names[int(long.motion[-1])] == "non_periodic"


@pytest.mark.slow
def test_attractors_of_up_to_64_periods_are_polished_cycles(cascade):
    for position, num_periods in [*CASCADE.items()][2:5]:
        end = cascade.sel({POSITION: position})
        system = vx.models.impact_oscillator(2.8, position=position)
        ds = vx.attractors(system, (end.x.values[None], end.v.values[None]), progress=False)
        assert ds.num_periods.values.tolist() == [num_periods]
        assert ds.num_impacts.values.tolist() == [[num_periods]]
        assert ds.is_stable.all()
        assert float(ds.residual[0]) < 1e-12
        assert float(ds.exponents[0, 0]) == pytest.approx(float(end.lyapunov_exponents[0]), abs=1e-3)


@pytest.mark.slow
def test_an_impact_at_the_section_itself_splits_no_attractor():
    """The phase of the load is shifted until the one orbit hits the stop at phase 0, up to a few roundings."""
    frequency = 0.79
    begin = vx.attractors(machine(frequency), STARTS, transient=400, progress=False)
    assert begin.num_impacts.values.tolist() == [[2]]
    end = 2 * float(machine(frequency).forcing.period)
    sol = vx.simulate(machine(frequency), 0.0, end, begin.x0.values[0], begin.v0.values[0], max_events=8)
    phase = frequency * float(sol.events.t[0])
    for by in (0.0, -8e-15, 8e-15, 1e-10):
        turned = machine(frequency, phase=phase + by)
        ds = vx.attractors(turned, STARTS, transient=400, progress=False)
        is_ours = ds.num_impacts.values[:, 0] == 2
        assert is_ours.sum() == 1
        assert (ds.num_impacts.values[~is_ours] == 0).all()
        section = np.stack([ds.section_x[is_ours.argmax(), :2, 0], ds.section_v[is_ours.argmax(), :2, 0]])
        at_stop = section[0].argmax()
        # The section is after the impact at each of these phases.
        speed = float(sol.events.velocity_minus[0])
        np.testing.assert_allclose(section[:, at_stop], [1.0, -0.9 * speed], atol=1e-8)
