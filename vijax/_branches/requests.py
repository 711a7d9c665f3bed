"""Requests of branches: what to compute for one of them, with the type of the answer.

A function that follows one branch is a generator of requests, `Requests[T]` if it returns a T. `ask` alone yields: so
many branches run side by side, see `scheduler.py`, while the code treats one.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from jaxtyping import Array

from .._orbits.sequence import Sequence
from .kernels import SimulatedMotion, locate_state, simulate_motion
from .parameter_family import ExtendedCycle, ParameterFamily

T = TypeVar("T")


class Request(Generic[T]):
    """Something to compute for a branch, whose result is a T.

    Attributes:
        sequence: events of the cycle.
    """

    sequence: Sequence


Requests = Generator[Request[Any], Any, T]


def ask(request: Request[T]) -> Requests[T]:
    """The answer to a request."""
    return (yield request)


@dataclass(frozen=True, eq=False)
class KernelCall(Request[T]):
    """Request for the result of a kernel.

    Attributes:
        program: the kernel, a function of a family, a sequence and the arguments.
        sequence: events of the cycle.
        arguments: the others, without padding.
    """

    program: Callable[..., T]
    sequence: Sequence
    arguments: tuple


@dataclass(frozen=True, eq=False)
class HostCall(Request[T]):
    """Request for what a function of the family alone tells, outside of all batches.

    Attributes:
        function: of the family.
        sequence: events of the cycle.
        of_make: True if all families of one tree structure and shapes have the same answer.
    """

    function: Callable[[ParameterFamily], T]
    sequence: Sequence
    of_make: bool = False

    def answer(self, family: ParameterFamily, known: dict[Callable, Any]) -> T:
        """The answer; `known` are those for the make of the family."""
        if not self.of_make:
            return self.function(family)
        if self.function not in known:
            known[self.function] = self.function(family)
        return known[self.function]


def simulation_of(sequence: Sequence, place: ExtendedCycle) -> KernelCall[SimulatedMotion]:
    """Request for a simulation from the start of a cycle."""
    return KernelCall(simulate_motion, sequence, (place, np.full(np.shape(place.z), np.nan)))


def simulation_from(sequence: Sequence, start: np.ndarray, p: float) -> KernelCall[SimulatedMotion]:
    """Request for a simulation from a start in space, at a scaled parameter, with the room of a sequence."""
    nowhere = ExtendedCycle(0 * start, np.zeros(len(sequence.kind)), np.asarray(p))
    return KernelCall(simulate_motion, sequence, (nowhere, start))


def location_on(sequence: Sequence, place: ExtendedCycle, time: float) -> KernelCall[Array]:
    """Request for the scaled state of a cycle, (2 n,), `time` forcing periods after its start."""
    return KernelCall(locate_state, sequence, (place, np.asarray(time, float)))
