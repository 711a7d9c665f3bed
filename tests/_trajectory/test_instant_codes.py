"""Instants as whole numbers."""

import jax.numpy as jnp
import numpy as np
import pytest

from vijax._machine.kinds import FRICTION, RIGID
from vijax._trajectory.instant_codes import codes_of, instants_of

FLAGS, SWITCHES, NUMBERS = (
    ("hit", "stuck", "released"),
    ("closed", "opened", "slipped", "turned"),
    ("ended", "before", "after"),
)


@pytest.mark.parametrize("is_switching", [False, True], ids=["rigid", "switching"])
def test_codes_hold_flags_and_laws(is_switching):
    rng = np.random.default_rng(1)
    shape, times = (200, 3), jnp.arange(200.0)
    # Numbers are below 128.
    mask = ~sum(1 << 7 + 8 * place + 7 for place in range(3)) if is_switching else -1
    codes = mask & jnp.asarray(rng.integers(0, 2**31 if is_switching else 2**3, shape), jnp.int32)
    instants = instants_of(codes, times, (RIGID, FRICTION) if is_switching else (RIGID,))
    np.testing.assert_array_equal(codes_of(instants), codes)
    np.testing.assert_array_equal(instants.time, times)
    bits = np.unpackbits(np.asarray(codes)[..., None].view(np.uint8), axis=-1, bitorder="little")
    names = (*FLAGS, *(SWITCHES if is_switching else ()))
    for place, name in enumerate(reversed(names)):
        owner = instants if name in FLAGS else instants.switched
        np.testing.assert_array_equal(getattr(owner, name), bits[..., place] == 1)
    if is_switching:
        for place, name in enumerate(reversed(NUMBERS)):
            expected = (np.asarray(codes) >> len(names) + 8 * place) & 255
            np.testing.assert_array_equal(getattr(instants.switched, name).astype(np.uint8), expected)
    else:
        assert instants.switched is None
