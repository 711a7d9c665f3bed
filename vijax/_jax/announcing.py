"""Reports of programs that are being compiled, for the call that waits for them.

A call receives them within `announced_to`; what compiles calls `announce`, in whichever thread.
"""

import enum
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stage(enum.Enum):
    """Stage of making a program, before it can run."""

    COMPILES = enum.auto()
    """Traced and compiled, and kept for later processes."""
    COMPILES_NOW = enum.auto()
    """Traced and compiled for this process alone."""
    TRACES = enum.auto()
    """Traced in every process; compiled unless a process before has done so."""
    WAITS = enum.auto()
    """Compiled by another process or thread, for which this one waits."""


class _Listener:
    """Callback of the outermost call that receives reports: it affects messages alone."""

    tell: Callable[[Stage], None] | None = None


_listener = _Listener()


def is_announced() -> bool:
    """Flag of being within a call that announces what compiles."""
    return _listener.tell is not None


@contextmanager
def announced_to(tell: Callable[[Stage], None]) -> Iterator[None]:
    """Report all that compiles within the block, in all threads."""
    before, _listener.tell = _listener.tell, tell
    try:
        yield
    finally:
        _listener.tell = before


def announce(stage: Stage) -> None:
    """Report a stage to the call that waits for it."""
    if _listener.tell is not None:
        _listener.tell(stage)
