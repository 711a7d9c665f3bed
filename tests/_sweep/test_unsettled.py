"""The warning of a sweep on motions that have not settled."""

import re
import warnings

import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._sweep.unsettled import warn_of_unsettled_points


def settling(rates: list[float], num_periods: int = 20) -> xr.Dataset:
    """Section of motions at a fixed point that they approach by a factor a period."""
    way = np.array(rates)[:, None] ** np.arange(num_periods)
    x = (1.0 + 0.01 * way)[..., None]
    sections = {f"section_{name}": (("a", "period", "mass"), x) for name in ("x", "v")}
    return xr.Dataset(sections | {"forcing_period": ("a", np.full(len(rates), 2 * np.pi))})


def said(ds: xr.Dataset) -> str:
    """The warning, empty if there is none."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_unsettled_points(ds)
    return " ".join(str(each.message) for each in caught)


def test_motions_that_still_approach_a_cycle_are_counted_with_the_time_that_they_take():
    # The distance of the slowest from its cycle, relative to the motion, falls below 1e-6 after so many more.
    left = np.log(0.01 * 0.95**19 / 1e-6) / -np.log(0.95)
    text = said(settling([0.1, 0.9, 0.95]))
    assert text.startswith("2 of 3 motions have not settled. Run on for about ")
    assert abs(int(re.findall(r"about (\d+)", text)[0]) - left) <= 1
    assert "shows no rate" not in text


@pytest.mark.parametrize("slow", [0.99, 0.9996])
def test_no_time_is_told_of_a_motion_whose_record_is_too_short_to_show_its_rate(slow):
    assert said(settling([slow])) == (
        "1 of 1 motions have not settled. The record of 20 forcing periods shows no rate of approach: record more."
    )
    known, both = said(settling([0.95])), said(settling([0.95, slow]))
    assert both.startswith(known.replace("1 of 1", "2 of 2"))
    assert both.endswith(
        " For 1 of them the record of 20 forcing periods shows no rate of approach: record more."
    )


def test_after_the_time_that_is_told_the_motions_have_settled():
    rates = [0.8, 0.9, 0.95]
    more = int(re.findall(r"about (\d+)", said(settling(rates)))[0]) + 1
    assert said(settling(rates, 20 + more).isel(period=slice(more, None))) == ""


def test_nothing_is_said_of_settled_motions_short_records_and_failed_points():
    failed = settling([0.9])
    failed["section_x"][0, 5:] = np.nan
    for ds in (settling([0.1]), settling([0.9], 4), failed, xr.Dataset()):
        assert said(ds) == ""


@pytest.mark.thorough
@pytest.mark.parametrize("progress", [False, True])
def test_a_sweep_warns_of_it_with_and_without_its_progress(progress):
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([0.1], 0.7), [vx.Stop(0, 9.0, "upper", 0.7)]
    )
    with pytest.warns(UserWarning, match="2 of 2 motions have not settled"):
        ds = vx.sweep(system, {"forcing.frequency": [0.6, 0.7]}, transient=10, record=12, progress=progress)
    assert ds.sizes["forcing.frequency"] == 2
