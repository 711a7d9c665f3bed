"""Result of `simulate`, and its evaluation at any time."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lazy_loader
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._descriptions import described_by
from .._flow.interface import AbstractFlow
from .._hybrid.limits import EVENT_NAMES
from .._jax.arrays import Flag, Numbers, Reals, Scalar, array_namespace
from .._jax.concrete import concrete, is_traced
from .._jax.errors import checked
from .._jax.packing import Packed
from .._jax.xla import differentiable, padding_allowed
from .._machine.machine import Machine
from .._printing import describe_solution
from .evaluation import Evaluated, Times, coasted, followed, motion_of_stops
from .event_log import EventLog, Restarts
from .grazing import Grazing
from .results import RESULTS
from .solution_dataset import dataset_of

if TYPE_CHECKING:
    import xarray as xr
else:  # with pandas it takes as long to import as everything else of a trajectory
    xr = lazy_loader.load("xarray")


class Solution(eqx.Module):
    """One trajectory.

    Attributes:
        ts: requested times, (times,).
        xs: positions at these times, (times, n); at the time of an event, those after it.
        vs: velocities, likewise.
        x1: position at t1, (n,).
        v1: velocity at t1, (n,).
        stuck1: flags of the stops that hold their mass at t1, (stops,).
        sticking1: flags of the friction elements that stick at t1, (friction,).
        events: event log.
        num_events: number of logged events.
        num_steps: number of steps, including trials that were not taken.
        num_rejected: number of these trials that were not accurate enough; 0 for an exact motion.
        grazing: closest approach to grazing: `grazing.impact_speed`, `grazing.clearance` and the flag
            `grazing.is_near`, which warns that derivatives are unreliable or one-sided.
        result: member of `vx.RESULTS`.
        max_steps: bound on the number of steps.
        t0: start time.
        t1: end time.
    """

    ts: Float[Array, " times"]
    xs: Float[Array, "times n"]
    vs: Float[Array, "times n"]
    x1: Float[Array, " n"]
    v1: Float[Array, " n"]
    stuck1: Bool[Array, " stops"]
    sticking1: Bool[Array, " friction"]
    events: EventLog
    num_events: Int[Array, ""]
    num_steps: Int[Array, ""]
    num_rejected: Int[Array, ""]
    grazing: Grazing
    result: RESULTS
    t0: Scalar
    t1: Scalar
    prepared: Packed
    restarts: Restarts
    max_steps: Int[Array, ""]
    known_until: Scalar
    last_sliders: Any = None
    base: Any = None  # `BaseLoad` of a base that moves, for drawings

    @property
    def sliders1(self) -> Float[Array, "*batch hysteresis"]:
        """Sliders of the Jenkins elements at t1."""
        return self.x1[..., :0] if self.last_sliders is None else self.last_sliders

    @property
    def num_sliders(self) -> int:
        """Number of Jenkins elements."""
        return self.sliders1.shape[-1]

    @property
    def of_masses(self) -> "Solution":
        """The same with positions and velocities of the masses alone, without coordinates of Jenkins elements."""
        if self.last_sliders is None:
            return self
        num = self.x1.shape[-1] - self.num_sliders
        names = lambda s: (s.xs, s.vs, s.x1, s.v1)  # noqa: E731
        return eqx.tree_at(names, self, tuple(a[..., :num] for a in names(self)))

    @property
    def machine(self) -> Machine:
        """The prepared machine."""
        return self.prepared.unpacked()[0]

    @property
    def flow(self) -> AbstractFlow:
        """The prepared flow."""
        return self.prepared.unpacked()[1]

    def evaluate(self, t: Numbers) -> tuple[Float[Array, "... n"], Float[Array, "... n"]]:
        """Evaluate position and velocity at any time, as exactly as the trajectory itself.

        Args:
            t: times in [t0, t1], any shape; for a batch of `jax.vmap` the same times for each.

        Returns:
            x and v, of the shape of `t` and then (n,), behind the axes of a batch. NaN where the motion is unknown:
            after the last event of a log that was too short, or after the motion stopped.

        Raises:
            ValueError: for times outside [t0, t1]; a RuntimeError if they are traced.

        Example:
            ```python
            import jax.numpy as jnp, vijax as vx
            sol = vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 50.0)
            x, v = sol.evaluate(jnp.linspace(0.0, 50.0, 1001))
            ```
        """
        now, n = self._at(t), self.x1.shape[-1]
        return now.x[..., :n], now.v[..., :n]

    @property
    def accelerations(self) -> Float[Array, "*lanes times n"]:
        """Accelerations at `ts`, see `acceleration`; (times, n), behind the axes of a batch."""
        if self.t1.ndim == 0:
            return self.acceleration(self.ts)
        return _evaluate_batch(self, self.ts, in_axes=(0, 0)).acceleration[..., : self.x1.shape[-1]]

    def acceleration(self, t: Numbers) -> Float[Array, "... n"]:
        """Evaluate accelerations at any time, as exactly as the trajectory itself.

        At the time of an event it is that after the event. A mass that a stop holds has that of its stop. An impact, which
        is a jump of the velocity, has no acceleration: `events.impulse` measures it.

        Args:
            t: times in [t0, t1], any shape.

        Returns:
            Accelerations, of the shape of `t` and then (n,), behind the axes of a batch; NaN where `evaluate` is. Of a machine on
            a moving base they are relative to the base, as positions are.

        Raises:
            ValueError: as for `evaluate`.

        Example:
            ```python
            import vijax as vx
            sol = vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 50.0)
            acceleration = sol.acceleration(50.0)
            ```
        """
        return self._at(t).acceleration[..., : self.x1.shape[-1]]

    def contact_force(self, t: Numbers) -> Float[Array, "... stops"]:
        """Evaluate the contact force of each stop while it holds its mass; 0 while it does not.

        It does not include impacts, which are impulses: see `events.impulse`. Of a compliant stop it is the force with
        which it pushes, N.

        Args:
            t: times in [t0, t1], any shape.

        Returns:
            Force, of the shape of `t` and then (stops,), behind the axes of a batch; NaN where `evaluate` is.

        Raises:
            ValueError: as for `evaluate`.

        Example:
            ```python
            import vijax as vx
            sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
            force = sol.contact_force(80.0)
            ```

        References:
            Wagg & Bishop (2004), Eqs. 19-20.
        """
        return self._at(t).force[..., : self.stuck1.shape[-1]]

    def friction_force(self, t: Numbers) -> Float[Array, "... friction"]:
        """Evaluate the force T of each friction element, which acts on the masses with -row T.

        Args:
            t: times in [t0, t1], any shape.

        Returns:
            Force, of the shape of `t` and then (friction,), behind the axes of a batch; NaN where `evaluate` is. At rest
            beside a stop that presses on the same mass, the stop carries the load and T is 0.

        Raises:
            ValueError: as for `evaluate`.

        Example:
            ```python
            import vijax as vx
            load = vx.Harmonic(amplitude=[1.5], frequency=0.6)
            system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, friction=[vx.Friction(0, 1.0)])
            force = vx.simulate(system, 0.0, 50.0).friction_force(50.0)
            ```
        """
        force, num_stops = self._at(t).force, self.stuck1.shape[-1]
        return force[..., num_stops : force.shape[-1] - self.num_sliders]

    def hysteresis_force(self, t: Numbers) -> Float[Array, "... hysteresis"]:
        """Evaluate the force S of each Jenkins element, which acts on the masses with -row S.

        Args:
            t: times in [t0, t1], any shape.

        Returns:
            Force, of the shape of `t` and then (hysteresis,), behind the axes of a batch; NaN where `evaluate` is.

        Raises:
            ValueError: as for `evaluate`.

        Example:
            ```python
            import jax.numpy as jnp, vijax as vx
            load = vx.Harmonic(amplitude=[0.5], frequency=0.9)
            system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, hysteresis=[vx.Jenkins(0, 1.0, 0.3)])
            sol = vx.simulate(system, 0.0, 50.0)
            t = jnp.linspace(40.0, 50.0, 200)
            loop = sol.evaluate(t)[0], sol.hysteresis_force(t)
            ```
        """
        force = self._at(t).force
        return force[..., force.shape[-1] - self.num_sliders :]

    def evaluate_sliders(self, t: Numbers) -> Float[Array, "... hysteresis"]:
        """Evaluate the slider z of each Jenkins element.

        Args:
            t: times in [t0, t1], any shape.

        Returns:
            Sliders, lengths along the rows, of the shape of `t` and then (hysteresis,), behind the axes of a batch; NaN where
            `evaluate` is.

        Raises:
            ValueError: as for `evaluate`.

        Example:
            ```python
            import vijax as vx
            system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], hysteresis=[vx.Jenkins(0, 1.0, 0.3)])
            slider = vx.simulate(system, 0.0, 50.0, [2.0], [0.0]).evaluate_sliders(50.0)
            ```
        """
        now, num = self._at(t), self.num_sliders
        if not num:
            return now.x[..., :0]
        rows = self.machine.contacts.rows[..., -num:, :]
        stretches = now.v[..., now.v.shape[-1] - num :]
        return jnp.einsum("...j,...kj->...k", now.x, _before_times(rows, now.x)) - stretches

    def evaluate_stops(self, t: Numbers) -> tuple[Float[Array, "... stops"], Float[Array, "... stops"]]:
        """Evaluate positions and velocities of the stops at any time.

        Args:
            t: times, any shape.

        Returns:
            Positions and velocities, of the shape of `t` and then (stops,), behind the axes of a batch.

        Example:
            ```python
            import vijax as vx
            sol = vx.simulate(vx.models.ball_on_table(60.0, 0.004), 0.0, 5.0)
            height_above_table = sol.evaluate(2.0)[0] - sol.evaluate_stops(2.0)[0]
            ```
        """
        evaluate = motion_of_stops
        for _ in range(self.t1.ndim):
            evaluate = eqx.filter_vmap(evaluate, in_axes=(0, None))
        return evaluate(self.machine, jnp.asarray(t, self.t0.dtype))

    def to_xarray(self) -> "xr.Dataset":
        """Convert to a labelled dataset.

        Returns:
            Dataset of `x` and `v` at the saved times, (time, mass); the logged events, (event,): `event_time`,
            `event_stop`, `event_kind` with its flags, `event_velocity_minus`, `event_velocity_plus`, `event_impulse`,
            and `event_friction_impulse` with friction of contacts;
            the end state `x1`, `v1`, `stuck1`; `result` with its flags; and the other attributes of this class. A
            batch of `jax.vmap` has `lane` as first dimension, and its events are padded with NaN and -1 to the
            longest log.

        Raises:
            ValueError: for traced values, or for a batch of batches.

        Example:
            ```python
            import vijax as vx
            ds = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0).to_xarray()
            speeds = abs(ds.event_velocity_minus).where(ds.event_stop == 1, drop=True)
            ```
        """
        if concrete(self.t1) is None:
            raise ValueError("`to_xarray` needs numbers: call it outside of `jax.jit` and `jax.vmap`.")
        if self.t1.ndim > 1:
            raise ValueError(
                f"`to_xarray` labels one trajectory or one batch, but this is a batch of shape {self.t1.shape}: "
                "label its parts."
            )
        return dataset_of(self)

    __repr__, _repr_html_ = described_by(describe_solution, tuple(RESULTS._name_to_item), EVENT_NAMES)

    @padding_allowed
    def _at(self, t: Numbers) -> "Evaluated":
        if self.t1.ndim == 0 and not is_traced((self, t)):
            return _evaluate_known(self, np.asarray(t, self.t0.dtype))
        times = jnp.asarray(t, self.t0.dtype)
        found = _evaluate_batch(self, times.ravel(), in_axes=(0, None))
        is_outside = _is_outside(self, times)
        if concrete(is_outside):
            raise ValueError(_OUTSIDE)
        found = Evaluated(*(a.reshape(*self.t1.shape, *times.shape, a.shape[-1]) for a in found))
        return checked(found, is_outside.astype(int), ("", _OUTSIDE))


def _before_times(rows: Array, x: Array) -> Array:
    """Rows of a machine, or of a batch of machines, behind which the axes of times of x have a place each."""
    batch = rows.shape[:-2]
    return rows.reshape(*batch, *[1] * (x.ndim - 1 - len(batch)), *rows.shape[-2:])


_OUTSIDE = (
    "Argument `t` must lie within [t0, t1] of the solution: simulate a longer span, or ask for other times."
)


# Times evaluated at once; fewer are padded, so that only one size is compiled.
_TIMES = 256


def _is_outside(solution: Solution, times: Reals) -> Flag | np.bool_:
    """True if any time lies outside the simulated span by more than rounding."""
    library = array_namespace(times)
    t0, t1 = (library.asarray(a)[..., None] for a in (solution.t0, solution.t1))
    slack = 8 * np.finfo(times.dtype).eps * library.maximum(abs(t0), abs(t1))
    t = times.reshape((1,) * solution.t1.ndim + (-1,))
    return ~((t >= t0 - slack) & (t <= t1 + slack)).all()


def _evaluate_known(solution: Solution, times: np.ndarray) -> Evaluated:
    """The motion at concrete times, `_TIMES` of them at once."""
    if _is_outside(solution, times):
        raise ValueError(_OUTSIDE)
    t0, t1, known_until = (np.asarray(a) for a in (solution.t0, solution.t1, solution.known_until))
    num_parts = max(-(-times.size // _TIMES), 1)
    t = np.full(num_parts * _TIMES, t0)
    t[: times.size] = np.clip(times.ravel(), t0, t1)
    rows = jax.tree.map(np.asarray, solution.restarts)
    row = np.maximum(np.searchsorted(rows.t, t, side="right") - 1, 0)
    parts = []
    for k in range(0, t.size, _TIMES):
        starts = jax.tree.map(lambda a, k=k: a[row[k : k + _TIMES]], rows)
        request = Times(rows.phase[0], starts, t[k : k + _TIMES], t0, np.asarray(solution.max_steps))
        parts.append(coasted(solution.prepared, request))
    is_known = (t <= known_until)[:, None]
    whole = (np.where(is_known, np.concatenate(columns), np.nan) for columns in zip(*parts, strict=True))
    return Evaluated(*(jax.device_put(a[: times.size].reshape(*times.shape, a.shape[-1])) for a in whole))


def _evaluate_batch(
    solution: Solution, times: Float[Array, "..."], *, in_axes: tuple[int, int | None]
) -> Evaluated:
    """The motion at times, of each trajectory of a batch; NaN where it is unknown."""
    evaluate = _evaluate_all
    for _ in range(solution.t1.ndim):
        evaluate = eqx.filter_vmap(evaluate, in_axes=in_axes)
    return evaluate(solution, times)


def _evaluate_all(solution: Solution, times: Float[Array, " times"]) -> Evaluated:
    return jax.vmap(lambda t: _evaluate(solution, t))(times)


def _evaluate(solution: Solution, t: Scalar) -> Evaluated:
    """Follow the smooth motion from the last event before t."""
    rows = solution.restarts
    t = jnp.clip(t, solution.t0, solution.t1)
    is_known = t <= solution.known_until
    row = jnp.clip(jnp.searchsorted(rows.t, t, side="right") - 1, 0)
    start = jax.tree.map(lambda a: a[row], rows)
    request = solution.prepared, rows.phase[0], start, t, solution.t0, solution.max_steps
    found = differentiable(followed, request)
    return Evaluated(*(jnp.where(is_known, a, jnp.nan) for a in found))
