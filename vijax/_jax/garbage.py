"""Python's search for garbage, put off while a program is traced, and rare while many objects are made that stay."""

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# New objects after which it searches among them where it is rare; Python takes 700 to 2000.
_MANY = 200_000


class _Shared:
    """A change of Python's settings that several threads share: the first makes it, the last takes it back.

    Args:
        change: makes it, and returns what was before.
        take_back: restores that.
    """

    def __init__(self, change: Callable[[], Any], take_back: Callable[[Any], Any]):
        self.lock, self.change, self.take_back = threading.Lock(), change, take_back
        self.count, self.before = 0, None

    @contextmanager
    def during(self) -> Iterator[None]:
        """Run a block with the change."""
        with self.lock:
            self.before = self.before if self.count else self.change()
            self.count += 1
        try:
            yield
        finally:
            with self.lock:
                self.count -= 1
                if not self.count:
                    self.take_back(self.before)


def _disabled() -> bool:
    was_on = gc.isenabled()
    gc.disable()
    return was_on


def _rare() -> tuple[int, int, int]:
    before = gc.get_threshold()
    gc.set_threshold(max(before[0], _MANY) if before[0] else 0, *before[1:])  # 0 is never
    return before


_put_off = _Shared(_disabled, lambda was_on: gc.enable() if was_on else None)
_rarely = _Shared(_rare, lambda before: gc.set_threshold(*before))


def without_garbage_collection() -> Any:
    """Run a block without Python's search for garbage; the memory of all else is freed as ever.

    Tracing makes a million objects that stay. It searched among them for a fifth of the time of tracing, and found a
    thousand.
    """
    return _put_off.during()


def with_rare_garbage_collection() -> Any:
    """Run a block in which Python searches for garbage a hundred times more rarely.

    Branches make many objects that stay, and few that are garbage: it searched for a fifth of their time.
    """
    return _rarely.during()
