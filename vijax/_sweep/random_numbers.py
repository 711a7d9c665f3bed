"""Random numbers of calls that draw: `rng=` as SPEC 7 of Scientific Python has it, and the older `seed=`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._jax.arrays import Count, whole_number

Rng = int | np.integer | Sequence[int] | np.random.Generator | np.random.BitGenerator | np.random.SeedSequence


def generator_of(rng: Rng | None, seed: Count | None) -> np.random.Generator:
    """Generator of a call: that of `rng`, or of the number `seed`; of 0 without either, so that a call can be repeated.

    Raises:
        ValueError: if both are given, or one is of another form.
    """
    if rng is not None and seed is not None:
        raise ValueError("Give `rng` or `seed`, not both: `rng` also takes the number that `seed` takes.")
    if rng is None:
        return np.random.default_rng(0 if seed is None else whole_number("seed", seed))
    wanted: Any = rng
    try:
        return np.random.default_rng(wanted)
    except (TypeError, ValueError) as error:
        raise ValueError(
            "Argument `rng` must be a whole number, 0 or more, several of these, or a `Generator`, `BitGenerator` or "
            f"`SeedSequence` of NumPy, but is {rng!r}."
        ) from error
