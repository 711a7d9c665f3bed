import numpy as np
import pytest

from vijax._branches.singular import _root_of


def test_a_branch_point_is_found_beside_cycles_without_multipliers() -> None:
    # A random machine had a cycle on a step whose multipliers were not numbers.
    ways = np.linspace(0.0, 1.0, 6)
    values = np.where(ways < 0.9, ways - 0.3, np.nan)
    assert _root_of(ways, values, 1.0) == pytest.approx(0.3)
    assert np.isnan(_root_of(ways, np.full(6, np.nan), 1.0))
    assert np.isnan(_root_of(ways[:0], values[:0], 1.0))
