"""The line of the user's program to which a warning points."""

import sys

_PACKAGE = __name__.partition(".")[0]
# What stands between functions of this package: checks of annotations, and eager evaluation by JAX.
_BETWEEN = _PACKAGE, "jax", "jaxtyping", "beartype", "contextlib", "equinox"


def users_line() -> int:
    """`stacklevel` of the innermost call from outside of this package, however many functions are wrapped on the way."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _BETWEEN:
        frame, level = frame.f_back, level + 1
    return level
