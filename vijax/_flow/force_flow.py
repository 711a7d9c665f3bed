"""Motion of a machine with a force between events, by the Taylor series of `force_series.py`.

Each step expands the motion; what is left is as for linear machines: steps proved free of events by the coefficients, and
landing on events. Where a force consists of branches, a step also ends where its branch changes, see `branches.py`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PyTree

from .._jax.arrays import Scalar
from .._jax.xla import compute_once
from .._lanes.transform import lanes_last
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives
from .._machine.machine import Machine
from .._machine.state import State, with_memory
from .._series.motion_bound import has_motion_bound
from .._series.order_loop import LoopSeries
from .._series.plan import Plan
from .._series.series import Series
from .arrival import arrival_of
from .branches import DECIDING, Branches, branches_ahead, changes_at, modes_now, unknown_branches
from .delayed_branches import gain_of_delay
from .exact_step import ExpandingFlow, flight_along, move_along, state_after_step
from .force_plan import plan_of
from .force_series import LONGEST_PHASE, ForceSeries, force_series
from .interface import Flight, FlightMotion, PhaseChange, StepMotion
from .orders import Orders, as_array, slope_of, value_of
from .series import derivative, horner, sum_series
from .series_length import derivative_limit, is_bounded, is_consistent, motion_limit, time_limit
from .shortening import MOST_HALVINGS, shortened
from .taylor import TaylorExpansion

# Longest step of a motion without any scale, in time scales of the machine.
_LONGEST = 1e3
# Quarterings of a step whose end contradicts the force.
_MOST_CUTS = 40
# Bound on the steps of a flow map: only a diverged guess needs more, and nothing else should wait for it.
_MOST_STEPS = 10_000
# Orders and tolerances of 32-bit numbers.
_MOST_ORDER, _LEAST_TOLERANCE = {"float64": 40, "float32": 8}, {"float64": 1e-16, "float32": 1e-7}


class ForceExpansion(TaylorExpansion):
    """Taylor coefficients of positions, forces and phase.

    Attributes:
        pace: time scale of the motion now: the length of a step for accuracy alone.
        branches: branches of the force in this step, and those that follow it; None if there is one branch alone.
        is_alone: whether it is the motion of one trajectory, whose polynomials are summed by few operations.
    """

    pace: Scalar
    branches: Branches | None = None
    is_alone: bool = eqx.field(static=True, default=False)

    @property
    def series(self) -> tuple[Array, ...]:
        """All orders of which each has one."""
        order = len(self.forces)
        return self.x[:order], self.forces, self.phase[:order]

    def rest(self, machine: Machine, limit: Scalar) -> tuple[Array, Array]:
        """Bound |x^(4)| / 24 and |force^(3)| / 6 on [0, limit] by sums of absolute coefficients."""
        del machine
        value = value_of if self.is_alone else horner
        return value(jnp.abs(self.x[4:]), limit), value(jnp.abs(self.forces[3:]), limit)

    def velocity_rest(self, machine: Machine, limit: Scalar) -> Array:
        """Bound |v^(4)| / 24 by the sum of absolute coefficients."""
        del machine
        x = jnp.abs(self.x)
        return value_of(slope_of(x)[4:], limit) if self.is_alone else horner(derivative(x)[4:], limit)

    def move(self, machine: Machine, state: State, step: Scalar) -> tuple[Array, Array, Array]:
        """Sum the series at `step`."""
        del machine, state
        if not self.is_alone:
            return sum_series(self.x, self.phase, step)
        change = [step * value_of(a[1:], step) for a in (self.x, self.phase)]
        return change[0], value_of(slope_of(self.x), step), change[1]


class ForceFlow(ExpandingFlow):
    """Motion of a machine with a force, by Taylor series.

    Attributes:
        order: last order of positions.
        tolerance: bound of the last terms, relative to the motion in a step.
        num_switches: number of choices between branches in the force.
    """

    is_linear: ClassVar[bool] = False

    order: int = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)
    num_switches: int = eqx.field(static=True)

    def expand(self, machine: Machine, state: State, hold: Held) -> ForceExpansion:
        """Compute the Taylor series of the motion at `state`, and the step for which they are right."""
        if state.x.ndim == 1:
            return self._expand(machine, state, hold, is_alone=True)
        return lanes_last(partial(self._expand, is_alone=False))(machine, state, hold)

    def _expand(
        self, machine: Machine, state: State, hold: Held, direction: Scalar | float = 1.0, *, is_alone: bool
    ) -> ForceExpansion:
        order, tolerance = self._order_and_tolerance(state)
        plan = self._plan(machine, jacobian=True)
        modes = self._modes(machine, state, hold, is_alone=is_alone)
        motion = force_series(plan, machine, state, hold, modes, order, is_alone=is_alone)
        call = compute_once if is_alone else _plainly
        limit_of = partial(_limit, has_powers=plan.has_closing_powers)
        assert motion.sizes is not None  # the plan has them
        limit = call(limit_of, machine, motion.x, *motion.sizes, tolerance)
        limit = time_limit(self._plan(machine), machine, state, modes, limit, order, tolerance)
        limit = _bounded(plan, machine, state, motion, limit)
        limit = _consistent(
            self._plan(machine), machine, state, hold, modes, motion, limit, tolerance, direction
        )
        pace, branches = limit, None
        if plan.num_switches:
            # Backwards a branch is continued.
            search = jnp.where(direction > 0, limit, 0)
            branches = call(branches_ahead, motion.series, modes, state.memory, search)
            limit = jnp.minimum(limit, branches.until)
        return _expansion(motion, limit, pace, branches)

    def fly(self, machine: Machine, state: State, remaining: Scalar, resolution: Scalar) -> Flight:
        """Take the longest step proved free of events, and land on an event close to its end."""
        hold = machine.hold(state.held)
        motion = compute_once(self.expand, machine, state, hold)
        until = None if motion.branches is None else motion.branches.until
        flight = flight_along(
            machine,
            state,
            motion,
            hold,
            remaining,
            resolution,
            near_future=self._near_future,
            near=_at_pace(machine, motion.pace),
            until=until,
        )
        if motion.branches is None:
            return flight
        has_event = jnp.any(flight.is_event, axis=0)
        memory = motion.branches.after(flight.duration, has_event)
        return eqx.tree_at(lambda f: f.end, flight, with_memory(flight.end, memory))

    def propagate(self, machine: Machine, state: State, hold: Held, step: Scalar) -> StepMotion:
        """Sum the series; where a branch changes at the end, its time moves with the parameters."""
        if state.x.ndim == 1:
            return self._move(machine, state, hold, step)
        still = jax.lax.stop_gradient
        modes = still(lanes_last(partial(self._modes, is_alone=False))(machine, state, hold))
        # The rule of derivatives would trace the concrete numbers of the machine.
        numbers, known = eqx.partition((machine, state, hold), lambda a: isinstance(a, jax.Array))
        return _moved_in_lanes(self, numbers, step, modes, lambda numbers: eqx.combine(numbers, known))

    def _move(
        self,
        machine: Machine,
        state: State,
        hold: Held,
        step: Scalar,
        *,
        is_alone: bool = True,
        modes: Any = None,
    ) -> tuple[Array, Array, Array]:
        """`propagate`, a subject of derivatives."""
        order, _ = self._order_and_tolerance(state)
        plan = self._plan(machine)
        if modes is None:
            modes = jax.lax.stop_gradient(self._modes(machine, state, hold, is_alone=is_alone))
        found = force_series(plan, machine, state, hold, modes, order, is_alone=is_alone)
        motion = _expansion(found, step, step, None)
        call = compute_once if is_alone else _plainly
        displacement, v, change = call(move_along, machine, state, motion, hold, step)
        if not plan.num_switches:
            return displacement, v, change
        branches, delay = changes_at(found.series, modes, jnp.abs(step))
        moved = state_after_step(machine, state, displacement, v, change, step)
        gain = gain_of_delay(plan, machine, moved, hold, (branches.modes, branches.at_end()), delay)
        return displacement + gain * delay / 2, v + gain, change

    def coast(self, machine: Machine, state: State, remaining: Scalar) -> tuple[State, Scalar]:
        """Step as far as the expansion is valid."""
        return self._coast(machine, state, machine.hold(state.held), remaining, 1.0)[:2]

    def _coast(
        self, machine: Machine, state: State, hold: Held, remaining: Scalar, direction: Scalar | float
    ) -> tuple[State, Scalar, Array]:
        """State after a step in a direction, its length without a sign, and the displacement."""
        still = jax.lax.stop_gradient
        # Lengths of steps are constants, and the series for them has more in it than that of the motion.
        ahead = compute_once(partial(self._expand, is_alone=True), *still((machine, state, hold)), direction)
        step = jnp.minimum(remaining, ahead.limit)
        moved = self._move(machine, state, hold, direction * step)
        end = state_after_step(machine, state, *moved, direction * step)
        if ahead.branches is not None:
            memory = ahead.branches.after(still(step), jnp.zeros(step.shape, bool))
            end = with_memory(end, memory)
        return end, step, moved[0]

    def flow_map(
        self, machine: Machine, state: State, hold: Held, span: Scalar, change: PhaseChange
    ) -> FlightMotion:
        """Follow a whole flight step by step; NaN after too many. Differentiable forward."""
        del change
        direction, zero = jnp.where(span < 0, -1.0, 1.0), jnp.zeros_like(state.x)

        def one(now: _FlowMapState) -> _FlowMapState:
            here = now.state
            end, step, displacement = self._coast(machine, here, hold, now.left, direction)
            displacement, gain = now.displacement + displacement, now.gain + (end.v - here.v)
            return _FlowMapState(end, now.left - step, displacement, gain, now.num_steps + 1)

        begin = with_memory(state, self.memory(jnp.zeros_like(span)))
        is_on = lambda now: (now.left > 0) & (now.num_steps < _MOST_STEPS)  # noqa: E731
        start = _FlowMapState(begin, direction * span, zero, zero, jnp.array(0))
        end = jax.lax.while_loop(is_on, one, start)
        is_there = end.left == 0
        return jnp.where(is_there, end.displacement, jnp.nan), jnp.where(is_there, end.gain, jnp.nan)

    def memory(self, like: Scalar) -> PyTree:
        """Branches of the force, not decided yet; None if there is one alone."""
        return unknown_branches(self.num_switches, like)

    def _plan(self, machine: Machine, *, jacobian: bool = False) -> Plan:
        assert machine.extra is not None
        force, lanes = machine.extra.force, machine.mean.ndim > 1
        return plan_of(force, machine.num_masses, lanes=lanes, jacobian=jacobian)

    def _modes(self, machine: Machine, state: State, hold: Held, *, is_alone: bool) -> tuple[Scalar, ...]:
        plan = self._plan(machine)
        if not plan.num_switches:
            return ()

        def series_with(modes: tuple[Scalar, ...]) -> Series | LoopSeries:
            return force_series(plan, machine, state, hold, modes, DECIDING, is_alone=is_alone).series

        return modes_now(plan, state.memory, series_with)

    def _near_future(self, machine: Machine, state: State, hold: Held) -> tuple[Array, ...]:
        """First Taylor coefficients at the end of a step, in the branches that follow."""
        terms = arrival_of(machine).terms
        is_alone = state.x.ndim == 1

        def of_one(machine: Machine, state: State, hold: Held) -> tuple[Array, ...]:
            plan = self._plan(machine)
            modes = self._modes(machine, state, hold, is_alone=is_alone)
            motion = force_series(plan, machine, state, hold, modes, terms, is_alone=is_alone)
            x, force, phase = map(as_array, (motion.x, motion.force, motion.phase[: terms + 1]))
            return x, force, phase

        return (of_one if is_alone else lanes_last(of_one))(machine, state, hold)

    def _order_and_tolerance(self, state: State) -> tuple[int, float]:
        dtype = str(state.x.dtype)
        return min(self.order, _MOST_ORDER[dtype]), max(self.tolerance, _LEAST_TOLERANCE[dtype])


@eqx.filter_custom_jvp
def _moved_in_lanes(flow: ForceFlow, numbers: Any, step: Scalar, modes: Any, of_numbers: Callable) -> Any:
    """`ForceFlow.propagate` in lanes, written out element by element, as its derivative is."""
    return _in_lanes(flow, numbers, step, modes, of_numbers)


def _in_lanes(flow: ForceFlow, numbers: Any, step: Scalar, modes: Any, of_numbers: Callable) -> Any:
    def of_one(given: Any, step: Scalar, modes: Any) -> Any:
        machine, state, hold = given
        return flow._move(machine, state, hold, step, is_alone=False, modes=modes)

    return lanes_last(of_one)(of_numbers(numbers), step, modes)


@_moved_in_lanes.def_jvp
def _moved_in_lanes_jvp(primals: tuple, tangents: tuple) -> tuple:
    flow, numbers, step, modes, of_numbers = primals
    found = _moved_in_lanes(*primals)

    def of_one(given: Any, step: Scalar, modes: Any, by_numbers: Any, by_step: Any) -> Any:
        moving, known = eqx.partition(given, lambda a: isinstance(a, jax.Array))

        def end(moving: Any, step: Scalar) -> Any:
            machine, state, hold = eqx.combine(moving, known)
            return flow._move(machine, state, hold, step, is_alone=False, modes=modes)

        return eqx.filter_jvp(end, (moving, step), (by_numbers, by_step))[1]

    along = lanes_last(of_one)(of_numbers(numbers), step, modes, tangents[1], tangents[2])
    return found, along


class _FlowMapState(NamedTuple):
    """Carry of a flow map: state, time left, displacement, gain of velocity, and number of steps."""

    state: State
    left: Scalar
    displacement: Array
    gain: Array
    num_steps: Int[Array, ""]


def _expansion(motion: ForceSeries, limit: Scalar, pace: Scalar, branches: Branches | None) -> ForceExpansion:
    x, force, phase = map(as_array, (motion.x, motion.force, motion.phase))
    now = Derivatives(2 * x[2], 6 * x[3], force[0], force[1], 2 * force[2])
    return ForceExpansion(now, limit, x, force, phase, pace, branches, not isinstance(motion.x, list))


def _plainly(function: Any, *args: Any) -> Any:
    return function(*args)


def _at_pace(machine: Machine, pace: Scalar) -> Machine:
    """The machine with the time scale of its motion now."""
    timescale = jnp.minimum(machine.timescale, pace)
    return eqx.tree_at(lambda m: (m.rate, m.timescale), machine, (1 / timescale, timescale))


def _limit(
    machine: Machine, x: Orders, by_x: Any, by_v: Any, tolerance: float, *, has_powers: bool
) -> Scalar:
    """Longest step by rules 1 and 2, and for which the phase of the load is right."""
    of_derivatives = derivative_limit(by_x, by_v, len(x) - 1, tolerance, has_powers=has_powers)
    limit = jnp.minimum(motion_limit(machine, x, tolerance), of_derivatives)
    fastest = machine.fastest
    limit = jnp.where(
        fastest > 0, jnp.minimum(limit, LONGEST_PHASE / jnp.where(fastest > 0, fastest, 1)), limit
    )
    return jnp.minimum(limit, _LONGEST * machine.timescale)


def _bounded(plan: Plan, machine: Machine, state: State, motion: ForceSeries, limit: Scalar) -> Scalar:
    """Longest step, halved until the force along it is bounded on a disc of complex times."""
    if not has_motion_bound(plan):
        return limit

    def is_good(limit: Scalar) -> Any:
        return compute_once(is_bounded, plan, machine, state, motion, limit)

    return shortened(limit, is_good, 1 / 2, MOST_HALVINGS)


def _consistent(
    plan: Plan,
    machine: Machine,
    state: State,
    hold: Held,
    modes: tuple[Scalar, ...],
    motion: ForceSeries,
    limit: Scalar,
    tolerance: float,
    direction: Scalar | float,
) -> Scalar:
    """Longest step, quartered until it ends where the force is that of the polynomial."""

    def is_good(limit: Scalar) -> Any:
        step = direction * limit
        return compute_once(is_consistent, plan, machine, state, hold, modes, motion, step, tolerance)

    return shortened(limit, is_good, 1 / 4, _MOST_CUTS)
