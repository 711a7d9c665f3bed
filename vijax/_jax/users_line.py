"""The line of the user's program to which a warning points."""

import sys
from types import FrameType

_PACKAGE = __name__.partition(".")[0]
# What stands between functions of this package: checks of annotations, and eager evaluation by JAX.
_BETWEEN = _PACKAGE, "jax", "jaxtyping", "beartype", "contextlib", "equinox"


def users_line() -> int:
    """`stacklevel` of the innermost call from outside of this package, however many functions are wrapped on the way."""
    return _outwards(sys._getframe(1))[1]


def users_place() -> tuple[str, int]:
    """File and line of this call, for a warning that is given later."""
    frame = _outwards(sys._getframe(1))[0]
    return frame.f_code.co_filename, frame.f_lineno


def _outwards(frame: FrameType) -> tuple[FrameType, int]:
    level = 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _BETWEEN:
        frame, level = frame.f_back, level + 1
    return frame, level
