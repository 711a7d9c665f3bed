"""Motion between events of a machine with proportional damping, exact, mode by mode.

It is faster than `TaylorFlow` where the modes diagonalise the damping. Every mode is then q'' + 2 a q' + w^2 q = load,
and with b = w^2 - a^2 of either sign its free motion consists of

    c(t) = cos(sqrt(b) t),  s(t) = sin(sqrt(b) t) / sqrt(b),

entire functions of b: one formula for under-, over- and critically damped modes. They are summed as short power series
of b t^2 (a step is never long against the motion). The series vectorise, which library sines do not, and give the
increments c - 1 and exp(-a t) - 1 to full relative accuracy.

Every set of held masses has its own modes, computed once before the loop from concrete values: see `modes.py`, which
also says where they do not apply. So has every set of closed compliant contacts. The slip of friction is a constant
load: it displaces the mean of the steady response and leaves the modes.
"""

import operator
from functools import reduce
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Scalar, append_axes, matvec
from .._jax.xla import compute_once, is_any
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives, derivatives
from .._machine.machine import Machine
from .._machine.state import State
from .._system.waves import speeds, turned
from .exact_step import ExpandingFlow
from .interface import Expansion, FlightMotion, PhaseChange, StepMotion
from .modal_tables import Modes, Rests, SteadyResponse, bounds_of_rests, response_of
from .mode_series import (
    LONGEST_STEP_AND_TERMS,
    cosine_and_sine,
    factors,
    faded,
    increments_at_any_time,
)
from .polynomial_response import (
    LONGEST_STEP_AND_TERMS as LONGEST_UNDER_TABLES,
    bounds_of_load,
    from_rest,
    from_rest_at_any_time,
)


class ModalFlow(ExpandingFlow):
    """Exact motion of a linear machine with proportional damping. Made by `modal_flow`.

    The first axis of arrays is the set of held masses, the last the lanes. `sets` flags the masses held in each set,
    none in the first. `closed` flags the compliant contacts that are closed, for machines whose forces switch.
    """

    has_flow_map: ClassVar[bool] = True

    modes: Modes
    sets: Bool[Array, "sets n ..."]
    closed: Bool[Array, "sets contacts ..."] | None = None

    def prepare(self, machine: Machine) -> "PreparedModalFlow":
        """Add the steady response to the load, and the longest step."""

        def of_set(modes: Modes, closed: Array | None) -> tuple[SteadyResponse, Rests, Scalar]:
            own = machine if closed is None else machine.with_closed(closed)
            response = response_of(own, modes, switches=closed is not None)
            return response, bounds_of_rests(own, modes, response), own.rate

        response, rests, rates = jax.vmap(of_set)(self.modes, self.closed)
        longest = LONGEST_STEP_AND_TERMS if machine.tables is None else LONGEST_UNDER_TABLES
        trust, _ = longest[str(machine.mean.dtype)]
        # Overdamped modes are differences of growing terms and take half the step.
        excess = jnp.max(self.modes.decay**2 - self.modes.squared_frequency, axis=(0, 1))
        least = 2 * jnp.sqrt(jnp.maximum(excess, 0))
        limit = trust / jnp.maximum(machine.rate if self.closed is None else rates, least)
        return PreparedModalFlow(self.modes, response, rests, limit, self.sets, self.closed)

    def expand(self, machine: Machine, state: State, hold: Held) -> "ModalExpansion":
        """Prepare the modes and expand."""
        return self.prepare(machine).expand(machine, state, hold)


class PreparedModalFlow(ExpandingFlow):
    """Modes of a machine with its steady response to the load, and bounds of derivatives."""

    has_flow_map: ClassVar[bool] = True
    flow_map_reaches_far: ClassVar[bool] = True

    modes: Modes
    response: SteadyResponse
    rests: Rests
    limit: Float[Array, "..."]
    sets: Bool[Array, "sets n ..."]
    closed: Bool[Array, "sets contacts ..."] | None

    def expand(self, machine: Machine, state: State, hold: Held) -> "ModalExpansion":
        """Compute the modal coordinates of the free motion."""
        tables = self.modes, self.response, self.rests
        if self.closed is None:
            (modes, response, rests), limit = self._of_set(machine, state, hold, tables), self.limit
        else:
            tables = *tables, self.limit
            modes, response, rests, limit = self._of_set(machine, state, hold, tables)
        q, q_rate = self._coordinates(machine, state, modes, response)
        now = derivatives(machine, state, hold)
        return ModalExpansion(
            modes=modes,
            response=response,
            rests=rests,
            q=q,
            q_rate=q_rate,
            now=now,
            limit=limit,
            push=_push(machine, modes, state.phase),
        )

    def propagate(self, machine: Machine, state: State, hold: Held, step: Scalar) -> StepMotion:
        """Advance the modes, without what only `fly` needs of an expansion: derivatives would be taken of that too."""
        return compute_once(self._advanced, machine, state, hold, step)

    def _advanced(
        self, machine: Machine, state: State, hold: Held, step: Scalar
    ) -> tuple[Array, Array, Array]:
        modes, response = self._of_set(machine, state, hold, (self.modes, self.response))
        free, push = self._coordinates(machine, state, modes, response), _push(machine, modes, state.phase)
        if push is None:
            return _moved(machine, modes, response, free, state, step)
        return _moved_under_tables(machine, modes, response, free, push, state, step)

    def flow_map(
        self, machine: Machine, state: State, hold: Held, span: Scalar, change: PhaseChange
    ) -> FlightMotion:
        """Evaluate the modes at any time."""
        modes, response = self._of_set(machine, state, hold, (self.modes, self.response), skips=False)
        free, push = self._coordinates(machine, state, modes, response), _push(machine, modes, state.phase)
        w2, a, forced = modes.squared_frequency, modes.decay, None
        increments = increments_at_any_time(w2, a, span)
        if push is not None:
            forced = from_rest_at_any_time(w2, a, span, len(push), increments).forced(push)
        return _gone(machine, modes, response, free, increments, change, forced)

    def _coordinates(
        self, machine: Machine, state: State, modes: Modes, response: SteadyResponse
    ) -> tuple[Float[Array, "modes ..."], Float[Array, "modes ..."]]:
        """Free motion, as q and q' of the modes, by the tables of the set held now."""
        steady = response.offset(machine) + response.waves.at(state.phase)
        if len(self.sets) > 1:
            steady = steady + matvec(modes.anchor, state.x)
        steady_v = response.waves.at(machine.phase_rate(state.phase))
        return matvec(modes.inverse, state.x - steady), matvec(modes.inverse, state.v - steady_v)

    def _of_set(
        self, machine: Machine, state: State, hold: Held, tables: tuple[Any, ...], *, skips: bool = True
    ) -> tuple[Any, ...]:
        """Tables of the set of masses held now, and of the compliant contacts closed now.

        A loop of very many steps `skips` the selection where no mass is held.
        """
        free = jax.tree.map(lambda a: a[0], tables)
        if len(self.sets) == 1:
            return free
        held, closed = hold, None
        if self.closed is not None:
            held, closed = machine.contacts.held_and_closed(hold, state.mode.closed)
        flags = held if closed is None else jnp.concatenate([held, closed])
        if not skips and flags.ndim == 1:
            return self._pick(flags, tables)
        full = lambda a: jnp.broadcast_to(a, jnp.broadcast_shapes(a.shape, flags.shape[1:]))  # noqa: E731
        return jax.lax.cond(
            is_any(flags), lambda: self._select(flags, tables), lambda: jax.tree.map(full, free)
        )

    def _select(self, flags: Bool[Array, "flags ..."], tables: tuple[Any, ...]) -> tuple[Any, ...]:
        """Tables of the set of each lane, by a chain of selections, cheaper than a gather."""
        chosen, sets = jax.tree.map(lambda a: a[0], tables), self._flags_of_sets()
        for k in range(1, len(sets)):
            is_this = reduce(operator.and_, list(flags == sets[k]))
            chosen = jax.tree.map(lambda a, old, k=k, yes=is_this: jnp.where(yes, a[k], old), tables, chosen)
        return chosen

    def _pick(self, flags: Bool[Array, " flags"], tables: tuple[Any, ...]) -> tuple[Any, ...]:
        """Tables of the set of a single trajectory, by fewer operations than `_select`: they compile faster."""
        sets = self._flags_of_sets()
        is_this = jnp.arange(len(sets)) == jnp.argmax(jnp.all(sets == flags[None], axis=1))
        return jax.tree.map(lambda a: jnp.sum(jnp.where(append_axes(is_this, a), a, 0), axis=0), tables)

    def _flags_of_sets(self) -> Bool[Array, "sets flags ..."]:
        return self.sets if self.closed is None else jnp.concatenate([self.sets, self.closed], axis=1)


class ModalExpansion(Expansion):
    """Modal coordinates of the free motion, and steady response."""

    modes: Modes
    response: SteadyResponse
    rests: Rests
    q: Float[Array, "modes ..."]
    q_rate: Float[Array, "modes ..."]
    now: Derivatives
    limit: Scalar
    push: list[Float[Array, "modes ..."]] | None = None

    def rest(self, machine: Machine, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 for all later times, or up to `limit` under loads by tables."""
        root, rests = self._roots_of_energies(), self.rests
        if self.push is None:
            return matvec(rests.x, root) + rests.x_load, matvec(rests.force, root) + rests.force_load
        w2, a, shape = self.modes.squared_frequency, self.modes.decay, jnp.abs(self.modes.shape)
        load, rate, *later = bounds_of_load(self.push, limit)
        # The root of the energy grows by the impulse of the load at most.
        root = root + load * limit
        by_load = jnp.abs(4 * a * a - w2) * load + 2 * a * rate
        x4 = matvec(shape, by_load + later[0] if later else by_load) * (1 / 24)
        x3 = matvec(shape, 2 * a * load + rate) * (1 / 6)
        force = 4 * matvec(jnp.abs(machine.damping), x4) + matvec(jnp.abs(machine.stiffness), x3)
        if machine.tables is not None:
            force = force + machine.tables.bound(3) * (1 / 6)
        return (
            matvec(rests.x, root) + rests.x_load + x4,
            matvec(rests.force, root) + rests.force_load + force,
        )

    def velocity_rest(self, machine: Machine, limit: Scalar) -> Float[Array, "n ..."]:
        """Bound |v^(4)| / 24 for all later times."""
        del machine, limit
        assert self.rests.fifth is not None
        assert self.rests.fifth_load is not None
        return matvec(self.rests.fifth, self._roots_of_energies()) + self.rests.fifth_load

    def _roots_of_energies(self) -> Float[Array, "modes ..."]:
        return jnp.sqrt(self.q_rate**2 + self.modes.squared_frequency * self.q**2)

    def move(self, machine: Machine, state: State, step: Scalar) -> StepMotion:
        """Advance every mode and the forcing phase."""
        free = self.q, self.q_rate
        if self.push is None:
            return _moved(machine, self.modes, self.response, free, state, step)
        return _moved_under_tables(machine, self.modes, self.response, free, self.push, state, step)


def _moved(
    machine: Machine,
    modes: Modes,
    response: SteadyResponse,
    free: tuple[Array, Array],
    state: State,
    step: Scalar,
) -> tuple[Array, Array, Array]:
    """Displacement, velocity and change of the phase after a step, from the free motion (q, q')."""
    speed = speeds(state.phase, machine.pace)
    fade, wave, arc, turn, slide = compute_once(factors, modes.squared_frequency, modes.decay, speed, step)
    increments = faded(modes.decay, fade, wave, arc)
    change = turned(state.phase, (turn, slide))
    displacement, gain = _gone(machine, modes, response, free, increments, change)
    return displacement, state.v + gain, change


def _push(machine: Machine, modes: Modes, phase: Array) -> list[Array] | None:
    """Loads by tables on every mode, and their derivatives; None if there are none."""
    if machine.tables is None:
        return None
    transposed = jnp.swapaxes(modes.shape, 0, 1)
    return [matvec(transposed, p) for p in machine.derivatives_of_tables(phase)]


def _moved_under_tables(
    machine: Machine,
    modes: Modes,
    response: SteadyResponse,
    free: tuple[Array, Array],
    push: list[Array],
    state: State,
    step: Scalar,
) -> tuple[Array, Array, Array]:
    """`_moved` under loads by tables; the free motion comes with the response to them."""
    w2, a = modes.squared_frequency, modes.decay
    moved = from_rest(w2, a, step, len(push))

    def of_harmonics(phase: Array) -> Array:
        speed = speeds(phase, machine.pace)
        terms = LONGEST_STEP_AND_TERMS[str(step.dtype)][1]
        turn, slide = compute_once(cosine_and_sine, speed * speed * step * step, terms)
        return turned(phase, (turn, slide * speed * step))

    change = machine.with_harmonics(state.phase, step, of_harmonics)
    increments, forced = moved.free(w2, a), moved.forced(push)
    displacement, gain = _gone(machine, modes, response, free, increments, change, forced)
    return displacement, state.v + gain, change


def _gone(
    machine: Machine,
    modes: Modes,
    response: SteadyResponse,
    free: tuple[Array, Array],
    increments: tuple[Array, Array, Array],
    change: Array,
    forced: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Displacement and gain of velocity from the increments of the free motion (q, q') and the change of the phase."""
    (q, q_rate), (grow, reach, slow) = free, increments
    dq = grow * q + reach * q_rate
    dq_rate = slow * q_rate - reach * modes.squared_frequency * q
    if forced is not None:
        dq, dq_rate = dq + forced[0], dq_rate + forced[1]
    displacement = matvec(modes.shape, dq) + response.waves.at(change)
    return displacement, matvec(modes.shape, dq_rate) + response.waves.at(machine.phase_rate(change))
