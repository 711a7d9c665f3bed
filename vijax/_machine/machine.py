"""Machine as arrays, as the engine computes with it."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._jax.arrays import (
    Flag,
    Scalar,
    clip_to_zero,
    matvec,
)
from .._jax.xla import is_any
from .._system.waves import Tones, Waves, phase_at, phase_of, phase_rate, turned
from .contacts import Held
from .extra_force import ExtraForce
from .frame import Frame
from .kinds import COMPLIANT, JENKINS
from .state import ModeLayout, State, start_period
from .switching import SwitchingContacts
from .tables import Tables
from .turns import Turns


class Machine(eqx.Module):
    """`ImpactSystem` as arrays over masses, stops and harmonics, lanes last.

    The load is `mean` plus `waves` of the angular frequency `frequency`. `rate` bounds every frequency and decay rate
    of the linear motion, for any set of held masses, by its norm; `timescale` is its inverse; `closed_rate` is the rate with compliant
    contacts closed, None if there are none. `extra` is None for a linear
    machine. `frame` is None where all stops stand still or contacts are coupled. Otherwise everything, the load
    included, is relative to it: positions and velocities are relative to the stops of their mass. `tables` is None
    where no load is given by a table. `tones` is None where all harmonics have the frequency `frequency`, by which periods are
    counted; otherwise it has the frequencies of the rows of `waves`, and `turns` their quotients to it.
    """

    damping: Float[Array, "n n ..."]
    stiffness: Float[Array, "n n ..."]
    mean: Float[Array, "n ..."]
    waves: Waves
    frequency: Scalar
    period: Scalar
    contacts: Any  # `Contacts`, of which type checkers do not see the kind
    rate: Scalar
    timescale: Scalar
    can_stick: bool = eqx.field(static=True)
    extra: ExtraForce | None = None
    frame: Frame | None = None
    closed_rate: Any = None
    num_states: int = eqx.field(static=True, default=0)
    tables: Tables | None = None
    base: Any = None  # `BaseLoad`, only where absolute accelerations are computed
    tones: Tones | None = None
    turns: Turns | None = None

    @property
    def pace(self) -> Any:
        """Angular frequency of all rows of `waves`: one number, or `Tones`."""
        return self.frequency if self.tones is None else self.tones

    @property
    def fastest(self) -> Scalar:
        """Highest angular frequency of the load."""
        if self.tones is None:
            return self.waves.num_harmonics * self.frequency
        return jnp.max(self.tones.speeds, axis=0)

    @property
    def num_masses(self) -> int:
        """Number of masses, n."""
        return self.mean.shape[0]

    @property
    def inverse_mass(self) -> Float[Array, "..."]:
        """Diagonal of M^-1, (n,), or M^-1, (n, n)."""
        return self.contacts.inverse_mass

    def load(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "n ..."]:
        """Load at a phase of the forcing, given as cosines and sines of h W t."""
        return self.mean + self.varying_load(phase)

    def varying_load(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "n ..."]:
        """Load at a phase, or its derivative at the rate of a phase, without its mean."""
        waves = self.waves.at(phase)
        return waves if self.tables is None else waves + self.tables.load(self._columns(phase))

    def _columns(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "2 columns ..."]:
        """Columns of a phase that belong to loads by tables."""
        return phase[:, self.waves.num_harmonics :]

    def derivatives_of_tables(self, phase: Float[Array, "2 columns ..."]) -> list[Float[Array, "n ..."]]:
        """Sum of the loads by tables at a phase, and its derivatives by time."""
        assert self.tables is not None
        return self.tables.derivatives_of_load(self._columns(phase))

    @property
    def num_columns(self) -> int:
        """Number of columns of a phase: of harmonics, and of loads by tables."""
        of_tables = 0 if self.tables is None else self.tables.columns.shape[1]
        return self.waves.num_harmonics + of_tables

    @property
    def is_periodic(self) -> bool:
        """True if all loads repeat with the forcing period."""
        return self.tones is None and (self.tables is None or all(self.tables.first.in_step))

    def phase_of_harmonics(self, t: Scalar) -> Float[Array, "2 harmonics ..."]:
        """Phase of the harmonics at a time."""
        if self.tones is None:
            return phase_at(self.frequency * t, self.waves.num_harmonics)
        return phase_of(self.tones.speeds * t)

    def phase_of_period(
        self, phase0: Float[Array, "2 harmonics ..."], periods: Int[Array, "..."]
    ) -> Float[Array, "2 harmonics ..."]:
        """Phase at the beginning of a forcing period, from that at the beginning of the first."""
        if self.tones is None or self.turns is None:
            return phase0
        turns = self.tones.of_rows(self.turns.in_periods(periods)[1])
        by = phase_of(2 * jnp.pi * (turns - jnp.round(turns)))
        own = turned(phase0[:, : self.waves.num_harmonics], by)
        return own if self.tables is None else _side_by_side(own, self._columns(phase0))

    def start_period(
        self, state: State, phase0: Float[Array, "2 harmonics ..."], is_over: Bool[Array, "..."]
    ) -> State:
        """Count a forcing period that is over and reset time and phase, so that neither drifts."""
        if self.tones is not None:
            begins = lambda: self.phase_of_period(phase0, state.periods + 1)  # noqa: E731
            phase0 = jax.lax.cond(
                is_any(is_over), lambda: jnp.broadcast_to(begins(), state.phase.shape), lambda: state.phase
            )
        return start_period(state, phase0, is_over)

    def phase_at(self, t: Scalar) -> Float[Array, "2 harmonics ..."]:
        """Phase at a time."""
        phase = self.phase_of_harmonics(t)
        return phase if self.tables is None else self.with_tables_at(phase, t)

    def with_tables_at(
        self, phase: Float[Array, "2 harmonics ..."], t: Scalar
    ) -> Float[Array, "2 columns ..."]:
        """Phase of the harmonics, and columns of loads by tables, at a time."""
        assert self.tables is not None
        return _side_by_side(phase, self.tables.at(t))

    def phase_at_start(self, t: Scalar) -> Float[Array, "2 harmonics ..."]:
        """Phase at the beginning of a trajectory, at which the machine was prepared."""
        return self.with_tables(self.phase_of_harmonics(t))

    def with_tables(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "2 columns ..."]:
        """Phase of the harmonics, and columns of loads by tables, at the beginning of a trajectory."""
        return phase if self.tables is None else _side_by_side(phase, self.tables.columns)

    def phase_after(
        self, phase: Float[Array, "2 harmonics ..."], step: Scalar
    ) -> Float[Array, "2 harmonics ..."]:
        """Phase after a step of any length without a knot."""
        by = self.phase_of_harmonics(step)
        if self.tables is None:
            return turned(phase, by)
        own = turned(phase[:, : self.waves.num_harmonics], by)
        columns = self._columns(phase)
        return _side_by_side(own, columns + self.tables.change(columns, step))

    def with_harmonics(
        self, phase: Float[Array, "2 harmonics ..."], step: Scalar, harmonics: Callable[..., Array]
    ) -> Float[Array, "2 harmonics ..."]:
        """Change of a phase over a step without a knot, of which `harmonics` makes that of the harmonics."""
        if self.tables is None:
            return harmonics(phase)
        own = harmonics(phase[:, : self.waves.num_harmonics])
        return _side_by_side(own, self.tables.change(self._columns(phase), step))

    def moved(self, x: Float[Array, "n ..."], displacement: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """Positions after a displacement.

        Those of first-order states are 0: nothing depends on them, and they would drift, a neutral direction of every orbit.
        """
        x = x + displacement
        if not self.num_states:
            return x
        is_mass = np.arange(len(x)) < len(x) - self.num_states
        return jnp.where(is_mass.reshape(-1, *[1] * (x.ndim - 1)), x, 0)

    def phase_rate(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "2 harmonics ..."]:
        """Time derivative of the phase."""
        if self.tables is None:
            return phase_rate(phase, self.pace)
        harmonics = phase_rate(phase[:, : self.waves.num_harmonics], self.pace)
        return _side_by_side(harmonics, self.tables.rate(self._columns(phase)))

    def force(
        self, phase: Float[Array, "2 harmonics ..."], x: Float[Array, "n ..."], v: Float[Array, "n ..."]
    ) -> Float[Array, "n ..."]:
        """Linear force on every mass: f - C v - K x."""
        return self.load(phase) - matvec(self.damping, v) - matvec(self.stiffness, x)

    def force_rate(
        self, phase: Float[Array, "2 harmonics ..."], v: Float[Array, "n ..."], a: Float[Array, "n ..."]
    ) -> Float[Array, "n ..."]:
        """Time derivative of `force`, for the accelerations `a`."""
        rate = self.varying_load(self.phase_rate(phase))
        return rate - matvec(self.damping, a) - matvec(self.stiffness, v)

    def total_force(self, state: State) -> Float[Array, "n ..."]:
        """Force on every mass without contact forces."""
        linear = self.force(state.phase, state.x, state.v)
        if self.extra is None:
            return linear
        return linear + self.extra(self.clock(state), state.x, state.v)

    def total_force_rate(self, state: State, a: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
        """Time derivative of `total_force`, for the accelerations `a`."""
        linear = self.force_rate(state.phase, state.v, a)
        if self.extra is None:
            return linear
        t = self.clock(state)
        return linear + jax.jvp(self.extra, (t, state.x, state.v), (jnp.ones_like(t), state.v, a))[1]

    def total_force_curvature(
        self, state: State, a: Float[Array, "n ..."], jerk: Float[Array, "n ..."]
    ) -> Float[Array, "n ..."]:
        """Second time derivative of `total_force`, for the accelerations `a` and their rates `jerk`."""
        linear = self.force_rate(self.phase_rate(state.phase), a, jerk)
        if self.extra is None:
            return linear
        t, extra = self.clock(state), self.extra

        def rate(s):
            path = lambda s: (t + s, state.x + s * (state.v + s * a / 2), state.v + s * (a + s * jerk / 2))  # noqa: E731
            return jax.jvp(lambda s: extra(*path(s)), (s,), (jnp.ones_like(s),))[1]

        return linear + jax.jvp(rate, (jnp.zeros_like(t),), (jnp.ones_like(t),))[1]

    def in_space(self, state: State) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Positions and velocities in space, the coordinates of the user."""
        if self.frame is None:
            return state.x, state.v
        w, rate = self.frame.at(state.phase)
        return state.x + w, state.v + rate

    def acceleration_in_space(
        self, state: State, force: Float[Array, "n ..."], hold: Held
    ) -> Float[Array, "n ..."]:
        """Accelerations in space from `total_force`; those of their stops of masses that are held."""
        own = self.contacts.accelerations(force, hold, state.phase)
        return own if self.frame is None else own + self.frame.acceleration_at(state.phase)

    def absolute(self, acceleration: Float[Array, "n ..."], state: State) -> Float[Array, "n ..."]:
        """Accelerations with that of the base, from those relative to it."""
        if self.base is None:
            return acceleration
        return acceleration - self.contacts.inverse_mass_times(self._load_of_base(state.phase))

    def _load_of_base(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "n ..."]:
        load = self.base.waves.at(phase)
        if not any(self.base.tables):
            return load
        assert self.tables is not None
        return load + self.tables.load_of(self._columns(phase), self.base.tables)

    def relative_to_stops(
        self, phase: Float[Array, "2 harmonics ..."], x: Float[Array, "n ..."], v: Float[Array, "n ..."]
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Positions and velocities relative to the stops, the inverse of `in_space`."""
        if self.frame is None:
            return x, v
        w, rate = self.frame.at(phase)
        return x - w, v - rate

    def velocity_of_stops(self, phase: Float[Array, "2 harmonics ..."]) -> Float[Array, "stops ..."] | None:
        """Velocities of the stops, missing in relative ones; 0 for contacts between masses, None if all stand still."""
        if self.frame is not None:
            return self.contacts.size(self.frame.at(phase)[1])
        return self.contacts.own_velocity(self.phase_rate(phase))

    def stops_at(
        self, phase: Float[Array, "2 harmonics ..."]
    ) -> tuple[Float[Array, "stops ..."], Float[Array, "stops ..."]]:
        """Positions and velocities of the stops in space."""
        position, contacts = self.contacts.position, self.contacts
        if self.frame is not None:
            w, rate = self.frame.at(phase)
            return position + contacts.size(w), contacts.size(rate)
        still = jnp.zeros_like(self.mean)
        moved, rate = (-contacts.signed(contacts.towards(still, p)) for p in (phase, self.phase_rate(phase)))
        return position + moved, rate

    def clock(self, state: State) -> Scalar:
        """Time as the extra force takes it; since the start of the trajectory if there is no extra force."""
        origin = 0.0 if self.extra is None else self.extra.origin
        return origin + state.periods * self.period + state.time

    def hold(self, held: Bool[Array, "stops ..."]) -> Held:
        """Effect on the motion of the flagged stops that hold; none holds if the machine cannot stick."""
        return self.contacts.hold(held if self.can_stick else jnp.zeros_like(held))

    def in_mode(self, state: State) -> "Machine":
        """Machine with the forces of friction and compliant contacts in the mode of a state; itself if there are none."""
        if state.mode is None or not isinstance(self.contacts, SwitchingContacts):
            return self
        contacts = self.contacts.directed(state.mode.direction)
        names = lambda m: (m.mean, m.contacts)  # noqa: E731
        machine = eqx.tree_at(names, self, (self.mean + contacts.load_of(state.mode), contacts))
        machine = machine.with_closed(state.mode.closed)
        if JENKINS in contacts.laws.kinds:
            rows = contacts.sticking_rows(state.mode.direction)
            machine = eqx.tree_at(lambda m: m.damping, machine, jnp.where(rows[:, None], machine.damping, 0))
        return machine if contacts.drag is None else machine.with_oblique_forces(state.held)

    def with_oblique_forces(self, held: Bool[Array, "contacts ..."]) -> "Machine":
        """Machine with the rate of motions in which contacts hold whose forces bring along friction."""
        rate = self.rate * jax.lax.stop_gradient(self.contacts.obliqueness(held))
        return eqx.tree_at(lambda m: (m.rate, m.timescale), self, (rate, 1 / rate))

    def with_closed(self, closed: Bool[Array, "contacts ..."]) -> "Machine":
        """Machine with the springs and dampers of closed compliant contacts."""
        if COMPLIANT not in self.contacts.laws.kinds:
            return self
        stiffness, damping = self.contacts.matrices_of(closed)
        rate = jnp.where(jnp.any(closed, axis=0), self.closed_rate, self.rate)
        return eqx.tree_at(
            lambda m: (m.damping, m.stiffness, m.rate, m.timescale),
            self,
            (self.damping + damping, self.stiffness + stiffness, rate, 1 / rate),
        )

    @property
    def has_tied_friction(self) -> bool:
        """True if there is friction of contacts."""
        return self.mode_layout is not None and self.mode_layout.is_tied

    @property
    def mode_layout(self) -> ModeLayout | None:
        """Layout of the mode of a state; None if all contacts are rigid."""
        return ModeLayout(self.contacts.laws.is_tied) if self.contacts.is_switching else None

    @property
    def is_linear(self) -> bool:
        """True if all forces are linear between impacts: without a force of the user, friction and compliant contacts."""
        return self.extra is None and not self.contacts.is_switching

    def approach(self, state: State) -> Float[Array, "stops ..."]:
        """Speeds of approach to the contacts."""
        return self.contacts.towards(state.v, self.phase_rate(state.phase))

    def until_knots(self, state: State) -> Float[Array, "streams ..."]:
        """Time to the next knot of each load by a table."""
        assert self.tables is not None
        elapsed = state.periods * self.period
        return self.tables.until(state.knots, state.periods, elapsed, state.time, state.time_low)

    def past_knots(self, state: State, at: Bool[Array, "streams ..."]) -> tuple[State, Flag]:
        """State after knots of flagged tables, and whether the load jumps there by more than rounding."""
        assert self.tables is not None
        num_harmonics, old = self.waves.num_harmonics, self._columns(state.phase)
        knots, new = self.tables.past(state.knots, old, at)
        before, after = self.tables.load(old), self.tables.load(new)
        noise = 64 * jnp.finfo(after.dtype).eps * self.tables.bound(0)
        jumps = jnp.any(jnp.abs(after - before) > noise, axis=0)
        phase = _side_by_side(state.phase[:, :num_harmonics], new)
        return eqx.tree_at(lambda s: (s.phase, s.knots), state, (phase, knots)), jumps


def _side_by_side(
    harmonics: Float[Array, "2 harmonics ..."], columns: Float[Array, "2 columns ..."]
) -> Float[Array, "2 both ..."]:
    """Phase of harmonics and of loads by tables, in all lanes of both."""
    lanes = jnp.broadcast_shapes(harmonics.shape[2:], columns.shape[2:])
    both = [jnp.broadcast_to(a, (*a.shape[:2], *lanes)) for a in (harmonics, columns)]
    return jnp.concatenate(both, axis=1)


def in_periods(machine: Machine, span: Float[Array, "..."]) -> tuple[Int[Array, "..."], Float[Array, "..."]]:
    """Time since the start as whole forcing periods and remainder."""
    whole = jnp.floor(span / machine.period)
    return whole.astype(int), clip_to_zero(span - whole * machine.period)
