"""Events of instants as one whole number for each contact: all that a search for an orbit reads of a run, in one array.

A program hands it out beside its results for a few microseconds, where the columns of a log would cost as many arrays.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.transition import Instant, Switches
from .._machine.kinds import RIGID

# Names of flags, and of numbers of `_BITS` bits: a guard is 0, 1 or 2, and what an element does one of a dozen.
_FLAGS, _SWITCHES = ("hit", "stuck", "released"), ("closed", "opened", "slipped", "turned")
_NUMBERS, _BITS = ("ended", "before", "after"), 8


def codes_of(instants: Instant) -> Int[Array, "rows contacts"]:
    """Codes of instants, without their times, velocities and impulses."""
    flags = [getattr(instants, name) for name in _FLAGS]
    code = jnp.zeros(instants.hit.shape, jnp.int32)
    if (switched := instants.switched) is not None:
        flags += [getattr(switched, name) for name in _SWITCHES]
        for name in _NUMBERS:
            code = (code << _BITS) | getattr(switched, name).astype(jnp.int32)
    for flag in flags:
        code = (code << 1) | flag
    return code


def instants_of(
    codes: Int[Array, "rows contacts"], times: Float[Array, " rows"], kinds: tuple[int, ...]
) -> Instant:
    """Instants of codes and times, of elements of some kinds; what codes leave out is zero."""
    has_switches = not set(kinds) <= {RIGID}
    names = (*_FLAGS, *(_SWITCHES if has_switches else ()))
    read: dict[str, Array] = {name: (codes >> place) & 1 != 0 for place, name in enumerate(reversed(names))}
    whole = codes >> len(names)
    for place, name in enumerate(reversed(_NUMBERS)):
        read[name] = ((whole >> _BITS * place) & ((1 << _BITS) - 1)).astype(jnp.int8)
    none: Bool[Array, "rows contacts"] = jnp.zeros(codes.shape, bool)
    unknown = jnp.zeros(codes.shape, times.dtype)
    switched = None
    if has_switches:
        switched = Switches(**{name: read[name] for name in (*_SWITCHES, *_NUMBERS)}, unlogged=none)
    return Instant(
        **{name: read[name] for name in _FLAGS},
        velocity_minus=unknown,
        velocity_plus=unknown,
        chatter=unknown,
        arrived=jnp.zeros(times.shape, bool),
        time=times,
        switched=switched,
    )
