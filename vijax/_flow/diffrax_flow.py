"""Motion of any smooth machine between events, by the solvers of diffrax.

Only the stepping interface of diffrax is used: one `solver.step` is one trial, `stepsize_controller` accepts or
rejects it and sets the next length, and the dense output of the solver is the polynomial on which events are located
(`approximate_step.py`). `diffrax.diffeqsolve` with `diffrax.Event` was rejected: it tests signs at the ends of steps,
so two crossings in one step are missed; of several events it takes the first of the list instead of the first in
time; and it finds the time of an event on the dense output, which is less accurate than the steps.

Positions and velocities are integrated as gains since the start of the step, so a light bounce keeps all its digits.
The gain of a held mass is the one that the force on it would cause: it costs nothing and gives the contact force
inside the step.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from .._jax.arrays import Scalar, add_up, as_float
from .._jax.xla import compute_once
from .._machine.contacts import Held
from .._machine.machine import Machine
from .._machine.state import State, with_memory
from .approximate_step import Attempt, SteppingFlow, longest_step
from .bernstein import nodes, slopes_at_nodes
from .event_margins import StepInterior, phase_change
from .exact_step import state_after_step
from .explicit_step import explicit_step
from .interface import FlightMotion, PhaseChange

# Gains of positions and velocities, and integrals of the pulls.
_Gains = tuple[Array, Array, Array | None]
# Gains at the end of a step, their errors, and the gains inside.
_Step = tuple[_Gains, _Gains, _Gains]

# Bound on the trials of a flow map: only a diverged guess needs more, and nothing else should wait for it.
_MOST_TRIALS = 10_000
# Share of the contradiction between force and polynomial that counts as an error. The polynomial is less accurate than
# the end of a step: in smooth motion this stays far below the error itself, in a wall it is far above.
_SHARE = 1e-5
# Range of degrees of dense outputs; those of diffrax go from 3 to 6.
_LEAST, _MOST = 3, 8
# Default rtol and atol.
_TOLERANCES = {"float64": (1e-10, 1e-12), "float32": (1e-5, 1e-6)}


class _FlowMapState(NamedTuple):
    """Carry of a flow map: state, time left, next step, displacement, gain of velocity, and number of trials."""

    state: State
    left: Scalar
    step: Scalar
    displacement: Array
    gain: Array
    num_trials: Array


class DiffraxFlow(SteppingFlow):
    """Motion by a diffrax solver, for machines with a `force`, or to compare with the exact motion.

    Args:
        solver: a Runge-Kutta method of diffrax; Dopri8 if left out.
        stepsize_controller: `diffrax.PIDController` with numbers for tolerances, or
            `diffrax.ConstantStepSize`. If left out a `PIDController` with rtol 1e-10 and atol 1e-12
            (1e-5 and 1e-6 in 32-bit numbers).
        dt0: length of the first step, or of all steps if it is constant; chosen if left out.

    Raises:
        ValueError: for a solver that is not a Runge-Kutta method, or implicit without tolerances of its own, and for a
            controller of fixed times, or of constant steps without `dt0`.

    Example:
        ```python
        import diffrax, vijax as vx
        flow = vx.DiffraxFlow(diffrax.Tsit5(), diffrax.PIDController(rtol=1e-8, atol=1e-8))
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0, flow=flow)
        ```

    References:
        P. Kidger, On Neural Differential Equations (2021), Sec. 5.
    """

    solver: Any = eqx.field(static=True)
    stepsize_controller: Any = eqx.field(static=True)
    dt0: Float[Array, "..."] | None

    def __init__(
        self,
        solver: diffrax.AbstractSolver | None = None,
        stepsize_controller: diffrax.AbstractStepSizeController | None = None,
        dt0: ArrayLike | None = None,
    ):
        self.solver = diffrax.Dopri8() if solver is None else solver
        self.stepsize_controller = stepsize_controller
        self.dt0 = None if dt0 is None else as_float(dt0).reshape(1)

    def __check_init__(self):
        solver = self.solver
        if (
            not isinstance(solver, diffrax.AbstractRungeKutta)
            or solver.term_structure is not diffrax.AbstractTerm
        ):
            raise ValueError(
                f"Argument `solver` must be a Runge-Kutta method for one term, but is {solver}: every step starts afresh."
            )
        if isinstance(solver, diffrax.AbstractImplicitSolver) and not isinstance(
            solver.root_finder.rtol, float
        ):
            raise ValueError(
                "An implicit `solver` needs tolerances of its own: for instance "
                "diffrax.Kvaerno5(root_finder=diffrax.VeryChord(rtol=1e-8, atol=1e-8))."
            )
        controller = self.stepsize_controller
        if isinstance(controller, (diffrax.ClipStepSizeController, diffrax.StepTo)):
            raise ValueError(
                "Argument `stepsize_controller` must choose steps by their error or keep them constant: the times "
                "where a step must end are those of the machine."
            )
        if isinstance(controller, diffrax.ConstantStepSize) and self.dt0 is None:
            raise ValueError("Argument `dt0` must be given with a constant step size.")

    @property
    def fits_one_kernel(self) -> bool:
        """True for explicit methods with their stages written out; implicit ones solve systems by LAPACK."""
        return self._is_written_out

    def attempt(self, machine: Machine, state: State, hold: Held, step: Scalar) -> Attempt:
        """Try one step."""
        take = partial(self._step, hold=hold, step=step, loop="lax")
        return self._judged(machine, state, hold, step, *_with_neighbour(take, machine, state))

    def _judged(
        self, machine: Machine, state: State, hold: Held, step: Scalar, found: _Step, neighbour: _Step
    ) -> Attempt:
        """Attempt from a computed step and its derivative, accepted or rejected by the controller.

        The controller holds three errors against its tolerances: of the step; of a neighbouring motion relative to this
        one, which is all there is at rest; and the contradiction between the force and the polynomial. An explicit
        method does not see a stiff wall into which its first stages fall, and which throws the later ones out again.
        """
        (displacement, gain, _), error, inside = found
        # The gain of a held mass is not part of the motion.
        moving = lambda gains: (gains[0], machine.contacts.gain_with_hold(gains[1], hold))  # noqa: E731
        defect = _SHARE * contradiction(machine, state, hold, step, StepInterior(*inside))
        start = (state.x, state.v, *_neighbour_of(state), state.v)
        gains = (*moving(found[0]), *moving(neighbour[0]), moving(found[0])[1])
        errors = (*moving(error), *moving(neighbour[1]), moving((defect, defect))[1])
        after = tuple(a + b for a, b in zip(start, gains, strict=True))
        zero = jnp.zeros_like(step)
        keep, begin, stop, _, control, _ = self._controller(step.dtype).adapt_step_size(
            zero, step, start, after, None, errors, self._error_order(), state.memory.control
        )
        numbers = jnp.concatenate([*after, *errors])
        is_finite = jnp.all(jnp.isfinite(numbers))
        following = jnp.where(is_finite, stop - begin, step / 4)
        control = jax.tree.map(lambda a, old: jnp.asarray(a, old.dtype), control, state.memory.control)
        return Attempt(displacement, gain, StepInterior(*inside), is_finite & keep, following, control)

    def flow_map(
        self, machine: Machine, state: State, hold: Held, span: Scalar, change: PhaseChange
    ) -> FlightMotion:
        """Follow a whole flight by steps of controlled length; NaN after too many.

        Differentiable forward. Step lengths but the last are constants: derivatives are those of the computed motion.
        """
        del change
        still, longest = jax.lax.stop_gradient, longest_step(machine)
        # Programs with a flow map take longer to compile than to run.
        solver = self.compact().solver

        def one(state: _FlowMapState) -> _FlowMapState:
            here, is_last = state.state, jnp.abs(state.left) <= state.step
            step = jnp.where(is_last, state.left, jnp.copysign(state.step, state.left))
            take = partial(_by_diffrax, solver, hold=hold, step=step)
            neighbour = still(_with_neighbour(take, *still((machine, here)))[1])
            attempt = self._judged(machine, here, hold, step, take(machine, here), neighbour)
            gain = machine.contacts.gain_with_hold(attempt.gain, hold)
            phase = phase_change(machine, here.phase, step)
            moved = state_after_step(machine, here, attempt.displacement, here.v + gain, phase, step)
            taken = _FlowMapState(
                moved,
                jnp.where(is_last, 0, state.left - step),
                state.step,
                state.displacement + attempt.displacement,
                state.gain + gain,
                state.num_trials,
            )
            found = jax.tree.map(lambda a, b: jnp.where(attempt.is_good, a, b), taken, state)
            memory = eqx.tree_at(lambda m: m.control, here.memory, still(attempt.control))
            return found._replace(
                state=with_memory(found.state, memory),
                step=jnp.minimum(still(jnp.abs(attempt.following)), longest),
                num_trials=state.num_trials + 1,
            )

        begin, nothing = with_memory(state, self.memory(jnp.zeros_like(span))), jnp.zeros_like(state.x)
        first = still(jnp.minimum(self.first_step(machine), longest))
        is_on = lambda state: (jnp.abs(state.left) > 0) & (state.num_trials < _MOST_TRIALS)  # noqa: E731
        start = _FlowMapState(begin, span, first, nothing, nothing, jnp.array(0))
        end = jax.lax.while_loop(is_on, one, start)
        is_there = end.left == 0
        return jnp.where(is_there, end.displacement, jnp.nan), jnp.where(is_there, end.gain, jnp.nan)

    def compact(self) -> "DiffraxFlow":
        """The same method, with its stages in a loop."""
        return DiffraxFlow(_with_loop(self.solver, "lax"), self.stepsize_controller, self.dt0)

    def step_by(
        self, machine: Machine, state: State, hold: Held, step: Scalar
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Take the step of `attempt` by a loop that JAX can transpose."""
        return self._step(machine, state, hold, step, "bounded")[0][:2]

    def control(self, like: Scalar) -> PyTree:
        """Initial memory of the controller."""
        zero = jnp.zeros((), like.dtype)
        _, first = self._controller(like.dtype).init(
            diffrax.ODETerm(_field),
            zero,
            zero + jnp.inf,
            zero,
            zero + (1 if self._dt0 is None else self._dt0),
            None,
            self.solver.func,
            self._error_order(),
        )
        return jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a), like.shape), first)

    def first_step(self, machine: Machine) -> Scalar:
        """`dt0`, or a tenth of the shortest time scale of the motion."""
        return 0.1 / machine.rate if self._dt0 is None else self._dt0.astype(machine.rate.dtype)

    @property
    def _is_written_out(self) -> bool:
        return isinstance(self.solver, diffrax.AbstractERK) and self.solver.scan_kind is None

    @property
    def _dt0(self) -> Scalar | None:
        """`dt0` of one trajectory, or of all lanes."""
        return self.dt0 if self.dt0 is None or not self.dt0.ndim else self.dt0[0]

    def _controller(self, dtype: jnp.dtype) -> diffrax.AbstractStepSizeController:
        if self.stepsize_controller is not None:
            return self.stepsize_controller
        rtol, atol = _TOLERANCES[str(dtype)]
        return diffrax.PIDController(rtol=rtol, atol=atol)

    def _error_order(self) -> Any:
        return self.solver.error_order(diffrax.ODETerm(_field))

    def _step(self, machine: Machine, state: State, hold: Held, step: Scalar, loop: str) -> _Step:
        """Gains of positions, velocities and pushes, their errors, and the gains at the nodes of `bernstein.py`."""
        if self._is_written_out:
            field = lambda time, gains: compute_once(_field, time, gains, (machine, state, hold))  # noqa: E731
            nothing = _nothing_gained(machine, state)
            end, error, inside = explicit_step(self.solver, field, nothing, step, degree_inside(self.solver))
            return end, error, jax.tree.map(lambda *a: jnp.stack(a), *inside)
        return _by_diffrax(_with_loop(self.solver, loop), machine, state, hold, step)


def _neighbour_of(state: State) -> tuple[Array, Array]:
    """Neighbouring motion at the start of a step: distances, and relative velocities in units of the machine's rate.

    All are one, with signs in no order, so that it is in no symmetric mode.
    """
    signs = np.where(np.cumsum(np.arange(2 * len(state.x)) ** 2 % 7) % 2, 1.0, -1.0)
    x, v = (jnp.asarray(part, state.x.dtype) for part in np.split(signs, 2))
    return x, v


def _with_neighbour(
    take: Callable[[Machine, State], _Step], machine: Machine, state: State
) -> tuple[_Step, _Step]:
    """A step, and that of a neighbouring motion relative to it, with velocities in units of the machine's rate."""

    def of(x: Array, v: Array) -> _Step:
        return take(machine, eqx.tree_at(lambda s: (s.x, s.v), state, (x, v)))

    x, v = _neighbour_of(state)
    found, beside = jax.jvp(of, (state.x, state.v), (x, machine.rate * v))
    scaled = lambda gains: (gains[0], machine.timescale * gains[1], gains[2])  # noqa: E731
    return found, (scaled(beside[0]), scaled(beside[1]), beside[2])


def contradiction(
    machine: Machine, state: State, hold: Held, step: Scalar, inside: StepInterior
) -> Float[Array, " n"]:
    """Largest difference between the gain of velocity that the force would give in a step and the slope of the polynomial."""
    degree = len(inside.gain) - 1
    force_at = lambda time, x, v: _field(time, (x, v, None), (machine, state, hold))[1]  # noqa: E731
    times = step * jnp.asarray(nodes(degree), step.dtype)
    forces = compute_once(jax.vmap(force_at), times, inside.displacement, inside.gain)
    slopes = [
        add_up([float(w) * gain for w, gain in zip(row, inside.gain, strict=True)])
        for row in slopes_at_nodes(degree)
    ]
    return jnp.max(jnp.abs(step * forces - jnp.stack(slopes)), axis=0)


def _with_loop(solver: Any, kind: str) -> Any:
    """A solver with a loop of some kind over its stages."""
    return eqx.tree_at(lambda s: s.scan_kind, solver, kind, is_leaf=lambda leaf: leaf is None)


def _nothing_gained(machine: Machine, state: State) -> _Gains:
    pushes = jnp.zeros_like(state.gap) if machine.contacts.is_coupled else None
    return jnp.zeros_like(state.x), jnp.zeros_like(state.v), pushes


def _by_diffrax(solver: Any, machine: Machine, state: State, hold: Held, step: Scalar) -> _Step:
    """Results of `DiffraxFlow._step` by the `step` of diffrax."""
    nothing, args, zero = _nothing_gained(machine, state), (machine, state, hold), jnp.zeros_like(step)
    term = diffrax.ODETerm(_field)
    memory = solver.init(term, zero, step, nothing, args)
    if memory is not None:  # a method that needs the last stage of the step before as its first
        memory = (False, _field(zero, nothing, args))
    end, error, dense, _, _ = solver.step(term, zero, step, nothing, args, memory, made_jump=False)
    # Runge-Kutta methods store slopes times the step: on [0, 1] the dense output is a constant matrix.
    path = solver.interpolation_cls(t0=0.0, t1=1.0, **dense)
    return end, error, jax.vmap(path.evaluate)(jnp.asarray(nodes(degree_inside(solver)), step.dtype))


def degree_inside(solver: Any) -> int:
    """Degree of a solver's dense output, the polynomial on which events are located."""
    return _degree(type(solver).interpolation_cls, solver.tableau.num_stages)


@cache
def _degree(interpolation: Callable, num_stages: int) -> int:
    """Index of the last Chebyshev coefficient that is not zero, for random slopes."""
    with jax.ensure_compile_time_eval():
        y, k = jnp.asarray([0.3, 0.8]), jnp.asarray(np.random.default_rng(0).normal(size=num_stages))
        path = interpolation(t0=0.0, t1=1.0, y0=y[0], y1=y[1], k=k)
        values = np.asarray(jax.jit(jax.vmap(path.evaluate))(jnp.asarray(nodes(_MOST))))
    size = np.abs(np.polynomial.Chebyshev.fit(nodes(_MOST), values, _MOST, domain=[0, 1]).coef)
    return max(_LEAST, int(np.flatnonzero(size > 1e-5 * size.max())[-1]))


def _field(
    time: Any, gains: tuple[Array, Array, Array | None], args: tuple[Machine, State, Held]
) -> tuple[Array, Array, Array | None]:
    """Velocities, and the accelerations and pulls of `Contacts.free_accelerations`."""
    machine, state, hold = args
    v = machine.contacts.gain_with_hold(state.v + gains[1], hold)
    names = lambda s: (s.time, s.phase, s.x, s.v)  # noqa: E731
    phase = state.phase + phase_change(machine, state.phase, time)
    then = (state.time + time, phase, state.x + gains[0], v)
    force = machine.total_force(eqx.tree_at(names, state, then))
    return v, *machine.contacts.free_accelerations(force, hold, phase)
