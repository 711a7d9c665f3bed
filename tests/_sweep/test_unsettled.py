"""The word of a sweep on motions that have not settled."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._sweep.unsettled import say_unsettled


def settling(rates: list[float], num_periods: int = 20) -> xr.Dataset:
    """Section of motions at a fixed point that they approach by a factor a period."""
    way = np.array(rates)[:, None] ** np.arange(num_periods)
    x = (1.0 + way)[..., None]
    sections = {f"section_{name}": (("a", "period", "mass"), x) for name in ("x", "v")}
    return xr.Dataset(sections | {"forcing_period": ("a", np.full(len(rates), 2 * np.pi))})


def test_motions_that_still_approach_a_cycle_are_counted_with_the_time_that_they_take(capsys):
    say_unsettled(settling([0.1, 0.9, 0.95]), "sweep")
    # The change of the slowest in the last period, relative to its state, falls below 1e-6 after so many more.
    left = np.log(0.05 * 0.95**18 / 2 / 1e-6) / -np.log(0.95)
    said = capsys.readouterr().err
    assert said.startswith("sweep: 2 of 3 motions have not settled; increase `transient` by about ")
    assert abs(int(said.split()[-3]) - left) <= 1


def test_nothing_is_said_of_settled_motions_short_records_and_failed_points(capsys):
    failed = settling([0.9])
    failed["section_x"][0, 5:] = np.nan
    for ds in (settling([0.1]), settling([0.9], 4), failed, xr.Dataset()):
        say_unsettled(ds, "sweep")
    assert not capsys.readouterr().err


@pytest.mark.thorough
def test_a_sweep_says_it_with_its_progress_alone(capsys):
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], vx.Harmonic([0.1], 0.7), [vx.Stop(0, 9.0, "upper", 0.7)]
    )
    for progress in (False, True):
        vx.sweep(system, {"forcing.frequency": [0.6, 0.7]}, transient=10, record=12, progress=progress)
        assert ("2 of 2 motions have not settled" in capsys.readouterr().err) == progress
