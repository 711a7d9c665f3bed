"""Impact law, and the restitution matrices of Wagg & Bishop (2004)."""

from collections.abc import Sequence
from itertools import combinations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from .._jax.arrays import Numbers, as_float
from .._machine.machine import Machine
from .._machine.state import State
from .friction_impacts import rebound_with_friction


def rebound(
    machine: Machine,
    state: State,
    hit: Bool[Array, "stops ..."],
    kept: Bool[Array, "stops ..."] | None = None,
) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
    """Positions and velocities after impacts on the stops `hit`: gaps closed, u -> -r u (Eq. 11).

    The stops `kept` stay closed during the impacts. They are chosen elsewhere, so this map is smooth.
    """
    if machine.has_tied_friction:  # which chooses what closed contacts do
        return rebound_with_friction(machine, state, hit)[:2]
    contacts, phase_rate = machine.contacts, machine.phase_rate(state.phase)
    kept = jnp.zeros_like(hit) if kept is None else kept
    x = contacts.with_closed_gaps(state.x, hit, state.phase)
    return x, contacts.reflected(state.v, hit, kept, phase_rate)


def before(
    machine: Machine,
    state: State,
    hit: Bool[Array, "stops ..."],
    approach: Float[Array, "stops ..."],
) -> Float[Array, "n ..."]:
    """Velocities before `rebound`, from the speeds of approach u to the stops `hit`: r = 0 erases them."""
    return machine.contacts.with_approach(state.v, hit, approach, machine.phase_rate(state.phase))


def restitution_matrix(num_masses: int, restitutions: dict[int, ArrayLike]) -> Float[Array, "n n"]:
    """Return the restitution matrix R of the velocities, v_after = R v_before (Eq. 12).

    Args:
        num_masses: n.
        restitutions: restitution of every mass that impacts.

    Returns:
        Diagonal matrix with -r for the masses that impact and 1 for the others, (n, n).

    Example:
        ```python
        import vijax as vx
        both = vx.restitution_matrix(2, {0: 0.7, 1: 0.7})
        ```

    References:
        Wagg & Bishop (2004), Eqs. 12 and 23.
    """
    _check_masses(num_masses, tuple(restitutions))
    diagonal = jnp.ones(num_masses)
    for i, r in restitutions.items():
        diagonal = diagonal.at[i].set(-as_float(r))
    return jnp.diag(diagonal)


def modal_restitution_matrix(modes: Numbers, restitutions: dict[int, ArrayLike]) -> Float[Array, "n n"]:
    """Return the restitution matrix of the modal velocities, R^ = Psi^-1 R Psi (Eq. 15).

    Args:
        modes: Psi, shape (n, n), one mode a column.
        restitutions: restitution of every mass that impacts.

    Returns:
        The matrix, (n, n).

    Example:
        ```python
        import jax.numpy as jnp, vijax as vx
        modes = jnp.linalg.eigh(jnp.array([[2.0, -1.0], [-1.0, 1.0]]))[1]
        one = vx.modal_restitution_matrix(modes, {0: 0.7})
        ```

    References:
        Wagg & Bishop (2004), Eqs. 14-17.
    """
    modes = as_float(modes, "modes")
    if modes.ndim != 2 or modes.shape[0] != modes.shape[1]:
        raise ValueError(f"Argument `modes` must have shape (n, n), but has shape {modes.shape}.")
    return jnp.linalg.solve(modes, restitution_matrix(modes.shape[0], restitutions) @ modes)


def impact_configurations(masses: Sequence[int]) -> list[tuple[int, ...]]:
    """List the sets of masses that can impact at one instant: all non-empty subsets.

    Args:
        masses: the masses that have stops.

    Returns:
        The n_r = 2^n - 1 sets (Eq. 13), single impacts first.

    Example:
        ```python
        import vijax as vx
        assert vx.impact_configurations([0, 1]) == [(0,), (1,), (0, 1)]
        ```

    References:
        Wagg & Bishop (2004), Eq. 13.
    """
    unique = sorted(set(masses))
    return [s for k in range(1, len(unique) + 1) for s in combinations(unique, k)]


def _check_masses(num_masses: int, masses: tuple[int, ...]) -> None:
    for i in masses:
        if not 0 <= i < num_masses:
            raise ValueError(f"Mass {i} does not exist: the machine has masses 0 to {num_masses - 1}.")
