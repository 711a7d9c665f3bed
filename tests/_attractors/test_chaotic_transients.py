"""Persistent and transient chaos are distinguished, in the paper's machines and others: long to compile."""

import numpy as np
import pytest
from coexisting_motions import found

import vijax as vx


@pytest.mark.thorough
@pytest.mark.slow
def test_case_a_has_two_attractors_at_1_8():
    ds = found(vx.models.wagg_bishop_a(1.8), 90)
    assert ds.num_periods.values.tolist() == [3, 2]
    assert ds.num_impacts.values.tolist() == [[1, 1], [1, 0]]


@pytest.mark.slow
def test_chaos_of_case_a_at_1_4_is_a_transient_beside_the_motion_without_impacts():
    system = vx.models.wagg_bishop_a(1.4)
    ds = found(system, 90)
    assert ds.motion.values.tolist() == [0]
    assert ds.share.values.tolist() == [1.0]
    # After 100 periods many still impact; after 3000 none.
    values = {"x0[0]": np.linspace(-0.3, 0.3, 9), "v0[0]": np.linspace(-1, 1, 10)}
    kinds = [vx.sweep(system, values, transient=t, max_impacts=0, progress=False) for t in (100, 3000)]
    impacting = [float((one.num_impacts.sum("stop") > 0).mean()) for one in kinds]
    assert impacting[0] > 0.2
    assert impacting[1] == 0


@pytest.mark.slow
def test_starts_that_stay_in_chaos_for_thousands_of_periods_are_followed_to_the_cycle_behind_it():
    """At 2.0 the chaos of case (b) decays at a constant rate, with a mean lifetime of 3000 periods and more."""
    system = vx.models.wagg_bishop_b(2.0)
    ds = vx.attractors(system, 200, progress=False)
    assert ds.num_periods.values.tolist() == [1]
    assert ds.share.values.tolist() == [1.0]
    assert int(ds.num_not_settled) == 0
    # After a hundred periods many starts are still chaotic.
    short = vx.sweep(
        system, {"x0[0]": [0.0, 0.1], "v0[0]": np.linspace(-1, 1, 50)}, max_impacts=0, progress=False
    )
    assert (vx.classify(short).num_periods == 0).mean() > 0.2


@pytest.mark.slow
def test_what_is_not_followed_long_enough_is_told_with_what_settles_it():
    system, starts = vx.models.wagg_bishop_b(2.0), 200
    with pytest.warns(UserWarning, match="of 200 starts have not settled, .* Increase `transient`, now 1"):
        short = vx.attractors(system, starts, transient=1, progress=False)
    assert 0 < int(short.num_not_settled) < 200
    assert short.num_periods.values.tolist() == [1]
    longer = vx.attractors(system, starts, transient=100, progress=False)
    assert int(longer.num_not_settled) == 0


@pytest.mark.slow
def test_chaos_of_case_b_at_2_05_lasts_beside_a_cycle():
    system = vx.models.wagg_bishop_b(2.05)
    values = {"x0[0]": np.linspace(-0.3, 0.3, 8), "v0[0]": np.linspace(-1, 1, 10)}
    ds = vx.basins(system, values, progress=False)
    assert sorted(ds.num_periods.values.tolist()) == [0, 1]
    largest = ds.exponents.values[:, 0]
    assert ((largest > 0.1) == (ds.num_periods.values == 0)).all()
    long = vx.classify(vx.sweep(system, values, transient=3000, progress=False))
    np.testing.assert_array_equal(ds.num_periods.values[ds.label.values], long.num_periods)


@pytest.mark.slow
def test_machines_with_contacts_and_with_forces_have_attractors():
    damper = found(vx.models.impact_damper(1.1), 60)
    # Mirror images.
    assert damper.num_impacts.values.tolist() == [[4, 4], [4, 4]]
    assert damper.num_periods.values.tolist() == [2, 2]
    duffing = found(vx.models.duffing_oscillator(1.2), 60)
    assert duffing.num_impacts.values.tolist() == [[2], [1]]
    assert duffing.is_stable.all()
