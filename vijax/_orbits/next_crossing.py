"""The next passage of a mass through a position.

The position becomes a contact of the machine that nothing hits. The engine finds the time at which it closes, as
exactly as for a stop and with the same proof that no passage is missed, and the motion ends there.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._flow.choose import choose_flow
from .._flow.interface import AbstractFlow
from .._flow.taylor import TaylorFlow
from .._jax.arrays import Count, Numbers, Reals, Scalar, as_float, whole_number
from .._jax.concrete import concrete
from .._jax.errors import checked, none_true, number_of_doubts
from .._jax.nan_mask import known_or_nan
from .._jax.xla import padding_allowed
from .._machine.numbers import MachineNumbers, numbers_of
from .._system.checks import FINITE, check_one, check_shape, validate_start, whole_start
from .._system.contact import AbstractRigidLimit, Contact
from .._system.restitution import restitution_of_contacts
from .._system.system import AnySystem, ImpactSystem, machine_of, with_args
from .._trajectory.impact_loop import ImpactRequest, follow_to_impact
from .._trajectory.results import RESULTS, result_sentences
from .._trajectory.simulate import bound_of_steps, warn_about_reverse_steps
from .next_impact import default_end_time

_SIDES = {"up": 1.0, "down": -1.0}
_NONE = (
    "The mass does not pass the place in that direction before `t1`: look at the motion with `vx.simulate`, or give it "
    "more time by a later `t1`."
)


@padding_allowed
def next_crossing(
    system: AnySystem,
    t0: ArrayLike,
    x0: Numbers,
    v0: Numbers,
    mass: Count,
    position: ArrayLike,
    direction: str = "up",
    *,
    t1: ArrayLike | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_steps: Count | None = None,
    max_reverse_steps: Count | None = None,
    throw: bool = True,
) -> tuple[Float[Array, ""], Float[Array, " n"], Float[Array, " n"]]:
    """Return time and state where a mass next passes a position, as a differentiable function.

    From one passage to the next it is the Poincare map of the section x_i = c. All events between are followed as in
    `vx.simulate`. Derivatives are those of the state on the section: they include the change of its time, and the
    position of that mass has those of `position`. A start on the section, such as the last result, does not count.

    Args:
        system: the machine.
        t0: time of the start.
        x0: positions, (n,).
        v0: velocities, (n,).
        mass: index of the mass.
        position: the position c.
        direction: "up" where x rises through it, "down" where it falls.
        t1: time at which to give up; 1000 forcing periods after t0, if left out.
        flow: as for `simulate`.
        args: likewise.
        max_steps: likewise.
        max_reverse_steps: likewise.
        throw: raise if there is no such passage; otherwise time, state and their derivatives are NaN.

    Returns:
        Time, positions, (n,), and velocities, (n,); with Jenkins elements those of their sliders behind them.

    Raises:
        ValueError: if there is no such mass or direction, no `t1` for a load without a frequency, or a wrong start: see
            `simulate`.
        RuntimeError: with `throw`, if the mass does not pass there until t1, or the motion ends before, see `RESULTS`.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        t, x, v = vx.next_crossing(system, 0.0, [0.0, 0.0], [0.0, 0.0], mass=1, position=0.1)
        ```

    References:
        M. di Bernardo et al., Piecewise-smooth Dynamical Systems (2008), Sec. 2.4.
    """
    warn_about_reverse_steps(max_reverse_steps)
    system = machine_of(system)
    bound, n = with_args(system, args), system.num_masses
    index = whole_number("mass", mass)
    if index >= n:
        raise ValueError(f"Argument `mass` must lie in 0 to {n - 1}, but is {index}.")
    if direction not in _SIDES:
        raise ValueError(f'Argument `direction` must be "up" or "down", but is {direction!r}.')
    begin, x, v, place = (as_float(a) for a in (t0, x0, v0, position))
    end = default_end_time(bound, begin) if t1 is None else as_float(t1)
    x, v = whole_start(bound, x, v)
    for name, value in (("t0", begin), ("t1", end), ("position", place)):
        check_shape(name, value, ())
    check_one("position", place, FINITE)
    doubts = validate_start(bound, begin, end, end[None], x, v)
    side = _SIDES[direction]
    search = _Search(
        bound,
        choose_flow(bound, can_stick=True, wanted=flow or (TaylorFlow() if bound.force is None else None)),
        index,
        place,
        end,
        bound_of_steps(max_steps),
    )
    is_sound = none_true(doubts)
    beyond = side * (x[index] - place)
    is_before = (beyond < 0) | ((beyond == 0) & (side * v[index] <= 0))
    start = _Passage(begin, x, v, jnp.asarray(True), RESULTS.successful)
    if concrete(is_before) is None or not is_before:
        start = search.back(start, -side, is_before, is_sound)
    found = search.passage(start, side, start.is_there & is_sound)
    there = found.t, found.x, found.v
    is_there = start.is_there & found.is_there
    if not throw:
        return known_or_nan(is_there, there)
    result = RESULTS.where(start.is_there, found.result, start.result)
    is_late = ~is_there & (result == RESULTS.successful)
    return checked(there, *number_of_doubts([*doubts, (is_late, _NONE)], *result_sentences(result)))


class _Passage(NamedTuple):
    """A time and a state, a flag of whether the motion arrived there, and the result if it did not."""

    t: Scalar
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    is_there: Bool[Array, ""]
    result: RESULTS


class _Search(NamedTuple):
    """A search for a passage of the mass through the position."""

    system: ImpactSystem
    flow: AbstractFlow
    mass: int
    place: Scalar
    end: Scalar
    max_steps: Array | np.ndarray

    def passage(self, start: _Passage, side: float, is_sound: Reals) -> _Passage:
        """The next passage towards a side, from a start on the other side."""
        return self._to(start, side, self.place, self.end, is_sound)

    def back(self, start: _Passage, side: float, is_back: Bool[Array, ""], is_sound: Reals) -> _Passage:
        """The next passage back, or the start itself where `is_back`."""
        # Where `is_back` the motion takes no time, and the position is one that it has not passed.
        place = jnp.where(is_back, start.x[self.mass] + side, self.place)
        end = jnp.where(is_back, start.t, self.end)
        found = self._to(start, side, place, end, is_sound)
        t, x, v = (
            jnp.where(is_back, old, new)
            for old, new in zip((start.t, start.x, start.v), (found.t, found.x, found.v), strict=True)
        )
        return _Passage(t, x, v, is_back | found.is_there, found.result)

    def _to(self, start: _Passage, side: float, place: Scalar, end: Scalar, is_sound: Reals) -> _Passage:
        wanted = ImpactRequest(
            t0=start.t,
            t1=end,
            x0=start.x,
            v0=start.v,
            stop=jnp.asarray(len(self.system.stops)),
            num_impacts=np.asarray(1),
            max_steps=self.max_steps,
            is_sound=is_sound,
        )
        numbers = _with_contact(self.system, self.mass, side, place)
        found = follow_to_impact(numbers, self.flow, wanted)
        x = jnp.where(found.is_there, found.x.at[self.mass].set(place), found.x)
        return _Passage(found.t, x, found.v, found.is_there, found.result)


def _with_contact(system: ImpactSystem, mass: int, side: float, place: Scalar) -> MachineNumbers:
    """The numbers of a machine with one contact more, between a mass and a position."""
    if system.is_coupled or any(stop.motion is not None for stop in system.stops):
        contact = Contact({mass: side}, side * place, 1.0)
        return numbers_of(eqx.tree_at(lambda s: s.stops, system, (*system.stops, contact)))
    numbers = numbers_of(system)
    row = jnp.zeros(system.num_masses).at[mass].set(side)
    names = lambda numbers: (numbers.rows, numbers.limit)  # noqa: E731
    longer = [
        jnp.concatenate([jnp.asarray(a), b[None]])
        for a, b in zip(names(numbers), (row, side * place), strict=True)
    ]
    restitution = restitution_of_contacts(
        [
            *(stop.restitution for stop in system.stops if isinstance(stop, AbstractRigidLimit)),
            jnp.ones_like(place),
        ],
        0 * place,
    )
    return eqx.tree_at(lambda n: (*names(n), n.restitution), numbers, (*longer, restitution))
