"""Dry friction elements of constant normal force."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._jax.arrays import Count, Reals, as_float, whole_number
from .._jax.concrete import concrete
from .._printing import as_html, as_text, describe_friction
from .checks import FINITE, NOT_NEGATIVE, Rule, check_number
from .contact import check_row, row_of


class Friction(eqx.Module):
    """Dry friction along a combination of coordinates: of masses on the ground, on a belt, or between masses.

    With the sliding velocity w = row . v - velocity, the element acts on the masses with -row T. While it slips, T =
    force * sign(w). At w = 0 it sticks, w stays 0, as long as that needs |T| <= static; otherwise it slips, in the direction
    in which |T| would exceed `static`. Impacts give no friction impulse: the normal force is constant.

    The log numbers friction elements after the stops: element k is `len(stops) + k`. It has a `vx.STICK` where an
    element comes to rest and stays, a `vx.SLIP` where it starts to slip, and a `vx.TURN` where w passes zero and slip
    continues in the other direction.

    Args:
        row: the coefficient of each mass that it concerns, `{mass: coefficient}`, counted from 0; or the number of a
            mass, for `{mass: 1.0}`.
        force: F, magnitude of the friction force of slip, not negative.
        static: Fs, largest magnitude of the friction force of stick, not below `force`; equal to it if left out. Leave it
            out where both are equal and derivatives matter: they are those by both at once.
        velocity: of the surface along the row: of a belt on which a mass lies; 0 for the ground.

    Raises:
        ValueError: for a row without entries or of zeros, a negative mass, a force that is negative or not finite, or a
            static friction below the force of slip.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[4.0], frequency=0.8)
        rubbing = vx.Friction(0, force=1.0, static=1.2)
        system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, friction=[rubbing])
        sol = vx.simulate(system, 0.0, 50.0)
        ```

    References:
        J. P. Den Hartog, Trans. ASME 53 (1931), APM-53-9, 107-115;
        M. di Bernardo, C. J. Budd, A. R. Champneys & P. Kowalczyk, Piecewise-smooth Dynamical Systems (2008), Ch. 8.
    """

    masses: tuple[int, ...] = eqx.field(static=True)
    row: Float[Array, "..."]
    force: Float[Array, "..."]
    static: Float[Array, "..."] | None
    velocity: Float[Array, "..."]

    def __init__(
        self,
        row: Mapping[int, ArrayLike] | Count,
        force: ArrayLike,
        static: ArrayLike | None = None,
        velocity: ArrayLike = 0.0,
    ):
        is_row = isinstance(row, Mapping)
        self.masses, self.row = row_of("the friction", row if is_row else {whole_number("row", row): 1.0})
        self.force = as_float(force, "force")
        self.static = None if static is None else as_float(static, "static")
        self.velocity = as_float(velocity, "velocity")

    def __check_init__(self):
        check_row(self.masses, self.row)
        self.check_law("", check_number)

    def check_law(self, name: str, check: Callable[[str, Any, Rule], None]) -> None:
        """Check its numbers, by `check_number`, or by `check_every` where lanes are last; `name` is a prefix."""
        check(f"{name}force", self.force, NOT_NEGATIVE)
        check(f"{name}velocity", self.velocity, FINITE)
        if self.static is None:
            return
        check(f"{name}static", self.static, NOT_NEGATIVE)
        least, most = concrete(self.force), concrete(self.static)
        if least is not None and most is not None and (most < least).any():
            raise ValueError(
                f"Argument `{name}static` must not be below `{name}force`, the friction of slip, but is {most} and {least}: "
                "leave it out if both are equal."
            )

    def __repr__(self) -> str:
        return as_text(describe_friction, self)

    def _repr_html_(self) -> str:
        return as_html(describe_friction, self)

    @property
    def coefficients(self) -> dict[int, Reals]:
        """All entries of the row, by mass."""
        return {mass: self.row[k] for k, mass in enumerate(self.masses)}

    @property
    def grip(self) -> Reals:
        """Largest friction force of stick."""
        return self.force if self.static is None else self.static
