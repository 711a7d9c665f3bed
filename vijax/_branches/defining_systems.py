"""Defining systems: equations whose solution is a bifurcation, and that solution as a function of the machine.

The equations of a cycle, see `cycle.py`, with the parameter as one more unknown, are extended by a condition:

    fold, period doubling, Neimark-Sacker    Z - e^{i theta} N is singular; theta is one more unknown
    grazing, a force that touches zero       the value that defines the event, a gap or a force, has zero rate
    double impact                            the flight between both impacts has zero duration
    crossing-sliding                         friction would stick where it turns, or just stops within an impact
    branch point                             Z - N, with the derivative by the parameter as a column, is singular
    peak                                     a quantity is stationary along the branch; the times of its extremes are unknowns

(Z, N) is the pencil of the neighbours, see `condensation.py`: nothing is divided by the speed of an impact. A matrix A
is singular where the last unknown psi of the bordered equations

    A y + b psi = 0,    c* y = 1

vanishes. (The determinant of A was rejected: its size means nothing.) The real and the imaginary part of psi are two
equations. At a fold and a period doubling psi is real where theta is 0 or pi, and its imaginary part keeps theta
there: one system serves all three. At a branch point, where a symmetry makes two branches cross, the equations of a
cycle are singular whatever condition is added; so beta b is added to the closing, with one more unknown beta, which is
zero at the solution.
"""

import abc
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from .._jax.arrays import Reals, Scalar
from .._jax.xla import compile_quickly
from .._orbits.condensation import condense
from .._orbits.cycle import Problem, Residual, Unknowns, residual
from .._orbits.linear_cycle import linearise
from .._orbits.newton import has_converged, is_worth_a_step
from .._orbits.sequence import Sequence
from .parameter_family import ExtendedCycle, ParameterFamily

_MAX_STEPS = 16


class TrialCycle(NamedTuple):
    """Iterate of Newton's method.

    Attributes:
        family: of the machines.
        place: the unknowns of the cycle, with the parameter, scaled.
        problem: the equations of the cycle.
        unknowns: its unknowns without the parameter, not scaled.
    """

    family: ParameterFamily
    place: ExtendedCycle
    problem: Problem
    unknowns: Unknowns


class AbstractCondition(eqx.Module):
    """Condition by which a cycle is a bifurcation.

    Attributes:
        own: guesses of its unknowns beside those of the cycle, (own,).
    """

    own: eqx.AbstractVar[Reals]

    def begun(self, cycle: TrialCycle) -> "AbstractCondition":
        """Condition with the data, such as borders, that it takes from the first iterate of Newton's method, if any."""
        del cycle
        return self

    @abc.abstractmethod
    def values(self, cycle: TrialCycle, own: Float[Array, " own"]) -> Float[Array, " conditions"]:
        """Values that vanish at the bifurcation, one more than the condition has unknowns."""

    def residual_and_values(
        self, cycle: TrialCycle, own: Float[Array, " own"]
    ) -> tuple[Residual, Float[Array, " conditions"]]:
        """Residual of the equations of the cycle, and `values`, in one pass where these take the linearised equations."""
        return residual(cycle.problem, cycle.unknowns), self.values(cycle, own)

    def unfolding(self, own: Float[Array, " own"]) -> Float[Array, "..."]:
        """Term added to the closing, zero at a solution; only singular equations of a cycle need one."""
        del own
        return jnp.zeros(())


class AtMultiplier(AbstractCondition):
    """Condition that a multiplier is e^{i theta}.

    Attributes:
        own: theta, (1,).
        borders: b and c, unit vectors, (2, 2 n).
    """

    own: Reals
    borders: Reals

    def begun(self, cycle):
        left, _, right = jnp.linalg.svd(_singular(cycle, self.own[0])[1])
        return AtMultiplier(self.own, jnp.stack([left[:, -1], right[-1].conj()]))

    def values(self, cycle, own):
        return self.residual_and_values(cycle, own)[1]

    def residual_and_values(self, cycle, own):
        (found, singular), (b, c) = _singular(cycle, own[0]), self.borders
        bordered = jnp.block([[singular, b[:, None]], [c.conj()[None], jnp.zeros((1, 1), b.dtype)]])
        psi = jnp.linalg.solve(bordered, jnp.zeros_like(bordered[0]).at[-1].set(1))[-1]
        return found, jnp.stack([psi.real, psi.imag])


class AtBranchPoint(AbstractCondition):
    """Condition that another branch crosses.

    Attributes:
        own: beta, (1,).
        left: b, a unit vector, (2 n,).
        right: c, two unit vectors, (2, 2 n + 1).
    """

    own: Reals
    left: Reals
    right: Reals

    def begun(self, cycle):
        left, _, right = jnp.linalg.svd(_with_parameter(cycle)[1])
        return AtBranchPoint(self.own, left[:, -1], right[-2:])

    def values(self, cycle, own):
        return self.residual_and_values(cycle, own)[1]

    def residual_and_values(self, cycle, own):
        (found, singular), b, c = _with_parameter(cycle), self.left, self.right
        bordered = jnp.block([[singular, b[:, None]], [c, jnp.zeros((2, 1), b.dtype)]])
        return found, jnp.linalg.solve(bordered.T, jnp.zeros_like(bordered[0]).at[-1].set(1))[-2:]

    def unfolding(self, own):
        return own[0] * self.left


class AtEvent(AbstractCondition):
    """Condition that the value that defines an event has zero rate, or that its flight has zero duration.

    Attributes:
        own: empty, (0,).
        index: number of the event.
        is_tangent: True for the rate, False for the duration.
    """

    own: Reals
    index: Reals
    is_tangent: Reals

    def values(self, cycle, own):
        problem, unknowns = cycle.problem, cycle.unknowns
        is_event = jnp.arange(len(unknowns.flights)) == self.index
        ending = lambda flights: residual(problem, unknowns._replace(flights=flights)).events  # noqa: E731
        _, changes = jax.jvp(ending, (unknowns.flights,), (is_event.astype(unknowns.flights.dtype),))
        values = jnp.where(self.is_tangent, changes, unknowns.flights)
        return jnp.sum(jnp.where(is_event, values, 0))[None]


class AtTurn(AbstractCondition):
    """Condition that friction would stick where it turns: the force beyond its grip vanishes, see `EndOfFlight`.

    Attributes:
        own: empty, (0,).
        index: number of the turn.
    """

    own: Reals
    index: Reals

    def values(self, cycle, own):
        speed = residual(cycle.problem, cycle.unknowns).speed
        return jnp.sum(jnp.where(jnp.arange(len(speed)) == self.index, speed, 0))[None]


class AtGrip(AbstractCondition):
    """Condition that friction of a contact just stops within an impact, see `grip` of `EndOfFlight`.

    Attributes:
        own: empty, (0,).
        index: number of the impact.
        element: number of the friction element, behind the stops.
    """

    own: Reals
    index: Reals
    element: Reals

    def values(self, cycle, own):
        grip = residual(cycle.problem, cycle.unknowns).grip
        is_own = (jnp.arange(len(grip)) == self.index)[:, None] & (jnp.arange(grip.shape[1]) == self.element)[
            None
        ]
        return jnp.sum(jnp.where(is_own, grip, 0))[None]


def _singular(cycle: TrialCycle, theta: Scalar) -> tuple[Residual, Complex[Array, "state state"]]:
    """Residual, and Z - e^{i theta} N."""
    found, flights = linearise(cycle.problem, cycle.unknowns, cycle.family.scale)
    pencil = condense(flights).pencil
    return found, pencil.end - jax.lax.complex(jnp.cos(theta), jnp.sin(theta)) * pencil.start


def _with_parameter(cycle: TrialCycle) -> tuple[Residual, Float[Array, "state free"]]:
    """Residual, and Z - N with a column for the parameter, the first of two."""
    family = cycle.family
    problem, change = family.linear_problem(cycle.problem.sequence, cycle.place.p)
    found, flights = linearise(problem, cycle.unknowns, family.scale, change=change)
    pencil = condense(flights).pencil
    return found, pencil.end - pencil.start[: len(family.scale)]


class DefiningSystem(eqx.Module):
    """Defining system.

    Attributes:
        family: of the machines.
        sequence: of the events of the orbit.
        condition: by which the orbit is a bifurcation.
    """

    family: ParameterFamily
    sequence: Sequence
    condition: AbstractCondition

    def unknowns(self, place: ExtendedCycle) -> Float[Array, " unknowns"]:
        """Cycle and unknowns of the condition as one vector.

        Without empty parts: on one core XLA fails to convert a program that cuts an empty part out of a concatenation
        with an empty array, says nothing, and then finds no LAPACK in what follows.
        """
        parts = (jnp.ravel(a) for a in (*place, self.condition.own))
        return jnp.concatenate([a for a in parts if a.size])

    def place(self, y: Float[Array, " unknowns"]) -> tuple[ExtendedCycle, Float[Array, " own"]]:
        """Cycle and unknowns of the condition from one vector."""
        size, span = len(self.family.scale), self.family.span
        end = len(y) - len(self.condition.own)
        first = end - span.size
        return ExtendedCycle(y[:size], y[size:first], y[first:end].reshape(span.shape)), y[end:]

    def cycle(self, place: ExtendedCycle) -> TrialCycle:
        """The cycle with its equations."""
        return TrialCycle(
            self.family, place, self.family.problem(self.sequence, place.p), self.family.unknowns(place)
        )

    def begun(self, y: Float[Array, " unknowns"]) -> "DefiningSystem":
        """System whose condition has its data from a cycle."""
        place, own = self.place(y)
        condition = replace(self.condition, own=own)
        return replace(self, condition=condition.begun(self.cycle(place)))

    def values(self, y: Float[Array, " unknowns"]) -> Float[Array, " equations"]:
        """Residuals of the equations."""
        place, own = self.place(y)
        cycle = self.cycle(place)
        found, values = self.condition.residual_and_values(cycle, own)
        closing = found.closing / self.family.scale + self.condition.unfolding(own)
        return jnp.concatenate([closing, found.events, values])

    def linearised(
        self, y: Float[Array, " unknowns"]
    ) -> tuple[Float[Array, "equations unknowns"], Float[Array, " equations"]]:
        """Jacobian by the unknowns, and residuals."""

        def twice(y: Array) -> tuple[Array, Array]:
            values = self.values(y)
            return values, values

        return jax.jacfwd(twice, has_aux=True)(y)


class _Now(NamedTuple):
    y: Array
    matrix: Array
    step: Array
    last: Array
    num_steps: Array


class Plane(NamedTuple):
    """Equation `weights . y = target`, added where there are two parameters."""

    weights: Reals
    target: Reals


class Solved(NamedTuple):
    """Result of Newton's method.

    Attributes:
        defining: the system, with the data that its condition takes from the guess.
        y: the unknowns.
        matrix: Jacobian, its last row that of the plane.
        num_steps: number of Newton steps.
        is_found: whether the last step is rounding.
    """

    defining: DefiningSystem
    y: Float[Array, " unknowns"]
    matrix: Float[Array, "equations unknowns"]
    num_steps: Int[Array, ""]
    is_found: Bool[Array, ""]


def solve(defining: DefiningSystem, guess: Float[Array, " unknowns"], plane: Plane | None = None) -> Solved:
    """Solve a defining system by Newton's method from a guess."""
    defining = defining.begun(guess)

    def is_on(now: _Now) -> Array:
        return is_worth_a_step(now.step, now.last, now.num_steps, _MAX_STEPS)

    def one(now: _Now) -> _Now:
        matrix, values = defining.linearised(now.y)
        if plane is not None:
            matrix = jnp.vstack([matrix, plane.weights])
            values = jnp.append(values, plane.weights @ now.y - plane.target)
        step = jnp.linalg.solve(matrix, values)
        return _Now(now.y - step, matrix, jnp.max(jnp.abs(step)), now.step, now.num_steps + 1)

    big, size = jnp.asarray(jnp.finfo(guess.dtype).max, guess.dtype), len(guess)
    first = _Now(guess, jnp.zeros((size, size), guess.dtype), big, big, jnp.array(0))
    last = jax.lax.while_loop(is_on, one, first)
    return Solved(defining, last.y, last.matrix, last.num_steps, has_converged(last.step))


@eqx.filter_custom_jvp
def implicit_solution(defining: DefiningSystem, y: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
    """Solution as a function of the machine, with derivatives by the implicit function theorem."""
    del defining
    return y


@implicit_solution.def_jvp
def _implicit_jvp(primals, tangents):
    defining, y = primals
    y = implicit_solution(defining, y)
    return y, -jnp.linalg.solve(_matrix(defining, y), _moved(defining, tangents[0], y))


# Two separate programs: derivatives of all kinds share the first, outside of `jax.jit`.
@compile_quickly
def _matrix(defining: DefiningSystem, y: Float[Array, " unknowns"]) -> Float[Array, "unknowns unknowns"]:
    return defining.linearised(y)[0]


@compile_quickly
def _moved(defining: DefiningSystem, change: Any, y: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
    return eqx.filter_jvp(lambda defining: defining.values(y), (defining,), (change,))[1]
