"""Check that rigid contacts with friction can carry a force while they slip.

A contact of row a whose friction slips with the sign s along the row g presses with W = a + mu s g. If a M^-1 W <= 0, its
force pulls the masses towards the contact, and no motion, or several, agree with the laws (P. Painleve, C. R. Acad. Sci. 121
(1895)). A compliant contact has the force of its depth, whatever its friction.
"""

from typing import Any

import numpy as np

from .._jax.concrete import concrete


def check_slip(system: Any) -> None:
    """Reject a rigid contact that cannot carry a force while its friction slips, unless numbers are traced; lanes may be last."""
    by_contact: dict[int, list[Any]] = {}
    for element in system.friction:
        if element.is_tied and not system.stops[element.contact].is_compliant:
            by_contact.setdefault(element.contact, []).append(element)
    mass = concrete(system.mass)
    if mass is None:
        return
    for number, elements in by_contact.items():
        row, tangents = system.stops[number].coefficients, [element.coefficients for element in elements]
        numbers = [*row.values(), *(a for tangent in tangents for a in tangent.values())]
        coefficients = [concrete(element.slip) for element in elements]
        known = [a for a in coefficients if a is not None]
        if len(known) < len(elements) or any(concrete(a) is None for a in numbers):
            continue
        own = _product(mass, row, row, has_full_mass=system.has_full_mass)
        beside = [_product(mass, row, tangent, has_full_mass=system.has_full_mass) for tangent in tangents]
        _check_one(number, own, np.stack(np.broadcast_arrays(*beside)), known)


def _check_one(number: int, own: np.ndarray, beside: np.ndarray, coefficients: list[np.ndarray]) -> None:
    """Check one contact: a M^-1 a against the sum of mu |a M^-1 g| over its friction elements."""
    lost = sum(mu * np.abs(c) for mu, c in zip(coefficients, beside, strict=True))
    if (own > lost).all():
        return
    if np.ndim(own) or np.ndim(lost):
        raise ValueError(
            f"At some points contact {number} cannot carry a force while it slips: row . M^-1 (row +- coefficient tangent) must be "
            "positive (Painleve); lower the coefficient of its friction."
        )
    if len(coefficients) > 1:
        raise ValueError(
            f"Contact {number} cannot carry a force while its {len(coefficients)} friction elements slip: row . M^-1 row must be "
            "above the sum of coefficient |row . M^-1 tangent| (Painleve); lower the coefficients."
        )
    mu, c = float(coefficients[0]), float(beside[0])
    sign, way = ("-", "negative") if c > 0 else ("+", "positive")
    raise ValueError(
        f"Contact {number} with coefficient {mu:.5g} cannot carry a force while it slips in the {way} direction: row . M^-1 (row "
        f"{sign} {mu:.5g} tangent) must be positive (Painleve); the coefficient must be below {float(own) / abs(c):.5g}."
    )


def _product(
    mass: np.ndarray, one: dict[int, Any], other: dict[int, Any], *, has_full_mass: bool
) -> np.ndarray:
    """Product a M^-1 b of two rows, lanes last."""
    if not has_full_mass:
        shared = [np.asarray(one[i]) * np.asarray(other[i]) / mass[i] for i in one if i in other]
        return np.asarray(sum(shared, np.zeros(())))
    first, second = (_vector(row, len(mass)) for row in (one, other))
    inverse = np.linalg.inv(np.moveaxis(mass, (0, 1), (-2, -1)))
    pair = np.moveaxis(first, 0, -1), np.moveaxis(second, 0, -1)
    return np.asarray(np.einsum("...i,...ij,...j->...", pair[0], inverse, pair[1]))


def _vector(row: dict[int, Any], size: int) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*(np.asarray(concrete(row.get(i, 0.0))) for i in range(size))))
