"""Files and folders that cannot be made, told in a sentence."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def naming_argument(name: str, path: Path) -> Iterator[None]:
    """Say of what is being written which argument names a place where nothing can be.

    Args:
        name: of the argument.
        path: what it names.

    Raises:
        ValueError: in place of what the operating system raises.
    """
    try:
        yield
    except OSError as error:
        raise ValueError(
            f"Argument `{name}` must name a place that can be written to, but {str(path)!r} is none: {error.strerror or error}. "
            "Name another, or make the folder that it is in."
        ) from error
