"""Random numbers: `rng` takes all that NumPy makes a generator of, `seed` what it took before."""

import numpy as np
import pytest

from vijax._sweep.random_numbers import generator_of


def drawn(rng=None, seed=None) -> list[float]:
    return generator_of(rng, seed).uniform(size=3).tolist()


def test_rng_is_whatever_numpy_makes_a_generator_of():
    number = np.random.default_rng(7).uniform(size=3).tolist()
    for rng in (7, np.int64(7), np.random.default_rng(7), np.random.SeedSequence(7), np.random.PCG64(7)):
        assert drawn(rng) == number
    assert drawn(seed=7) == number
    assert drawn([1, 2]) == np.random.default_rng([1, 2]).uniform(size=3).tolist()
    assert drawn() == drawn(0) == drawn(seed=0)


def test_a_generator_goes_on_where_it_is():
    rng = np.random.default_rng(7)
    assert generator_of(rng, None) is rng
    assert drawn(rng) != drawn(rng)


def test_what_seeds_nothing_is_refused():
    with pytest.raises(ValueError, match="`rng` or `seed`, not both"):
        generator_of(1, 1)
    with pytest.raises(ValueError, match="`rng` must be a whole number, 0 or more"):
        generator_of(-1, None)
    with pytest.raises(ValueError, match="`seed` must be a whole number"):
        generator_of(None, 0.5)
