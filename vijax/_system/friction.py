"""Dry friction elements, of constant normal force or tied to the normal force of a contact."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Count, Reals, as_float, whole_number
from .._jax.concrete import concrete
from .._printing import describe_friction
from .checks import FINITE, NOT_NEGATIVE, Rule, check_number
from .contact import check_row, row_by_mass, row_of


class Friction(eqx.Module):
    """Dry friction along a combination of coordinates: of masses on the ground, on a belt, or between masses.

    With the sliding velocity w = row . v - velocity, the element acts on the masses with -row T. While it slips, T =
    F sign(w). At w = 0 it sticks, w stays 0, as long as that needs |T| <= Fs; otherwise it slips, in the direction
    in which |T| would exceed Fs.

    - With `force` the normal force is constant: F = force, Fs = static. Impacts give no friction impulse.
    - With `coefficient` the friction is that of a contact, a stop of the machine, rigid or compliant: F = coefficient N and Fs
      = static_coefficient N, N the force of the contact. While the contact is open, there is no friction. Friction and
      normal force are coupled where M, or a damper or spring of the contact, couples their directions.

    Impacts on a contact with friction follow Newton's law in Moreau's form: the friction impulse P is at most
    coefficient p, p the impulse of the contact, and takes the sliding velocity to 0 if that suffices; otherwise |P| = coefficient p,
    against the sliding velocity after the impact. As with the other forms of Newton's law, an impact that couples
    both directions and stops or reverses the slip may gain energy if the restitution is near 1. A contact whose friction is so
    large that it cannot carry a force while it slips is refused (Painleve).

    The log numbers friction elements after the stops: element k is `len(stops) + k`. It has a `vx.STICK` where an
    element comes to rest and stays, a `vx.SLIP` where it starts to slip, and a `vx.TURN` where w passes zero and slip
    continues in the other direction. A slip that begins or ends with its contact is not logged.

    Args:
        row: the coefficient of each mass that it concerns, `{mass: coefficient}`, counted from 0; or the number of a
            mass, for `{mass: 1.0}`. For friction of a contact the direction along which that slips.
        force: F, magnitude of the friction force of slip, not negative; give this or `coefficient`.
        static: Fs, largest magnitude of the friction force of stick, not below `force`; equal to it if left out. Leave it
            out where both are equal and derivatives matter: they are those by both at once.
        velocity: of the surface along the row: of a belt on which a mass lies; 0 for the ground.
        coefficient: mu, friction force of slip over the normal force, not negative.
        static_coefficient: largest friction force of stick over the normal force, not below `coefficient`; equal to it if left
            out. Impacts use `coefficient`.
        contact: number of the stop of the machine whose force presses, counted from 0; the first one if left out.

    Raises:
        ValueError: for a row without entries or of zeros, a negative mass, a number that is negative or not finite, a
            static friction below that of slip, or not exactly one of `force` and `coefficient`.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[4.0], frequency=0.8)
        rubbing = vx.Friction(0, force=1.0, static=1.2)
        system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, friction=[rubbing])
        sol = vx.simulate(system, 0.0, 50.0)
        ```

        A block, of which coordinate 0 is along the floor and coordinate 1 its height:

        ```python
        import vijax as vx
        weight = vx.Harmonic(amplitude=[0.0, 0.0], frequency=1.0, mean=[0.0, -1.0])
        floor = vx.Stop(mass=1, position=0.0, side="lower", restitution=0.5)
        rubbing = vx.Friction(0, coefficient=0.3, contact=0)
        none = [[0.0, 0.0], [0.0, 0.0]]
        system = vx.ImpactSystem([1.0, 1.0], none, none, weight, [floor], friction=[rubbing])
        sol = vx.simulate(system, 0.0, 8.0, [0.0, 1.0], [2.0, 0.0])
        ```

    References:
        J. P. Den Hartog, Trans. ASME 53 (1931), APM-53-9, 107-115;
        M. di Bernardo, C. J. Budd, A. R. Champneys & P. Kowalczyk, Piecewise-smooth Dynamical Systems (2008), Ch. 8;
        F. Pfeiffer & C. Glocker, Multibody Dynamics with Unilateral Contacts (1996), Ch. 5-8;
        R. I. Leine & H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems (2004).
    """

    masses: tuple[int, ...] = eqx.field(static=True)
    row: Float[Array, "..."]
    force: Float[Array, "..."] | None
    static: Float[Array, "..."] | None
    velocity: Float[Array, "..."]
    coefficient: Float[Array, "..."] | None = None
    static_coefficient: Float[Array, "..."] | None = None
    contact: int | None = eqx.field(static=True, default=None)

    def __init__(
        self,
        row: Mapping[int, ArrayLike] | Count,
        force: ArrayLike | None = None,
        static: ArrayLike | None = None,
        velocity: ArrayLike = 0.0,
        *,
        coefficient: ArrayLike | None = None,
        static_coefficient: ArrayLike | None = None,
        contact: Count | None = None,
    ):
        is_row = isinstance(row, Mapping)
        self.masses, self.row = row_of("the friction", row if is_row else {whole_number("row", row): 1.0})
        if (force is None) == (coefficient is None):
            raise ValueError(
                "Give `force`, the friction force of a constant normal force, or `coefficient`, friction force over the force of "
                "a contact, and not both."
            )
        _refuse_other(force is None, ("static", static), "static_coefficient")
        _refuse_other(coefficient is None, ("static_coefficient", static_coefficient), "static")
        if contact is not None and coefficient is None:
            raise ValueError(
                "Argument `contact` is for friction tied to a contact: give `coefficient` instead of `force`."
            )
        self.velocity = as_float(velocity, "velocity")
        names = ("force", "static", "coefficient", "static_coefficient")
        numbers = dict(zip(names, (force, static, coefficient, static_coefficient), strict=True))
        for name, number in numbers.items():
            setattr(self, name, None if number is None else as_float(number, name))
        self.contact = (
            None if coefficient is None else whole_number("contact", 0 if contact is None else contact)
        )

    def __check_init__(self):
        check_row(self.masses, self.row)
        self.check_law("", check_number)

    def check_law(self, name: str, check: Callable[[str, Any, Rule], None]) -> None:
        """Check its numbers, by `check_number`, or by `check_every` where lanes are last; `name` is a prefix."""
        check(f"{name}velocity", self.velocity, FINITE)
        if self.coefficient is None:
            _check_pair(name, ("force", self.force), ("static", self.static), check)
        else:
            static = "static_coefficient", self.static_coefficient
            _check_pair(name, ("coefficient", self.coefficient), static, check)

    __repr__, _repr_html_ = described_by(describe_friction)

    coefficients = property(row_by_mass)

    @property
    def is_tied(self) -> bool:
        """True if the force of a contact presses, False if the normal force is constant."""
        return self.contact is not None

    @property
    def slip(self) -> Reals:
        """Friction force of slip, or its coefficient."""
        slip = self.coefficient if self.is_tied else self.force
        assert slip is not None
        return slip

    @property
    def grip(self) -> Reals:
        """Largest friction force of stick, or its coefficient."""
        static = self.static_coefficient if self.is_tied else self.static
        return self.slip if static is None else static


def _refuse_other(is_wrong: bool, given: tuple[str, Any], remedy: str) -> None:
    """Reject an argument of the other kind of friction."""
    if is_wrong and given[1] is not None:
        kind = "of constant force" if given[0] == "static" else "tied to a contact"
        raise ValueError(f"Argument `{given[0]}` is for friction {kind}: give `{remedy}` instead.")


def _check_pair(
    name: str, slip: tuple[str, Any], static: tuple[str, Any], check: Callable[[str, Any, Rule], None]
) -> None:
    """Check the friction of slip, and that of stick, which must not be below it."""
    check(f"{name}{slip[0]}", slip[1], NOT_NEGATIVE)
    if static[1] is None:
        return
    check(f"{name}{static[0]}", static[1], NOT_NEGATIVE)
    least, most = concrete(slip[1]), concrete(static[1])
    if least is not None and most is not None and (most < least).any():
        raise ValueError(
            f"Argument `{name}{static[0]}` must not be below `{name}{slip[0]}`, the friction of slip, but is {most} and {least}: "
            "leave it out if both are equal."
        )
