"""The motion of a linear machine between events, exact to rounding: its Taylor series.

For M x'' + C x' + K x = f(t) with a periodic f every Taylor coefficient follows from the two before
it, by one product with C and one with K. With rate * step <= 1.5, where `rate` bounds the first-order
matrix in the norm of the energy, 22 terms leave 1.5^22 / 22! = 7e-18 of the motion and cancellation
costs at most e^1.5 roundings.

One recurrence serves every machine alike: any damping, proportional to the stiffness or not, from
none through critical to heavy, rigid-body modes, exact resonance, repeated frequencies, and any set of
held masses (their coefficients are zeros). It has no division that could fail, so its derivatives
by every parameter are as good as its values. The same numbers give the derivatives of every gap
and contact force, their bounds, and increments instead of differences.

A normal-mode solution per set of held masses needs case distinctions for resonance, another method for
damping that the modes do not diagonalise, tables of 2^stops sets, and has no derivative at repeated
frequencies. Where none of that matters it is faster, and `ModalFlow` is taken instead.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._machine import Machine, State
from .._types import Scalar, lift, matvec
from .._xla import compute_once
from .flow import AbstractFlow, Derivatives, Expansion

_ORDER_AND_TRUST = {"float64": (22, 1.5), "float32": (11, 1.0)}


class TaylorFlow(AbstractFlow):
    """Exact motion of a linear machine, by its Taylor series to rounding."""

    def expand(self, machine: Machine, state: State, is_held: Bool[Array, "n ..."]) -> "TaylorExpansion":
        """Expand the motion at `state` with the masses `is_held` at rest."""
        order, trust = _ORDER_AND_TRUST[str(state.x.dtype)]
        response = jnp.where(is_held, 0, machine.inverse_mass)
        speed = lift(machine.harmonics, state.phase[0]) * machine.frequency
        x, force, phase = [state.x, state.v], [], [state.phase]
        for k in range(order - 1):
            load = machine.oscillating_load(phase[k]) + (machine.mean if k == 0 else 0)
            damped = matvec(machine.damping, x[k + 1] * (k + 1))
            force.append(load - damped - matvec(machine.stiffness, x[k]))
            x.append(response * force[k] * (1 / ((k + 1) * (k + 2))))
            turn = speed * (1 / (k + 1))
            phase.append(jnp.stack(jnp.broadcast_arrays(-turn * phase[k][1], turn * phase[k][0])))
        now = Derivatives(2 * x[2], 6 * x[3], force[0], force[1], 2 * force[2])
        limit = trust / machine.rate
        return TaylorExpansion(now, limit, machine.always, tuple(x), tuple(force), tuple(phase))


class TaylorExpansion(Expansion):
    """Taylor coefficients of displacement, force and phase."""

    now: Derivatives
    limit: Scalar
    always: Bool[Array, ""]
    x: tuple[Float[Array, "n ..."], ...]
    forces: tuple[Float[Array, "n ..."], ...]
    phase: tuple[Float[Array, "2 harmonics ..."], ...]

    def rest(self, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 on [0, limit]: sums of absolute coefficients."""
        x_rest = _horner([jnp.abs(c) for c in self.x[4:]], limit)
        return x_rest, _horner([jnp.abs(c) for c in self.forces[3:]], limit)

    def move(
        self, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Sum the series at `step`."""
        return compute_once(self.always, _sum_series, self.x, self.phase, step)


def _sum_series(x: tuple[Array, ...], phase: tuple[Array, ...], step: Scalar) -> tuple[Array, ...]:
    velocity = [k * c for k, c in enumerate(x)][1:]
    return step * _horner(x[1:], step), _horner(velocity, step), _horner(phase, step)


def _horner(coefficients, u: Scalar) -> Array:
    total = coefficients[-1]
    for c in coefficients[-2::-1]:
        total = total * u + c
    return total
