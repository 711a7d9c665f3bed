"""Steps along a branch: when one is accepted, short enough, and plain.

On a plain step nothing happens: no test function changes sign, no bound is passed, and the machine follows the cycle.
Most steps are plain. They are taken one after another in one compiled program, `step_kernel.py`; the first one that is
not plain is returned to `located_steps.py`. All functions treat one branch, and are traced.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._jax.arrays import Flag, Scalar
from .._orbits.sequence import NOTHING, Sequence
from .kernels import CorrectedCycle, SimulatedMotion
from .parameter_family import ExtendedCycle
from .point import BranchPoint, DirectedBranch
from .requests import Request
from .test_functions import grips, is_crossed, margins, num_unstable, test_slopes
from .tolerances import (
    FIRST_STEP,
    LEAST_COSINE,
    MULTIPLIER_MOVE,
    NARROWEST_BY_MOVE,
    PLANNED_MOVE,
    PROBE_STEP,
    ROUNDED,
    ROUNDED_FUNCTION,
    SEPARATE_EVENTS,
    TRUSTED,
)

# `_FEW`: largest number of Newton iterations after which steps grow by half.
# `_MANY`: number of Newton iterations from which steps shrink, and the most of an accepted step.
_FEW, _MANY = 4, 7


class Tried(NamedTuple):
    """A step that is accepted and short enough, and not taken.

    Attributes:
        point: the point at its end.
        motion: motion of the machine started there, if it was simulated and is like the cycle; else None.
        next_length: length of the step after it.
    """

    point: BranchPoint
    motion: SimulatedMotion | None
    next_length: float


@dataclass(frozen=True, eq=False)
class PlainSteps(Request[tuple[BranchPoint, float, Tried | None]]):
    """Request for plain steps.

    The answer is the last point, the length of the next step, and this step itself if it was tried and not taken, or
    None.

    Attributes:
        walk: receives the points.
        start: first point of the branch.
        point: point from which to step.
        ds: length of the first step.
        is_trial: True to try one step of this length without taking it; None is then the answer for a step that is
            not accepted, or too long.
    """

    walk: DirectedBranch
    start: BranchPoint
    point: BranchPoint
    ds: float
    is_trial: bool = False

    @property
    def sequence(self) -> Sequence:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Sequence of the cycles."""
        return self.point.sequence


class StepState(NamedTuple):
    """Quantities by which steps are judged.

    Attributes:
        place: the point.
        tangent: of the branch there.
        margins: values of the test functions of the sequence, (tests,).
        slopes: derivatives of these along the branch.
        neighbours: values of the test functions of the multipliers, (4,).
        grips: that impacts leave, see `grips` of `test_functions.py`; empty without friction of contacts.
        num_unstable: number of unstable multipliers.
        multipliers: (2 n,).
        past: as in `CorrectedCycle`.
    """

    place: ExtendedCycle
    tangent: ExtendedCycle
    margins: Array
    slopes: Array
    neighbours: Array
    grips: Array
    num_unstable: Array
    multipliers: Array
    past: Array

    @classmethod
    def of(cls, sequence: Sequence, cycle: CorrectedCycle) -> "StepState":
        """State at a corrected cycle."""
        return cls(
            cycle.found.place,
            cycle.found.tangent,
            margins(sequence, cycle),
            test_slopes(sequence, cycle),
            cycle.neighbours,
            grips(sequence, cycle),
            num_unstable(cycle),
            cycle.found.multipliers,
            cycle.past,
        )


class StepLimits(NamedTuple):
    """Limits that a plain step neither passes nor exceeds.

    Attributes:
        num_periods: n.
        bounds: of the scaled parameter, (2,).
        longest: longest step, along the scaled parameter or for a cycle of size 1.
        start: first point of the branch.
        tangent: there; zero if the sequence has changed since.
    """

    num_periods: Any
    bounds: Any
    longest: Any
    start: ExtendedCycle
    tangent: ExtendedCycle


def is_accepted(known: StepState, new: StepState, cycle: CorrectedCycle, ds: Scalar) -> Flag:
    """True where the corrector converged fast and the tangents at both ends are close."""
    found = cycle.found
    is_near = found.is_converged & (found.first < 10 * ds) & (found.num_steps <= _MANY)
    return is_near & (new.tangent.along(known.tangent) > LEAST_COSINE)


def is_resolved(known: StepState, new: StepState, ds: Scalar) -> Flag:
    """True where a step is short enough: no pair of multipliers passes +1, and no function of it vanishes twice."""
    is_slow = (_multiplier_motion(known, new) <= MULTIPLIER_MOVE) | (ds <= NARROWEST_BY_MOVE)
    falls, rises = known.slopes * ds / 3, new.slopes * ds / 3
    # The Hermite cubic through both ends is positive if these two of its Bernstein coefficients are.
    dips = (falls < 0) & (rises > 0) & ((known.margins + falls <= 0) | (new.margins - rises <= 0))
    is_known = (known.margins > 0) & (new.margins > 0)
    return is_slow & ~jnp.any(dips & is_known) & ~(_turns_at_zero(known, new, ds) & (ds > SEPARATE_EVENTS))


def _turns_at_zero(known: StepState, new: StepState, ds: Scalar) -> Flag:
    """True where a function of multipliers seems to pass zero and come back on a step.

    Their slopes are not known: the parabola through the last three points does so.
    """
    sign, before, here, after = jnp.sign(known.neighbours), known.past[:-1], known.neighbours, new.neighbours
    rise = (here - before) / known.past[-1]
    bend = ((after - here) / ds - rise) / (known.past[-1] + ds)
    slope = rise + bend * known.past[-1]
    is_turning = (sign * slope < 0) & (sign * (slope + 2 * bend * ds) > 0)
    is_beyond = sign * (here - slope**2 / jnp.where(is_turning, 4 * bend, 1)) < 0
    is_rounding = jnp.maximum(jnp.abs(here), jnp.abs(after)) < ROUNDED_FUNCTION
    return jnp.any(is_turning & is_beyond & (here * after > 0) & ~is_rounding)


def next_length(known: StepState, new: StepState, cycle: CorrectedCycle, ds: Scalar, most: Scalar) -> Scalar:
    """Length of the step after one of length `ds`, at most `most` for a cycle of size 1."""
    steps = cycle.found.num_steps
    grown = ds * jnp.where(steps <= _FEW, 1.5, jnp.where(steps < _MANY, 1.2, 0.7))
    # Cycles may grow far beyond the first one; along the parameter no step exceeds `most`.
    size = jnp.maximum(jnp.max(jnp.abs(new.place.z)), 1)
    along_parameter = most / jnp.maximum(jnp.abs(new.tangent.p), ROUNDED)
    longest = jnp.minimum(most * size, jnp.maximum(along_parameter, most))
    grown = jnp.minimum(jnp.where(ds == PROBE_STEP, FIRST_STEP, grown), longest)
    planned = ds * PLANNED_MOVE / jnp.maximum(_multiplier_motion(known, new), np.finfo(float).tiny)
    return jnp.minimum(grown, jnp.maximum(planned, NARROWEST_BY_MOVE))


def _multiplier_motion(known: StepState, new: StepState) -> Scalar:
    """Largest move of a complex multiplier, relative to its distance from +1."""
    mu, before = new.multipliers, known.multipliers
    is_pair = jnp.isfinite(mu) & (jnp.abs(jnp.imag(mu)) > ROUNDED)
    mu = jnp.where(is_pair, mu, 0)
    ways = jnp.abs(mu[:, None] - before[None, :])
    way = jnp.min(jnp.where(jnp.isfinite(ways), ways, jnp.inf), axis=1)
    return jnp.max(jnp.where(is_pair, way / jnp.maximum(jnp.abs(mu - 1), ROUNDED), 0))


def is_plain(sequence: Sequence, known: StepState, new: StepState, limits: StepLimits, ds: Scalar) -> Flag:
    """True where a step passes no zero of a test function, no bound, no start of a cycle or of the branch."""
    is_met = jnp.any((known.margins > 0) & (new.margins <= 0))
    is_special = jnp.any(is_crossed(known.neighbours, new.neighbours))
    if new.grips.size:
        is_special = is_special | jnp.any(is_crossed(known.grips, new.grips))
    is_odd = (new.num_unstable - known.num_unstable) % 2 != 0
    is_out = (new.place.p < limits.bounds[0]) | (new.place.p > limits.bounds[1])
    times = jnp.cumsum(new.place.flights)
    is_other = jnp.any(sequence.is_event & ((times < 0) | (times > limits.num_periods)))
    s = limits.start.along(known.tangent) - known.place.along(known.tangent)
    is_back = (s > 0) & (s <= ds) & (limits.tangent.along(known.tangent) >= LEAST_COSINE)
    return ~(is_met | is_special | is_odd | is_out | is_other | is_back)


def is_followed_or_unstable(sequence: Sequence, cycle: CorrectedCycle, followed: SimulatedMotion) -> Any:
    """Flag, of JAX or of NumPy: a run follows the cycle with as many events, or cannot, as a multiplier exceeds `TRUSTED`."""
    is_same_number = (followed.sequence.kind != NOTHING).sum() == (sequence.kind != NOTHING).sum()
    is_untrusted = ~(abs(cycle.found.multipliers[0]) < TRUSTED)
    return (followed.is_alike & is_same_number) | (~followed.is_alike & is_untrusted)
