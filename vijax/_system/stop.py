"""A stop: a rigid wall on one side of one mass."""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._types import as_float, concrete


class Stop(eqx.Module):
    """A rigid stop that limits the travel of one mass from one side.

    An `"upper"` stop keeps `x <= position`, a `"lower"` one `x >= position`. On contact the
    velocity of the mass is multiplied by `-restitution` (Wagg & Bishop 2004, Eq. 11).

    Args:
        mass: index of the mass, counted from 0.
        position: where the stop stands, in units of length.
        side: `"upper"` or `"lower"`.
        restitution: coefficient of restitution, from 0 (plastic) to 1 (elastic). At 1 a mass never
            comes to rest on its stop: pressed on it while dampers take the energy, it bounces ever
            faster, and `simulate` ends with `max_steps_reached`.

    Raises:
        ValueError: for an unknown side, a negative index, or a restitution outside [0, 1].

    Example:
        ```python
        import vijax as vx
        wall = vx.Stop(mass=0, position=0.3, side="upper", restitution=0.7)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.1, Eq. 11.
    """

    mass: int = eqx.field(static=True)
    position: Float[Array, "..."] = eqx.field(converter=as_float)
    side: Literal["upper", "lower"] = eqx.field(static=True)
    restitution: Float[Array, "..."] = eqx.field(converter=as_float)

    def __init__(
        self,
        mass: int = 0,
        position: ArrayLike = 0.0,
        side: Literal["upper", "lower"] = "upper",
        restitution: ArrayLike = 1.0,
    ):
        self.mass = mass
        self.position = as_float(position)
        self.side = side
        self.restitution = as_float(restitution)

    def __check_init__(self):
        if self.side not in ("upper", "lower"):
            raise ValueError(
                f'Argument `side` must be "upper" (x <= position) or "lower" (x >= position), '
                f"but is {self.side!r}."
            )
        if isinstance(self.mass, bool) or not isinstance(self.mass, int) or self.mass < 0:
            raise ValueError(f"Argument `mass` must be the index of a mass, 0 or more, but is {self.mass!r}.")
        for name, value in (("position", self.position), ("restitution", self.restitution)):
            if value.ndim != 0:
                raise ValueError(f"Argument `{name}` must be a number, but has shape {value.shape}.")
        position, restitution = concrete(self.position), concrete(self.restitution)
        if position is not None and not np.isfinite(position):
            raise ValueError(f"Argument `position` must be finite, but is {position}.")
        if restitution is not None and not 0 <= restitution <= 1:
            raise ValueError(
                f"Argument `restitution` must lie between 0 (plastic) and 1 (elastic), but is {restitution}."
            )

    @property
    def sign(self) -> int:
        """+1 for an upper stop, -1 for a lower one: the gap is `sign (position - x)`."""
        return 1 if self.side == "upper" else -1
