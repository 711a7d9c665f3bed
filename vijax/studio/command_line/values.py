"""Parsing of numbers on the command line: a range, several, or one."""

import re
from typing import Any

import numpy as np

from ..._jax.arrays import Numbers, as_float

RANGES = "first:last:points, as 0.5:2:1000, with :log behind it for equal ratios, or numbers with commas"
_NUMBERS = "a number, or several with commas"


def assignment(text: str) -> tuple[str, str]:
    """The path and the value of "path=value"."""
    path, sign, value = text.partition("=")
    if not (path and sign and value):
        raise ValueError(f"{text!r} must be PATH=VALUES, as forcing.frequency=0.5:2:1000.")
    return path, value


def swept_values(path: str, given: Any) -> np.ndarray:
    """Swept values, (points, ...), from a text or from lists of numbers."""
    if isinstance(given, str):
        return _range(path, given) if ":" in given else numbers(path, given, RANGES)
    try:
        return np.atleast_1d(np.asarray(given, float))
    except (ValueError, TypeError) as error:
        raise ValueError(f"The values of `{path}` must be {RANGES}, but are {given!r}.") from error


def numbers(name: str, text: str, wanted: str = _NUMBERS) -> np.ndarray:
    """Numbers separated by commas, (points,)."""
    try:
        return np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise ValueError(f"The values of `{name}` must be {wanted}, but are {text!r}.") from error


def bounds_of(path: str, text: str) -> tuple[float, float]:
    """The two numbers of "low:high", the lower one first."""
    parts = text.split(":")
    if len(parts) != 2:
        raise ValueError(f"The bounds of `{path}` must be LOW:HIGH, as 0.7:1.0, but are {text!r}.")
    low, high = (float(numbers(path, part)[0]) for part in parts)
    if not low < high:
        raise ValueError(f"The bounds of `{path}` must be a lower and a higher number, but are {text!r}.")
    return low, high


def one_or_several(name: str, text: str) -> Numbers:
    """A number, or an array if there are commas."""
    found = numbers(name, text)
    return as_float(found if "," in text else found[0])


def _range(path: str, text: str) -> np.ndarray:
    match = re.fullmatch(r"([^:]+):([^:]+):(\d+)(:log)?", text)
    if match is None:
        raise ValueError(f"The values of `{path}` must be {RANGES}, but are {text!r}.")
    first, last = numbers(path, match[1], RANGES)[0], numbers(path, match[2], RANGES)[0]
    if match[4] is None:
        return np.linspace(first, last, int(match[3]))
    if not first * last > 0:
        raise ValueError(
            f"Equal ratios lead from {first} to {last} only if neither is zero nor of another sign."
        )
    return np.geomspace(first, last, int(match[3]))
