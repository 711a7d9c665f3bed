"""What is asked of a machine and a start before anything moves."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._system.system import ImpactSystem, not_alike
from .._types import Flag, Scalar, concrete
from .start import is_touching


def can_any_stick(system: ImpactSystem, x0: Array | np.ndarray, v0: Array | np.ndarray) -> bool:
    """Whether any stop might ever hold its mass: r < 1, or the mass starts at rest on it.

    Known only from concrete values; while any is traced the answer is yes. Lanes may stand last.
    """
    for stop in system.stops:
        if stop.motion is not None:
            return True  # at rest on it, or not: the start time decides
        r, position, x, v = (concrete(a) for a in (stop.restitution, stop.position, x0, v0))
        if r is None or (r < 1).any():
            return True
        if position is None or x is None or v is None:
            return True
        if ((np.abs(x[stop.mass] - position) <= 1e-3 * np.abs(position)) & (v[stop.mass] == 0)).any():
            return True
    return False


def validate_start(
    system: ImpactSystem,
    t0: Scalar,
    t1: Scalar,
    ts: Float[Array, " times"],
    x0: Float[Array, " n"],
    v0: Float[Array, " n"],
) -> list[tuple[Flag, str]]:
    """Refuse what is wrong from the start, and return what cannot be told while it is traced."""
    named = {"t0": t0, "t1": t1, "x0": x0, "v0": v0}
    checks = [(~jnp.all(jnp.isfinite(a)), f"Argument `{name}` must be finite.") for name, a in named.items()]
    checks.append((t1 < t0, "Argument `t1` must not lie before `t0`."))
    if ts.size:
        in_order = jnp.all(jnp.diff(ts) >= 0) & (ts[0] >= t0) & (ts[-1] <= t1)
        checks.append((~in_order, "Argument `ts` must be in increasing order, within [t0, t1]."))
    angle = system.forcing.frequency * t0
    for j, stop in enumerate(system.stops):
        gap = stop.sign * (stop.at(angle) - x0[stop.mass])
        sentence = (
            f"The start lies beyond a stop: `x0[{stop.mass}]` is past `stops[{j}]`. "
            f"Start mass {stop.mass} on its free side ({stop.side} stop), or on the stop."
        )
        checks.append(((gap < 0) & ~is_touching(gap, stop.reach(angle)), sentence))
        checks += [
            (~stop.moves_like(other), not_alike(stop.mass))
            for other in system.stops[:j]
            if other.mass == stop.mass and other.motion is not None
        ]
    verdicts = [concrete(is_wrong) for is_wrong, _ in checks]
    for verdict, (_, sentence) in zip(verdicts, checks, strict=True):
        if verdict is not None and verdict.any():
            raise ValueError(sentence)
    return [check for verdict, check in zip(verdicts, checks, strict=True) if verdict is None]
