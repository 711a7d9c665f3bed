"""Rigid modes: shifts of the masses that no spring and no contact resists.

Along such a shift e, K e = 0, K^T e = 0 and A e = 0, and every cycle belongs to a family, shifted by a constant along e. The
equations of the cycle do not determine it, and one of the closing follows from the others, as the momentum along e is
that of the loads. The projection P onto all e, along some of the coordinates, repairs both. Added to the closing of the
velocities, P dx0 keeps the cycle where it is along e, and vanishes at the solution, as no other term has a part along
e. So the step of Newton's method is still exact. P is zero, to the last bit, where springs or contacts hold every mass.

Dry friction resists the speed along a shift, not the shift. Then no closing of velocities follows from the others, and
along the shift a cycle comes back by a constant displacement: a capsule robot progresses. Its closing along such a
shift, projected by D, is replaced by D dx0, which keeps the start where it is.

The pencil of the Floquet multipliers has an eigenvalue 1 for every e. Without damping it is double with one
eigenvector, and rounding keeps half its digits. So it is removed by the exact eigenvector (e, 0): Wielandt's deflation.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jax.arrays import Reals, array_namespace
from .._jax.concrete import stop_gradients
from .._machine.numbers import MachineNumbers
from .condensation import Pencil

# Smallest normalised singular value above which a concrete machine has no rigid mode.
_HELD = 1e-3


def free_shifts(numbers: MachineNumbers) -> Float[Array, "n n"]:
    """The projection P onto all rigid shifts; zero for a machine with a `force`, which may resist them."""
    return jnp.asarray(_free_shifts(stop_gradients(numbers)))


def _free_shifts(known: MachineNumbers) -> Reals:
    """`free_shifts`, by NumPy of a machine of its arrays: each function of JAX would be a program of its own."""
    stiffness, rows = known.stiffness, known.rows
    if known.force is not None:
        return jnp.zeros_like(stiffness)
    # Normalised: springs and contacts count alike, whatever their units.
    library, n = array_namespace(stiffness, rows), len(stiffness)
    stiffest = library.max(library.abs(stiffness))
    springs = stiffness / library.where(stiffest > 0, stiffest, 1)
    rows = rows / library.sqrt(library.sum(rows * rows, axis=1, keepdims=True))
    # The positions of first-order states stay 0.
    states = np.eye(n, dtype=stiffness.dtype)[n - known.num_states :]
    felt = library.concatenate([springs, springs.T, rows, states])
    if library is np and np.linalg.svd(felt, compute_uv=False)[-1] > _HELD:
        return np.zeros_like(stiffness)
    _, sizes, axes = library.linalg.svd(felt, full_matrices=False)
    free = library.where(sizes <= 64 * n * jnp.finfo(sizes.dtype).eps * sizes[0], 1, 0)[:, None] * axes
    return free.T @ free


def free_drifts(numbers: MachineNumbers) -> Float[Array, "n n"] | None:
    """The projection D onto shifts that nothing but friction and sliders resist; None for machines without both."""
    known = stop_gradients(numbers)
    if known.laws is None or not known.laws.has_no_gap.any():
        return None
    is_friction = known.laws.has_no_gap
    resisted = _free_shifts(known)
    others = eqx.tree_at(lambda own: own.rows, known, known.rows[~is_friction])
    beside = np.eye(len(resisted), dtype=resisted.dtype) - resisted
    return jnp.asarray(beside @ _free_shifts(others) @ beside)


def all_shifts(shifts: Float[Array, "n n"], drift: Float[Array, "n n"] | None) -> Float[Array, "n n"]:
    """The projection onto all shifts whose multiplier is 1."""
    return shifts if drift is None else shifts + drift


def num_of(drift: Reals | None) -> Reals:
    """Number of independent shifts of a projection, each of which has a multiplier 1 that tells nothing of stability."""
    return 0 if drift is None else array_namespace(drift).round(array_namespace(drift).trace(drift))


def of_positions(drift: Float[Array, "n n"]) -> Float[Array, "state state"]:
    """A projection of positions as one of states."""
    return jnp.kron(jnp.array([[1, 0], [0, 0]], drift.dtype), drift)


def closing_pin(shifts: Float[Array, "n n"]) -> Float[Array, "state state"]:
    """The matrix that adds P to the closing, by the state at the start."""
    return jnp.kron(jnp.array([[0, 0], [1, 0]], shifts.dtype), shifts)


def deflated(pencil: Pencil, shifts: Float[Array, "n n"]) -> Pencil:
    """The pencil with the multiplier of each shift replaced by zero."""
    end, start = pencil
    return Pencil(end - of_positions(shifts) @ start, start)


def drifts(numbers: MachineNumbers, shifts: Float[Array, "n n"]) -> Array:
    """True where the mean of the load has a part along a shift, so that no motion repeats."""
    mean = stop_gradients(numbers.mean)
    slack = 64 * len(shifts) * jnp.finfo(shifts.dtype).eps
    return jnp.any(jnp.abs(shifts.T @ mean) > slack * (jnp.abs(shifts.T) @ jnp.abs(mean)))
