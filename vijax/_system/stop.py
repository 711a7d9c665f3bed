"""Stops: rigid walls on one side of one mass."""

from collections.abc import Mapping
from typing import Any, Literal

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Count, Reals, as_float, whole_number
from .._printing import describe_limit
from .contact import AbstractRigidLimit
from .forcing import Harmonic
from .restitution import AbstractRestitution, Restitution, as_restitution


def check_side(side: Any) -> None:
    """Reject a side that is neither of both."""
    if side not in ("upper", "lower"):
        raise ValueError(
            f'Argument `side` must be "upper" (x <= position) or "lower" (x >= position), but is {side!r}.'
        )


def mass_of_stop(mass: Any, contact: str) -> int:
    """Index of the mass of a stop; `contact` is the name of the class that takes a row of masses."""
    if isinstance(mass, Mapping):
        raise ValueError(
            f"Argument `mass` must be the index of one mass, but is {mass}. A row is a `{contact}`."
        )
    return whole_number("mass", mass)


class Stop(AbstractRigidLimit):
    """A rigid stop that limits the travel of one mass from one side.

    An `"upper"` stop keeps `x <= position`, a `"lower"` one `x >= position`. On contact the velocity of the mass is
    multiplied by `-restitution` (Wagg & Bishop 2004, Eq. 11).

    A stop with a `motion` w(t) has the position `position + w(t)`, and the velocity relative to it, v - w', is
    multiplied. A sticking mass moves with its stop.

    Args:
        mass: index of the mass, counted from 0.
        position: the position of the stop, in units of length; the middle of its motion, if it moves.
        side: `"upper"` or `"lower"`.
        restitution: coefficient of restitution, from 0 (plastic) to 1 (elastic), or a law of it, a
            `vx.AbstractRestitution`, for one that depends on the speed of impact. At 1 a mass never
            comes to rest on its stop: pressed on it while dampers take the energy, it bounces ever
            faster, and `simulate` ends with `max_steps_reached`.
        motion: how the stop moves, a length: one column, amplitude (1,) or (harmonics, 1), of the frequency
            of the load. The machine has one frequency, `forcing.frequency`, and keeps no other. The stop
            does not move if left out.

    Raises:
        ValueError: for an unknown side, a negative index, a restitution outside [0, 1], or a motion
            of more than one column.

    Example:
        ```python
        import vijax as vx
        wall = vx.Stop(mass=0, position=0.3, side="upper", restitution=0.7)
        shaken = vx.Harmonic(amplitude=[0.1], frequency=0.8)
        table = vx.Stop(mass=1, position=0.0, side="lower", restitution=0.7, motion=shaken)
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.1, Eq. 11.
    """

    mass: int = eqx.field(static=True)
    position: Float[Array, "..."] = eqx.field(converter=as_float)
    side: Literal["upper", "lower"] = eqx.field(static=True)
    restitution: Restitution
    motion: Harmonic | None

    def __init__(
        self,
        mass: Count = 0,
        position: ArrayLike = 0.0,
        side: Literal["upper", "lower"] = "upper",
        restitution: ArrayLike | AbstractRestitution = 1.0,
        motion: Harmonic | None = None,
    ):
        self.mass = mass_of_stop(mass, "vx.Contact")
        self.position = as_float(position, "position")
        self.side = side
        self.restitution = as_restitution(restitution)
        self.motion = motion

    def __check_init__(self):
        check_side(self.side)

    __repr__, _repr_html_ = described_by(describe_limit)

    @property
    def sign(self) -> int:
        """Sign in the gap, `sign (position - x)`: 1 for an upper stop, -1 for a lower one."""
        return 1 if self.side == "upper" else -1

    @property
    def coefficients(self) -> dict[int, Reals]:
        """The one entry of the row, by mass."""
        return {self.mass: self.sign}

    @property
    def slot(self) -> tuple[int, str]:
        """Mass and side of the stop."""
        return self.mass, self.side

    @property
    def remedy(self) -> str:
        """Advice for a start beyond the stop."""
        side = f"Start mass {self.mass} on its free side ({self.side} stop), or on the stop."
        return f"`x0[{self.mass}]` is past `stops[{{j}}]`. {side}"
