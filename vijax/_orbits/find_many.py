"""All periodic orbits of one machine near some guesses."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers, as_numpy_float, refuse_single_precision, whole_number
from .._jax.concrete import is_traced
from .._jax.users_line import users_line
from .._jax.xla import padding_allowed
from .._progress import says_what_compiles, tqdm
from .._system.checks import validate_start
from .._system.periodicity import check_period
from .._system.system import AnySystem, machine_of
from .._trajectory.concrete_machine import known_machine
from .._trajectory.simulate import simulate_all
from .find import tell_of_search
from .many import search_each
from .orbit import PeriodicOrbit
from .rigid_modes import all_shifts, free_drifts, free_shifts
from .search import StroboscopicMap, with_room

# States closer than this, relative to the size of the orbit, belong to one orbit.
_SAME = 1e-6


@says_what_compiles
@padding_allowed
def find_periodic_orbits(
    system: AnySystem,
    starts: tuple[Numbers, Numbers] | Numbers,
    num_periods: Count = 1,
    *,
    args: object = None,
    flow: AbstractFlow | None = None,
    max_events: Count = 256,
    progress: bool = True,
) -> list[PeriodicOrbit]:
    """Find all periodic orbits near some guesses, stable and unstable, each once.

    Args:
        system: the machine; its numbers must be concrete, not traced.
        starts: guesses at phase 0: positions and velocities, (starts, n) each, or both side by side, (starts, 2 n).
        num_periods: n, the forcing periods after which they repeat. Orbits that repeat sooner are found as well. Before
            version 1.0 it stood in front of `starts`; this order still works, with a `DeprecationWarning`.
        args: as for `simulate`.
        flow: likewise.
        max_events: maximum number of events of a cycle.
        progress: show a progress bar.

    Returns:
        The orbits, sorted by the first position at phase 0. Orbits that coincide after some forcing periods, or up to
        a shift that no spring and no contact resists, count as one.

    Raises:
        ValueError: if numbers are traced, the load has no frequency, the starts have another shape, one lies beyond a
            stop, or 64-bit numbers are off.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_a(0.8)
        starts = np.random.default_rng(0).uniform(-0.3, 0.3, (100, 4))
        orbits = vx.find_periodic_orbits(system, starts, 1)
        ```
    """
    refuse_single_precision("find_periodic_orbits", system)
    if isinstance(starts, int | np.integer):
        starts, num_periods = _in_order(starts, num_periods)
    n, room = whole_number("num_periods", num_periods, 1), whole_number("max_events", max_events, 1)
    machine_of(system)  # or a sentence
    states = given_states(starts, system)
    if is_traced((system, args, flow)):
        raise ValueError(
            "`find_periodic_orbits` needs known numbers: call it outside of `jax.jit` and `jax.vmap`."
        )
    known = known_machine(system, args)
    check_period(known.system, *np.split(states[0], 2))
    t1 = np.asarray(2 * np.pi * n / known.system.forcing.frequency, states.dtype)
    for state in states:
        validate_start(known.system, 0 * t1, t1, t1[None], *np.split(state, 2))
    numbers, motion = known.numbers, known.flow(flow, can_stick=True)
    strobe = StroboscopicMap(
        numbers, motion, np.asarray(float(n), states.dtype), np.zeros((), states.dtype), room
    )
    with tqdm(total=len(states), unit="start", disable=not progress) as bar:
        axes = [None] * len(jax.tree.leaves(strobe))
        parts = search_each(strobe, axes, states, bar.update)
    searches = {lane: (part, k) for which, part in parts for k, lane in enumerate(which.tolist())}
    # Sorted by first position.
    starts_of = {
        lane: np.asarray(part.cycle.start[k]) for lane, (part, k) in searches.items() if part.is_orbit[k]
    }
    lanes = sorted(starts_of, key=lambda lane: tuple(starts_of[lane]))
    felt = np.eye(system.num_coordinates) - np.asarray(all_shifts(free_shifts(numbers), free_drifts(numbers)))
    different = _distinct_orbits(system, [starts_of[lane] for lane in lanes], felt, n, args, flow)
    orbits = []
    for part, k in (searches[lanes[i]] for i in different):
        search = with_room(jax.tree.map(lambda a, k=k: a[k], part), room)
        found, period, phase = vars(tell_of_search(strobe, search)), jnp.asarray(t1), jnp.zeros_like(t1)
        orbits.append(
            PeriodicOrbit(
                **found, system=system, num_periods=n, period=period, phase=phase, args=args, flow=flow
            )
        )
    return orbits


def _in_order(num_periods: Count, starts: Any) -> tuple[Any, Count]:
    """Arguments in the order of before version 1.0, put in that of now."""
    warnings.warn(
        "`find_periodic_orbits` takes `starts` before `num_periods`, as all functions do: write find_periodic_orbits(system, starts, num_periods).",
        DeprecationWarning,
        stacklevel=users_line(),
    )
    return starts, num_periods


def given_states(
    starts: tuple[Numbers, Numbers] | Numbers, system: AnySystem, or_else: str = ""
) -> np.ndarray:
    """States given one by one, (starts, 2 n); `or_else` names other forms of the argument, for messages."""
    parts = [as_numpy_float(a) for a in (starts if isinstance(starts, tuple) else (starts,))]
    num_masses = system.num_masses
    sizes = [2 * n // len(parts) for n in (num_masses, system.num_coordinates)]
    if not 1 <= len(parts) <= 2 or any(a.ndim != 2 or a.shape[1] not in sizes or not len(a) for a in parts):
        raise ValueError(
            f"Argument `starts` must be positions and velocities, (starts, {num_masses}) each, or both side by side, "
            f"(starts, {2 * num_masses}), {or_else}but has the shapes {[a.shape for a in parts]}."
        )
    if len({len(a) for a in parts}) > 1:
        raise ValueError("Argument `starts` must hold as many velocities as positions.")
    return all_coordinates(system, np.concatenate(parts, axis=1))


def all_coordinates(system: AnySystem, states: np.ndarray) -> np.ndarray:
    """States of all coordinates, (starts, 2 n), from such or those of the masses alone."""
    if not system.hysteresis:
        return states
    parts = machine_of(system).start_of(*(a.T for a in np.split(states, 2, axis=1)))
    return np.concatenate([np.asarray(a).T for a in parts], axis=1)


def _distinct_orbits(
    system: AnySystem,
    states: list[np.ndarray],
    felt: np.ndarray,
    num_periods: int,
    args: object,
    flow: AbstractFlow | None,
) -> list[int]:
    """Indices of distinct orbits, modulo whole periods and the rigid shifts that `felt` projects out."""
    kept: list[int] = []
    known: list[np.ndarray] = []  # states of the orbits so far, at phase 0 of each of their periods
    projection = np.kron(np.eye(2), felt)
    for i, state in enumerate(states):
        size = np.abs(state).max() or 1.0
        if any(np.abs(projection @ (other - state)).max() < _SAME * size for other in known):
            continue
        kept.append(i)
        known.append(state)
        if num_periods > 1:
            x, v = np.split(state, 2)
            ts = np.arange(1, num_periods) * np.asarray(system.forcing.period)
            sol = simulate_all(system, 0.0, ts[-1], x, v, ts=ts, args=args, flow=flow, throw=False)
            known += list(np.concatenate([sol.xs, sol.vs], axis=1))
    return kept
