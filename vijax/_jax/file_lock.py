"""A lock on a file, between processes and threads, which the system gives up for a process that dies."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None
    import msvcrt

# Seconds between two attempts, and seconds after which one goes on without the lock: no program takes as long to compile.
_PAUSE, _LONGEST = 0.02, 900.0


@contextmanager
def locked(file: Path, tell_waiting: Callable[[], None]) -> Iterator[None]:
    """Hold the lock of a file, which is removed afterwards; without one where the system allows none.

    Args:
        file: the file; nothing is written into it.
        tell_waiting: called once if another one holds the lock.
    """
    descriptor = _lock(file, tell_waiting)
    try:
        yield
    finally:
        if descriptor is not None:
            # While the lock is held: whoever opened the file before sees that it is gone.
            with suppress(OSError):
                file.unlink()
            os.close(descriptor)  # gives up the lock


def _lock(file: Path, tell_waiting: Callable[[], None]) -> int | None:
    end, is_told = time.monotonic() + _LONGEST, False
    while time.monotonic() < end:
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError:
            return None
        try:
            if is_free := _take(descriptor):
                if _is_at(file, descriptor):
                    return descriptor
        except OSError:  # a file system without locks
            os.close(descriptor)
            return None
        os.close(descriptor)
        if not is_free:
            if not is_told:
                is_told = True
                tell_waiting()
            time.sleep(_PAUSE)
    return None


def _take(descriptor: int) -> bool:
    """Take the lock; False if another one holds it.

    Raises:
        OSError: if the file system has no locks.
    """
    try:
        if fcntl is None:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _is_at(file: Path, descriptor: int) -> bool:
    """True unless the file was removed, by the one who held the lock before, or removed and made anew."""
    try:
        return os.path.samestat(os.stat(file), os.fstat(descriptor))
    except OSError:
        return False
