"""Room for compiled programs in a process that compiles many.

Each program takes about a hundred memory maps, of which Linux gives a process 65,530 (`vm.max_map_count`). When none
is left, XLA fails or hangs. All programs are therefore dropped before that, and compiled again when needed. Otherwise
300 sweeps of different kinds of machines would be too many.
"""

import logging
import weakref
from functools import cache
from pathlib import Path
from typing import Protocol, runtime_checkable

import jax

from .concrete import is_staged

_MAPS, _MOST = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
# _BETWEEN: programs compiled between two counts of the maps.
# _FULL: fraction of the maps above which programs are dropped; those of the next `_BETWEEN` must fit into the rest.
# _GROWTH: fraction of the maps that must be added after one drop before the next.
_BETWEEN, _FULL, _GROWTH = 4, 0.75, 0.1

_log = logging.getLogger(__name__)


class _MapCounts:
    """Counters of programs and memory maps.

    Attributes:
        new: programs compiled since the last count of the maps.
        others: maps left after the last drop of all programs: those of the rest of the process.
    """

    def __init__(self):
        self.new, self.others = 0, 0
        jax.monitoring.register_event_duration_secs_listener(self._note)

    def _note(self, event: str, duration_secs: float, **_: str | int) -> None:
        del duration_secs
        self.new += event == "/jax/core/compile/backend_compile_duration"


_taken = _MapCounts()


@runtime_checkable
class HoldsPrograms(Protocol):
    """Holder of compiled programs that JAX does not know."""

    def drop(self) -> None:
        """Drop them."""
        ...


_holders: "weakref.WeakSet[HoldsPrograms]" = weakref.WeakSet()


def note_holder(holder: HoldsPrograms) -> None:
    """Register a holder of programs, as long as it lives."""
    _holders.add(holder)


def note_program() -> None:
    """Count a program that was loaded instead of compiled."""
    _taken.new += 1


def make_room() -> None:
    """Drop compiled programs if hardly any memory maps are left. Costs next to nothing if nothing was compiled."""
    if _taken.new < _BETWEEN or is_staged() or (most := most_maps()) is None:
        return
    _taken.new, now = 0, num_maps()
    # Where the rest of the process takes the room, programs are not dropped again and again.
    if now > max(_FULL * most, _taken.others + _GROWTH * most):
        _log.info("%d of %d memory maps are taken: all compiled programs are dropped.", now, most)
        for holder in list(_holders):
            holder.drop()
        jax.clear_caches()
        _taken.others = num_maps()


def num_maps() -> int:
    """Number of memory maps of this process."""
    return _MAPS.read_bytes().count(b"\n")


@cache
def most_maps() -> int | None:
    """Limit on memory maps; None where the system does not report it."""
    return int(_MOST.read_text()) if _MOST.exists() and _MAPS.exists() else None
