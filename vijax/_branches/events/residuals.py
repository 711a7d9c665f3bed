"""Residuals of a cycle in the equations of many words: only those that it solves are worth a correction."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._orbits.cycle import MOMENT, events_of, residual
from ..._orbits.sequence import Sequence
from ..margin_sizes import Sizes
from ..padding import padded, room_for
from ..parameter_family import ExtendedCycle, ParameterFamily
from ..requests import KernelCall, Requests, ask

# ROWS: cycles of one call.
ROWS = 16


def residuals(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, rows: tuple[Any, ...]
) -> Float[Array, " rows"]:
    """Largest residual of each cycle, its events and durations being rows; they share start and parameter with `place`.

    Without the division by durations, which magnifies rounding where these vanish.
    """
    sizes = Sizes.of(family)

    def one(row: tuple[Array, ...]) -> Array:
        *events, flights = row
        own = Sequence(*events)
        problem = family.problem(own, place.p)
        found = residual(problem, family.unknowns(place._replace(flights=flights)))
        values, zeros = found.events / sizes.of_events(own), events_of(problem).zeros
        if zeros is not None:
            values = values * jnp.maximum(jnp.abs(flights), MOMENT) ** zeros
        closing = jnp.max(jnp.abs(found.closing / family.scale))
        return jnp.maximum(closing, jnp.max(jnp.abs(values), initial=0.0))

    return jax.lax.map(one, rows)


def residuals_of(cycles: list[tuple[Sequence, ExtendedCycle]]) -> Requests[np.ndarray]:
    """Largest residuals of cycles that share start and parameter, (cycles,)."""
    longest, place = max(cycles, key=lambda cycle: len(cycle[0].kind))
    room = room_for(len(longest.kind))
    wide = [padded(sequence, (own,), room) for sequence, own in cycles]
    rows = [(*sequence, own.flights) for sequence, own in wide]
    rows += [rows[-1]] * (-len(rows) % ROWS)
    found = []
    for k in range(0, len(rows), ROWS):
        part = tuple(np.stack(own) for own in zip(*rows[k : k + ROWS], strict=True))
        found.append((yield from ask(KernelCall(residuals, longest, (place, part)))))
    return np.concatenate(found)[: len(cycles)]
