"""Elements side by side: rows, and velocities or limits, that are multiples, so that in any motion they switch at one instant.

In the equations of cycles the first of several friction elements, or of compliant contacts that also open together, has the sum of
their forces, and the others, its followers, have none: shared in another way by elements at rest, the same motion would be
another sequence. A follower has no events and no margins; its mode is that of the first one, and at rest it is kept so.
Of rigid contacts of one place and one restitution the first has all impacts, and carries the load.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import Reals
from .._machine.contacts import Contacts
from .._machine.kinds import COMPLIANT, FRICTION, RIGID
from .._machine.laws import Laws
from .._machine.numbers import MachineNumbers
from .._machine.state import AHEAD, BEHIND, HELD, KEPT, rests_in
from .._machine.switching import SwitchingContacts
from .._system.restitution import ByContact, Restitution
from .._system.waves import Waves


class SideBySide(NamedTuple):
    """Pairs of elements whose guards are one function: the multiple of their rows, in the row of the first of the two; else 0.

    Attributes:
        begin: those that come to rest together, or close, (elements, elements).
        end: those that slip together, or open, (elements, elements).
    """

    begin: Float[Array, "elements elements"]
    end: Float[Array, "elements elements"]


def may_have_pairs(elements: MachineNumbers | Contacts) -> bool:
    """Whether elements may stand side by side: several of a kind, but for stops of single masses."""
    are_coupled = elements.signs is not None if isinstance(elements, MachineNumbers) else elements.is_coupled
    return are_coupled and has_several_of_a_kind(elements.kinds)


def has_several_of_a_kind(kinds: tuple[int, ...]) -> bool:
    """Whether there are several elements of a kind."""
    return len(set(kinds)) < len(kinds)


def side_by_side(numbers: MachineNumbers | Contacts) -> SideBySide:
    """Elements side by side.

    To slip together, the largest stretches of Jenkins elements must be multiples too; to open together, the forces of compliant
    contacts.
    """
    laws = numbers.laws if isinstance(numbers, MachineNumbers | SwitchingContacts) else None
    rows, kinds = jnp.asarray(numbers.rows), np.array(numbers.kinds)
    near = 4 * float(jnp.finfo(rows.dtype).eps)
    square = jnp.sum(rows * rows, axis=1)
    share = (rows @ rows.T) / jnp.where(square > 0, square, 1)[:, None]
    away = jnp.max(jnp.abs(rows[None] - share[:, :, None] * rows[:, None]), axis=2)

    def is_multiple(of_elements: Reals, share: Array) -> Bool[Array, "elements elements"]:
        own = jnp.asarray(of_elements)
        return jnp.abs(own[None] - share * own[:, None]) <= near * jnp.abs(own[None])

    begin = np.triu(kinds[:, None] == kinds[None], 1)
    begin = begin & (away <= near * jnp.max(jnp.abs(rows), axis=1)[None])
    if laws is not None:
        begin = begin & is_multiple(laws.velocity, share)
    are_contacts = (kinds == COMPLIANT) | (kinds == RIGID)
    if sum(are_contacts) > 1:
        is_one_place = (share > 0) & is_multiple(numbers.limit, share)
        for motion in [row for wave in jax.tree.leaves(_walls_of(numbers)) for row in wave]:
            is_one_place = is_one_place & is_multiple(motion, share)
        begin = begin & (is_one_place | ~are_contacts[None])
    if sum(kinds == RIGID) > 1:
        begin = begin & (_have_one_law(numbers.restitution) | (kinds != RIGID)[None])
    end = begin
    if COMPLIANT in kinds:
        assert laws is not None
        stiffness = jnp.asarray(laws.stiffness)
        ratio = stiffness[None] / jnp.where(stiffness > 0, stiffness, 1)[:, None]
        is_one_force = is_multiple(laws.damping, ratio) & is_multiple(laws.preload, ratio * share)
        end = begin & (is_one_force | (kinds != COMPLIANT)[None])
    if laws is not None and laws.reach is not None:
        end = end & is_multiple(laws.reach, jnp.abs(share))
    return SideBySide(jnp.where(begin, share, 0), jnp.where(end, share, 0))


def _have_one_law(restitution: Restitution) -> Bool[Array, "elements elements"] | bool:
    """Flags of the pairs of contacts with equal numbers in their law; of several laws none counts as equal."""
    if isinstance(restitution, ByContact):
        return False
    numbers = [jnp.asarray(law) for law in jax.tree.leaves(restitution)]
    return jnp.all(jnp.stack([own[:, None] == own[None] for own in numbers]), axis=0)


def _walls_of(numbers: MachineNumbers | Contacts) -> Waves | None:
    """Motions of the contacts along their rows; None if all stand still, or those of one mass move alike."""
    if isinstance(numbers, Contacts):
        return numbers.walls
    return None if numbers.signs is None else numbers.travel


def _shares_of_sums(laws: Laws, pairs: SideBySide) -> Float[Array, "elements elements"]:
    """Multiples by which followers count for the first of them, in the row of that; 0 for all else."""
    kinds = np.array(laws.kinds)
    normal = np.array(laws.normal or [-1] * len(kinds))
    rubs = (kinds == FRICTION) & (normal[:, None] == normal[None])
    whole = rubs | (kinds == RIGID)[None]
    shares = jnp.where(whole, pairs.begin, jnp.where((kinds == COMPLIANT)[None], pairs.end, 0))
    return jnp.where(jnp.any(shares != 0, axis=0)[:, None], 0, shares)


def summed(numbers: MachineNumbers) -> MachineNumbers:
    """The machine with the sum of the forces of elements side by side in the first of them, and none in the others."""
    laws = numbers.laws
    if laws is None or max(map(laws.kinds.count, (COMPLIANT, FRICTION))) < 2:
        return numbers
    shares = jnp.abs(_shares_of_sums(laws, side_by_side(numbers)))
    follows = jnp.any(shares != 0, axis=0)

    def of_sum(own: Reals | None, order: int) -> Array | None:
        return None if own is None else jnp.where(follows, 0, own + shares**order @ own)

    names = {"force": 1, "grip": 1, "coefficient": 1, "static_coefficient": 1, "preload": 1}
    names |= {"stiffness": 2, "damping": 2}
    new = [of_sum(getattr(laws, name), order) for name, order in names.items()]
    get = lambda numbers: [getattr(numbers.laws, name) for name in names]  # noqa: E731
    return eqx.tree_at(get, numbers, new, is_leaf=lambda leaf: leaf is None)


def follower_flags(contacts: Contacts) -> Bool[Array, " elements"]:
    """Flags of the elements whose forces `summed` gave to others, and of rigid contacts that follow others."""
    follows = jnp.any(side_by_side(contacts).begin != 0, axis=0)
    if not isinstance(contacts, SwitchingContacts):
        return follows
    laws: Laws = contacts.laws
    forces = [laws.force, laws.grip, laws.preload, laws.stiffness, laws.damping, laws.coefficient]
    has_none = jnp.all(jnp.stack([jnp.asarray(own) == 0 for own in forces if own is not None]), axis=0)
    return follows & has_none


def of_first_contacts(
    pairs: SideBySide, kinds: tuple[int, ...], flags: Bool[Array, "rows elements"]
) -> Bool[Array, "rows elements"]:
    """Flags of elements at instants, those of rigid contacts side by side in the first of them: rounding decides which is hit."""
    rigid = np.array(kinds) == RIGID
    follows = (pairs.begin != 0) & rigid[:, None] & rigid[None]
    return (flags | (flags @ follows.T)) & ~jnp.any(follows, axis=0)[None]


def as_their_sum(
    laws: Laws, pairs: SideBySide, ended: Array, before: Array, after: Array
) -> tuple[Int[Array, "rows elements"], Int[Array, "rows elements"], Int[Array, "rows elements"]]:
    """Zeros of guards at instants and the modes before and after, (rows, elements) each, of the machine `summed`."""
    shares = _shares_of_sums(laws, pairs)
    follows, leads = (jnp.any(shares != 0, axis=axis)[None] for axis in (0, 1))

    def summed_mode(mode: Array) -> Array:
        is_held = jnp.any((shares != 0)[None] & (mode == HELD)[:, None], axis=2)
        mode = jnp.where(leads & rests_in(mode) & is_held, jnp.int8(HELD), mode)
        return jnp.where(follows & rests_in(mode), jnp.int8(KEPT), mode)

    before, after = summed_mode(before), summed_mode(after)
    # By the bound that the sum has reached, not by that of the first one, which may have been there all along.
    slips = rests_in(before) & ((after == AHEAD) | (after == BEHIND))
    of_others = jnp.max(jnp.where((shares != 0)[None], ended[:, None], 0), axis=2)
    of_sum = jnp.where(ended > 0, ended, of_others)
    of_sum = jnp.where(slips & (of_sum > 0), jnp.where(after == AHEAD, 1, 2), of_sum)
    ended = jnp.where(leads, jnp.where(rests_in(before) & rests_in(after), 0, of_sum), ended)
    return jnp.where(follows, 0, ended), before, after
