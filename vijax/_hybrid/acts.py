"""Search for a set of acts of elements that agrees with all laws, among finitely many, see `decision.py` and `friction_impacts.py`.

Up to a number of elements all sets are tried, one after the other, and the best is taken. Of more, the first are the starts of
pivots: all elements in conflict change their act at once, later one at a time (as principal pivots of linear
complementarity: K. G. Murty, Linear Algebra Appl. 7 (1974)).

Such a set may let go more than it must, as what is in conflict lets go all at once. So whatever gives way in it is held once more, one
element after the other, with pivots of all others.

Of equally good sets that is taken to which pivots from the first set lead: what is beyond its bound lets go. Where these lead back
to it, as where each of two could slip alone and both together would return, the set is taken whose forces stay furthest within
their bounds: the order of the elements has no part. Of more elements than are listed it has, as their pivots and trials go by it.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._jax.xla import is_any

# Of more elements than all sets are tried of: number of starts, of pivots from each, and of those that change several acts at
# once.
_STARTS, _PIVOTS, _JOINT_PIVOTS = 27, 64, 16
# Number of pivots before all sets are tried, and with an element that is held once more.
_FIRST_PIVOTS = 6
# Score of a conflict, of friction at rest, of any other element at rest.
CONFLICT, STICKS, HOLDS = -10_000, 100, 1


class Judged(NamedTuple):
    """A set of acts.

    Attributes:
        score: not negative if it stands.
        proposed: the acts after a pivot.
        found: what it means.
        load: greatest ratio of a force to its bound, among elements that hold; None if no two sets have one score.
    """

    score: Int[Array, "..."]
    proposed: Int[Array, "contacts ..."]
    found: Any
    load: Float[Array, "..."] | None = None


class _Trials(NamedTuple):
    """Elements of the best set that are held once more: flags of those that were, of the one that is, and the number of its pivots."""

    done: Bool[Array, "contacts ..."]
    one: Bool[Array, "contacts ..."]
    pivots: Int[Array, "..."]


class _Search(NamedTuple):
    """Search among sets of acts: the number of turns, the last set begun with, the next one, the best so far, and the trials of many."""

    turn: Int[Array, ""]
    start: Int[Array, "contacts ..."]
    acts: Int[Array, "contacts ..."]
    is_last: Bool[Array, "..."]
    best: tuple[Judged, Int[Array, "contacts ..."]]
    trials: _Trials | None


def search_acts(
    judge: Callable[[Array], Judged],
    elements: Bool[Array, "contacts ..."],
    first: Int[Array, "contacts ..."],
    most: Int[Array, "..."],
    nothing: Any,
    *,
    enumerated: int,
    has_two: Bool[Array, "contacts ..."] | None = None,
    has_loads: bool = False,
) -> Judged:
    """Best set of acts 0, -1 and 1 of the elements.

    Args:
        judge: judges a set.
        elements: flags of the elements that have a choice.
        first: the set to begin with, all acts 0.
        most: score that no set exceeds.
        nothing: what a set means, before any is judged.
        enumerated: number of elements up to which all sets are tried.
        has_two: flags of elements that have the acts 0 and -1 alone; none if left out.
        has_loads: whether `judge` gives loads, which decide between sets of one score.
    """
    count = jnp.sum(elements, axis=0)
    # Of a machine with so few elements all sets are always tried: what is for more is left out of its program.
    is_few, is_listed = len(elements) <= enumerated, count <= enumerated

    def goes_on(carry: _Search) -> Array:
        is_over = (carry.best[0].score >= most) | carry.is_last
        return is_any(~is_over if is_few else ~is_over & (is_listed | (carry.turn < _STARTS * _PIVOTS)))

    def turned(carry: _Search) -> _Search:
        found, best = judge(carry.acts), carry.best[0]
        better = found.score > best.score
        if found.load is not None:
            # Pivots from the first set come before all others.
            load = jnp.where(jnp.all(carry.start == first, axis=0), -jnp.inf, found.load)
            found = found._replace(load=load)
            # Symmetric sets have one load to rounding: the first one is taken.
            less = load < best.load - float(jnp.finfo(load.dtype).eps) ** 0.5
            better = better | ((found.score == best.score) & less)
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), (found, carry.acts), carry.best)
        turn = carry.turn + 1
        following, is_last = _next_set(elements, carry.start, has_two)
        changes = found.proposed != carry.acts
        is_first = (turn <= _FIRST_PIVOTS) & jnp.all(carry.start == first, axis=0) & jnp.any(changes, axis=0)
        if is_few:
            acts = jnp.where(changes, found.proposed, carry.acts)
            start, acts = (jnp.where(is_first, a, following) for a in (carry.start, acts))
            return _Search(turn, start, acts, carry.is_last | (~is_first & is_last), best, None)
        starts_anew = jnp.where(is_listed, ~is_first, turn % _PIVOTS == 0)
        start = jnp.where(starts_anew, following, carry.start)
        first_change = changes & (jnp.cumsum(changes, axis=0) == 1)
        is_single = turn % _PIVOTS > _JOINT_PIVOTS
        pivoted = jnp.where(jnp.where(is_single, first_change, changes), found.proposed, carry.acts)
        is_last = is_listed & starts_anew & is_last
        acts, is_found = jnp.where(starts_anew, start, pivoted), ~is_listed & (best[0].score >= 0)
        assert carry.trials is not None
        trials, held_again = _held_again(elements, carry.trials, found, best[1])
        trials = jax.tree.map(lambda a, b: jnp.where(is_found, a, b), trials, carry.trials)
        acts = jnp.where(is_found, held_again, acts)
        is_last = carry.is_last | jnp.where(is_found, ~jnp.any(trials.one, axis=0), is_last)
        return _Search(turn, start, acts, is_last, best, trials)

    lowest = jnp.full_like(count, 2 * len(elements) * CONFLICT)
    none, nowhere = jnp.zeros_like(elements), jnp.zeros_like(count, bool)
    begun = Judged(lowest, first, nothing, jnp.full(count.shape, jnp.inf) if has_loads else None), first
    trials = None if is_few else _Trials(none, none, jnp.zeros_like(count))
    search = _Search(jnp.array(0), first, first, nowhere, begun, trials)
    return jax.lax.while_loop(goes_on, turned, search).best[0]


def _held_again(
    elements: Array, trials: _Trials, found: Judged, best: Array
) -> tuple[_Trials, Int[Array, "contacts ..."]]:
    """The next trial, and its set: more pivots with the same element, or the best set with the next one that gives way in it."""
    goes_on = (found.score < 0) & (trials.pivots < _FIRST_PIVOTS) & jnp.any(trials.one, axis=0)
    waits = elements & (best != 0) & ~trials.done
    one = jnp.where(goes_on, trials.one, waits & (jnp.cumsum(waits, axis=0) == 1))
    acts = jnp.where(one, jnp.int8(0), jnp.where(goes_on, found.proposed, best))
    return _Trials(trials.done | one, one, jnp.where(goes_on, trials.pivots + 1, 0)), acts


def _next_set(
    elements: Array, acts: Array, has_two: Array | None
) -> tuple[Int[Array, "contacts ..."], Bool[Array, "..."]]:
    """The set that follows, acts 0, -1, 1 counted upwards from the first element at rest; and whether it is the first again."""

    def count(carries: Array, one: tuple[Array, ...]) -> tuple[Array, Array]:
        is_at_rest, act, *two = one
        # 0 -> -1 -> 1 -> 0.
        turned = jnp.where(act == 0, -1, jnp.where(act < 0, 1, 0)).astype(act.dtype)
        is_last = act > 0
        if two:
            is_last = is_last | (two[0] & (act < 0))
            turned = jnp.where(is_last, jnp.int8(0), turned)
        return carries & (~is_at_rest | is_last), jnp.where(carries & is_at_rest, turned, act)

    rows = (elements, acts) if has_two is None else (elements, acts, has_two)
    carries, acts = jax.lax.scan(count, jnp.ones_like(elements[0]), rows)
    return acts, carries
