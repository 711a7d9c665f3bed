"""Clear errors for files and folders that cannot be written."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def naming_argument(name: str, path: Path) -> Iterator[None]:
    """Raise a ValueError that names the argument if its path cannot be written to, in place of the system's error."""
    try:
        yield
    except OSError as error:
        raise ValueError(
            f"Argument `{name}` must name a place that can be written to, but {str(path)!r} is none: {error.strerror or error}. "
            "Name another, or make the folder that it is in."
        ) from error


@contextmanager
def saying_what_is_kept(folder: Path) -> Iterator[None]:
    """Raise an OSError with a sentence where results cannot be written in the middle of a sweep, as on a full disk."""
    try:
        yield
    except OSError as error:
        raise OSError(
            error.errno,
            f"Results cannot be written to {str(folder)!r}: {error.strerror or error}. What is done is kept there: make room, and "
            "call again.",
        ) from error
