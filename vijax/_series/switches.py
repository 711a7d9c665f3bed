"""Choices between branches of a force."""

from dataclasses import dataclass

from .algebra import Operand


@dataclass(eq=False, frozen=True)
class Switch:
    """Choice between branches: its mode is the number of knots below its guard.

    Attributes:
        guard: series that decides.
        knots: numbers at which the branch changes, in ascending order; they do not change along the motion.
        mode: series of the mode, a number that is given.
        is_time: the guard is linear in time alone, so its knots are known ahead.
    """

    guard: int
    knots: tuple[Operand, ...]
    mode: int
    is_time: bool = False
