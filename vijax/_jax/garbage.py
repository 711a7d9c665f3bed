"""Python's search for garbage, put off while a program is traced."""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class _PutOff:
    """Number of threads that put it off now, and whether it was on before the first of them."""

    def __init__(self):
        self.lock = threading.Lock()
        self.count, self.was_on = 0, False

    def begin(self) -> None:
        """Put it off."""
        with self.lock:
            if not self.count:
                self.was_on = gc.isenabled()
                gc.disable()
            self.count += 1

    def end(self) -> None:
        """Let it go on, after the last."""
        with self.lock:
            self.count -= 1
            if not self.count and self.was_on:
                gc.enable()


_put_off = _PutOff()


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Run a block without Python's search for garbage; the memory of all else is freed as ever.

    Tracing makes a million objects that stay. It searched among them for a fifth of the time of tracing, and found a
    thousand.
    """
    _put_off.begin()
    try:
        yield
    finally:
        _put_off.end()
