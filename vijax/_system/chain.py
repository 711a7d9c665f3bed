"""Chains of masses."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import concrete
from .friction import Friction
from .hysteresis import Jenkins
from .load import AbstractLoad
from .parts import AnyStop
from .system import ImpactSystem


def chain(
    masses: Numbers,
    dampings: Numbers,
    stiffnesses: Numbers,
    forcing: AbstractLoad | None = None,
    stops: Sequence[AnyStop] = (),
    force: Any = None,
    friction: Sequence[Friction] = (),
    hysteresis: Sequence[Jenkins] = (),
) -> ImpactSystem:
    """Build a chain of masses: wall, spring and damper, mass, spring and damper, mass, ...

    Spring and damper i join mass i to mass i - 1, the first of them to the wall; the last mass is free on its far
    side (Wagg & Bishop 2004, Fig. 1).

    Args:
        masses: m, length n.
        dampings: c, length n.
        stiffnesses: k, length n.
        forcing: the load, see `ImpactSystem`.
        stops: the stops.
        force: any other force on the masses, see `ImpactSystem`.
        friction: the friction elements.
        hysteresis: the Jenkins elements.

    Returns:
        The machine, with the matrices of Eqs. 1 and 2.

    Raises:
        ValueError: if the three sequences differ in length.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.3, 0.0], frequency=0.8)
        system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, [vx.Stop(0, 0.3, "upper", 0.7)])
        ```

    References:
        Wagg & Bishop (2004), Eqs. 1-2.
    """
    given = {"masses": masses, "dampings": dampings, "stiffnesses": stiffnesses}
    mass, damping, stiffness = (as_float(a, name) for name, a in given.items())
    for name, values in zip(given, (mass, damping, stiffness), strict=True):
        if values.shape != (mass.size,):
            raise ValueError(
                f"Argument `{name}` must have one entry per mass, shape ({mass.size},), "
                f"but has shape {values.shape}."
            )
    matrices = mass, _chain_matrix(damping), _chain_matrix(stiffness)
    return ImpactSystem(*matrices, forcing, stops, force, friction, hysteresis=hysteresis)


def _chain_matrix(links: Float[Array, " n"]) -> Float[Array, "n n"]:
    """Matrix of n links in a row, [E] of Eq. 5 for equal links."""
    known = concrete(links)
    if known is None:
        after = jnp.append(links[1:], 0)
        return jnp.diag(links + after) - jnp.diag(links[1:], 1) - jnp.diag(links[1:], -1)
    after = np.append(known[1:], known.dtype.type(0))
    return as_float(np.diag(known + after) - np.diag(known[1:], 1) - np.diag(known[1:], -1))
