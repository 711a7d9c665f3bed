"""Requests of many branches as rows of arrays are what each of them is alone, padded."""

import numpy as np

from vijax._branches.kernels import corrected_cycle, simulate_motion
from vijax._branches.padding import padded
from vijax._branches.parameter_family import ExtendedCycle
from vijax._branches.request_rows import padded_cycles, padded_sequences, rows_of_parts
from vijax._branches.requests import KernelCall
from vijax._hybrid.limits import IMPACT, RELEASE
from vijax._orbits.sequence import Sequence

ROOM, STOPS, SIZE = 16, 2, 4


def cycle_of(rng: np.random.Generator, num_events: int) -> tuple[Sequence, ExtendedCycle]:
    kinds, stops = rng.choice([IMPACT, RELEASE], num_events), rng.integers(STOPS, size=num_events)
    sequence = Sequence(kinds, stops, rng.random((num_events + 1, STOPS)) < 0.5)
    return sequence, ExtendedCycle(rng.normal(size=SIZE), rng.random(num_events), rng.normal())


def test_sequences_and_cycles_are_padded_side_by_side_as_alone():
    rng = np.random.default_rng(0)
    cycles = [cycle_of(rng, num) for num in (0, 3, ROOM)]
    sequences = padded_sequences([sequence for sequence, _ in cycles], ROOM)
    places = padded_cycles([place for _, place in cycles], ROOM)
    for k, (sequence, place) in enumerate(cycles):
        long, wide = padded(sequence, (place,), ROOM)
        for together, alone in zip((*sequences, *places), (*long, *wide), strict=True):
            np.testing.assert_array_equal(together[k], alone)


def test_corrections_and_simulations_are_rows_of_one_batch():
    rng = np.random.default_rng(1)
    (one, place), (other, start), (_, weights) = (cycle_of(rng, num) for num in (2, 5, 2))
    state, nowhere = rng.normal(size=SIZE), np.full(SIZE, np.nan)
    asked = [
        KernelCall(corrected_cycle, one, (place, weights, np.asarray(0.3))),
        KernelCall(simulate_motion, other, (start, state)),
    ]
    rows = rows_of_parts(asked, ROOM, has_grip=False)
    correction, simulation = rows.requests.each_unpacked()
    np.testing.assert_array_equal(rows.ds, [0.0, np.nan])
    np.testing.assert_array_equal([correction.target, simulation.target], [0.3, np.nan])
    np.testing.assert_array_equal([correction.simulates, simulation.simulates], [False, True])
    np.testing.assert_array_equal(correction.start, nowhere)
    np.testing.assert_array_equal(simulation.start, state)
    first, second = (own.found for own in rows.points.each_unpacked())
    wide, heavy = padded(one, (place, weights), ROOM)[1:]
    _, far = padded(other, (start,), ROOM)
    for found, expected in zip(
        (*first.place, *first.tangent, *second.place), (*wide, *heavy, *far), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
