"""Steps of few branches, up to the first at whose end the machine does not follow the cycle.

The program of few branches of a machine whose forces switch steps on as if it did, see `step_kernel.py`; the runs are made here.
"""

from collections.abc import Sequence as Many
from typing import NamedTuple

import jax
import numpy as np

from .._jax.packing import Packed
from .._orbits.sequence import Sequence
from .batches import FamilyStack
from .kernels import SimulatedMotion
from .motions import motions
from .padding import padded_for_run
from .step_kernel import Stepped
from .steps import is_followed_or_unstable


class _End(NamedTuple):
    """The last try that counts, its motion if it was simulated, and whether later ones are dropped."""

    last: int
    motion: SimulatedMotion | None
    is_cut: bool


def followed(
    stack: FamilyStack,
    tasks: Many[int],
    requests: Packed,
    before: Packed,
    stepped: Stepped,
    points: Packed,
    room: int,
) -> tuple[Stepped, Packed]:
    """Results of `take_steps` with `motion` as a list, and the points from which to step on.

    Args:
        stack: families of the branches.
        tasks: of the rows.
        requests: for steps.
        before: points where they began.
        stepped: results without simulations.
        points: where these end.
        room: padded number of events of the cycles.
    """
    ends = [_end_of(stack, task, requests.at(k), stepped, k, room) for k, task in enumerate(tasks)]
    cut = [k for k, end in enumerate(ends) if end.is_cut]
    stepped = stepped._replace(motion=[end.motion for end in ends], runs=None)  # pyright: ignore[reportArgumentType]
    if cut:
        names = "next_ds", "is_taken", "last", "is_sound", "has_motion", "next_length"
        stepped = stepped._replace(**{name: np.array(getattr(stepped, name)) for name in names})
        points = jax.tree.map(np.array, points)
    for k in cut:
        j = ends[k].last
        stepped.next_length[k] = stepped.ds[k, j + 1] if j < stepped.last[k] else stepped.next_ds[k]
        stepped.next_ds[k], stepped.last[k] = stepped.ds[k, j], j
        stepped.is_taken[k, j:], stepped.is_sound[k], stepped.has_motion[k] = False, True, True
        row = stepped.tries.at((k, j - 1)) if stepped.is_taken[k].any() else before.at(k)
        points.reals[k], points.wholes[k] = row.reals, row.wholes
    return stepped, points


def _end_of(stack: FamilyStack, task: int, request: Packed, stepped: Stepped, k: int, room: int) -> _End:
    last, is_taken = int(stepped.last[k]), stepped.is_taken[k]
    tries = np.flatnonzero(is_taken | (np.arange(len(is_taken)) == last) & stepped.has_motion[k])
    if not tries.size:
        return _End(last, None, is_cut=False)
    sequence: Sequence = request.unpacked().sequence
    assert stepped.runs is not None
    cycle, runs = (own.at((k, tries)).unpacked() for own in (stepped.tries, stepped.runs))
    sequence, places = padded_for_run(sequence, (cycle.found.place,), room)
    found = motions(stack, task, sequence, places, runs)
    for row, j in enumerate(tries.tolist()):
        at = lambda tree, row=row: jax.tree.map(lambda a: a[row], tree)  # noqa: E731
        if is_taken[j] and not is_followed_or_unstable(sequence, at(cycle), at(found)):
            return _End(j, at(found), is_cut=True)
    return _End(last, at(found) if tries[-1] == last else None, is_cut=False)
