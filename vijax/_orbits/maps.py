"""The stroboscopic map, the monodromy matrix and the saltation matrix."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._flow.interface import AbstractFlow
from .._hybrid.law import rebound
from .._jax.arrays import (
    Count,
    Numbers,
    Reals,
    Scalar,
    array_namespace,
    as_float,
    in_full_precision,
    whole_number,
)
from .._jax.concrete import concrete
from .._jax.errors import checked, number_of_doubts
from .._jax.nan_mask import known_or_nan
from .._jax.xla import differentiable, padding_allowed
from .._machine.first_state import state_before_contact
from .._machine.numbers import MachineNumbers, numbers_of
from .._machine.preparation import prepare
from .._machine.state import State
from .._system.checks import FINITE, check_number, check_shape, not_finite, refuse
from .._system.periodicity import check_period
from .._system.system import AnySystem, ImpactSystem, machine_of, with_args
from .._trajectory.results import RESULTS, result_sentences
from .._trajectory.simulate import Settings, simulate_with, warn_about_reverse_steps


@padding_allowed
def stroboscopic_map(
    system: AnySystem,
    x0: Numbers,
    v0: Numbers,
    num_periods: Count = 1,
    *,
    phase: ArrayLike = 0.0,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_steps: Count | None = None,
    max_reverse_steps: Count | None = None,
    throw: bool = True,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return the state a number of forcing periods later, as a differentiable function.

    Derivatives by the state, the phase and parameters include the change of the period.

    Args:
        system: the machine; its load must have a frequency, and its `force`, if it has one, the same period.
        x0: positions, (n,).
        v0: velocities, (n,).
        num_periods: number of whole forcing periods.
        phase: phase W t of the load at the start, and at the end, in radians.
        flow: as for `simulate`.
        args: likewise.
        max_steps: likewise.
        max_reverse_steps: likewise.
        throw: raise if the motion does not reach the end; otherwise the state and its derivatives are NaN. Such a lane
            of a batch changes neither the other lanes nor derivatives of values that leave it out.

    Returns:
        Positions and velocities, (n,) each.

    Raises:
        ValueError: if the load has no frequency, if the `force` does not have the period of the load, for a start
            beyond a stop, or for numbers that are not finite, as far as they are concrete (not traced).
        RuntimeError: with `throw`, if the motion does not reach the end, see `RESULTS`.

    Example:
        ```python
        import jax, vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        jacobian = jax.jacfwd(lambda x: vx.stroboscopic_map(system, x, [0.0, 0.0]))
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2.
    """
    system = machine_of(in_full_precision(system))
    check_period(with_args(system, args), x0, v0)
    begin = angle_of(phase) / system.forcing.frequency
    end = begin + whole_number("num_periods", num_periods) * system.forcing.period
    allowed = (RESULTS.max_events_reached,)  # nothing is logged
    warn_about_reverse_steps(max_reverse_steps)
    settings = Settings(0, max_steps, allowed if throw else None)
    sol = simulate_with(system, begin, end, x0, v0, settings, flow=flow, args=args)
    state = sol.x1, sol.v1
    return state if throw else known_or_nan(result_sentences(sol.result, allowed)[0] == 0, state)


def angle_of(phase: ArrayLike) -> Scalar:
    """A phase of the load as an array; refuses concrete values that are not one finite number."""
    angle = as_float(phase)
    check_number("phase", angle, FINITE)
    return angle


@padding_allowed
def monodromy_matrix(
    system: AnySystem,
    x0: Numbers,
    v0: Numbers,
    num_periods: Count = 1,
    *,
    phase: ArrayLike = 0.0,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_steps: Count | None = None,
    throw: bool = True,
) -> Float[Array, "state state"]:
    """Return the derivative of the stroboscopic map by the state (x, v).

    On a periodic orbit its eigenvalues are the Floquet multipliers, at every phase.

    Args:
        system: the machine.
        x0: positions, (n,).
        v0: velocities, (n,).
        num_periods: the period of the orbit in forcing periods.
        phase: as for `stroboscopic_map`.
        flow: as for `simulate`.
        args: likewise.
        max_steps: likewise.
        throw: raise if the motion does not reach the end; otherwise the matrix is NaN.

    Returns:
        The matrix, (2 n, 2 n).

    Raises:
        ValueError: as `stroboscopic_map` does.
        RuntimeError: likewise.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        matrix = vx.monodromy_matrix(system, [0.0, 0.0], [0.0, 0.0])
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2; M. di Bernardo et al., Piecewise-smooth Dynamical Systems
        (2008), Sec. 2.5.
    """
    machine = machine_of(system)
    n = machine.num_coordinates
    given = as_float(x0, "x0"), as_float(v0, "v0")
    for name, value in zip(("x0", "v0"), given, strict=True):
        if value.shape != (n,):
            check_shape(name, value, (machine.num_masses,))
    start = jnp.concatenate(machine.start_of(*given))

    def strobe(y: Float[Array, " state"]) -> Float[Array, " state"]:
        end = stroboscopic_map(
            system,
            y[:n],
            y[n:],
            num_periods,
            phase=phase,
            flow=flow,
            args=args,
            max_steps=max_steps,
            throw=throw,
        )
        return jnp.concatenate(end)

    return jax.jacfwd(strobe)(start)


@padding_allowed
def saltation_matrix(
    system: AnySystem,
    t: ArrayLike,
    x: Numbers,
    v: Numbers,
    stop: Count,
    *,
    args: object = None,
    throw: bool = True,
) -> Float[Array, "state state"]:
    """Return the derivative of the state just after an impact by the state just before, no other mass held.

    With the derivative R of the reset (v_i to -r v_i), the gap g, and the vector fields f- = (v-, a-) and f+
    before and after: S = R + (f+ - R f-) (dg/dy) / (dg/dy f-). Where stops move, all is in their frame.

    At a grazing impact, of speed 0, the entries in which the acceleration of the impacting mass enters are infinite.
    The other entries are their limits.

    Of a machine whose forces switch it is the derivative of a run of no duration that begins with the impact, at which the
    mass must approach a rigid stop: what is at rest there holds or slips as in any run.

    Args:
        system: the machine.
        t: time of the impact.
        x: positions, (n,), or those of all coordinates with Jenkins elements, as in `monodromy_matrix`.
        v: velocities before the impact, likewise.
        stop: index of the stop that is hit.
        args: as for `simulate`.
        throw: raise if a traced number is not finite, or a traced `stop` does not exist; otherwise the matrix is NaN.

    Returns:
        The matrix for the state (x, v), (2 n, 2 n).

    Raises:
        ValueError: if there is no such stop, it is compliant, or numbers are not finite; if forces switch, also for a state
            beyond another stop.
        RuntimeError: with `throw`, the same for traced arguments.

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        matrix = vx.saltation_matrix(system, 1.0, [0.3, 0.1], [0.5, 0.0], stop=0)
        ```

    References:
        M. di Bernardo et al., Piecewise-smooth Dynamical Systems (2008), Sec. 2.5.
    """
    system = machine_of(system)
    time, position, velocity = as_float(t), as_float(x), as_float(v)
    bound, number_of_stop = with_args(system, args), jnp.asarray(stop)
    impact = not_finite({"t": time, "x": position, "v": velocity})
    doubts = refuse([wrong_stop(bound, stop), _compliant_stop(bound, stop), *impact])
    if bound.is_switching:
        matrix = _saltation_of_run(bound, time, position, velocity, number_of_stop, throw=throw)
    else:
        given = numbers_of(bound), time, position, velocity, number_of_stop
        matrix = differentiable(_saltation, given)
    number, sentences = number_of_doubts(doubts)
    return checked(matrix, number, sentences) if throw else known_or_nan(number == 0, matrix)


def wrong_stop(system: ImpactSystem, stop: Count) -> tuple[Reals, str]:
    """Flag of a stop that does not exist, and the sentence of its error."""
    index: Reals = stop if concrete(stop) is None else np.asarray(whole_number("stop", stop))
    is_wrong, size = (index < 0) | (index >= len(system.stops)), len(system.stops)
    return is_wrong, f"Argument `stop` must be less than the number of stops, {size}, but is {stop}."


def _compliant_stop(system: ImpactSystem, stop: Count) -> tuple[Reals, str]:
    """Flag of a compliant stop, where nothing jumps, and the sentence of its error."""
    are_compliant = np.array([one.is_compliant for one in system.stops], bool)
    is_it = array_namespace(stop).any(are_compliant & (np.arange(len(are_compliant)) == stop))
    return is_it, (
        f"Argument `stop` must be the number of a rigid stop, but {stop} is compliant, and no velocity jumps there: "
        "differentiate `vx.simulate` across it."
    )


def _saltation_of_run(
    system: ImpactSystem, time: Scalar, x: Array, v: Array, stop: Array, *, throw: bool
) -> Array:
    """The derivative of a run of no duration that begins with an impact."""
    x, v = system.start_of(x, v)
    machine = prepare(numbers_of(system), jnp.ones_like(time), (time, x, v), can_stick=False)
    is_hit = jnp.arange(machine.contacts.num) == stop
    x = machine.contacts.with_closed_gaps(x, is_hit, machine.phase_at(time))
    allowed = (RESULTS.max_events_reached,)  # nothing is logged
    settings = Settings(0, None, allowed if throw else None)

    def behind(y: Float[Array, " state"]) -> tuple[Array, RESULTS]:
        x0, v0 = jnp.split(y, 2)
        sol = simulate_with(system, time, time, x0, v0, settings)
        return jnp.concatenate([sol.x1, sol.v1]), sol.result

    matrix, result = jax.jacfwd(behind, has_aux=True)(jnp.concatenate([x, v]))
    return known_or_nan(result_sentences(result, allowed)[0] == 0, matrix)


def _saltation(impact: tuple[MachineNumbers, Scalar, Array, Array, Array]) -> Array:
    numbers, time, x, v, stop = impact
    n = len(x)
    machine = prepare(numbers, jnp.ones_like(time), (time, x, v), can_stick=False)
    contacts, phase0 = machine.contacts, machine.phase_at(time)
    is_hit = jnp.arange(contacts.num) == stop
    nothing = machine.hold(jnp.zeros_like(is_hit))
    # In the frame of the stops, where they stand still; at one instant this changes no derivative by the state.
    x, v = machine.relative_to_stops(phase0, x, v)
    # The state, extended by the time since the impact: contacts may have motions of their own.
    y = jnp.concatenate([contacts.with_closed_gaps(x, is_hit, phase0), v, jnp.zeros_like(time)[None]])

    def at(y: Float[Array, " whole"]) -> State:
        phase = machine.phase_at(time + y[-1])
        return state_before_contact(machine, phase, y[:n], y[n:-1], jnp.zeros_like(is_hit))

    def field(y: Float[Array, " whole"]) -> Float[Array, " whole"]:
        state = at(y)
        a = contacts.accelerations(machine.total_force(state), nothing, state.phase)
        return jnp.concatenate([state.v, a, jnp.ones_like(time)[None]])

    def reset(y: Float[Array, " whole"]) -> Float[Array, " whole"]:
        return jnp.concatenate([*rebound(machine, at(y), is_hit), y[-1:]])

    def gap(y: Float[Array, " whole"]) -> Float[Array, ""]:
        return contacts.gaps(y[:n], machine.phase_at(time + y[-1]))[stop]

    def jump(y: Float[Array, " whole"]) -> Float[Array, " whole"]:
        return field(reset(y)) - slope @ field(y)

    slope, towards = jax.jacfwd(reset)(y), -jax.grad(gap)(y)
    along = contacts.inverse_mass_times(towards[:n]) * contacts.effective_mass[stop]
    approach = jnp.zeros_like(y).at[n:-1].set(along)  # the velocity that closes the gap at speed 1
    speed = towards @ field(y)
    # At speed 0 only the accelerations that the stop reverses jump; the rest is of the order of the speed.
    is_moving, of_rest = speed != 0, jump(y - speed * approach)
    limit = jax.jvp(jump, (y,), (approach,))[1]
    by_speed = jnp.where(is_moving, (jump(y) - of_rest) / jnp.where(is_moving, speed, 1), limit)
    by_speed += jnp.where(of_rest == 0, 0, of_rest / speed)
    whole = slope + jnp.where(towards == 0, 0, jnp.outer(by_speed, towards))
    return whole[:-1, :-1]
