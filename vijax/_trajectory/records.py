"""What the loop of a trajectory records, step by step: each record is one observer.

To add one, write a subclass of `AbstractObserver` and give it to `begin_loop` under a name. What it has seen is a part of
the carry of the loop under that name; `CallProgress` hands it on from call to call, and `finish` returns it.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._hybrid.transition import Instant
from .._jax.arrays import Flag, Scalar
from .._machine.machine import Machine
from .._machine.state import State
from .batched import Writing, put
from .event_log import Log, empty_log, log_row
from .grazing import Grazing, no_grazing, update_grazing


class Leg(NamedTuple):
    """One step of the loop; where a recorded flight is repeated, `before`, `flight` and `after` are None.

    Attributes:
        before: `State` at its beginning.
        flight: `Flight` from there.
        after: `State` after the transition at its end.
        onward: the same with a new period begun where one is over.
        instant: the transition.
        time: its time.
        is_goal: whether it ends at a goal.
        goal: number of goals reached before.
    """

    before: Any
    flight: Any
    after: Any
    onward: State
    instant: Instant
    time: Scalar
    is_goal: Bool[Array, "..."]
    goal: Int[Array, "..."]

    def in_lanes(self, live: Flag) -> "Leg":
        """The step as observers see it: of lanes that are not live no goal counts."""
        return self._replace(is_goal=live & self.is_goal)


class AbstractObserver(eqx.Module):
    """Observer of a motion, which keeps nothing itself: what it has seen is carried along."""

    @abc.abstractmethod
    def first(self, machine: Machine, state: State, t0: Scalar) -> Any:
        """Make what is seen before the first step, in the state at the start."""

    @abc.abstractmethod
    def update(self, machine: Machine, seen: Any, leg: Leg, live: Flag) -> Any:
        """Update what is seen by one step of the live lanes."""

    def goes_on(self, seen: Any) -> Flag | None:
        """Flag: the motion may go on; None if this observer never ends it."""
        del seen


class Logging(AbstractObserver):
    """Log of the events.

    Attributes:
        max_events: bound on the logged events of all calls.
        room: bound on the logged events of this call.
        is_whole: whether its log is the only one.
    """

    max_events: Int[Array, "..."]
    room: int = eqx.field(static=True)
    is_whole: bool = eqx.field(static=True)

    def first(self, machine: Machine, state: State, t0: Scalar) -> Log:
        """Make the log of the start."""

        def empty(state: State, t0: Scalar) -> Log:
            has_impulses = machine.contacts.is_coupled
            return empty_log(state, t0, self.room, is_whole=self.is_whole, has_impulses=has_impulses)

        return (jax.vmap(empty, -1) if t0.ndim else empty)(state, t0)

    def update(self, machine: Machine, seen: Log, leg: Leg, live: Flag) -> Log:
        """Log the events of a step."""
        del machine
        return log_row(seen, leg.onward, leg.instant, leg.time, live, self.max_events)

    def goes_on(self, seen: Log) -> Flag:
        """Flag: the log has room for another instant."""
        return seen.has_room(self.max_events)


class Saving(AbstractObserver):
    """Positions and velocities at the goals, (goals + 1, n) each; the last row takes what is not saved."""

    num_goals: int = eqx.field(static=True)
    num_coordinates: int = eqx.field(static=True)

    def first(self, machine: Machine, state: State, t0: Scalar) -> tuple[Array, Array]:
        """Make the room."""
        del machine
        saved = jnp.zeros((*t0.shape, self.num_goals + 1, self.num_coordinates), state.x.dtype)
        return saved, saved

    def update(
        self, machine: Machine, seen: tuple[Array, Array], leg: Leg, live: Flag
    ) -> tuple[Array, Array]:
        """Save the state at a goal."""
        del live
        x, v = machine.in_space(leg.onward)
        (saved,) = put(leg.is_goal, Writing(seen, (x[None], v[None]), leg.goal))
        return saved


class GrazingWatch(AbstractObserver):
    """Closest approach to grazing."""

    def first(self, machine: Machine, state: State, t0: Scalar) -> Grazing:
        """No approach yet."""
        del machine, state
        return no_grazing(t0)

    def update(self, machine: Machine, seen: Grazing, leg: Leg, live: Flag) -> Grazing:
        """Compare with the impacts and passes of a step."""
        return update_grazing(machine, leg.before, leg.after, leg.instant, seen, live)


class CountedImpacts(NamedTuple):
    """Impacts with one stop: velocities just before the last transition, (n,), and their number."""

    v: Float[Array, " n"]
    number: Int[Array, ""]


class ImpactCount(AbstractObserver):
    """Impacts with one stop, up to a number of them; one at the start does not count.

    Attributes:
        stop: the stop.
        most: the number.
    """

    stop: Int[Array, ""]
    most: Int[Array, ""]

    def first(self, machine: Machine, state: State, t0: Scalar) -> CountedImpacts:
        """None at the start."""
        del machine, t0
        return CountedImpacts(state.v, jnp.array(0))

    def update(self, machine: Machine, seen: CountedImpacts, leg: Leg, live: Flag) -> CountedImpacts:
        """Count an impact at the end of a step."""
        del machine
        is_later = (leg.before.periods > 0) | (leg.instant.time > 0)
        v = jnp.where(live, leg.flight.end.v, seen.v)
        return CountedImpacts(v, seen.number + (live & leg.instant.hit[self.stop] & is_later))

    def is_there(self, seen: CountedImpacts) -> Flag:
        """Flag: the motion has reached the last of them."""
        return seen.number >= self.most

    def goes_on(self, seen: CountedImpacts) -> Flag:
        """Flag: there are fewer."""
        return ~self.is_there(seen)
