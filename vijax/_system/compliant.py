"""Compliant stops and contacts: a spring and a damper behind a limit, instead of a rigid wall."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Count, as_float
from .._printing import describe_limit
from .checks import NOT_NEGATIVE, Rule, check_number
from .contact import AbstractLimit, check_row, row_by_mass, row_of
from .stop import Stop, check_side, mass_of_stop

# Numbers of the law.
LAW_OF_COMPLIANCE = "stiffness", "damping", "preload"


class AbstractCompliantLimit(AbstractLimit):
    """A limit that resists with the force N = max(0, preload + stiffness d + damping d'), d the depth past it."""

    is_compliant: ClassVar[bool] = True

    stiffness: eqx.AbstractVar[Float[Array, "..."]]
    damping: eqx.AbstractVar[Float[Array, "..."]]
    preload: eqx.AbstractVar[Float[Array, "..."]]

    @property
    def motion(self) -> None:
        """None: the limit does not move."""
        return None

    def __check_init__(self):
        self.check_law("", check_number)

    def check_law(self, name: str, check: Callable[[str, Any, Rule], None]) -> None:
        """Check the numbers of the spring and the damper."""
        for own in LAW_OF_COMPLIANCE:
            check(f"{name}{own}", getattr(self, own), NOT_NEGATIVE)


class CompliantStop(AbstractCompliantLimit):
    """A stop that yields: a mass that passes `position` meets a spring and a damper.

    With the depth d = x - position of an `"upper"` stop, position - x of a `"lower"` one, the stop pushes the mass back
    with N = max(0, preload + stiffness d + damping d') while d > 0. It never pulls: a damped stop that lags behind the
    mass loses contact inside, at d > 0. At d = 0 a stop with preload holds a mass at rest whose load is between 0 and
    the preload. The log has a `vx.CLOSE` where N becomes positive and a `vx.OPEN` where it becomes zero.

    The motion is linear between these events and exact to rounding, whatever the stiffness.

    Args:
        mass: index of the mass, counted from 0.
        position: the position of the stop, in units of length.
        side: `"upper"` or `"lower"`.
        stiffness: k, force per length, not negative.
        damping: c, force per velocity, not negative.
        preload: force at d = 0 of a spring that is built in under compression, not negative.

    Raises:
        ValueError: for an unknown side, a negative index, or a number that is negative or not finite.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.5], frequency=0.85)
        cushion = vx.CompliantStop(mass=0, position=1.26, side="upper", stiffness=5.0)
        system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, [cushion])
        sol = vx.simulate(system, 0.0, 50.0)
        ```

    References:
        S. W. Shaw & P. J. Holmes, J. Sound Vib. 90 (1983), 129-155; J. Ing, E. Pavlovskaia, M. Wiercigroch &
        S. Banerjee, Phil. Trans. R. Soc. A 366 (2008), 679-704.
    """

    mass: int = eqx.field(static=True)
    position: Float[Array, "..."]
    side: Literal["upper", "lower"] = eqx.field(static=True)
    stiffness: Float[Array, "..."]
    damping: Float[Array, "..."]
    preload: Float[Array, "..."]

    def __init__(
        self,
        mass: Count,
        position: ArrayLike,
        side: Literal["upper", "lower"],
        stiffness: ArrayLike,
        damping: ArrayLike = 0.0,
        preload: ArrayLike = 0.0,
    ):
        self.mass = mass_of_stop(mass, "vx.CompliantContact")
        self.position = as_float(position, "position")
        self.side = side
        self.stiffness = as_float(stiffness, "stiffness")
        self.damping = as_float(damping, "damping")
        self.preload = as_float(preload, "preload")

    def __check_init__(self):
        check_side(self.side)

    __repr__, _repr_html_ = described_by(describe_limit)

    # Of its mass and its side, as those of a rigid stop.
    sign, coefficients, slot = Stop.sign, Stop.coefficients, Stop.slot


class CompliantContact(AbstractCompliantLimit):
    """A compliant contact between masses, or of masses with a wall: a spring and a damper where `row . x > position`.

    As `vx.CompliantStop`, with the depth d = row . x - position: the force N acts on the masses along minus the row.

    Args:
        row: the coefficient of each mass that it concerns, `{mass: coefficient}`, counted from 0.
        position: its position along the row.
        stiffness: k, force per length, not negative.
        damping: c, force per velocity, not negative.
        preload: force at d = 0, not negative.

    Raises:
        ValueError: for a row without entries or of zeros, a negative mass, or a number that is negative or not finite.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.5, 0.0], frequency=1.0)
        buffer = vx.CompliantContact({0: 1.0, 1: -1.0}, 0.1, stiffness=30.0, damping=0.5)
        system = vx.chain([1.0, 0.5], [0.1, 0.1], [1.0, 1.0], load, [buffer])
        ```

    References:
        S. W. Shaw & P. J. Holmes, J. Sound Vib. 90 (1983), 129-155.
    """

    masses: tuple[int, ...] = eqx.field(static=True)
    row: Float[Array, "..."]
    position: Float[Array, "..."]
    stiffness: Float[Array, "..."]
    damping: Float[Array, "..."]
    preload: Float[Array, "..."]

    def __init__(
        self,
        row: Mapping[int, ArrayLike],
        position: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike = 0.0,
        preload: ArrayLike = 0.0,
    ):
        self.masses, self.row = row_of("the contact", row)
        self.position = as_float(position, "position")
        self.stiffness = as_float(stiffness, "stiffness")
        self.damping = as_float(damping, "damping")
        self.preload = as_float(preload, "preload")

    def __check_init__(self):
        check_row(self.masses, self.row)

    __repr__, _repr_html_ = described_by(describe_limit)

    coefficients = property(row_by_mass)
