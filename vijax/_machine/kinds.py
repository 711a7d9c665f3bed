"""Kinds of the elements of a machine; a machine of `RIGID` ones alone is the simplest of those whose forces switch."""

from typing import Final

RIGID: Final = 0
COMPLIANT: Final = 1
FRICTION: Final = 2
JENKINS: Final = 3
