"""Unilateral constraints: their abstract class, and contacts along any combination of coordinates."""

import abc
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Reals, as_float, whole_number
from .._jax.concrete import concrete
from .._printing import describe_limit
from .checks import FINITE, Rule, check_number, check_one
from .forcing import Harmonic
from .restitution import (
    AbstractRestitution,
    Restitution,
    as_restitution,
    check_restitution,
    light_coefficient,
)
from .waves import Waves


def row_of(who: str, row: Any) -> tuple[tuple[int, ...], Array]:
    """Masses and coefficients of a row, `{mass: coefficient}`; an error names `who` it belongs to."""
    if not isinstance(row, Mapping) or not row:
        raise ValueError(
            f"Argument `row` must give the coefficient of each mass that {who} concerns, as "
            f"{{0: 1.0, 1: -1.0}}, but is {row!r}."
        )
    return tuple(whole_number("row", mass) for mass in row), as_float(list(row.values()), "row")


def row_by_mass(element: Any) -> dict[int, Reals]:
    """All entries of the row of an element, by mass."""
    return {mass: element.row[k] for k, mass in enumerate(element.masses)}


def whole_row(coefficients: Mapping[int, Any], num_masses: int) -> np.ndarray:
    """Known coefficients as a row of numbers, one for every mass."""
    row = np.zeros(num_masses)
    for mass, coefficient in coefficients.items():
        row[mass] = float(coefficient)
    return row


def check_row(masses: tuple[int, ...], row: Array) -> None:
    """Reject a row whose coefficients are not one finite number for each mass, or are all zero."""
    if row.shape != (len(masses),):
        raise ValueError(
            f"Argument `row` must give one number for each mass, but its numbers have shape {row.shape}."
        )
    check_one("row", row, FINITE)
    known = concrete(row)
    if known is not None and not known.any():
        raise ValueError("Argument `row` must have a coefficient that is not zero.")


class AbstractLimit(eqx.Module):
    """A limit of the motion, `coefficients . x <= sign * at(W t)`, that a rigid contact keeps and a compliant one resists.

    Attributes:
        is_compliant: True if the limit yields, with a spring and a damper.
    """

    is_compliant: ClassVar[bool] = False

    position: eqx.AbstractVar[Float[Array, "..."]]
    motion: eqx.AbstractVar[Harmonic | None]

    @property
    @abc.abstractmethod
    def coefficients(self) -> dict[int, Reals]:
        """The nonzero entries of the row, by mass."""

    @property
    def sign(self) -> int:
        """Sign of the position in the gap, `sign * position - coefficients . x`: 1 where it counts along the row."""
        return 1

    @property
    def slot(self) -> tuple[int, str] | None:
        """The mass and the side of it that this limits; None unless it acts on one mass alone."""
        return None

    def __check_init__(self):
        check_number("position", self.position, FINITE)
        if not isinstance(self.motion, Harmonic | None):
            raise ValueError(f"Argument `motion` must be a `vx.Harmonic` or None, but is {self.motion!r}.")
        if self.motion is not None and self.motion.amplitude.shape[-1] != 1:
            raise ValueError(
                "Argument `motion` must move one stop, with an amplitude of shape (1,) or (harmonics, 1), "
                f"but its amplitude has shape {self.motion.amplitude.shape}."
            )

    @abc.abstractmethod
    def check_law(self, name: str, check: Callable[[str, Any, Rule], None]) -> None:
        """Check the numbers of its law, by `check_number`, or by `check_every` where lanes are last; `name` is a prefix."""

    def along(self, x: Reals) -> Reals:
        """Positions or velocities of the masses along the row, positive towards the constraint; lanes may be last."""
        return sum(a * x[i] for i, a in self.coefficients.items())

    def size(self, x: Reals) -> Reals:
        """Sum of the magnitudes of the terms of `along`."""
        return sum(abs(a * x[i]) for i, a in self.coefficients.items())

    def gap(self, x: Reals, angle: Reals) -> Reals:
        """Gap of the masses at x at the phase `angle` = W t of the load; negative beyond the constraint."""
        return self.sign * self.at(angle) - self.along(x)

    @property
    def centre(self) -> Reals:
        """Mean position."""
        return self.position if self.motion is None else self.position + self.motion.mean[0]

    def at(self, angle: Reals) -> Reals:
        """Position at the phase `angle` = W t of the load; lanes may be last."""
        if self.motion is None:
            return self.position
        return self.centre + self._waves().at_angle(angle)[0]

    def slope_at(self, angle: Reals) -> Reals:
        """Derivative of the position by the phase; the velocity is W times that."""
        if self.motion is None:
            return 0 * self.position
        return self._waves().slope_at_angle(angle)[0]

    def reach(self, angle: Reals) -> Reals:
        """Magnitude of the terms of the position at that phase; sets the rounding error of the gap."""
        if self.motion is None:
            return abs(self.position)
        return abs(self.centre) + self._waves().rounded(angle)[0]

    def moves_like(self, other: "AbstractLimit") -> Reals:
        """Test whether two constraints keep their distance; lanes may be last."""
        if self.motion is None or other.motion is None:
            return np.asarray(self.motion is other.motion)
        ours, theirs = self._waves(), other._waves()
        if ours.num_harmonics != theirs.num_harmonics:
            return np.asarray(False)
        return ((ours.cosine == theirs.cosine) & (ours.sine == theirs.sine)).all(axis=(0, 1))

    def _waves(self) -> Waves:
        """Motion without its mean, as a series of one row."""
        assert self.motion is not None
        return self.motion.waves(self.position.ndim)


class AbstractRigidLimit(AbstractLimit):
    """A unilateral constraint.

    Subclasses define `coefficients`, `sign` and `remedy`; all else follows.
    """

    restitution: eqx.AbstractVar[Restitution]

    @property
    def light_restitution(self) -> Reals:
        """Its coefficient at light impacts."""
        return light_coefficient(self.restitution)

    @property
    @abc.abstractmethod
    def remedy(self) -> str:
        """Advice for a start beyond it, with a placeholder `{j}` for its number."""

    def __check_init__(self):
        self.check_law("", check_number)

    def check_law(self, name: str, check: Callable[[str, Any, Rule], None]) -> None:
        """Check its restitution."""
        check_restitution(self.restitution, f"{name}restitution", check)


class Contact(AbstractRigidLimit):
    """A contact between masses, or of masses with a wall: it keeps `row . x <= position`.

    A row with the entries 1 of mass i and -1 of mass k keeps x_i - x_k below the position: a free mass in a
    container, teeth with backlash, beads. An impact reverses the relative velocity u = row . v, less the velocity of
    the contact if it moves, and multiplies it by `restitution`; the velocities change along M^-1 row.

    Several contacts that share masses and close at the same instant follow Moreau's form of Newton's law: impulses
    p >= 0, every u after the impact at most -restitution times u before, with equality where p > 0. Sticking contacts
    count as plastic, and release where others pull them open. With equal restitutions no energy is created. With
    different restitutions of contacts hit at the same instant, energy may be created (Kane's paradox); other laws,
    Poisson's for instance, then also differ from this one.

    Args:
        row: the coefficient of each mass that it concerns, `{mass: coefficient}`, counted from 0.
        position: its position along the row; the middle of its motion, if it moves.
        restitution: coefficient of restitution, from 0 (plastic) to 1 (elastic), or a `vx.AbstractRestitution`.
        motion: how the contact moves along its row, a length: one column, of the frequency of the load, as for
            `vx.Stop`. It does not move if left out.

    Raises:
        ValueError: for a row without entries or of zeros, a negative mass, a restitution outside [0, 1], or a
            motion of more than one column.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.1, 0.0], frequency=1.0)
        ends = [vx.Contact({1: 1.0, 0: -1.0}, 0.5, 0.6), vx.Contact({1: -1.0, 0: 1.0}, 0.5, 0.6)]
        damper = vx.ImpactSystem([1.0, 0.1], [[0.04, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]], load, ends)
        ```

    References:
        J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics (1988), Sec. 6;
        Ch. Glocker, Set-Valued Force Laws (2001), Ch. 7.
    """

    masses: tuple[int, ...] = eqx.field(static=True)
    row: Float[Array, "..."]
    position: Float[Array, "..."]
    restitution: Restitution
    motion: Harmonic | None

    def __init__(
        self,
        row: Mapping[int, ArrayLike],
        position: ArrayLike = 0.0,
        restitution: ArrayLike | AbstractRestitution = 1.0,
        motion: Harmonic | None = None,
    ):
        self.masses, self.row = row_of("the contact", row)
        self.position = as_float(position, "position")
        self.restitution = as_restitution(restitution)
        self.motion = motion

    def __check_init__(self):
        check_row(self.masses, self.row)

    __repr__, _repr_html_ = described_by(describe_limit)

    coefficients = property(row_by_mass)

    @property
    def remedy(self) -> str:
        """Advice for a start beyond the contact."""
        return "`row . x0` is past the position of `stops[{j}]`. Start with it below that, or equal."
