"""Laws of the elements of a machine whose forces switch, in one numbering."""

from typing import Any

import equinox as eqx
import numpy as np

from .._jax.arrays import Reals
from .._system.system import ImpactSystem
from .kinds import COMPLIANT, FRICTION, JENKINS, RIGID


class Laws(eqx.Module):
    """Force laws of all elements, (contacts,) each; zero where a number is not of the kind of an element.

    Attributes:
        kinds: kind of every element.
        stiffness: k of compliant contacts and Jenkins elements.
        damping: c of compliant contacts.
        preload: F0 of compliant contacts.
        force: F of friction.
        grip: Fs of friction.
        velocity: velocity of the surface under friction.
        reach: largest stretch of Jenkins elements, F / k; None if there are none.
        normal: number of the contact that presses each friction element, -1 for all other elements; None if friction has
            constant forces alone. Then so are the coefficients.
        coefficient: mu of friction of contacts.
        static_coefficient: the largest force of stick of that, over the force of the contact.
    """

    kinds: tuple[int, ...] = eqx.field(static=True)
    stiffness: Reals
    damping: Reals
    preload: Reals
    force: Reals
    grip: Reals
    velocity: Reals
    reach: Reals | None = None
    normal: tuple[int, ...] | None = eqx.field(static=True, default=None)
    coefficient: Any = None
    static_coefficient: Any = None

    @property
    def num_stops(self) -> int:
        """Number of contacts, rigid and compliant, which come before friction."""
        return sum(kind < FRICTION for kind in self.kinds)

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements, which come last."""
        return sum(kind == JENKINS for kind in self.kinds)

    @property
    def has_no_gap(self) -> np.ndarray:
        """Flags of friction and Jenkins elements, which resist velocities."""
        return np.array(self.kinds) >= FRICTION

    @property
    def is_tied(self) -> bool:
        """True if the force of a contact presses some friction."""
        return self.normal is not None


def kinds_of_elements(system: ImpactSystem) -> list[int]:
    """Kinds of all elements of a machine, rigid contacts included."""
    kinds = [COMPLIANT if stop.is_compliant else RIGID for stop in system.stops]
    return kinds + [FRICTION] * len(system.friction) + [JENKINS] * len(system.hysteresis)


def contacts_of_elements(system: ImpactSystem) -> list[int]:
    """Number of the contact that presses each element, -1 for all but friction of contacts."""
    of_friction = [-1 if element.contact is None else element.contact for element in system.friction]
    return [-1] * len(system.stops) + of_friction + [-1] * len(system.hysteresis)


def laws_of(system: ImpactSystem, of_contacts) -> Laws | None:
    """Laws of the elements of a machine, None if all its contacts are rigid; `of_contacts` makes an array of a list."""
    kinds = kinds_of_elements(system)
    if set(kinds) <= {RIGID}:
        return None
    elements = [*system.stops, *system.friction, *system.hysteresis]

    def of(name: str, *own: int) -> Reals:
        pairs = zip(kinds, elements, strict=True)
        return of_contacts([getattr(element, name) if kind in own else 0.0 for kind, element in pairs])

    tied = [kind == FRICTION and element.is_tied for kind, element in zip(kinds, elements, strict=True)]
    normal = contacts_of_elements(system)

    def of_friction(name: str, *, is_tied: bool = False) -> Reals:
        own = [kind == FRICTION and each == is_tied for kind, each in zip(kinds, tied, strict=True)]
        return of_contacts(
            [getattr(element, name) if each else 0.0 for each, element in zip(own, elements, strict=True)]
        )

    return Laws(
        kinds=tuple(kinds),
        stiffness=of("stiffness", COMPLIANT, JENKINS),
        **{name: of(name, COMPLIANT) for name in ("damping", "preload")},
        force=of_friction("slip"),
        grip=of_friction("grip"),
        velocity=of("velocity", FRICTION),
        reach=of("reach", JENKINS) if system.hysteresis else None,
        normal=tuple(normal) if any(tied) else None,
        coefficient=of_friction("slip", is_tied=True) if any(tied) else None,
        static_coefficient=of_friction("grip", is_tied=True) if any(tied) else None,
    )
