"""Sizes of queues, lanes and chunks."""

from dataclasses import dataclass, fields

from .._jax.arrays import whole_number


@dataclass(frozen=True)
class ExecutionSettings:
    """Sizes of the loops that run many trajectories. They affect speed; results change by rounding only.

    Args:
        lanes: trajectories in one loop: enough to hide the overhead of the compiled loop, few enough for the cache.
        points: most points of one queue: so many that its end, where lanes have no work left, is a small part of it.
        turns: turns of the loop after which it returns, to show progress and accept interrupts.
        impact_rows: room for impacts, in rows, which the host takes away when it is full.
        mark_rows: the same for the ends of recorded periods.
        cores: number of queues that run at the same time, or with an executor number of workers that share a small
            sweep; if left out, one for every core of this process.
        in_flight: chunks that an executor has at a time: more than it has workers, few enough to stay in memory.
        chunk_periods: forcing periods in a chunk of a store or an executor, for each core: the work of a few seconds.
        min_chunk: fewest points of a chunk for each core, so that lanes do not idle.
        max_chunk: most points of a chunk for each core, no more than a queue holds.
        long_chain: forcing periods of a carried chain from which it has a program for its number of chains.
        visits: points of a carried chain that are run in one go; a store keeps them together.
    """

    lanes: int = 80
    points: int = 2048
    turns: int = 1 << 14
    impact_rows: int = 1 << 15
    mark_rows: int = 1 << 13
    cores: int | None = None
    in_flight: int = 4096
    chunk_periods: int = 250_000
    min_chunk: int = 192
    max_chunk: int = 2048
    long_chain: int = 200_000
    visits: int = 256

    def __post_init__(self):
        for one in fields(self):
            if (value := getattr(self, one.name)) != one.default:
                whole_number(one.name, value, 1)

    def __repr__(self) -> str:
        """Only what differs from the default: it stands in the signatures that `help` prints."""
        own = [
            f"{one.name}={value!r}"
            for one in fields(self)
            if (value := getattr(self, one.name)) != one.default
        ]
        return f"{type(self).__name__}({', '.join(own)})"

    def chunk_of(self, periods: int) -> int:
        """Number of points of a chunk for one core, each of `periods` forcing periods."""
        return min(max(self.chunk_periods // max(periods, 1), self.min_chunk), self.max_chunk)


DEFAULT_SETTINGS = ExecutionSettings()
