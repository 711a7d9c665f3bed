"""Taylor series of the motion of a linear machine between events, exact to rounding.

For M x'' + C x' + K x = f(t) with a periodic f every Taylor coefficient follows from the two before it, by one product
with C and one with K. With rate * step <= 1.5, where `rate` bounds the first-order matrix in the energy norm, 22 terms
leave 1.5^22 / 22! = 7e-18 of the motion and cancellation costs at most e^1.5 roundings.

One recurrence serves every machine: any damping, proportional to the stiffness or not, from none through critical to
heavy; rigid-body modes, exact resonance, repeated frequencies; and any set of held masses (with zero coefficients). It
has no division that could fail, so its derivatives by every parameter are as accurate as its values. The same numbers
give the derivatives of every gap and contact force, their bounds, and increments instead of differences.

The recurrence is a loop over the order (`scan`). If it is unrolled, XLA recomputes every coefficient from the first,
which was 3 times slower and took twice as long to compile.

A normal-mode solution for every set of held masses needs case distinctions for resonance, another method for damping
that the modes do not diagonalise, tables of 2^stops sets, and has no derivative at repeated frequencies. Where none of
that matters it is faster, and `ModalFlow` is used instead.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jax.arrays import Scalar, add_up, matvec
from .._jax.xla import compute_once
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State
from .interface import StepMotion

_SHORT = 4
# Most orders that are unrolled without a call each: of more, XLA would compute each from the first.
_UNROLLED = 5


def taylor_series(
    machine: Machine, state: State, hold: Held, order: int, *, unroll: bool = False
) -> tuple[Float[Array, "_ n ..."], Float[Array, "_ n ..."], Float[Array, "_ 2 harmonics ..."]]:
    """Taylor coefficients of positions, up to `order`, of forces, and of the forcing phase."""
    extend, start = next_coefficients(machine, hold), rows_of_state(state)
    if unroll and order > _UNROLLED:
        extend = partial(compute_once, extend)
    _, coefficients = jax.lax.scan(extend, start, orders(order, state), unroll=unroll)
    x, force = (vector(rows, len(state.x), axis=1) for rows in coefficients[:2])
    phase = jnp.stack(coefficients[2], axis=1).reshape(len(x), *state.phase.shape)
    x = jnp.concatenate([jnp.stack([state.x, state.v]), x])
    return x, force, jnp.concatenate([state.phase[None], phase])


def orders(order: int, state: State) -> tuple[Float[Array, " orders"], ...]:
    """Factors k, 1 / (k + 1) and 1 / ((k + 1) (k + 2)) of every order, tabulated because divisions are slow."""
    k = np.arange(order - 1)
    return tuple(jnp.asarray(a, state.x.dtype) for a in (k, 1 / (k + 1), 1 / ((k + 1) * (k + 2))))


def rows_of_state(state: State) -> tuple[list[Array], list[Array], list[Array]]:
    _, waves = state.phase.shape[:2]
    return _rows(state.x), _rows(state.v), [state.phase[i, h] for i in range(2) for h in range(waves)]


def next_coefficients(machine: Machine, hold: Held) -> Callable:
    """Recurrence: from coefficients k, k + 1 of x and k of the phase to the next ones, and coefficient k of the force.

    Short vectors are lists of their rows: each row is then one pass over the lanes, whichever axis `vmap` gives them.
    """
    n, mean, tables = machine.num_masses, _rows(machine.mean), machine.tables
    num_harmonics = machine.waves.num_harmonics
    waves = [_rows(row) for load in (machine.waves.cosine, machine.waves.sine) for row in load]
    speeds = [machine.frequency * (h + 1) for h in range(num_harmonics)]
    if machine.tones is not None:
        speeds = list(machine.tones.speeds)

    def product(matrix: Float[Array, "n n ..."], x: list[Array]) -> list[Array]:
        if n > _SHORT:
            return [matvec(matrix, x[0])]
        return [add_up([matrix[i, j] * x[j] for j in range(n)]) for i in range(n)]

    def extend(last, order):
        (x, x_next, phase), (k, by_next, by_next_two) = last, order
        columns = None
        if tables is not None:
            phase, columns = _parted(phase, num_harmonics)
        spring, drag = product(machine.stiffness, x), product(machine.damping, x_next)
        force = []
        for i in range(len(x)):
            load = add_up([wave[i] * p for wave, p in zip(waves, phase, strict=True)])
            force.append(load + jnp.where(k == 0, mean[i], 0) - (k + 1) * drag[i] - spring[i])
        if tables is not None and columns is not None:
            force = [a + b for a, b in zip(force, _rows(tables.load(columns)), strict=True)]
        of_phase = jnp.stack(phase).reshape(2, num_harmonics, *phase[0].shape)
        x_new = machine.contacts.accelerations(vector(force, n), hold, of_phase)
        x_new = [by_next_two * a for a in _rows(x_new)]
        cos, sin = phase[: len(speeds)], phase[len(speeds) :]
        phase_new = [-w * s * by_next for w, s in zip(speeds, sin, strict=True)]
        phase_new += [w * c * by_next for w, c in zip(speeds, cos, strict=True)]
        if tables is not None and columns is not None:
            phase_new = _joined(phase_new, by_next * tables.rate(columns))
        return (x_next, x_new, phase_new), (x_new, force, phase_new)

    return extend


def _parted(phase: list[Array], num_harmonics: int) -> tuple[list[Array], Float[Array, "2 columns ..."]]:
    """Rows of a phase of harmonics, and columns of loads by tables."""
    half = len(phase) // 2
    parts = phase[:half], phase[half:]
    harmonics = [*parts[0][:num_harmonics], *parts[1][:num_harmonics]]
    return harmonics, jnp.stack([jnp.stack(part[num_harmonics:]) for part in parts])


def _joined(harmonics: list[Array], columns: Float[Array, "2 columns ..."]) -> list[Array]:
    """Inverse of `_parted`."""
    half = len(harmonics) // 2
    return [*harmonics[:half], *columns[0], *harmonics[half:], *columns[1]]


def _rows(vector: Float[Array, "n ..."]) -> list[Array]:
    return list(vector) if len(vector) <= _SHORT else [vector]


def vector(rows: list[Array], n: int, axis: int = 0) -> Array:
    return jnp.stack(rows, axis) if n <= _SHORT else rows[0]


def sum_series(
    x: Float[Array, "_ n ..."], phase: Float[Array, "_ 2 harmonics ..."], step: Scalar
) -> StepMotion:
    """Displacement, velocity and change of the phase at `step`."""
    return step * horner(x[1:], step), horner(derivative(x), step), step * horner(phase[1:], step)


def derivative(coefficients: Float[Array, "_ ..."] | list[Array]) -> list[Array]:
    """Coefficients of the derivative of a polynomial."""
    return [k * coefficients[k] for k in range(1, len(coefficients))]


def horner(coefficients: Float[Array, "_ ..."] | list[Array], u: Scalar) -> Array:
    """Value of a polynomial at u, by Horner's scheme."""
    total = coefficients[-1]
    for k in range(len(coefficients) - 2, -1, -1):
        total = total * u + coefficients[k]
    return total
