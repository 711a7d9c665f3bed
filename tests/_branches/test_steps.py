"""Steps of many branches in a batch: decisions on arrays equal the decisions on each branch alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BPoly

from vijax._branches import test_functions as tests
from vijax._branches.admissibility import Margins
from vijax._branches.batches import FamilyStack
from vijax._branches.corrector import Corrected
from vijax._branches.kernels import CorrectedCycle, corrected_cycle
from vijax._branches.margin_scan import LeastMargins
from vijax._branches.minima import _NODES, _at_nodes
from vijax._branches.multiplier_functions import of_doubling, of_meeting, of_neighbours, of_pairs
from vijax._branches.padding import MOST_EVENTS, padded
from vijax._branches.parameter_family import ExtendedCycle, ParameterFamily
from vijax._branches.point import BranchPoint, PlainPoint, TooManyEvents, stacked_cycles
from vijax._branches.requests import KernelCall
from vijax._branches.scheduler import _next_request
from vijax._branches.step_kernel import each_row
from vijax._branches.test_functions import crossings, margins, num_unstable
from vijax._hybrid.limits import IMPACT, RELEASE
from vijax._jax.packing import pack
from vijax._orbits.sequence import Sequence

ROOM, STOPS = 16, 2


def cycle(rng: np.random.Generator, mu: np.ndarray | None = None) -> CorrectedCycle:
    """Random test functions of one cycle or, with the multipliers of several, of those."""
    if mu is None:
        root = complex(*rng.normal(size=2))
        mu = np.array([*rng.normal(size=2), root, root.conjugate()])
    some = lambda *shape: jnp.asarray(rng.normal(size=(*mu.shape[:-1], *shape)))  # noqa: E731
    place = ExtendedCycle(some(4), some(ROOM), some())
    found = Corrected(
        place, place, jnp.asarray(mu), some(ROOM), some(), some(), jnp.array(3), jnp.array(True)
    )
    stops, force = jnp.zeros(STOPS, int), some(STOPS).at[..., 1].set(jnp.inf)
    watched = LeastMargins(
        some(STOPS), some(STOPS), stops, force, some(STOPS), stops, some(STOPS), stops, stops > 0, some()
    )
    rates = Margins(some(ROOM), some(STOPS), some(STOPS), some(STOPS))
    return jax.device_get(CorrectedCycle(found, watched, rates, some(4), of_neighbours(found), some(5)))


def sequence_of(rng: np.random.Generator, num_events: int) -> Sequence:
    kinds, stops = rng.choice([IMPACT, RELEASE], num_events), rng.integers(STOPS, size=num_events)
    return Sequence(kinds, stops, rng.random((num_events + 1, STOPS)) < 0.5)


@pytest.mark.parametrize("num_events", [0, 1, 5, ROOM])
def test_margins_are_the_tests_of_a_sequence(num_events):
    rng = np.random.default_rng(num_events)
    for _ in range(20):
        sequence, before, after = sequence_of(rng, num_events), cycle(rng), cycle(rng)
        (long,) = padded(sequence, (), ROOM)
        own, later = margins(long, before), margins(long, after)
        values = [test.of(before) for test in tests.tests_of(sequence)]
        np.testing.assert_array_equal(
            np.sort(own[np.isfinite(own)]), np.sort(np.array(values)[np.isfinite(values)])
        )
        is_met = bool(np.any((own > 0) & (later <= 0)))
        assert is_met == bool(crossings(tests.tests_of(sequence), before, after))


def test_functions_of_multipliers_are_those_of_each_branch():
    # One multiplier is infinite, as at a grazing.
    rng = np.random.default_rng(0)
    rows = [np.asarray(cycle(rng).found.multipliers) for _ in range(6)]
    rows[2] = np.array([np.inf, 0.2, -0.5, 0.1], complex)
    together, alone = cycle(rng, np.stack(rows)), [cycle(rng, mu) for mu in rows]
    for of in (of_doubling, of_meeting, of_pairs):
        np.testing.assert_allclose(of(np.stack(rows)), [of(mu) for mu in rows], rtol=1e-14)
    np.testing.assert_allclose(num_unstable(together), [num_unstable(one) for one in alone], rtol=1e-14)


def test_points_side_by_side_are_what_each_is_alone():
    rng = np.random.default_rng(0)
    sequence = sequence_of(rng, 3)
    rows = pack(jax.tree.map(lambda *a: np.stack(a), *(cycle(rng) for _ in range(3))), has_rows=True)
    plain = [PlainPoint(sequence, rows, k, float(k)) for k in (2, 0)]
    few, many = (seen_with_room(rng, room) for room in (ROOM, 2 * ROOM))
    points = [BranchPoint.of(sequence, few, 0.0), plain[0], BranchPoint.of(sequence, many, 1.0), plain[1]]
    together = stacked_cycles(points)
    assert together.found.speeds.shape == (4, 2 * ROOM)
    for k, seen_alone in enumerate([few, rows.at(2).unpacked(), many, rows.at(0).unpacked()]):
        for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(seen_alone), strict=True):
            own = a[k][tuple(slice(size) for size in np.shape(b))]
            np.testing.assert_array_equal(own, b)
            assert np.count_nonzero(a[k]) == np.count_nonzero(own)


def seen_with_room(rng: np.random.Generator, room: int) -> CorrectedCycle:
    """A cycle with capacity for that many events."""
    one = cycle(rng)
    longer = lambda a: np.resize(a, room) if np.shape(a) == (ROOM,) else a  # noqa: E731
    return jax.tree.map(longer, one)


def test_a_branch_that_comes_to_too_many_events_is_told_so():
    def task():
        try:
            yield KernelCall(corrected_cycle, sequence_of(rng, MOST_EVENTS + 1), ())
        except TooManyEvents as why:
            yield KernelCall(corrected_cycle, sequence_of(rng, 3), (str(why),))

    rng = np.random.default_rng(0)
    family, stack = object.__new__(ParameterFamily), object.__new__(FamilyStack)
    assert _next_request(family, stack, task(), None).arguments == ("max_events",)


def test_a_batch_of_one_is_computed_without_vmap_with_the_same_numbers():
    def collatz(start: jax.Array) -> tuple[jax.Array, jax.Array]:
        following = lambda n: jax.lax.cond(n & 1 == 0, lambda: n >> 1, lambda: 3 * n + 1)  # noqa: E731
        one = lambda now: (following(now[0]), now[1] + 1)  # noqa: E731
        return jax.lax.while_loop(lambda now: now[0] > 1, one, (start, jnp.array(0)))

    starts = jnp.array([27, 97])
    together = each_row(collatz)(starts)
    alone = [each_row(collatz)(starts[k : k + 1]) for k in range(2)]
    np.testing.assert_array_equal(together, np.concatenate(alone, axis=1))
    np.testing.assert_array_equal(together[1], [111, 118])
    assert "select_n" in str(jax.make_jaxpr(each_row(collatz))(starts))
    assert "select_n" not in str(jax.make_jaxpr(each_row(collatz))(starts[:1]))


@pytest.mark.parametrize("num", [3, 4])
def test_polynomials_between_samples_have_their_values_and_derivatives(num):
    by_scipy = BPoly.from_derivatives([0.0, 1.0], np.eye(2 * num).reshape(2, num, 2 * num))
    for nu, found in enumerate(_at_nodes(num)):
        np.testing.assert_allclose(found, by_scipy(_NODES, nu=nu), rtol=0, atol=1e-15)
