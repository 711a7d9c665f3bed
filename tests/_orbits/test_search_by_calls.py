"""Searches whose runs are calls of the program of `simulate`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._orbits import find
from vijax._orbits.search import StroboscopicMap
from vijax._trajectory.concrete_machine import known_machine
from vijax._trajectory.one_call import EVENTS

# Two programs of one search agree to rounding, which Newton's method of a stable cycle does not enlarge.
SAME = 1e-11


def strobe_of(system: vx.ImpactSystem, room: int = 64) -> StroboscopicMap:
    known = known_machine(system, None)
    return StroboscopicMap(
        known.numbers, known.flow(None, can_stick=True), np.asarray(1.0), np.asarray(0.0), room
    )


@pytest.mark.thorough
@pytest.mark.parametrize("away", [0.0, 0.5], ids=["near", "far"])
def test_it_is_the_search_of_one_program(away):
    system = vx.models.wagg_bishop_a(0.8)
    settled = vx.simulate(system, 0.0, 100 * system.forcing.period)
    guess = np.concatenate([(1 - away) * np.asarray(settled.x1), settled.v1])
    strobe = strobe_of(system)
    found, expected = find.search_to_end(strobe, guess), find._search_in_one(strobe, jnp.asarray(guess))
    assert bool(found.is_orbit)
    assert int(found.num_runs) > 1 or not away
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, rtol=SAME, atol=SAME)


class InOneProgram(Exception):
    """The search goes to a program of its own."""


def test_runs_too_long_for_a_call_are_searched_in_one_program(monkeypatch):
    def refuse(strobe, guess):
        raise InOneProgram(strobe.room)

    monkeypatch.setattr(find, "_search_in_one", refuse)
    with pytest.raises(InOneProgram, match=str(EVENTS + 1)):
        find.search_to_end(strobe_of(vx.models.wagg_bishop_a(0.8), EVENTS + 1), np.zeros(4))
