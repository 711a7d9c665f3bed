"""Attractors of one mass with one stop begin, double and end where others found it, and long periods are no chaos."""

import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

AMPLITUDE, POSITION = "forcing.amplitude[0]", "stops[0].position"
# R. Ghosh & D. J. W. Simpson, arXiv 2510.16218, c = 0.04, r = 0.9, one impact in two periods, at W: folds and a
# doubling, by the amplitude.
FOLDS = {0.79: 0.35564119904136, 0.7995: 0.36218601300675}
DOUBLING = 0.90, 0.35421999760770
# The fold is met to five digits: nearer to it motions settle too slowly. At a doubling the multiplier is -1 as well.
NEAR_FOLD, NEAR_DOUBLING = 1e-5, 1e-3
STARTS = np.random.default_rng(0).uniform([-1.5, -1.5], [1.0, 1.5], (48, 2))


def machine(frequency: float, amplitude: float = 0.36, phase: float = 0.0) -> vx.ImpactSystem:
    return vx.models.impact_oscillator(
        frequency, amplitude, phase=phase, position=1.0, restitution=0.9, damping_ratio=0.02
    )


def around(value: float, by: float) -> list[float]:
    return [value * (1 - by), value * (1 + by)]


def test_an_orbit_begins_at_the_published_fold_and_the_quiet_motion_ends_where_it_grazes():
    frequency, fold = 0.79, FOLDS[0.79]
    grazing = abs(1 - frequency**2 + 0.04j * frequency)
    values = np.array([*around(fold, NEAR_FOLD), *around(grazing, NEAR_FOLD)])
    ds = vx.follow_attractors(
        machine(frequency), AMPLITUDE, values, STARTS, transient=400, threshold=1.0, progress=False
    )
    one = (ds.num_impacts[..., 0] == 1) & (ds.num_periods == 2)
    quiet = (ds.num_impacts[..., 0] == 0) & (ds.num_periods == 1)
    assert one.sum("attractor").values.tolist() == [0, 1, 0, 0]
    assert quiet.sum("attractor").values.tolist() == [1, 1, 1, 0]
    # On its way from the fold the orbit doubles: it ends as another.
    born, dying = int(one[1].argmax()), int(quiet[0].argmax())
    assert float(ds.birth[born]) == values[1]
    assert float(ds.death[dying]) == values[3]
    # A fold's multiplier is 1, and the distance from 1 goes as the root of that from the fold.
    assert 0.99 < float(ds.multipliers[1, born].real.max()) < 1
    assert ds.is_found[3, int(ds.successor[dying])]


def test_a_motion_doubles_at_the_published_value_and_goes_on_as_one_attractor():
    frequency, doubling = DOUBLING
    values = around(doubling, NEAR_DOUBLING)
    ds = vx.follow_attractors(machine(frequency), AMPLITUDE, values, STARTS, transient=400, progress=False)
    assert ds.num_periods.values.tolist() == [[4], [2]]
    assert ds.num_impacts.values.ravel().tolist() == [2, 1]
    assert np.isnan(ds.birth).all()
    assert np.isnan(ds.death).all()
    assert -1 < float(ds.multipliers[1, 0, 0].real) < -0.99


def test_a_chart_counts_one_attractor_more_beyond_the_published_folds():
    plane = {
        "forcing.frequency": [*FOLDS],
        AMPLITUDE: np.array([a for fold in FOLDS.values() for a in around(fold, NEAR_FOLD)]),
    }
    chart = vx.chart(
        machine(1.0), plane, stride=1, transient=400, starts=STARTS, multipliers=True, progress=False
    )
    for k, column in enumerate((0, 2)):
        before, after = chart.num_attractors.values[k, column : column + 2]
        assert after == before + 1
    assert int(chart.num_not_settled.sum()) == int(chart.num_failed.sum()) == 0
    # What is lost in n periods and m impacts.
    n, m = chart.num_periods, chart.num_impacts[..., 0]
    exact = 0.9 ** (2 * m) * np.exp(-0.04 * n * 2 * np.pi / chart["forcing.frequency"])
    np.testing.assert_allclose(chart.multipliers.prod("multiplier").real, exact, rtol=1e-9)


# Periods 2^k follow each other up to -0.02519, where chaos begins: r = 0.8, W = 2.8, c = 0.
CASCADE = {-0.0262: 8, -0.0258: 8, -0.02534: 16, -0.02522: 32, -0.025193: 64, -0.02508: 0}


@pytest.fixture(scope="module")
def cascade():
    return vx.sweep(
        vx.models.impact_oscillator(2.8),
        {POSITION: [*CASCADE]},
        transient=3000,
        record=1280,  # exponents have errors by 20 blocks: whole cycles in each
        max_impacts=0,
        x0=[-0.5],
        carry="up",
        lyapunov=True,
        progress=False,
    )


def test_a_cascade_of_doublings_is_told_from_the_chaos_behind_it(cascade):
    short, long = vx.classify(cascade, last=15), vx.classify(cascade, last=256)
    names = short.motion.flag_meanings.split()
    assert long.num_periods.values.tolist() == [*CASCADE.values()]
    assert short.num_periods.values.tolist() == [0] * 6
    assert [names[k] for k in short.motion.values] == ["not_settled"] * 5 + ["non_periodic"]
    assert names[int(long.motion[-1])] == "non_periodic"


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


def test_an_impact_at_the_section_itself_splits_no_attractor():
    """With the load's phase at which the one orbit hits the stop every section of it lies on the impact."""
    frequency = 0.79
    begin = vx.attractors(machine(frequency), STARTS[:12], transient=400, progress=False)
    k = begin.num_impacts[:, 0].values.tolist().index(2)
    sol = vx.simulate(machine(frequency), 0.0, 4 * np.pi / frequency, begin.x0.values[k], begin.v0.values[k])
    for j in range(2):
        phase = frequency * float(sol.events.t[j])
        turned = machine(frequency, phase=phase)
        ds = vx.attractors(turned, STARTS, transient=400, progress=False)
        assert ds.sizes["attractor"] == 1
