"""States at the ends of periods, as tables, in no more memory than they take themselves."""

import tracemalloc

import numpy as np

import vijax as vx
from vijax._execution.records import Impact
from vijax._execution.runner import Counts, PointResults
from vijax._sweep.dataset import _section_table

POINTS, RECORD, TRANSIENT, OF_EACH = 4000, 20, 5, 2
# The tables of positions and velocities come before that of held times, which is made of one more, and of flags.
MOST_TABLES = 4.3


def found(periods: np.ndarray) -> PointResults:
    """Results of which each number is known: those of the period p are p squared."""
    table = np.empty((OF_EACH, RECORD, POINTS))
    table[:] = np.arange(1.0, RECORD + 1)[:, None] ** 2
    ends = {f"section_{name}": table.copy() for name in ("x", "v", "held_time")} | {"periods": periods}
    none = np.zeros(0)
    return PointResults(ends, Impact(none, none, none, none, none, none), 0)


def machine() -> vx.ImpactSystem:
    """Machine of as many masses and stops."""
    stops = [vx.Stop(i, 1.0) for i in range(OF_EACH)]
    return vx.ImpactSystem(np.ones(OF_EACH), np.eye(OF_EACH), np.eye(OF_EACH), stops=stops)


def counts() -> Counts:
    return Counts(TRANSIENT, RECORD, 0, None, can_stick=True)


def test_held_times_are_those_of_each_period():
    periods = np.full(POINTS, TRANSIENT + RECORD)
    periods[7] = TRANSIENT + 3  # its motion ended early
    held = _section_table(counts(), found(periods), machine())["held_time"]
    expected = 2 * np.arange(1.0, RECORD + 1) - 1
    np.testing.assert_array_equal(held[0], np.repeat(expected[:, None], OF_EACH, axis=1))
    np.testing.assert_array_equal(held[7, :3], held[0, :3])
    assert np.isnan(held[7, 3:]).all()


def test_tables_of_sections_take_no_more_memory_than_one_of_them_beside_themselves():
    periods = np.full(POINTS, TRANSIENT + RECORD)
    tracemalloc.start()
    try:
        results = found(periods)
        size = results.ends["section_x"].nbytes
        tracemalloc.reset_peak()
        _section_table(counts(), results, machine())
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < MOST_TABLES * size
