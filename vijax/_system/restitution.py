"""Restitution laws: the velocity after an impact as a function of the speed of approach, u+ = -r(u) u.

A plain number means Newton's law, a constant r. A law is data: its fields are the numbers that are swept,
differentiated and written to files, with paths such as "stops[0].restitution.speed". To add one, write a class here
and list it in `vijax/__init__.pyi` and in the reference.
"""

import abc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike

from .._jax.arrays import Reals, as_float, stack
from .._jax.concrete import concrete
from .checks import NOT_NEGATIVE, POSITIVE, RESTITUTION, Rule


class AbstractRestitution(eqx.Module):
    """Restitution law r(u), for `restitution=` of `vx.Stop` and `vx.Contact`; subclass it for another law.

    Attributes:
        rules: rule of every field, `COEFFICIENT` (0 to 1), `POSITIVE` or `NOT_NEGATIVE`; all fields are numbers.

    Example:
        ```python
        import jax, jax.numpy as jnp, vijax as vx

        class Yielding(vx.AbstractRestitution):
            rules = {"elastic": vx.AbstractRestitution.COEFFICIENT, "speed": vx.AbstractRestitution.POSITIVE}
            elastic: jax.Array | float
            speed: jax.Array | float

            def __call__(self, speed):
                return self.elastic * jnp.exp(-jnp.abs(speed) / self.speed)
        ```

    References:
        K. L. Johnson, Contact Mechanics (1985), Sec. 11.5.
    """

    COEFFICIENT: ClassVar[Rule] = RESTITUTION
    POSITIVE: ClassVar[Rule] = POSITIVE
    NOT_NEGATIVE: ClassVar[Rule] = NOT_NEGATIVE

    rules: ClassVar[Mapping[str, Rule]] = {}

    @abc.abstractmethod
    def __call__(self, speed: Reals) -> Reals:
        """Coefficient at a speed of approach, elementwise; even, since inadmissible orbits have negative speeds."""

    @property
    def light(self) -> Reals:
        """Coefficient r(0) of light impacts, the ratio of chatter."""
        return self(0 * jax.tree.leaves(self)[0])

    def __repr__(self) -> str:
        numbers = ((field, concrete(getattr(self, field))) for field in self.rules)
        words = (
            f"{field}={f'{a:.6g}' if a is not None and a.ndim == 0 else 'traced or many'}"
            for field, a in numbers
        )
        return f"{type(self).__name__}({', '.join(words)})"


class FallingRestitution(AbstractRestitution):
    """Restitution that falls with the speed of impact, r(u) = r0 / (1 + |u| / speed)^exponent.

    Slow impacts are elastic except for r0; fast ones deform plastically: with the exponent 1/4 the coefficient falls as
    u^(-1/4), as for spheres far above the speed at which they yield.

    Args:
        restitution: coefficient r0 of light impacts, from 0 to 1.
        speed: scale of the speed, positive.
        exponent: exponent of the decrease, not negative; 0 is Newton's law.

    Raises:
        ValueError: for numbers outside these ranges, when the law is used in a stop or contact.

    Example:
        ```python
        import vijax as vx
        steel = vx.FallingRestitution(restitution=0.95, speed=0.5)
        wall = vx.Stop(mass=0, position=0.3, side="upper", restitution=steel)
        ```

    References:
        K. L. Johnson, Contact Mechanics (1985), Sec. 11.5.
    """

    rules: ClassVar[Mapping[str, Rule]] = {
        "restitution": RESTITUTION,
        "speed": POSITIVE,
        "exponent": NOT_NEGATIVE,
    }

    restitution: Reals
    speed: Reals
    exponent: Reals

    def __init__(self, restitution: ArrayLike = 1.0, speed: ArrayLike = 1.0, exponent: ArrayLike = 0.25):
        self.restitution = as_float(restitution, "restitution")
        self.speed = as_float(speed, "speed")
        self.exponent = as_float(exponent, "exponent")

    def __call__(self, speed: Reals) -> Reals:
        """Coefficient at a speed of approach."""
        return self.restitution * (1 + abs(speed) / self.speed) ** -self.exponent


class ByContact(AbstractRestitution):
    """Different laws of the contacts of a machine, in one, (contacts,)."""

    rules: ClassVar[Mapping[str, Rule]] = {}

    laws: tuple[Any, ...]

    def __call__(self, speed: Reals) -> Reals:
        """Coefficient of each contact at its speed."""
        return stack([coefficient(law, u) for law, u in zip(self.laws, speed, strict=True)])

    @property
    def light(self) -> Reals:
        """Coefficient of light impacts of each contact."""
        return stack([light_coefficient(law) for law in self.laws])


# A law, or an array (Newton's law, constant). Typed `Any`: type checkers would reject `float(stop.restitution)`.
Restitution = Any


def as_restitution(value: ArrayLike | AbstractRestitution) -> Restitution:
    """Convert a number, or the numbers of a law, to arrays."""
    if not isinstance(value, AbstractRestitution):
        return as_float(value, "restitution")
    if without := {field.name for field in fields(value)} - value.rules.keys():
        raise ValueError(f"`{type(value).__name__}.rules` must give a rule for `{min(without)}`.")
    return jax.tree.map(as_float, value, is_leaf=lambda a: a is not value)


def check_restitution(restitution: Restitution, name: str, check: Callable[[str, Any, Rule], None]) -> None:
    """Apply a check, `check_number` or `check_every` for lanes, to a coefficient or to all numbers of a law."""
    if not isinstance(restitution, AbstractRestitution):
        return check(name, restitution, RESTITUTION)
    for field, rule in restitution.rules.items():
        check(f"{name}.{field}", getattr(restitution, field), rule)


def coefficient(restitution: Restitution, speed: Reals) -> Reals:
    """Coefficient at a speed of approach, u+ = -r u (Wagg & Bishop 2004, Eq. 11)."""
    return restitution(speed) if isinstance(restitution, AbstractRestitution) else restitution


def light_coefficient(restitution: Restitution) -> Reals:
    """Coefficient of light impacts."""
    return restitution.light if isinstance(restitution, AbstractRestitution) else restitution


def restitution_of_contacts(several: Sequence[Restitution], zero: Reals) -> Restitution:
    """One law for all contacts, (contacts,); `zero` has the lanes of the machine."""
    if not several:
        return np.zeros((0, *zero.shape), zero.dtype)
    if len({type(law) if isinstance(law, AbstractRestitution) else None for law in several}) > 1:
        return ByContact(tuple(jax.tree.map(lambda a: a + zero, law) for law in several))
    return jax.tree.map(lambda *values: stack([a + zero for a in values]), *several)


def describe_restitution(restitution: Restitution) -> float | dict[str, Any]:
    """Describe a coefficient as a number, or a law as a table of its name and numbers."""
    if not isinstance(restitution, AbstractRestitution):
        return float(restitution)
    return {"law": type(restitution).__name__} | {
        a: float(getattr(restitution, a)) for a in restitution.rules
    }


def laws_by_name() -> dict[str, type[AbstractRestitution]]:
    """Restitution laws defined in this process, by name."""
    return {law.__name__: law for law in AbstractRestitution.__subclasses__() if law is not ByContact}
