"""Room for compiled programs in a process that compiles many.

Each program takes some hundred memory maps, of which Linux gives a process 65,530 (`vm.max_map_count`). When none is
left, XLA fails, or waits for ever. So all programs are dropped before that; those that are asked for again are compiled
again. 300 sweeps of machines of different make would be too many otherwise.
"""

import logging
from functools import cache
from pathlib import Path

import jax

from .arrays import is_staged

_MAPS, _MOST = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
# Programs between two looks, and how much of the room may be taken at one: the next few must fit in what is left.
_BETWEEN, _FULL, _GROWTH = 4, 0.75, 0.1

_log = logging.getLogger(__name__)


class _Taken:
    """What is known of the maps.

    Attributes:
        new: programs since the last look.
        others: maps that were left when all programs were dropped: what else the process has.
    """

    def __init__(self):
        self.new, self.others = 0, 0
        jax.monitoring.register_event_duration_secs_listener(self._note)

    def _note(self, event: str, duration_secs: float, **_: str | int) -> None:
        del duration_secs
        self.new += event == "/jax/core/compile/backend_compile_duration"


_taken = _Taken()


def make_room() -> None:
    """Drop compiled programs if hardly any memory maps are left. Costs next to nothing where nothing was compiled."""
    if _taken.new < _BETWEEN or is_staged() or (most := most_maps()) is None:
        return
    _taken.new, now = 0, num_maps()
    # Where others have taken the room, programs are not dropped again and again.
    if now > max(_FULL * most, _taken.others + _GROWTH * most):
        _log.info("%d of %d memory maps are taken: all compiled programs are dropped.", now, most)
        jax.clear_caches()
        _taken.others = num_maps()


def num_maps() -> int:
    """The memory maps of this process."""
    return _MAPS.read_bytes().count(b"\n")


@cache
def most_maps() -> int | None:
    """How many it may have; None where the system does not tell."""
    return int(_MOST.read_text()) if _MOST.exists() and _MAPS.exists() else None
