"""Newton's method on the equations of a cycle, and the implicit derivatives of its solution.

`is_worth_a_step` and `has_converged` end every Newton's method on a cycle, a bifurcation or an invariant circle.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Reals, Scalar, array_namespace
from .._jax.xla import in_lanes_of
from .condensation import Pencil, condense, solve_condensed
from .cycle import Problem, Residual, Unknowns, residual
from .linear_cycle import linearise

# Steps are relative to the solution. `_CONVERGED`: step that has converged, the root of eps; one below it that is not under
# half the last one is rounding. `_ROUNDING`: so is a step below so many eps, as residuals have the rounding of a few terms.
_CONVERGED, _ROUNDING = {"float64": 1e-8, "float32": 3e-4}, 4.0
# Step behind which the next is rounding.
_TINY = 1e-10
_MAX_STEPS = 24


def is_worth_a_step(
    step: Reals,
    last: Reals,
    num_steps: Reals,
    most: int,
    *,
    tolerance: Reals | float | None = None,
    settled: float | None = None,
) -> Any:
    """Flag, of JAX or of NumPy: Newton's method takes its next step.

    Args:
        step: size of the next step, relative to the solution.
        last: size of the step before, very large if there is none.
        num_steps: number of steps so far.
        most: largest number of steps.
        tolerance: size of a step below which the solution counts as found; rounding, if left out.
        settled: size of a step behind which the next is rounding, as steps shrink quadratically; without it that is computed, as
            for branches, whose lengths of steps follow the number of Newton's.
    """
    is_found = (step < _ROUNDING * np.finfo(step.dtype).eps) | (has_converged(step) & (step >= last / 2))
    is_found = is_found if settled is None else is_found | (last < settled)
    is_found = is_found if tolerance is None else is_found | (step < tolerance)
    return (num_steps < most) & ~is_found & array_namespace(step).isfinite(step)


def has_converged(step: Reals) -> Any:
    """Flag, of JAX or of NumPy: a step of Newton's method is small enough for a solution."""
    return step < _CONVERGED[str(step.dtype)]


class Polished(NamedTuple):
    """State of Newton's method.

    Attributes:
        unknowns: the cycle.
        residual: residual of its equations.
        pencil: of its neighbours, for the multipliers; in scaled coordinates.
        first: change of the start by the first step, (2 n,).
        step: size of the next step, relative to the orbit.
        last: size of the step before.
        num_steps: number of steps.
    """

    unknowns: Unknowns
    residual: Residual
    pencil: Pencil
    first: Float[Array, " state"]
    step: Scalar
    last: Scalar
    num_steps: Int[Array, ""]

    @property
    def is_converged(self) -> Bool[Array, ""]:
        """True where only rounding is left."""
        return has_converged(self.step)


def scale_of(problem: Problem, z: Float[Array, " state"]) -> Float[Array, " state"]:
    """Sizes of positions and velocities of a motion, to which errors and steps are relative, (2 n,)."""
    x, v = jnp.split(jnp.abs(z), 2)
    limit, frequency = jnp.abs(problem.machine.contacts.limit), problem.machine.frequency
    length = jnp.maximum(jnp.max(x), jnp.max(v) / frequency)
    length = jnp.maximum(length, jnp.max(limit, initial=0))
    length = jnp.where(length > 0, length, 1)
    return jnp.repeat(jnp.stack([length, length * frequency]), len(x))


def polish(problem: Problem, guess: Unknowns) -> Polished:
    """Solve the equations of a cycle by Newton's method from a guess."""
    scale = scale_of(problem, guess.z)
    count = jnp.sum(problem.sequence.is_event)

    def is_on(carry: tuple[Unknowns, Polished]) -> Array:
        now = carry[1]
        return is_worth_a_step(now.step, now.last, now.num_steps, _MAX_STEPS, settled=_TINY)

    def one(carry: tuple[Unknowns, Polished]) -> tuple[Unknowns, Polished]:
        here, before = carry
        found, flights = linearise(problem, here, scale, count)
        equations = condense(flights, count)
        dz, dflights = solve_condensed(equations, -found.events, -found.closing / scale, count)
        step = jnp.maximum(jnp.max(jnp.abs(dz)), jnp.max(jnp.abs(dflights), initial=0))
        first = jnp.where(before.num_steps == 0, dz * scale, before.first)
        now = Polished(here, found, equations.pencil, first, step, before.step, before.num_steps + 1)
        return Unknowns(here.z + dz * scale, here.flights + dflights), now

    return jax.lax.while_loop(is_on, one, in_lanes_of(guess.z, (guess, _nothing(guess))))[1]


def _nothing(guess: Unknowns) -> Polished:
    """The state before the first step."""
    z, events = guess
    big, square = jnp.asarray(jnp.finfo(z.dtype).max, z.dtype), jnp.zeros((len(z), len(z)), z.dtype)
    nothing = Residual(jnp.zeros_like(events), jnp.zeros_like(z), jnp.zeros_like(events))
    return Polished(guess, nothing, Pencil(square, square), jnp.zeros_like(z), big, big, jnp.array(0))


def pencil_of(problem: Problem, unknowns: Unknowns) -> Pencil:
    """Pencil of the neighbours of an orbit, differentiable."""
    scale = jax.lax.stop_gradient(scale_of(problem, unknowns.z))
    return condense(linearise(problem, unknowns, scale)[1]).pencil


@eqx.filter_custom_jvp
def implicit_orbit(problem: Problem, unknowns: Unknowns) -> Unknowns:
    """Unknowns of an orbit as a function of its machine: derivatives by the implicit function theorem."""
    del problem
    return unknowns


@implicit_orbit.def_jvp
def _implicit_jvp(primals, tangents):
    problem, unknowns = primals
    unknowns = implicit_orbit(problem, unknowns)
    scale = scale_of(problem, unknowns.z)
    _, moved = eqx.filter_jvp(lambda problem: residual(problem, unknowns), (problem,), (tangents[0],))
    _, flights = linearise(problem, unknowns, scale)
    change = solve_condensed(condense(flights), -moved.events, -moved.closing / scale)
    return unknowns, Unknowns(change[0] * scale, change[1])
