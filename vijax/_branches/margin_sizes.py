"""Sizes by which margins and residuals are divided: what is zero must not depend on the units of a machine."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._hybrid.limits import CLOSE, OPEN, RELEASE, SLIP, STICK, TURN
from .._jax.arrays import Reals, array_namespace
from .._orbits.sequence import SECOND, Sequence
from .._system.system import machine_of
from .kinds import Kind
from .parameter_family import ParameterFamily
from .test_functions import TestFunction, tests_of


class Sizes(NamedTuple):
    """Sizes of gaps, of velocities and of forces, of the motions of a family."""

    length: Reals
    speed: Reals
    force: Reals

    @classmethod
    def of(cls, family: ParameterFamily) -> "Sizes":
        """Those of a family; the force is the largest that accelerates, damps or holds a mass in a motion of that size."""
        length, speed, machine = family.scale[0], family.scale[-1], machine_of(family.system)
        rates = speed * speed / length, speed, length
        matrices = machine.mass, machine.damping, machine.stiffness
        xp = array_namespace(*rates, *matrices)
        return cls(
            length, speed, xp.stack([abs(a).max() * b for a, b in zip(matrices, rates, strict=True)]).max()
        )

    def of_test(self, test: TestFunction, sequence: Sequence) -> float:
        """Size of the values of a test function; 1 of durations, of friction that is torn off and of grips in impacts."""
        if test.of_flight or test.kind in (Kind.TEAR, Kind.IN_IMPACT):
            return 1.0
        if not test.least:
            return float(self.force if sequence.kind[test.index] == TURN else self.speed)
        if test.least == "force" or test.kind == Kind.FORCE_ZERO:
            return float(self.force)
        return float(self.speed if test.kind == Kind.GRAZING_SLIDING else self.length)

    def of_margins(self, sequence: Sequence) -> np.ndarray:
        """Sizes of all `margins` of a sequence, in their order; 1 for no test."""
        room, guards = len(sequence.kind), sequence.mode.shape[1] * sequence.num_groups
        begins = {name: 2 * room + k * guards for k, name in enumerate(("gap", "force", "rise"))}
        found = np.ones(2 * room + 3 * guards)
        for test in tests_of(sequence):
            begin = begins[test.least] if test.least else room * test.of_flight
            found[begin + test.index] = self.of_test(test, sequence)
        return found

    def of_events(self, sequence: Sequence) -> Float[Array, " events"]:
        """Sizes of the guards that vanish at events."""
        kind = sequence.kind % SECOND
        of_force = jnp.isin(kind, np.array((RELEASE, SLIP, OPEN)))
        of_force |= (kind == CLOSE) & (sequence.kind >= SECOND)
        of_speed = jnp.isin(kind, np.array((STICK, TURN)))
        return jnp.where(of_force, self.force, jnp.where(of_speed, self.speed, self.length))
